//! Why an import failed.

use std::path::PathBuf;
use std::{fmt, io};

use thiserror::Error;

use super::cad::CadError;
use super::gltf::GltfError;
use super::obj::ObjError;
use super::ply::PlyError;
use super::report::Warning;
use super::rvm::RvmError;
use super::stl::StlError;
use crate::ModelError;
use trimaran_scene::PlantFrame;

/// Why files could not be imported: the file, the place in it, and the remedy.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// There are no files.
    #[error(
        "no input files: name at least one .glb, .gltf, .rvm, .rev, .obj, .stl, .ply, .step, .iges \
         or .ifc file"
    )]
    NoFiles,
    /// An option is invalid.
    #[error("the {option} is {value}; it must be a positive, finite number")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
    },
    /// The plant's coordinates make no sense.
    #[error(
        "the plant's origin is {:?}, and its north at {} degrees; the origin must be within 10^12 m, and \
         north at most a full turn", plant.origin, plant.north_deg
    )]
    Plant {
        /// Its coordinates.
        plant: PlantFrame,
    },
    /// A file cannot be read at all.
    #[error("cannot read {path}: {source}; check the name and the permissions")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The name has no known ending.
    #[error(
        "{path} is of no known format: its name must end in .glb, .gltf, .rvm, .rev, .obj, .stl, .ply, \
         .step, .iges or .ifc"
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The format is a known one that is not read.
    #[error("{path} is {format}, which is not read: convert it first, {way}")]
    ToBeConverted {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: &'static str,
        /// How to convert it.
        way: &'static str,
    },
    /// The name has the ending of one format and the first bytes are of another.
    #[error(
        "{path} is not what its name says: a {expected} file starts with {magic}; it may be damaged, or have the wrong ending"
    )]
    WrongMagic {
        /// The file.
        path: PathBuf,
        /// The format of the ending.
        expected: &'static str,
        /// The first bytes of that format.
        magic: &'static str,
    },
    /// A packed file of a format that is not read when packed.
    #[error(
        "{path} is packed with gzip, and only OBJ, STL, PLY, STEP, IGES and IFC are read so: unpack it \
         first, as with gunzip"
    )]
    Packed {
        /// The file.
        path: PathBuf,
    },
    /// The packed data is cut off or damaged.
    #[error("{path} cannot be unpacked: {source}; it is damaged: get it again")]
    Unpack {
        /// The file.
        path: PathBuf,
        /// The error.
        source: io::Error,
    },
    /// A packed file is larger than any packed model.
    #[error(
        "{path} unpacks to more than {limit} bytes; if it is a model, unpack it with gunzip and import that"
    )]
    UnpacksToMore {
        /// The file.
        path: PathBuf,
        /// The limit of its unpacked size.
        limit: u64,
    },
    /// A glTF file is malformed or needs an unsupported feature.
    #[error("{path}: {source}")]
    Gltf {
        /// The file.
        path: PathBuf,
        /// The error.
        source: Box<GltfError>,
    },
    /// An RVM file is malformed.
    #[error("{path}: {source}")]
    Rvm {
        /// The file.
        path: PathBuf,
        /// The error.
        source: RvmError,
    },
    /// An OBJ file is malformed.
    #[error("{path}: {source}")]
    Obj {
        /// The file.
        path: PathBuf,
        /// The error.
        source: ObjError,
    },
    /// A STEP, IGES or IFC file cannot be converted.
    #[error("{path}: {source}")]
    Cad {
        /// The file.
        path: PathBuf,
        /// The error.
        source: CadError,
    },
    /// An STL file is malformed.
    #[error("{path}: {source}")]
    Stl {
        /// The file.
        path: PathBuf,
        /// The error.
        source: StlError,
    },
    /// A PLY file is malformed.
    #[error("{path}: {source}")]
    Ply {
        /// The file.
        path: PathBuf,
        /// The error.
        source: PlyError,
    },
    /// No file has an object left.
    #[error(
        "{} nothing to draw: no object with a surface is left{}; \
         export the model as faces (OBJ, glTF) or with its primitives (RVM)",
        subject(files),
        listed(warnings)
    )]
    NothingToDraw {
        /// The files' names.
        files: Vec<String>,
        /// The first warnings.
        warnings: Vec<Warning>,
    },
    /// The files are valid one by one, but their model is not.
    #[error("{path}: {source}")]
    Model {
        /// The file.
        path: PathBuf,
        /// The error.
        source: ModelError,
    },
    /// More objects or meshes than 32-bit indices can name.
    #[error("the files hold more than 4 thousand million {what} together; import them as several scenes")]
    TooLarge {
        /// Their kind.
        what: &'static str,
    },
}

/// A place in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilePosition {
    /// A byte of a binary form, from 0 on.
    Byte(u64),
    /// A line of a text form, from 1 on.
    Line(u64),
}

impl fmt::Display for FilePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Line(line) => write!(f, "line {line}"),
        }
    }
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
