//! The bytes of a file, in memory that nobody else can change.
//!
//! A mapped file changes under its reader when somebody overwrites it (`scp` and `cp` do), and a file cut
//! short kills the reader by SIGBUS. A check at opening would be worth nothing then. So a file is mapped only
//! where the kernel promises that nobody can write to it; any other file is copied, and hashed piece by piece
//! while it is copied.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;

use memmap2::{Mmap, MmapMut, MmapOptions};
use rayon::prelude::*;
use trimaran_proto::SceneHash;

use super::hash::{self, Fingerprint};

/// A whole file, and the fingerprint of its sections.
pub(super) struct Stable {
    pub(super) map: Mmap,
    pub(super) fingerprint: SceneHash,
}

/// Why a file could not be had in memory.
pub(super) enum Unread {
    /// The bytes cannot be read; `UnexpectedEof` if it ends before `length`.
    File(io::Error),
    /// There is no memory for it.
    Memory(io::Error),
}

/// Where a scene's bytes are before they are read.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    File(&'a File),
    Memory(&'a [u8]),
}

impl Source<'_> {
    /// How many bytes there are, now.
    pub(super) fn length(self) -> io::Result<u64> {
        match self {
            Self::File(file) => file.metadata().map(|metadata| metadata.len()),
            Self::Memory(bytes) => Ok(bytes.len() as u64),
        }
    }

    /// Fills `bytes` from `offset` on.
    pub(super) fn read_exact_at(self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        match self {
            Self::File(file) => read_exact_at(file, bytes, offset),
            Self::Memory(all) => {
                let rest = usize::try_from(offset).ok().and_then(|offset| all.get(offset..));
                rest.unwrap_or_default().read_exact(bytes)
            }
        }
    }
}

/// Maps or copies the first `length` bytes. `sections` are what is hashed and copied: they are within
/// `length`, in order and apart from each other; bytes between them come out as zeros or as they are.
pub(super) fn read(source: Source<'_>, length: usize, sections: &[Range<usize>]) -> Result<Stable, Unread> {
    match map_if_sealed(source, length) {
        Some(map) => {
            let bytes: Vec<&[u8]> =
                sections.iter().map(|range| map.get(range.clone()).unwrap_or_default()).collect();
            let fingerprint = hash::fingerprint_sections(&bytes);
            Ok(Stable { map, fingerprint })
        }
        None => copy(source, length, sections),
    }
}

/// A map of a file that nobody can write to any more, not even its owner: one with fs-verity, or a sealed
/// memfd. Processes that map it share its pages.
fn map_if_sealed(source: Source<'_>, length: usize) -> Option<Mmap> {
    let Source::File(file) = source else { return None };
    MmapOptions::new().len(length).map_if_safe(file).ok()
}

/// A copy in anonymous memory. Each piece is hashed while it is still in the processor's cache.
fn copy(source: Source<'_>, length: usize, sections: &[Range<usize>]) -> Result<Stable, Unread> {
    let mut map = MmapMut::map_anon(length).map_err(Unread::Memory)?;
    // No huge pages are asked for: with memory full of other files' pages, making them took three times as
    // long as copying.
    let mut fingerprint = Fingerprint::new();
    for range in sections {
        let section = map.get_mut(range.clone()).unwrap_or_default();
        let pieces = section
            .par_chunks_mut(hash::PIECE)
            .enumerate()
            .map(|(number, piece)| {
                source.read_exact_at(piece, (range.start + number * hash::PIECE) as u64)?;
                Ok(hash::piece(piece))
            })
            .collect::<io::Result<Vec<u128>>>()
            .map_err(Unread::File)?;
        fingerprint.section(range.len(), &pieces);
    }
    let map = map.make_read_only().map_err(Unread::Memory)?;
    Ok(Stable { map, fingerprint: fingerprint.finish() })
}

/// Fills `bytes` from `offset` of the file on, from any thread.
#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Fills `bytes` from `offset` of the file on, from any thread.
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
