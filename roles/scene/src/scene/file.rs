//! A cooked file: opened by its header and directory, its pages read and checked one by one.

use std::cell::RefCell;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Zeroable;
use thiserror::Error;
use trimaran_proto::SceneOutline;
use zstd::bulk::Decompressor;

use super::geometry::GeometryPlace;
use super::layout::{Entry, Firsts, Header, MAGIC, Section, VERSION, VERSIONS};
use super::source::Source;
use super::{Coordinates, OpenError, Overview, ReadCause, ReadError, SceneError, encode};

/// An open file whose header and directory are checked.
#[derive(Debug)]
pub(super) struct SceneFile {
    path: PathBuf,
    source: Source,
    header: Header,
    directory: Vec<Entry>,
}

/// Why a scene could not be saved. The requested name then has no partial file, and keeps an older one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SaveError {
    /// Writing failed: a full disk, a folder that is missing or read-only.
    #[error(
        "cannot write the scene {path:?}: {source}; check that its folder exists, is writable and has {bytes} bytes free"
    )]
    Io {
        /// The requested file.
        path: PathBuf,
        /// The size of the scene.
        bytes: u64,
        /// The system's error.
        source: io::Error,
    },
    /// The scene's own file cannot be read.
    #[error("the scene cannot be copied")]
    Read(#[from] ReadError),
}

impl SceneFile {
    pub(super) fn open(path: &Path) -> Result<Self, OpenError> {
        let io_error = |source| OpenError::Io { path: path.to_owned(), source };
        // Opening a pipe would wait for its writer.
        if !fs::metadata(path).map_err(io_error)?.is_file() {
            return Err(io_error(io::Error::other("it is not a regular file")));
        }
        let source = Source::file(File::open(path).map_err(io_error)?).map_err(io_error)?;
        Self::read(source, path)
    }

    pub(super) fn read(source: Source, path: &Path) -> Result<Self, OpenError> {
        let opened = read_directory(&source, path);
        let (header, directory) = match opened {
            Err(error) if source.has_changed() => return Err(error.while_changing(path)),
            opened => opened?,
        };
        Ok(Self { path: path.to_owned(), source, header, directory })
    }

    /// No file: a header without pages, so that every read is an error.
    pub(super) fn absent(outline: &SceneOutline) -> Self {
        let SceneOutline { hash, nodes, drawables, geometries, objects } = *outline;
        let mut header = Header { nodes, drawables, geometries, objects, ..Header::zeroed() };
        if let Some(half) = header.fingerprint.first_chunk_mut() {
            *half = hash.0.to_le_bytes();
        }
        let path = PathBuf::from(format!("{hash}, which comes over a link"));
        Self { path, source: Source::Memory(Vec::new()), header, directory: Vec::new() }
    }

    pub(super) const fn header(&self) -> &Header {
        &self.header
    }

    /// A page of a section, unpacked and verified by its hash; `records` are its records, for errors.
    pub(super) fn unpack(
        &self,
        section: Section,
        page: usize,
        records: &Range<usize>,
    ) -> Result<Vec<u8>, ReadError> {
        let Entry { length, unpacked, .. } = self.entry(section, page);
        if unpacked as usize > section.most_unpacked(length as usize) {
            return Err(self.error(section, page, records, ReadCause::Damaged));
        }
        let mut bytes = vec![0; unpacked as usize];
        self.unpack_into(section, page, records, &mut bytes)?;
        Ok(bytes)
    }

    /// The same into `room`, which is to be filled.
    pub(super) fn unpack_into(
        &self,
        section: Section,
        page: usize,
        records: &Range<usize>,
        room: &mut [u8],
    ) -> Result<(), ReadError> {
        thread_local! {
            // Making one takes as long as unpacking a page.
            static UNPACKER: RefCell<Option<Decompressor<'static>>> = const { RefCell::new(None) };
        }
        let bytes = self.checked(&self.entry(section, page));
        let bytes = bytes.map_err(|cause| self.error(section, page, records, cause))?;
        let filled = UNPACKER.with_borrow_mut(|unpacker| {
            if unpacker.is_none() {
                *unpacker = Decompressor::new().ok();
            }
            unpacker.as_mut().and_then(|unpacker| unpacker.decompress_to_buffer(&bytes, room).ok())
        });
        if filled == Some(room.len()) {
            Ok(())
        } else {
            Err(self.error(section, page, records, ReadCause::Damaged))
        }
    }

