//! Why an import failed.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::gltf::GltfError;
use super::obj::ObjError;
use super::report::Warning;
use super::rvm::RvmError;
use crate::ModelError;

/// Why files could not be imported: which file, where in it, and what to do.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// Nothing to import.
    #[error("no input files: name at least one .glb, .gltf, .rvm, .rev or .obj file")]
    NoFiles,
    /// An option makes no sense.
    #[error("the {option} is {value}; it must be a positive, finite number")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
    },
    /// A file cannot be read at all.
    #[error("cannot read {path}: {source}; check the name and the permissions", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The name tells of no format that is known here.
    #[error("{path} is of no known format: its name must end in .glb, .gltf, .rvm, .rev or .obj", path = path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The name tells of one format and the first bytes of another.
    #[error(
        "{path} is not what its name says: a {expected} file starts with {magic}; it may be damaged, or have the wrong ending",
        path = path.display()
    )]
    WrongMagic {
        /// The file.
        path: PathBuf,
        /// The format that the name tells of.
        expected: &'static str,
        /// What such a file starts with.
        magic: &'static str,
    },
    /// A file of a format that is not read as gzip packs it.
    #[error("{path} is packed with gzip, and only OBJ is read so: unpack it first, as with gunzip", path = path.display())]
    Packed {
        /// The file.
        path: PathBuf,
    },
    /// What gzip packed is cut off or damaged.
    #[error("{path} cannot be unpacked: {source}; it is damaged: get it again", path = path.display())]
    Unpack {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: io::Error,
    },
    /// A packed file that is larger than any model that gzip packs.
    #[error("{path} unpacks to more than {limit} bytes; if it is a model, unpack it with gunzip and import that", path = path.display())]
    UnpacksToMore {
        /// The file.
        path: PathBuf,
        /// How many bytes it may unpack to.
        limit: u64,
    },
    /// A glTF file is malformed or needs what is not supported.
    #[error("{path}: {source}", path = path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<GltfError>,
    },
    /// An RVM file is malformed.
    #[error("{path}: {source}", path = path.display())]
    Rvm {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: RvmError,
    },
    /// An OBJ file is malformed.
    #[error("{path}: {source}", path = path.display())]
    Obj {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ObjError,
    },
    /// No object is left of any file.
    #[error(
        "{} nothing to draw: no object with a surface is left{}; \
         export the model as faces (OBJ, glTF) or with its primitives (RVM)",
        subject(files),
        listed(warnings)
    )]
    NothingToDraw {
        /// The files' names.
        files: Vec<String>,
        /// What was left out of them, the first ones.
        warnings: Vec<Warning>,
    },
    /// The files are fine one by one, but what they make cannot be used.
    #[error("{path}: {source}", path = path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: ModelError,
    },
    /// More objects or meshes than 32-bit indices can name.
    #[error("the files hold more than 4 thousand million {what} together; import them as several scenes")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
    },
}

/// Names of files as the start of a sentence.
fn subject(files: &[String]) -> String {
    match files {
        [] => "the model has".to_owned(),
        [only] => format!("{only} has"),
        [first, rest @ ..] => format!("{first} and {} other files have", rest.len()),
    }
}

fn listed(warnings: &[Warning]) -> String {
    warnings.iter().map(|warning| format!(" ({warning})")).collect()
}
