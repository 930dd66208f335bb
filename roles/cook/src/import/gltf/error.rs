//! Why a glTF file could not be imported.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::import::OverBudget;

/// An error in a glTF file, its place, and the remedy.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GltfError {
    /// The binary container is broken.
    #[error("the container is malformed at byte {offset}: {what}; the file may be cut off: get it again")]
    Container {
        /// Byte in the file.
        offset: usize,
        /// The error.
        what: &'static str,
    },
    /// The JSON does not parse.
    #[error("the JSON does not parse: {0}; the file may be cut off or changed by hand: export it again")]
    Json(#[from] serde_json::Error),
    /// A part of the document is malformed: a value, a mesh, a node, a scene.
    #[error("{part} is malformed: {what}; export it again, or correct the file there")]
    Malformed {
        /// The part: a primitive with its mesh, the path to a node from its root.
        part: String,
        /// The error.
        what: String,
    },
    /// The file is of another version of glTF.
    #[error(
        "it is glTF {version}, and this reads 2.0: convert it \
         (gltf-pipeline, for one, converts glTF 1.0 to 2.0)"
    )]
    Version {
        /// The version that it claims, or needs at least.
        version: String,
    },
    /// The file requires an unsupported extension.
    #[error("it needs the extension {extension}, which is not supported: export it again without it")]
    Extension {
        /// The extension.
        extension: String,
    },
    /// A buffer cannot be loaded.
    #[error("buffer {buffer} cannot be read from {path}: {source}; a .gltf needs its buffers beside it")]
    BufferFile {
        /// Index of the buffer.
        buffer: usize,
        /// Its expected path.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A buffer's address or content is malformed.
    #[error("buffer {buffer} is malformed: {what}; export it again, or correct the file there")]
    Buffer {
        /// Index of the buffer.
        buffer: usize,
        /// The error.
        what: &'static str,
    },
    /// An accessor of geometry is malformed.
    #[error(
        "accessor {accessor}, needed by {user}, is malformed: {what}; export it again, or correct the file \
         there"
    )]
    Accessor {
        /// Index of the accessor.
        accessor: u32,
        /// Its user: a mesh's primitive or a node.
        user: String,
        /// The error.
        what: &'static str,
    },
    /// The compressed bytes of a buffer view are malformed.
    #[error(
        "buffer view {view} cannot be decompressed (meshopt): {what}; decompress the file with \
         `gltf-transform copy`, or export it again without compression"
    )]
    Packed {
        /// Index of the buffer view.
        view: u32,
        /// The error.
        what: &'static str,
    },
    /// A Draco-compressed primitive is malformed.
    #[error(
        "{mesh} cannot be decompressed (KHR_draco_mesh_compression): {what}; decompress the file with \
         `gltf-transform copy`, or export it again without compression"
    )]
    Draco {
        /// The mesh and primitive, with its name.
        mesh: String,
        /// The error.
        what: String,
    },
    /// It exceeds a limit.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}

impl GltfError {
    /// The error without its place.
    pub(super) fn what(&self) -> String {
        match self {
            Self::Accessor { accessor, what, .. } => format!("accessor {accessor}: {what}"),
            Self::Draco { what, .. } => {
                format!("KHR_draco_mesh_compression: {what}; `gltf-transform copy` decompresses the file")
            }
            Self::Malformed { what, .. } => what.clone(),
            other => other.to_string(),
        }
    }
}
