//! The cooked file: written whole or not at all, read into memory that nobody else can change, and trusted
//! only after it has been checked.
//!
//! Layout, little-endian: a [`Header`], then the sections, each starting at a multiple of 64 bytes, gaps
//! filled with zeros. Order of the sections: nodes, drawables, vertices, indices, objects, names, sources.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::mem::size_of;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use bytemuck::{AnyBitPattern, NoUninit, Pod, Zeroable};
use memmap2::Mmap;
use thiserror::Error;
use trimaran_proto::SceneHash;
use xxhash_rust::xxh3::xxh3_64;

use super::stable::{self, Source, Stable, Unread};
use super::{Drawable, Node, ObjectRecord, OpenError, Parts, Scene, Storage, Vertex, hash, validate};

/// The first bytes of every cooked scene. The line ends show a copy that changed them, as in PNG.
const MAGIC: [u8; 8] = *b"TRIMRN\r\n";
/// The format this build reads and writes.
const VERSION: u32 = 3;
/// Sections start at multiples of this: enough for every record, and a cache line.
const ALIGNMENT: u64 = 64;
const SECTIONS: usize = 7;

/// Bytes a record, by section.
const RECORD_SIZES: [u64; SECTIONS] = [
    size_of::<Node>() as u64,
    size_of::<Drawable>() as u64,
    size_of::<Vertex>() as u64,
    size_of::<u32>() as u64,
    size_of::<ObjectRecord>() as u64,
    1,
    1,
];

const _: () =
    assert!(cfg!(target_endian = "little"), "cooked scenes are read as they stand: little-endian only");

/// The start of a file.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: [u8; 8],
    version: u32,
    reserved: u32,
    /// The fingerprint of the sections, little-endian.
    fingerprint: [u8; 16],
    file_length: u64,
    sections: [Section; SECTIONS],
    /// XXH3-64 of all bytes of the header before this.
    check: u64,
}

/// Where a section lies.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Section {
    /// First byte in the file.
    offset: u64,
    /// Length in bytes.
    length: u64,
}

/// Why a scene could not be saved. Nothing is left behind under the name asked for, and an older file of that
/// name stays.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SaveError {
    /// Writing failed: a full disk, a folder that is missing or read-only.
    #[error(
        "cannot write the scene {path:?}: {source}; check that its folder exists, is writable and has {bytes} bytes free"
    )]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// The size of the scene.
        bytes: u64,
        /// What the system says.
        source: io::Error,
    },
}

impl Scene {
    /// Writes the scene to `path`: to a temporary name in the same folder, flushed to the disk and then
    /// renamed, so that a reader sees the old file or the whole new one. The same scene always makes the
    /// same bytes.
    ///
    /// # Errors
    /// If the system refuses; nothing is left behind then.
    pub fn save(&self, path: &Path) -> Result<(), SaveError> {
        let parts = self.parts();
        let sources = hash::encode_sources(parts.sources);
        let sections = hash::section_bytes(&parts, &sources);
        let header = Header::new(&sections, self.hash);
        write_atomically(path, |out| {
            out.write_all(bytemuck::bytes_of(&header))?;
            let mut position = size_of::<Header>() as u64;
            for (section, bytes) in header.sections.iter().zip(sections) {
                let gap = [0_u8; ALIGNMENT as usize];
                out.write_all(gap.get(..(section.offset - position) as usize).unwrap_or_default())?;
                out.write_all(bytes)?;
                position = section.offset + section.length;
            }
            Ok(())
        })
        .map_err(|source| SaveError::Io {
            path: path.to_owned(),
            bytes: header.file_length,
            source,
        })
    }

