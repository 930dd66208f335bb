//! The layout of a cooked file, and the tree of hashes over it.
//!
//! A file is a [`Header`], then pages one behind the other, then a directory of the pages. A page is read,
//! checked and unpacked as a whole: some records of one kind, or the triangles of some drawables.
//!
//! | pages | of what | packed by |
//! |---|---|---|
//! | 1 | nodes, 256 each | zstd |
//! | 2 | drawables, 1,024 each, as all below | zstd |
//! | 3 | places of geometry | zstd |
//! | 4 | objects | zstd |
//! | 5 | all objects' names, one page | zstd |
//! | 6 | the sources' names, one page, behind the see-through objects | zstd |
//! | 7 | the hierarchy of objects and their attributes, one page | postcard, then zstd |
//! | 8 | the coordinates of plant and files, one page; none in format 8 | postcard, then zstd |
//! | 9 | geometry, whole pieces up to about 32 KiB | meshoptimizer, piece by piece, then zstd |
//! | 10 | the overview, one page or none | postcard, then zstd |
//!
//! The directory has the BLAKE3 hash of each page as it lies in the file. The fingerprint is the BLAKE3 hash
//! of header and directory. So a reader that trusts the fingerprint can check any page alone.

use std::ops::{Range, RangeInclusive};

use bytemuck::{Pod, Zeroable};
use trimaran_proto::SceneHash;

use super::geometry::GeometryPlace;
use super::{Drawable, Node, ObjectRecord};

/// The first bytes of every cooked scene. The line ends show a copy that changed them, as in PNG.
pub(super) const MAGIC: [u8; 8] = *b"TRIMRN\r\n";
/// The newest format that this build reads and writes.
pub const VERSION: u32 = 9;
/// The format without coordinates, which this build reads as well. It also writes it where they are the usual
/// ones, so that builds that know no other format read the scene.
pub(super) const WITHOUT_COORDINATES: u32 = 8;
/// The formats that this build reads.
pub const VERSIONS: RangeInclusive<u32> = WITHOUT_COORDINATES..=VERSION;
/// The largest ratio of a page's unpacked to its packed bytes. It keeps a small file from requesting much
/// memory.
pub(super) const LARGEST_RATIO: usize = 4096;

/// The single pages of names and of the hierarchy have a lower ratio above this size, so that opening a small
/// file takes little memory.
const LARGEST_TEXT_RATIO: usize = 32;
const FREE_TEXT: usize = 16 << 20;

const _: () =
    assert!(cfg!(target_endian = "little"), "cooked scenes are read as they stand: little-endian only");

/// The start of a file, little-endian.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Header {
    pub(super) magic: [u8; 8],
    pub(super) version: u32,
    /// The number of pages.
    pub(super) pages: u32,
    pub(super) file_length: u64,
    /// The directory's first byte; it ends the file.
    pub(super) directory: u64,
    pub(super) nodes: u32,
    pub(super) drawables: u32,
    pub(super) geometries: u32,
    pub(super) objects: u32,
    /// Nodes without children.
    pub(super) leaves: u32,
    /// Pages of the overview: 1, or 0 without one.
    pub(super) overviews: u32,
    /// Bytes of all objects' names.
    pub(super) names: u64,
    pub(super) totals: Totals,
    /// BLAKE3 of the header's bytes before this, and then the directory's.
    pub(super) fingerprint: [u8; 32],
    /// The first bytes of the BLAKE3 of all bytes of the header before this.
    pub(super) check: [u8; 8],
}

/// Sums over the whole scene, available without reading it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Totals {
    /// The triangles of all leaves at their finest level: the original model, instances counted each.
    pub full_detail_triangles: u64,
    /// The triangles of all levels, instances counted once.
    pub stored_triangles: u64,
    /// The vertices of all levels, instances counted once.
    pub stored_vertices: u64,
}

