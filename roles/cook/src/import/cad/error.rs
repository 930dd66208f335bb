//! Why a STEP or IGES file could not be imported.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use thiserror::Error;

use crate::import::GltfError;

/// An error of the conversion of a STEP or IGES file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CadError {
    /// The program is not there.
    #[error(
        "STEP and IGES are read by the program trimaran-occt, which is not here: build it from Trimaran's \
         sources with `./x occt`, or name it in TRIMARAN_OCCT; or convert the file to glTF, as with FreeCAD"
    )]
    NoConverter,
    /// The program cannot be started.
    #[error("cannot start {program}, which converts STEP and IGES: {source}; build it again with `./x occt`")]
    Start {
        /// The program.
        program: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The temporary folder cannot be used.
    #[error("cannot use the temporary folder: {0}; make room there, or name another folder in TMPDIR")]
    Folder(#[source] io::Error),
    /// The file cannot be converted.
    #[error("it cannot be converted: {said}; see if other programs read it, and export it again")]
    Refused {
        /// The converter's own words.
        said: String,
    },
    /// It takes more memory than allowed.
    #[error(
        "its conversion takes more than {limit} bytes of memory; if the model is as large as that, allow more \
         with --max-triangles, or make fewer triangles with a larger --chord-tolerance"
    )]
    Memory {
        /// How much is allowed.
        limit: u64,
    },
    /// The program crashed.
    #[error(
        "its conversion crashed ({status}); the file may be damaged, or the memory full: export it again, or \
         convert it to glTF with another program, as with FreeCAD"
    )]
    Crashed {
        /// The exit status or the signal.
        status: String,
    },
    /// The program hangs.
    #[error(
        "its conversion made no progress for {} seconds, and was ended; try a larger --chord-tolerance, or \
         allow more with --converter-timeout",
        timeout.as_secs_f64()
    )]
    Hung {
        /// How long it may be silent.
        timeout: Duration,
    },
    /// Its result is malformed, or exceeds a limit.
    #[error(transparent)]
    Gltf(#[from] Box<GltfError>),
}