    /// Opens a scene that [`Scene::save`] wrote, and checks all of it: every byte against the fingerprint,
    /// every record against the rules.
    ///
    /// **What was opened stays as it was**, whatever becomes of the file: overwritten, cut short, replaced or
    /// deleted. The file is copied into memory while it is checked, so a scene takes its size in memory,
    /// once for each opening. A file that nobody can write to any more is mapped in place of that, and
    /// all processes that open it share it: one with fs-verity (`fsverity enable FILE`), or a sealed
    /// memfd. Such a file takes no memory that the system cannot take back.
    ///
    /// # Errors
    /// Says what is wrong with the file and what to do about it. [`OpenError::may_pass`] tells a file that is
    /// not there yet or is being written from one that stays unusable.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let io_error = |source| OpenError::Io { path: path.to_owned(), source };
        // Opening a pipe would wait for whoever writes to it.
        if !fs::metadata(path).map_err(io_error)?.is_file() {
            return Err(io_error(io::Error::other("it is not a regular file")));
        }
        let file = File::open(path).map_err(io_error)?;
        let before = Stamp::of(&file).map_err(io_error)?;
        let opened = Self::read(Source::File(&file), before.length, path);
        let changed = || Stamp::of(&file).is_ok_and(|after| after != before);
        opened.map_err(|error| if changed() { error.while_changing(path) } else { error })
    }

    /// Opens a scene whose file is in memory. `name` is what errors call it.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn open_bytes(name: &Path, bytes: &[u8]) -> Result<Self, OpenError> {
        Self::read(Source::Memory(bytes), bytes.len() as u64, name)
    }

    fn read(source: Source<'_>, length: u64, path: &Path) -> Result<Self, OpenError> {
        let mapped = MappedScene::read(source, length, path)?;
        validate::check(&mapped.parts())
            .map_err(|source| OpenError::Malformed { path: path.to_owned(), source })?;
        Ok(Self { hash: mapped.fingerprint, storage: Storage::File(mapped) })
    }
}

/// What tells that a file was written to.
#[derive(Debug, PartialEq, Eq)]
struct Stamp {
    length: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    fn of(file: &File) -> io::Result<Self> {
        let metadata = file.metadata()?;
        Ok(Self { length: metadata.len(), modified: metadata.modified().ok() })
    }
}

pub(super) fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o666); // less the umask: as any file one makes
    #[cfg(unix)]
    builder.permissions(permissions);
    let temporary = builder.prefix(".trimaran-").suffix(".tmp").tempfile_in(folder)?;
    let mut out = BufWriter::with_capacity(1 << 20, temporary);
    write(&mut out)?;
    let temporary = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path)?;
    // The rename itself is on the disk only once the folder is; systems that cannot open folders do without.
    if let Ok(folder) = File::open(folder) {
        folder.sync_all()?;
    }
    Ok(())
}

impl Header {
    fn new(sections: &[&[u8]; SECTIONS], fingerprint: SceneHash) -> Self {
        let mut end = size_of::<Self>() as u64;
        let sections = sections.map(|bytes| {
            let section = Section { offset: end.next_multiple_of(ALIGNMENT), length: bytes.len() as u64 };
            end = section.offset + section.length;
            section
        });
        let mut header = Self {
            magic: MAGIC,
            version: VERSION,
            reserved: 0,
            fingerprint: fingerprint.0.to_le_bytes(),
            file_length: end,
            sections,
            check: 0,
        };
        header.check = header.checksum();
        header
    }

    /// Reads and checks the header, and the file's length against it, before any memory is taken.
    fn read(source: Source<'_>, length: u64, path: &Path) -> Result<Self, OpenError> {
        let mut bytes = [0; size_of::<Self>()];
        let there = bytes.get_mut(..length.min(size_of::<Self>() as u64) as usize).unwrap_or_default();
        source.read_exact_at(there, 0).map_err(|error| unread(error, source, length, path))?;
        let bytes = &*there;
        let path = || path.to_owned();
        if !MAGIC.starts_with(bytes.get(..MAGIC.len()).unwrap_or(bytes)) {
            return Err(OpenError::Foreign { path: path() });
        }
        let cut_short =
            OpenError::Truncated { path: path(), expected: size_of::<Self>() as u64, actual: length };
        let version = bytes.get(8..12).and_then(|v| v.try_into().ok()).map(u32::from_le_bytes);
        match version {
            None => return Err(cut_short),
            Some(VERSION) => {}
            Some(found) => return Err(OpenError::Version { path: path(), found, known: VERSION }),
        }
        let Ok(header) = bytemuck::try_pod_read_unaligned::<Self>(bytes) else {
            return Err(cut_short);
        };
        if header.check != header.checksum() {
            Err(OpenError::Damaged { path: path(), what: "the header's checksum does not match" })
        } else if length < header.file_length {
            Err(OpenError::Truncated { path: path(), expected: header.file_length, actual: length })
        } else if length > header.file_length {
            Err(OpenError::Damaged { path: path(), what: "it is longer than it was when written" })
        } else {
            Ok(header)
        }
    }