/// The directory's entry of a page.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Entry {
    /// First byte in the file.
    pub(super) offset: u64,
    /// Bytes in the file.
    pub(super) length: u32,
    /// Bytes when unpacked.
    pub(super) unpacked: u32,
    /// The first numbers of a page of nodes. Else 0.
    pub(super) firsts: Firsts,
    /// Zero.
    pub(super) reserved: u32,
    /// BLAKE3 of the bytes in the file.
    pub(super) hash: [u8; 32],
}

/// The first numbers of a page of nodes. With them a page can be checked, and a leaf found by number, without
/// the earlier pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Firsts {
    /// The first child of all its nodes.
    pub(super) child: u32,
    /// Their first drawable.
    pub(super) drawable: u32,
    /// The number of its first leaf among all leaves.
    pub(super) leaf: u32,
}

impl Firsts {
    /// Of the first page.
    pub(super) const START: Self = Self { child: 1, drawable: 0, leaf: 0 };

    /// The numbers after a node.
    pub(super) fn after(self, node: &Node) -> Self {
        Self {
            child: self.child.saturating_add(node.child_count),
            drawable: self.drawable.saturating_add(node.drawable_count),
            leaf: self.leaf.saturating_add(u32::from(node.is_leaf())),
        }
    }
}

/// The kinds of pages, in the order of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Section {
    Nodes,
    Drawables,
    Places,
    Objects,
    Names,
    Sources,
    Hierarchy,
    Coordinates,
    Geometry,
    Overview,
}

impl Section {
    const ALL: [Self; 10] = [
        Self::Nodes,
        Self::Drawables,
        Self::Places,
        Self::Objects,
        Self::Names,
        Self::Sources,
        Self::Hierarchy,
        Self::Coordinates,
        Self::Geometry,
        Self::Overview,
    ];

    /// The binary logarithm of a page's records.
    pub(super) const fn page_bits(self) -> u32 {
        match self {
            Self::Nodes => 8,
            _ => 10,
        }
    }

    /// The records of a page.
    pub(super) const fn per_page(self) -> usize {
        1 << self.page_bits()
    }

    /// The pages of this many records.
    const fn pages(self, records: u32) -> usize {
        (records as usize).div_ceil(self.per_page())
    }

    /// The most bytes that a page unpacks to.
    pub(super) const fn most_unpacked(self, length: usize) -> usize {
        let most = LARGEST_RATIO * length;
        match self {
            Self::Names | Self::Sources | Self::Hierarchy | Self::Coordinates | Self::Overview => {
                let text = LARGEST_TEXT_RATIO * length;
                let text = if text > FREE_TEXT { text } else { FREE_TEXT };
                if most < text { most } else { text }
            }
            _ => most,
        }
    }

    /// The least bytes of a page that unpacks to this many.
    pub(super) const fn least_packed(self, unpacked: usize) -> usize {
        match self {
            Self::Names | Self::Sources | Self::Hierarchy | Self::Coordinates | Self::Overview
                if unpacked > FREE_TEXT =>
            {
                unpacked.div_ceil(LARGEST_TEXT_RATIO)
            }
            _ => unpacked.div_ceil(LARGEST_RATIO),
        }
    }

    /// The name of its records in errors.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Nodes => "nodes",
            Self::Drawables => "drawables",
            Self::Places => "places of geometry",
            Self::Objects => "objects",
            Self::Names => "names",
            Self::Sources => "names of sources",
            Self::Hierarchy => "hierarchy",
            Self::Coordinates => "coordinates",
            Self::Geometry => "geometry",
            Self::Overview => "overview",
        }
    }
}

impl Header {
    /// Whether the file says which coordinates people know.
    pub(super) const fn has_coordinates(&self) -> bool {
        self.version > WITHOUT_COORDINATES
    }

