//! The source of a scene's bytes: a file, or memory.

use std::fs::File;
use std::io::{self, Read};
use std::time::SystemTime;

/// The bytes of a cooked file.
#[derive(Debug)]
pub(super) enum Source {
    File { file: File, opened: Stamp },
    Memory(Vec<u8>),
}

/// Reveals whether a file was written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    length: u64,
    modified: Option<SystemTime>,
}

impl Source {
    pub(super) fn file(file: File) -> io::Result<Self> {
        let opened = Stamp::of(&file)?;
        Ok(Self::File { file, opened })
    }

    /// How many bytes there are, now.
    pub(super) fn length(&self) -> io::Result<u64> {
        match self {
            Self::File { file, .. } => file.metadata().map(|metadata| metadata.len()),
            Self::Memory(bytes) => Ok(bytes.len() as u64),
        }
    }

    /// Whether it is a file that was written to since it was opened.
    pub(super) fn has_changed(&self) -> bool {
        match self {
            Self::File { file, opened } => Stamp::of(file).is_ok_and(|now| now != *opened),
            Self::Memory(_) => false,
        }
    }

    /// Fills `bytes` from `offset` on, from any thread.
    pub(super) fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        match self {
            Self::File { file, .. } => read_exact_at(file, bytes, offset),
            Self::Memory(all) => {
                let rest = usize::try_from(offset).ok().and_then(|offset| all.get(offset..));
                rest.unwrap_or_default().read_exact(bytes)
            }
        }
    }
}

impl Stamp {
    fn of(file: &File) -> io::Result<Self> {
        let metadata = file.metadata()?;
        Ok(Self { length: metadata.len(), modified: metadata.modified().ok() })
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(not(unix))]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    use std::io::{Seek, SeekFrom};
    use std::sync::{Mutex, PoisonError};
    // All handles of a file share one position.
    static POSITION: Mutex<()> = Mutex::new(());
    let _alone = POSITION.lock().unwrap_or_else(PoisonError::into_inner);
    let mut file = file;
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(bytes)
}