    /// Where the sections lie: one behind the other within the file, aligned, and of whole records.
    fn ranges(&self) -> Option<[Range<usize>; SECTIONS]> {
        let mut end = size_of::<Self>() as u64;
        let mut ranges = [const { 0..0 }; SECTIONS];
        for ((section, size), range) in self.sections.iter().zip(RECORD_SIZES).zip(&mut ranges) {
            let Section { offset, length } = *section;
            let sound = offset >= end && offset.is_multiple_of(ALIGNMENT) && length.is_multiple_of(size);
            end = offset.checked_add(length).filter(|&end| sound && end <= self.file_length)?;
            *range = usize::try_from(offset).ok()?..usize::try_from(end).ok()?;
        }
        Some(ranges)
    }

    fn checksum(&self) -> u64 {
        let bytes = bytemuck::bytes_of(self);
        xxh3_64(bytes.get(..bytes.len() - size_of::<u64>()).unwrap_or(bytes))
    }

    fn fingerprint(&self) -> SceneHash {
        SceneHash(u128::from_le_bytes(self.fingerprint))
    }
}

/// What a failed read of a file that had `expected` bytes means.
fn unread(error: io::Error, source: Source<'_>, expected: u64, path: &Path) -> OpenError {
    let path = path.to_owned();
    match source.length() {
        Ok(actual) if error.kind() == io::ErrorKind::UnexpectedEof => {
            OpenError::Truncated { path, expected, actual }
        }
        _ => OpenError::Io { path, source: error },
    }
}

/// A file in memory, and where its sections lie: each range within the map, aligned and of whole records.
#[derive(Debug)]
pub(super) struct MappedScene {
    map: Mmap,
    sections: [Range<usize>; SECTIONS],
    sources: Vec<String>,
    fingerprint: SceneHash,
}

impl MappedScene {
    /// Reads a file of `length` bytes and compares it with its fingerprint.
    fn read(source: Source<'_>, length: u64, path: &Path) -> Result<Self, OpenError> {
        let damaged = |what| OpenError::Damaged { path: path.to_owned(), what };
        let header = Header::read(source, length, path)?;
        let sections = header
            .ranges()
            .ok_or_else(|| damaged("a section lies outside of it, or is not made of whole records"))?;
        // The header stands within the file's length, and the ranges within the header's.
        let bytes = usize::try_from(length).unwrap_or(usize::MAX);
        let Stable { map, fingerprint } =
            stable::read(source, bytes, &sections).map_err(|because| match because {
                Unread::File(error) => unread(error, source, length, path),
                Unread::Memory(source) => OpenError::Memory { path: path.to_owned(), bytes: length, source },
            })?;
        if fingerprint != header.fingerprint() {
            return Err(damaged("its checksum does not match"));
        }
        let [.., names, sources] = sections.clone().map(|range| map.get(range).unwrap_or_default());
        if std::str::from_utf8(names).is_err() {
            return Err(damaged("its names are not UTF-8"));
        }
        let sources =
            hash::decode_sources(sources).ok_or_else(|| damaged("its list of sources is broken"))?;
        Ok(Self { map, sections, sources, fingerprint })
    }

    pub(super) fn parts(&self) -> Parts<'_> {
        Parts {
            nodes: self.nodes(),
            drawables: self.drawables(),
            vertices: self.vertices(),
            indices: self.indices(),
            objects: self.objects(),
            names: self.records(5),
            sources: &self.sources,
        }
    }

    pub(super) fn nodes(&self) -> &[Node] {
        self.records(0)
    }

    pub(super) fn drawables(&self) -> &[Drawable] {
        self.records(1)
    }

    pub(super) fn vertices(&self) -> &[Vertex] {
        self.records(2)
    }

    pub(super) fn indices(&self) -> &[u32] {
        self.records(3)
    }

    pub(super) fn objects(&self) -> &[ObjectRecord] {
        self.records(4)
    }

    /// A section as records. `read` has checked its range and alignment, so the empty slice stands for
    /// nothing that happens.
    fn records<T: AnyBitPattern + NoUninit>(&self, section: usize) -> &[T] {
        let bytes = self.sections.get(section).and_then(|range| self.map.get(range.clone()));
        bytes.and_then(|bytes| bytemuck::try_cast_slice(bytes).ok()).unwrap_or_default()
    }
}