    /// The coordinates that people know, of a file with this many sources; the usual ones if it has none.
    pub(super) fn coordinates(&self, sources: usize) -> Result<Coordinates, ReadError> {
        if !self.header.has_coordinates() {
            return Ok(Coordinates::default());
        }
        let bytes = self.unpack(Section::Coordinates, 0, &(0..0))?;
        let damaged = || self.error(Section::Coordinates, 0, &(0..0), ReadCause::Damaged);
        Coordinates::decode(&bytes, sources).ok_or_else(damaged)
    }

    /// The overview, if it has one.
    pub(super) fn overview(&self) -> Result<Option<Overview>, ReadError> {
        if self.header.overviews == 0 {
            return Ok(None);
        }
        let bytes = self.unpack(Section::Overview, 0, &(0..0))?;
        let damaged = || self.error(Section::Overview, 0, &(0..0), ReadCause::Damaged);
        Overview::decode(&bytes).ok_or_else(damaged).map(Some)
    }

    /// Adds an overview to a file in memory that has none yet.
    pub(super) fn add_overview(&mut self, overview: &Overview) {
        if let Source::Memory(bytes) = &mut self.source
            && self.header.overviews == 0
        {
            encode::add_overview(bytes, &mut self.header, &mut self.directory, overview);
        }
    }

    /// A piece of geometry, packed by itself; `page` caches the page of the last read.
    pub(super) fn geometry<'p>(
        &self,
        number: usize,
        place: &GeometryPlace,
        page: &'p mut Option<(u32, Vec<u8>)>,
    ) -> Result<&'p [u8], ReadError> {
        let one = number..number + 1;
        let of = place.page as usize;
        if page.as_ref().is_none_or(|(last, _)| *last != place.page) {
            *page = Some((place.page, self.unpack(Section::Geometry, of, &one)?));
        }
        let bytes = page.as_ref().map(|(_, bytes)| bytes.as_slice()).unwrap_or_default();
        let start = place.offset as usize;
        let piece = bytes.get(start..start.saturating_add(place.length as usize));
        // The place was checked against the directory when it was read.
        piece.ok_or_else(|| self.error(Section::Geometry, of, &one, ReadCause::Damaged))
    }

    /// The length of a page of geometry, unpacked.
    pub(super) fn geometry_page_length(&self, page: u32) -> Option<u32> {
        let pages = self.directory.get(self.header.pages(Section::Geometry))?;
        Some(pages.get(page as usize)?.unpacked)
    }

    /// The first numbers of a page of nodes, and of the next page.
    pub(super) fn firsts(&self, page: usize) -> [Firsts; 2] {
        let pages = self.directory.get(self.header.pages(Section::Nodes)).unwrap_or_default();
        let Header { nodes, drawables, leaves, .. } = self.header;
        let end = Firsts { child: nodes, drawable: drawables, leaf: leaves };
        let firsts = |page: usize| pages.get(page).map_or(end, |entry| entry.firsts);
        [firsts(page), firsts(page + 1)]
    }

    /// The page of nodes with the leaf of this number.
    pub(super) fn page_of_leaf(&self, leaf: u32) -> usize {
        let pages = self.directory.get(self.header.pages(Section::Nodes)).unwrap_or_default();
        pages.partition_point(|entry| entry.firsts.leaf <= leaf).saturating_sub(1)
    }

    /// An error about records of a page.
    pub(super) fn error(
        &self,
        section: Section,
        page: usize,
        records: &Range<usize>,
        cause: ReadCause,
    ) -> ReadError {
        let entry = self.entry(section, page);
        let start = entry.offset;
        let what = match section {
            Section::Names
            | Section::Sources
            | Section::Hierarchy
            | Section::Coordinates
            | Section::Overview => section.name().to_owned(),
            _ if records.len() == 1 => format!("{} {}", section.name(), records.start),
            _ => format!("{} {} to {}", section.name(), records.start, records.end.saturating_sub(1)),
        };
        ReadError { path: self.path.clone(), bytes: start..start + u64::from(entry.length), what, cause }
    }

    /// Writes the file to another place: to a temporary name in the same folder, flushed to the disk and then
    /// renamed.
    pub(super) fn save(&self, path: &Path) -> Result<(), SaveError> {
        let mut unread = None;
        let saved = write_atomically(path, |out| {
            out.write_all(bytemuck::bytes_of(&self.header))?;
            for (page, entry) in self.directory.iter().enumerate() {
                match self.checked(entry) {
                    Ok(bytes) => out.write_all(&bytes)?,
                    Err(cause) => {
                        unread = Some(self.error_at(page, cause));
                        return Err(io::Error::other("the scene's own file cannot be read"));
                    }
                }
            }
            out.write_all(bytemuck::cast_slice(&self.directory))
        });
        match (saved, unread) {
            (_, Some(error)) => Err(SaveError::Read(error)),
            (Ok(()), None) => Ok(()),
            (Err(source), None) => {
                Err(SaveError::Io { path: path.to_owned(), bytes: self.header.file_length, source })
            }
        }
    }

    fn entry(&self, section: Section, page: usize) -> Entry {
        let pages = self.directory.get(self.header.pages(section)).unwrap_or_default();
        pages.get(page).copied().unwrap_or(Zeroable::zeroed())
    }

    /// A page as stored in the file, verified by its hash.
    fn checked(&self, entry: &Entry) -> Result<Vec<u8>, ReadCause> {
        let mut bytes = vec![0; entry.length as usize];
        let read = self.source.read_exact_at(&mut bytes, entry.offset);
        if read.is_ok() && *blake3::hash(&bytes).as_bytes() == entry.hash {
            return Ok(bytes);
        }
        Err(match read {
            _ if self.source.has_changed() => ReadCause::Changed,
            Err(error) => ReadCause::Io(Arc::new(error)),
            Ok(()) => ReadCause::Damaged,
        })
    }

    /// An error about a page counted over all sections.
    fn error_at(&self, page: usize, cause: ReadCause) -> ReadError {
        let entry = self.directory.get(page).copied().unwrap_or(Zeroable::zeroed());
        let bytes = entry.offset..entry.offset + u64::from(entry.length);
        ReadError { path: self.path.clone(), bytes, what: format!("page {page}"), cause }
    }

    /// Reports that a page's records break a rule.
    pub(super) fn malformed(
        &self,
        section: Section,
        page: usize,
        records: &Range<usize>,
        error: SceneError,
    ) -> ReadError {
        self.error(section, page, records, ReadCause::Malformed(error))
    }
}

