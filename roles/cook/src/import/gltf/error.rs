//! Why a glTF file could not be imported.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::import::OverBudget;

/// What is wrong with a glTF file, where in it, and what to do.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GltfError {
    /// The binary container is broken.
    #[error("the container is malformed at byte {offset}: {what}; the file may be cut off: get it again")]
    Container {
        /// Byte in the file.
        offset: usize,
        /// What is wrong there.
        what: &'static str,
    },
    /// The JSON does not parse.
    #[error("the JSON does not parse: {0}; the file may be cut off or changed by hand: export it again")]
    Json(#[from] serde_json::Error),
    /// A value in the JSON is not what the format has there.
    #[error("{part} is malformed: {what}; export it again, or correct the file there")]
    Field {
        /// What it is in: a node, a mesh, an accessor.
        part: String,
        /// The value, and what is wrong with it.
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
    /// The file cannot be read without an extension that is not supported.
    #[error("it needs the extension {extension}, which is not supported: export it again without it")]
    Extension {
        /// The extension.
        extension: String,
    },
    /// A buffer cannot be had.
    #[error("buffer {buffer} cannot be read from {path}: {source}; a .gltf needs its buffers beside it", path = path.display())]
    BufferFile {
        /// Index of the buffer.
        buffer: usize,
        /// Where it was looked for.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A buffer's address or content is malformed.
    #[error("buffer {buffer} is malformed: {what}; export it again, or correct the file there")]
    Buffer {
        /// Index of the buffer.
        buffer: usize,
        /// What is wrong with it.
        what: &'static str,
    },
    /// An accessor that geometry is read from is malformed.
    #[error(
        "accessor {accessor}, needed by {user}, is malformed: {what}; export it again, or correct the file \
         there"
    )]
    Accessor {
        /// Index of the accessor.
        accessor: u32,
        /// What needs it: a mesh's primitive or a node.
        user: String,
        /// What is wrong with it.
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
        /// What is wrong with it.
        what: &'static str,
    },
    /// A primitive that Draco has compressed is malformed.
    #[error(
        "{mesh} cannot be decompressed (KHR_draco_mesh_compression): {what}; decompress the file with \
         `gltf-transform copy`, or export it again without compression"
    )]
    Draco {
        /// The mesh and primitive, with its name.
        mesh: String,
        /// What is wrong with it.
        what: String,
    },
    /// A mesh is malformed.
    #[error("{mesh} is malformed: {what}; export it again, or correct the file there")]
    Mesh {
        /// The mesh and primitive, with its name.
        mesh: String,
        /// What is wrong with it.
        what: String,
    },
    /// A node is malformed.
    #[error("{node} is malformed: {what}; export it again, or correct the file there")]
    Node {
        /// The path to the node from its root.
        node: String,
        /// What is wrong with it.
        what: &'static str,
    },
    /// It asks for more than is allowed.
    #[error(transparent)]
    Budget(#[from] OverBudget),
    /// The scene to show is not there, or names a node that is not.
    #[error("scene {scene} is malformed: {what}; export it again, or correct the file there")]
    Scene {
        /// Index of the scene.
        scene: u32,
        /// What is wrong with it.
        what: &'static str,
    },
}

impl GltfError {
    /// What is wrong, without where that is.
    pub(super) fn what(&self) -> String {
        match self {
            Self::Accessor { accessor, what, .. } => format!("accessor {accessor}: {what}"),
            Self::Draco { what, .. } => {
                format!("KHR_draco_mesh_compression: {what}; `gltf-transform copy` decompresses the file")
            }
            Self::Mesh { what, .. } => what.clone(),
            other => other.to_string(),
        }
    }
}