    /// The pages of a section.
    pub(super) fn pages(&self, section: Section) -> Range<usize> {
        let mut first = 0;
        for of in Section::ALL {
            let count = match of {
                Section::Nodes => of.pages(self.nodes),
                Section::Drawables => of.pages(self.drawables),
                Section::Places => of.pages(self.geometries),
                Section::Objects => of.pages(self.objects),
                Section::Names | Section::Sources | Section::Hierarchy => 1,
                Section::Coordinates => usize::from(self.has_coordinates()),
                Section::Geometry => {
                    (self.pages.saturating_sub(self.overviews) as usize).saturating_sub(first)
                }
                Section::Overview => self.overviews as usize,
            };
            if of == section {
                return first..first + count;
            }
            first += count;
        }
        first..first
    }

    /// Sets the place of the directory, which ends a file whose pages end at `end`.
    pub(super) fn end_with(&mut self, directory: &[Entry], end: u64) {
        self.directory = end;
        self.file_length = end + size_of_val(directory) as u64;
    }

    /// Sets fingerprint and check; all other fields are set already.
    pub(super) fn seal(&mut self, directory: &[Entry]) {
        self.fingerprint = self.hash(directory);
        self.check = self.checksum();
    }

    /// The correct fingerprint.
    pub(super) fn hash(&self, directory: &[Entry]) -> [u8; 32] {
        let bytes = bytemuck::bytes_of(self);
        let before = std::mem::offset_of!(Self, fingerprint);
        let mut hasher = blake3::Hasher::new();
        hasher.update(bytes.get(..before).unwrap_or_default());
        hasher.update_rayon(bytemuck::cast_slice(directory));
        *hasher.finalize().as_bytes()
    }

    pub(super) fn checksum(&self) -> [u8; 8] {
        let bytes = bytemuck::bytes_of(self);
        let before = std::mem::offset_of!(Self, check);
        let hash = blake3::hash(bytes.get(..before).unwrap_or_default());
        std::array::from_fn(|index| hash.as_bytes().get(index).copied().unwrap_or_default())
    }

    /// The hash that peers compare: the first half of the fingerprint.
    pub(super) fn scene_hash(&self) -> SceneHash {
        let half = self.fingerprint.first_chunk::<16>().copied().unwrap_or_default();
        SceneHash(u128::from_le_bytes(half))
    }

    /// Whether the directory describes consecutive pages, and sections of the sizes required by their counts.
    pub(super) fn fits(&self, directory: &[Entry]) -> bool {
        let mut end = size_of::<Self>() as u64;
        let sound = directory.iter().all(|entry| {
            let sound = entry.offset == end;
            end = entry.offset.saturating_add(u64::from(entry.length));
            sound
        });
        let unpacked_as = |section: Section, count: u32, size: usize| {
            let pages = directory.get(self.pages(section)).unwrap_or_default();
            pages.iter().enumerate().all(|(page, entry)| {
                let first = page * section.per_page();
                entry.unpacked as usize == size * section.per_page().min(count as usize - first)
            })
        };
        let nodes = directory.get(self.pages(Section::Nodes)).unwrap_or_default();
        let names = directory.get(self.pages(Section::Names)).unwrap_or_default();
        let rising = |of: fn(&Firsts) -> u32| nodes.is_sorted_by_key(|entry| of(&entry.firsts));
        sound
            && end == self.directory
            && self.overviews <= 1
            && self.pages(Section::Overview).end == directory.len()
            && unpacked_as(Section::Nodes, self.nodes, size_of::<Node>())
            && unpacked_as(Section::Drawables, self.drawables, size_of::<Drawable>())
            && unpacked_as(Section::Places, self.geometries, size_of::<GeometryPlace>())
            && unpacked_as(Section::Objects, self.objects, size_of::<ObjectRecord>())
            && names.iter().all(|entry| u64::from(entry.unpacked) == self.names)
            && rising(|firsts| firsts.child)
            && rising(|firsts| firsts.drawable)
            && rising(|firsts| firsts.leaf)
            && nodes.first().is_none_or(|entry| entry.firsts == Firsts::START)
    }
}