/// Reads and checks header, directory and the file's length, before allocating more memory.
fn read_directory(source: &Source, path: &Path) -> Result<(Header, Vec<Entry>), OpenError> {
    let io_error = |error| OpenError::Io { path: path.to_owned(), source: error };
    let damaged = |what| OpenError::Damaged { path: path.to_owned(), what };
    let length = source.length().map_err(io_error)?;
    let mut bytes = [0; size_of::<Header>()];
    let there = bytes.get_mut(..length.min(size_of::<Header>() as u64) as usize).unwrap_or_default();
    source.read_exact_at(there, 0).map_err(io_error)?;
    let header = parse_header(there, length, path)?;
    let entries = header.pages as usize;
    if header.directory.checked_add((entries * size_of::<Entry>()) as u64) != Some(header.file_length) {
        return Err(damaged("its directory does not end it"));
    }
    let mut directory = vec![Entry::zeroed(); entries];
    source.read_exact_at(bytemuck::cast_slice_mut(&mut directory), header.directory).map_err(io_error)?;
    if header.fingerprint != header.hash(&directory) {
        Err(damaged("the checksum of its directory does not match"))
    } else if !header.fits(&directory) {
        Err(damaged("its directory does not go with its header"))
    } else {
        Ok((header, directory))
    }
}

fn parse_header(bytes: &[u8], length: u64, path: &Path) -> Result<Header, OpenError> {
    let path = || path.to_owned();
    if !MAGIC.starts_with(bytes.get(..MAGIC.len()).unwrap_or(bytes)) {
        return Err(OpenError::Foreign { path: path() });
    }
    let cut_short =
        OpenError::Truncated { path: path(), expected: size_of::<Header>() as u64, actual: length };
    let version = bytes.get(8..12).and_then(|v| v.try_into().ok()).map(u32::from_le_bytes);
    match version {
        None => return Err(cut_short),
        Some(found) if VERSIONS.contains(&found) => {}
        Some(found) => return Err(OpenError::Version { path: path(), found, known: VERSION }),
    }
    let Ok(header) = bytemuck::try_pod_read_unaligned::<Header>(bytes) else {
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
    // The rename is durable only after syncing the folder; systems that cannot open folders skip this.
    if let Ok(folder) = File::open(folder) {
        folder.sync_all()?;
    }
    Ok(())
}
