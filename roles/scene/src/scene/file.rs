//! The cooked file: written whole or not at all, mapped, and trusted only after it has been checked.
//!
//! Layout, little-endian: a [`Header`], then the sections, each starting at a multiple of 64 bytes, gaps filled with zeros.
//! Order of the sections: nodes, drawables, vertices, indices, objects, names, sources.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::mem::size_of;
use std::ops::Range;
use std::path::{Path, PathBuf};

use bytemuck::{AnyBitPattern, NoUninit, Pod, Zeroable};
use memmap2::Mmap;
use thiserror::Error;
use trimaran_proto::SceneHash;
use xxhash_rust::xxh3::xxh3_64;

use super::{Drawable, Node, ObjectRecord, Parts, Scene, SceneError, Storage, Vertex, hash, validate};

/// The first bytes of every cooked scene. The line ends show a copy that changed them, as in PNG.
const MAGIC: [u8; 8] = *b"TRIMRN\r\n";
/// The format this build reads and writes.
const VERSION: u32 = 2;
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
    assert!(cfg!(target_endian = "little"), "cooked scenes are mapped as they stand: little-endian only");

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

/// Why a scene could not be saved. Nothing is left behind under the name asked for, and an older file of that name stays.
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

/// Why a file is not opened as a scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The file cannot be read.
    #[error("cannot read the scene {path:?}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file is something else.
    #[error("{path:?} is not a cooked scene; make one with `trimaran import`")]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// The file has another version of the format.
    #[error("the scene {path:?} has format {found}, this build reads format {known}; {}", other_version_advice(*found, *known))]
    Version {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
        /// The format this build reads.
        known: u32,
    },
    /// The file ends early.
    #[error("the scene {path:?} is cut short: {actual} of {expected} bytes; copy it again, or import again")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The length it should have.
        expected: u64,
        /// The length it has.
        actual: u64,
    },
    /// The file's bytes are not those that were written.
    #[error("the scene {path:?} is damaged ({what}); copy it again, or import again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Which check failed.
        what: &'static str,
    },
    /// The bytes are as they were written, but are no scene.
    #[error(
        "the scene {path:?} breaks the rules of its format; import again, and report this if it happens again"
    )]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The rule.
        source: SceneError,
    },
}

fn other_version_advice(found: u32, known: u32) -> &'static str {
    if found > known {
        "use a newer build, or import again with this one"
    } else {
        "import again with this build"
    }
}

impl Scene {
    /// Writes the scene to `path`: to a temporary name in the same folder, flushed to the disk and then renamed, so that a
    /// reader sees the old file or the whole new one. The same scene always makes the same bytes.
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

    /// Maps a scene that [`Scene::save`] wrote, and checks all of it: every byte against the fingerprint, every record
    /// against the rules.
    ///
    /// # Errors
    /// Says what is wrong with the file and what to do about it.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let io_error = |source| OpenError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(io_error)?;
        let actual = file.metadata().map_err(io_error)?.len();
        if actual == 0 {
            return Err(OpenError::Foreign { path: path.to_owned() });
        }
        let map = map_file(&file).map_err(io_error)?;
        let header = Header::read(&map, path)?;
        let mapped = MappedScene::new(map, &header, path)?;
        let parts = mapped.parts();
        validate::check(&parts).map_err(|source| OpenError::Malformed { path: path.to_owned(), source })?;
        Ok(Self { hash: header.fingerprint(), storage: Storage::File(mapped) })
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

#[expect(unsafe_code, reason = "mapping a file is the one thing here that the compiler cannot check")]
fn map_file(file: &File) -> io::Result<Mmap> {
    // SAFETY: `Mmap::map` asks that the file does not change while it is mapped. Scenes are never written in place:
    // `Scene::save` makes a new file and renames it, which leaves the mapped one as it is. Someone who overwrites or cuts
    // the file by other means breaks that promise, as with any mapped program or library.
    unsafe { Mmap::map(file) }
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

    /// Reads and checks the header, and the file's length against it.
    fn read(bytes: &[u8], path: &Path) -> Result<Self, OpenError> {
        let path = || path.to_owned();
        let magic = bytes.get(..MAGIC.len()).unwrap_or(bytes);
        if magic.is_empty() || !MAGIC.starts_with(magic) {
            return Err(OpenError::Foreign { path: path() });
        }
        let cut_short = OpenError::Truncated {
            path: path(),
            expected: size_of::<Self>() as u64,
            actual: bytes.len() as u64,
        };
        let version = bytes.get(8..12).and_then(|v| v.try_into().ok()).map(u32::from_le_bytes);
        match version {
            None => return Err(cut_short),
            Some(VERSION) => {}
            Some(found) => return Err(OpenError::Version { path: path(), found, known: VERSION }),
        }
        let Some(bytes_of_header) = bytes.get(..size_of::<Self>()) else {
            return Err(cut_short);
        };
        let header: Self = bytemuck::pod_read_unaligned(bytes_of_header);
        let actual = bytes.len() as u64;
        if header.check != header.checksum() {
            Err(OpenError::Damaged { path: path(), what: "the header's checksum does not match" })
        } else if actual < header.file_length {
            Err(OpenError::Truncated { path: path(), expected: header.file_length, actual })
        } else if actual > header.file_length {
            Err(OpenError::Damaged { path: path(), what: "it is longer than it was when written" })
        } else {
            Ok(header)
        }
    }

    fn checksum(&self) -> u64 {
        let bytes = bytemuck::bytes_of(self);
        xxh3_64(bytes.get(..bytes.len() - size_of::<u64>()).unwrap_or(bytes))
    }

    fn fingerprint(&self) -> SceneHash {
        SceneHash(u128::from_le_bytes(self.fingerprint))
    }
}

/// A file in memory, and where its sections lie: each range within the map, aligned and of whole records.
#[derive(Debug)]
pub(super) struct MappedScene {
    map: Mmap,
    sections: [Range<usize>; SECTIONS],
    sources: Vec<String>,
}

impl MappedScene {
    fn new(map: Mmap, header: &Header, path: &Path) -> Result<Self, OpenError> {
        let damaged = |what| OpenError::Damaged { path: path.to_owned(), what };
        let mut sections = [const { 0..0 }; SECTIONS];
        for ((section, size), range) in header.sections.iter().zip(RECORD_SIZES).zip(&mut sections) {
            let end = section.offset.checked_add(section.length).filter(|&end| end <= map.len() as u64);
            match end {
                Some(end)
                    if section.offset.is_multiple_of(ALIGNMENT) && section.length.is_multiple_of(size) =>
                {
                    *range = section.offset as usize..end as usize;
                }
                _ => return Err(damaged("a section lies outside of it, or is not made of whole records")),
            }
        }
        let bytes = sections.clone().map(|range| map.get(range).unwrap_or_default());
        if hash::fingerprint_sections(&bytes) != header.fingerprint() {
            return Err(damaged("its checksum does not match"));
        }
        let [.., names, sources] = bytes;
        if std::str::from_utf8(names).is_err() {
            return Err(damaged("its names are not UTF-8"));
        }
        let sources =
            hash::decode_sources(sources).ok_or_else(|| damaged("its list of sources is broken"))?;
        Ok(Self { map, sections, sources })
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

    /// A section as records. `new` has checked its range and alignment, so the empty slice stands for nothing that happens.
    fn records<T: AnyBitPattern + NoUninit>(&self, section: usize) -> &[T] {
        let bytes = self.sections.get(section).and_then(|range| self.map.get(range.clone()));
        bytes.and_then(|bytes| bytemuck::try_cast_slice(bytes).ok()).unwrap_or_default()
    }
}
