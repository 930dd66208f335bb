//! The programs that convert files, and where they are.

use std::ffi::OsStr;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A program that reads formats by an engine of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// `trimaran-occt`, by Open CASCADE: STEP and IGES.
    OpenCascade,
    /// `trimaran-ifc`, by IfcOpenShell: IFC.
    IfcOpenShell,
}

impl Engine {
    /// The name of its program.
    #[must_use]
    pub const fn program(self) -> &'static str {
        match self {
            Self::OpenCascade => "trimaran-occt",
            Self::IfcOpenShell => "trimaran-ifc",
        }
    }

    /// The environment variable that names its program.
    #[must_use]
    pub const fn variable(self) -> &'static str {
        match self {
            Self::OpenCascade => "TRIMARAN_OCCT",
            Self::IfcOpenShell => "TRIMARAN_IFC",
        }
    }

    /// The formats that it reads.
    pub(super) const fn formats(self) -> &'static str {
        match self {
            Self::OpenCascade => "STEP and IGES",
            Self::IfcOpenShell => "IFC models",
        }
    }

    /// The command that makes its program, in Trimaran's sources.
    pub(super) const fn recipe(self) -> &'static str {
        match self {
            Self::OpenCascade => "./x occt",
            Self::IfcOpenShell => "./x ifc",
        }
    }

    /// Another program that converts its formats to glTF.
    pub(super) const fn alternative(self) -> &'static str {
        match self {
            Self::OpenCascade => "FreeCAD",
            Self::IfcOpenShell => "IfcConvert",
        }
    }

    /// Its program beside this one, or else in a folder of `PATH`.
    #[must_use]
    pub fn find(self, beside: Option<&Path>, path: Option<&OsStr>) -> Option<PathBuf> {
        let name = format!("{}{}", self.program(), std::env::consts::EXE_SUFFIX);
        let folders = path.into_iter().flat_map(std::env::split_paths);
        let beside = beside.and_then(Path::parent).map(Path::to_owned);
        iter::chain(beside, folders).map(|folder| folder.join(&name)).find(|program| program.is_file())
    }
}

/// The programs that convert files. Without its program a format is refused, with the way to get it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Converters {
    /// The path of `trimaran-occt`.
    pub occt: Option<PathBuf>,
    /// The path of `trimaran-ifc`.
    pub ifc: Option<PathBuf>,
    /// How long one may be silent before it is ended.
    pub timeout: Duration,
}

impl Default for Converters {
    /// No program, and half an hour: they say nothing while they parse a large file.
    fn default() -> Self {
        Self { occt: None, ifc: None, timeout: Duration::from_mins(30) }
    }
}

impl Converters {
    pub(super) fn program(&self, engine: Engine) -> Option<&Path> {
        match engine {
            Engine::OpenCascade => self.occt.as_deref(),
            Engine::IfcOpenShell => self.ifc.as_deref(),
        }
    }
}
