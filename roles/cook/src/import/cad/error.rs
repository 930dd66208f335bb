//! Why a STEP, IGES or IFC file could not be imported.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use thiserror::Error;

use super::Engine;
use crate::import::GltfError;

/// An error of the conversion of a STEP, IGES or IFC file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CadError {
    /// The program is not there.
    #[error(
        "{} are read by the program {}, which is not here: make it from Trimaran's sources with `{}`, or \
         name it in {}; or convert the file to glTF, as with {}",
        engine.formats(), engine.program(), engine.recipe(), engine.variable(), engine.alternative()
    )]
    NoConverter {
        /// Its engine.
        engine: Engine,
    },
    /// The program cannot be started.
    #[error(
        "cannot start {program}, which converts {}: {source}; make it again with `{}`",
        engine.formats(), engine.recipe()
    )]
    Start {
        /// The program.
        program: PathBuf,
        /// Its engine.
        engine: Engine,
        /// The system's error.
        source: io::Error,
    },
    /// The program cannot load its engine: a module or a library is not there.
    #[error("{} cannot load its engine: {said}; make it again with `{}`", engine.program(), engine.recipe())]
    NoEngine {
        /// The engine.
        engine: Engine,
        /// The program's own words.
        said: String,
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
         convert it to glTF with another program, as with {}",
        engine.alternative()
    )]
    Crashed {
        /// The program's engine.
        engine: Engine,
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
