//! BCF, the BIM Collaboration Format of buildingSMART: notes for other programs, and theirs. Versions 2.1 and
//! 3.0.

mod archive;
mod export;
mod import;
mod markup;
mod viewpoint;
mod xml;

#[cfg(test)]
mod tests;

use std::{fmt, str::FromStr};

use thiserror::Error;
use zip::result::ZipError;

pub use export::export;
pub use import::{Imported, import};
pub use xml::{XmlError, XmlFault};

use super::NoteFault;

/// A version of BCF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BcfVersion {
    /// 2.1, of 2017.
    V2,
    /// 3.0, of 2021.
    V3,
}

impl BcfVersion {
    const fn as_str(self) -> &'static str {
        match self {
            Self::V2 => "2.1",
            Self::V3 => "3.0",
        }
    }
}

impl fmt::Display for BcfVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A text is no version of BCF that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the versions of BCF are 2.1 and 3.0")]
pub struct BcfVersionError;

impl FromStr for BcfVersion {
    type Err = BcfVersionError;

    fn from_str(text: &str) -> Result<Self, BcfVersionError> {
        [Self::V2, Self::V3].into_iter().find(|version| version.as_str() == text).ok_or(BcfVersionError)
    }
}

/// Why a BCF file cannot be read or made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BcfError {
    /// It is no zip archive, or damaged.
    #[error("it is no BCF file: BCF is a zip archive")]
    Zip(#[source] ZipError),
    /// A file in it cannot be unpacked.
    #[error("{entry:?} in it cannot be unpacked")]
    Entry {
        /// The file's name.
        entry: String,
        /// Why.
        #[source]
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
    /// It has too many files.
    #[error("it has {files} files: {most} is the most")]
    Files {
        /// How many.
        files: usize,
        /// The limit.
        most: usize,
    },
    /// The name of a file leads out of the archive.
    #[error("the name {0:?} in it leads out of its folder: it may be hostile, and is not read")]
    Path(String),
    /// Two files have the same name.
    #[error("it has {0:?} twice")]
    Twice(String),
    /// It unpacks to too much.
    #[error("{entry:?} in it unpacks to more than {most} bytes: it may be hostile, and is not read")]
    Size {
        /// The file with which it became too much.
        entry: String,
        /// The limit.
        most: u64,
    },
    /// A file that it needs is not there.
    #[error("it has no {0:?}")]
    Missing(String),
    /// It is of another version.
    #[error("it is BCF {0:?}: save it as 2.1 or 3.0 where it comes from")]
    Version(String),
    /// A file in it is no XML that can be read.
    #[error("{entry:?} in it cannot be read")]
    Xml {
        /// The file's name.
        entry: String,
        /// The fault and its line.
        #[source]
        cause: XmlError,
    },
    /// An element has not what BCF demands.
    #[error("{entry:?} in it: {element} {why}")]
    Element {
        /// The file's name.
        entry: String,
        /// The element, or an attribute of it.
        element: &'static str,
        /// The fault of it.
        why: String,
    },
    /// A topic breaks a limit.
    #[error("{entry:?} in it has too much, or numbers that are none")]
    Note {
        /// The file's name.
        entry: String,
        /// The limit.
        #[source]
        cause: NoteFault,
    },
    /// The archive cannot be written.
    #[error("the archive cannot be written")]
    Write(#[source] ZipError),
}
