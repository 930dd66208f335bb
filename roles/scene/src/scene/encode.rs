//! Encodes arrays as a cooked file: the same arrays always make the same bytes.

use bytemuck::{NoUninit, Zeroable};
use rayon::prelude::*;
use trimaran_proto::ObjectSet;

use super::geometry::GeometryPlace;
use super::layout::{Entry, Firsts, Header, MAGIC, Section, Totals, VERSION, WITHOUT_COORDINATES};
use super::{Drawable, Extent, Geometry, Node, Overview, SceneArrays, SceneError, hierarchy_bytes};

/// The size from which a page of geometry counts as full: reading one piece reads and checks its whole page.
const GEOMETRY_PAGE: usize = 32 << 10;

/// Pages of records that are packed at a time.
const RECORD_PAGES_AT_ONCE: usize = 256;

/// Pieces of geometry that are packed, and then dropped, at a time.
const PACKED_AT_ONCE: usize = 1 << 14;

/// zstd's level: higher ones gain little on pages of this size, and cook longer.
const ZSTD_LEVEL: i32 = 3;

/// Begins a zstd skippable frame; its length follows (RFC 8878, 3.1.2).
const SKIPPED: u32 = 0x184D_2A50;

/// A page: its bytes in the file, and its directory entry.
struct Page {
    bytes: Vec<u8>,
    entry: Entry,
}

/// A file under way: a place for its header, and its pages so far.
struct Pages {
    file: Vec<u8>,
    directory: Vec<Entry>,
}

/// The bytes of a file of these arrays, whose records are not checked yet. Packed parts are dropped, so that
/// a large scene is not in memory twice.
pub(super) fn encode(mut arrays: SceneArrays) -> Result<Vec<u8>, SceneError> {
    check_counts(&arrays)?;
    set_sums(&mut arrays.nodes);
    set_nodes(&mut arrays);
    set_extents(&mut arrays)?;
    let hierarchy = hierarchy_bytes::encode(&arrays)?;
    let SceneArrays {
        nodes, drawables, geometries, objects, names, sources, see_through, coordinates, ..
    } = arrays;
    let (places, geometry) = place(geometries)?;
    let sources = encode_sources(&sources, &see_through);
    let mut header = Header {
        magic: MAGIC,
        version: if coordinates.are_usual() { WITHOUT_COORDINATES } else { VERSION },
        pages: 0,
        file_length: 0,
        directory: 0,
        nodes: nodes.len() as u32,
        drawables: drawables.len() as u32,
        geometries: places.len() as u32,
        objects: objects.len() as u32,
        leaves: nodes.iter().filter(|node| node.is_leaf()).count() as u32,
        overviews: 0,
        names: names.len() as u64,
        totals: totals(&nodes, &drawables, &places),
        fingerprint: [0; 32],
        check: [0; 8],
    };
    let mut pages = Pages { file: vec![0; size_of::<Header>()], directory: Vec::new() };
    let firsts = firsts(&nodes);
    pages.add_records(nodes, Section::Nodes);
    for (entry, firsts) in pages.directory.iter_mut().zip(firsts) {
        entry.firsts = firsts;
    }
    pages.add_records(drawables, Section::Drawables);
    pages.add_records(places, Section::Places);
    pages.add_records(objects, Section::Objects);
    let texts = [names.as_bytes(), &sources, &hierarchy];
    let sections = [Section::Names, Section::Sources, Section::Hierarchy];
    pages.add(texts.into_iter().zip(sections).map(|(text, section)| Page::packed(text, section)));
    if header.has_coordinates() {
        pages.add([Page::packed(&coordinates.encode(), Section::Coordinates)]);
    }
    pages.add(geometry);
    count("pages", pages.directory.len())?;
    Ok(pages.end(&mut header).0)
}

/// Adds a page with the overview to a file that has none.
pub(super) fn add_overview(
    file: &mut Vec<u8>,
    header: &mut Header,
    directory: &mut Vec<Entry>,
    overview: &Overview,
) {
    file.truncate(header.directory as usize);
    let mut pages = Pages { file: std::mem::take(file), directory: std::mem::take(directory) };
    pages.add([Page::packed(&overview.encode(), Section::Overview)]);
    header.overviews = 1;
    (*file, *directory) = pages.end(header);
}

fn check_counts(arrays: &SceneArrays) -> Result<(), SceneError> {
    if arrays.nodes.is_empty() {
        return Err(SceneError::Empty);
    }
    count("nodes", arrays.nodes.len())?;
    count("drawables", arrays.drawables.len())?;
    count("pieces of geometry", arrays.geometries.len())?;
    count("objects", arrays.objects.len())?;
    count("bytes of names", arrays.names.len())?;
    Ok(())
}

fn count(what: &'static str, count: usize) -> Result<u32, SceneError> {
    let number = u32::try_from(count).ok().filter(|&number| number < u32::MAX);
    number.ok_or(SceneError::TooMany { what, count })
}

/// Computes the fields that depend on ancestors or descendants. Children stand after their parents, so one
/// pass from the front visits ancestors first, and one from the end descendants.
fn set_sums(nodes: &mut [Node]) {
    nodes.par_iter_mut().for_each(|node| {
        node.reach = node.own_reach();
        node.objects = u32::from(node.object != Node::NONE);
        node.depth = 0;
    });
    for index in 1..nodes.len() {
        let parent = nodes.get(index).and_then(|node| nodes.get(node.parent as usize));
        let depth = parent.map_or(0, |parent| parent.depth.saturating_add(1));
        if let Some(node) = nodes.get_mut(index) {
            node.depth = depth;
        }
    }
    for index in (1..nodes.len()).rev() {
        let Some(&Node { reach, objects, parent, .. }) = nodes.get(index) else { continue };
        if let Some(parent) = nodes.get_mut(parent as usize) {
            parent.reach = parent.reach.max(reach);
            if parent.object == Node::NONE {
                parent.objects = parent.objects.saturating_add(objects);
            }
        }
    }
}

/// Sets each object's node: the first of its nodes, as its parts stand after it.
fn set_nodes(arrays: &mut SceneArrays) {
    let SceneArrays { nodes, objects, .. } = arrays;
    objects.iter_mut().for_each(|object| object.node = Node::NONE);
    for (index, node) in nodes.iter().enumerate().rev() {
        if let Some(object) = objects.get_mut(node.object as usize) {
            object.node = index as u32;
        }
    }
}

/// Computes the extents of each group's objects.
fn set_extents(arrays: &mut SceneArrays) -> Result<(), SceneError> {
    let SceneArrays { nodes, drawables, objects, hierarchy, .. } = arrays;
    hierarchy.check(objects.len() as u32)?;
    let mut extents = vec![Extent::default(); objects.len()];
    for leaf in nodes.iter().filter(|node| node.is_leaf()) {
        let triangles = finest(drawables, leaf).map(|drawable| u64::from(drawable.triangles)).sum();
        if let Some(extent) = extents.get_mut(leaf.object as usize) {
            *extent = extent.and(&Extent { min: leaf.world_min, max: leaf.world_max, triangles });
        }
    }
    for group in &mut hierarchy.groups {
        let all = extents.get(group.objects.start as usize..group.objects.end as usize).unwrap_or_default();
        group.extent = all.iter().fold(Extent::default(), |sum, extent| sum.and(extent));
    }
    Ok(())
}

/// Packs pieces, the first of which has the number `first`.
fn pack(geometries: &[Geometry], first: usize) -> Result<Vec<Vec<u8>>, SceneError> {
    let packed = geometries.par_iter().enumerate().map(|(index, geometry)| {
        geometry.pack().ok_or_else(|| SceneError::Malformed {
            what: "geometry",
            index: first + index,
            why: match geometry.check() {
                Some(super::GeometryError::Position(_)) => "a position of it is not finite",
                Some(_) => "one of its indices points past its vertices",
                None => "its indices are not a multiple of three above zero, or its vertices too many",
            },
        })
    });
    packed.collect()
}

/// Packs pieces, some at a time, and puts them into pages, in order.
fn place(geometries: Vec<Geometry>) -> Result<(Vec<GeometryPlace>, Vec<Page>), SceneError> {
    let (mut places, mut pages, mut open) = (Vec::with_capacity(geometries.len()), Vec::new(), Vec::new());
    let mut geometries = geometries.into_iter();
    while !geometries.as_slice().is_empty() {
        let some: Vec<Geometry> = geometries.by_ref().take(PACKED_AT_ONCE).collect();
        let mut full = Vec::new();
        for (geometry, bytes) in some.iter().zip(pack(&some, places.len())?) {
            if !open.is_empty() && open.len() + bytes.len() > GEOMETRY_PAGE {
                full.push(std::mem::take(&mut open));
            }
            count("bytes of geometry", bytes.len())?;
            places.push(GeometryPlace {
                page: count("pages", pages.len() + full.len())?,
                offset: count("bytes of a page", open.len())?,
                ..GeometryPlace::alone(geometry, bytes.len())
            });
            open.extend_from_slice(&bytes);
        }
        if geometries.as_slice().is_empty() && !open.is_empty() {
            full.push(std::mem::take(&mut open));
        }
        pages.par_extend(full.into_par_iter().map(|page| Page::packed(&page, Section::Geometry)));
    }
    Ok((places, pages))
}

/// The first numbers of each page of nodes.
fn firsts(nodes: &[Node]) -> Vec<Firsts> {
    let pages = nodes.chunks(Section::Nodes.per_page());
    let after = |firsts: &mut Firsts, page: &[Node]| {
        let end = page.iter().fold(*firsts, Firsts::after);
        Some(std::mem::replace(firsts, end))
    };
    pages.scan(Firsts::START, after).collect()
}

/// The pieces of a node's finest level.
fn finest<'d>(drawables: &'d [Drawable], node: &Node) -> impl Iterator<Item = &'d Drawable> + use<'d> {
    let own = drawables.iter().skip(node.first_drawable as usize).take(node.drawable_count as usize);
    let pieces = own.clone().next().map_or(0, |first| first.pieces.into());
    own.take(pieces)
}

fn totals(nodes: &[Node], drawables: &[Drawable], places: &[GeometryPlace]) -> Totals {
    let leaves = nodes.par_iter().filter(|node| node.is_leaf());
    let finest = leaves.flat_map_iter(|leaf| finest(drawables, leaf));
    Totals {
        full_detail_triangles: finest.map(|drawable| u64::from(drawable.triangles)).sum(),
        stored_triangles: places.iter().map(|place| u64::from(place.triangles)).sum(),
        stored_vertices: places.iter().map(|place| u64::from(place.vertices)).sum(),
    }
}

impl Pages {
    /// Adds records, and drops them.
    fn add_records<T: NoUninit + Sync>(&mut self, records: Vec<T>, section: Section) {
        for some in records.chunks(section.per_page() * RECORD_PAGES_AT_ONCE) {
            let pages = some.par_chunks(section.per_page());
            let pages: Vec<_> = pages.map(|page| Page::packed(bytemuck::cast_slice(page), section)).collect();
            self.add(pages);
        }
    }

    fn add(&mut self, pages: impl IntoIterator<Item = Page>) {
        for Page { bytes, entry } in pages {
            self.directory.push(Entry { offset: self.file.len() as u64, ..entry });
            self.file.extend_from_slice(&bytes);
        }
    }

    /// The whole file, with its header and its directory, and the directory by itself.
    fn end(self, header: &mut Header) -> (Vec<u8>, Vec<Entry>) {
        let Self { mut file, directory } = self;
        header.pages = directory.len() as u32;
        header.end_with(&directory, file.len() as u64);
        header.seal(&directory);
        file.extend_from_slice(bytemuck::cast_slice(&directory));
        if let Some(start) = file.first_chunk_mut::<{ size_of::<Header>() }>() {
            start.copy_from_slice(bytemuck::bytes_of(header));
        }
        (file, directory)
    }
}

impl Page {
    fn packed(unpacked: &[u8], section: Section) -> Self {
        // Packing into memory does not fail: there is room, and the level is valid.
        let mut bytes = zstd::bulk::compress(unpacked, ZSTD_LEVEL).unwrap_or_default();
        // All-equal names pack more tightly than readers accept: a skippable frame follows as padding.
        let missing = section.least_packed(unpacked.len()).saturating_sub(bytes.len());
        if missing > 0 {
            bytes.extend_from_slice(&SKIPPED.to_le_bytes());
            bytes.extend_from_slice(&(missing as u32).to_le_bytes());
            bytes.resize(bytes.len() + missing, 0);
        }
        let entry = Entry {
            length: bytes.len() as u32,
            unpacked: unpacked.len() as u32,
            hash: *blake3::hash(&bytes).as_bytes(),
            ..Zeroable::zeroed()
        };
        Self { bytes, entry }
    }
}

/// The see-through objects: the number of runs, then each as `ObjectSet` codes it. Then the sources' names:
/// each a length and that many bytes of UTF-8. All numbers are u32, little-endian.
fn encode_sources(sources: &[String], see_through: &ObjectSet) -> Vec<u8> {
    let runs: Vec<(u32, u32)> = see_through.clone().into();
    let numbers = runs.iter().flat_map(|&(gap, more)| [gap, more]);
    let mut bytes: Vec<u8> =
        std::iter::once(runs.len() as u32).chain(numbers).flat_map(u32::to_le_bytes).collect();
    for source in sources {
        bytes.extend_from_slice(&(source.len() as u32).to_le_bytes());
        bytes.extend_from_slice(source.as_bytes());
    }
    bytes
}

/// The reverse of [`encode_sources`] in a file of this many objects; `None` if the bytes are invalid.
pub(super) fn decode_sources(bytes: &[u8], objects: u32) -> Option<(Vec<String>, ObjectSet)> {
    let (count, rest) = bytes.split_first_chunk::<4>()?;
    let (runs, mut bytes) = rest.split_at_checked((u32::from_le_bytes(*count) as usize).checked_mul(8)?)?;
    let number = |bytes: &[u8; 4]| u32::from_le_bytes(*bytes);
    let runs = runs.as_chunks::<4>().0.as_chunks::<2>().0.iter().map(|[a, b]| (number(a), number(b)));
    let see_through = ObjectSet::try_from(runs.collect::<Vec<_>>()).ok()?;
    if see_through.runs().last().is_some_and(|run| run.end > objects) {
        return None;
    }
    let mut sources = Vec::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_first_chunk::<4>()?;
        let (name, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        sources.push(std::str::from_utf8(name).ok()?.to_owned());
        bytes = rest;
    }
    Some((sources, see_through))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_round_trip_and_cut_lists_are_refused() {
        let sources = vec!["a.RVM".to_owned(), String::new(), "für.glb".to_owned()];
        let bytes = encode_sources(&sources, &ObjectSet::default());
        let decoded = decode_sources(&bytes, 9);
        assert_eq!(decoded, Some((sources.clone(), ObjectSet::default())));
        for end in [3, 5, bytes.len() - 1] {
            assert_eq!(decode_sources(&bytes[..end], 9), None, "cut at {end}");
        }
        let glass: ObjectSet = [1, 2, 7].into_iter().collect();
        let bytes = encode_sources(&sources, &glass);
        assert_eq!(decode_sources(&bytes, 8), Some((sources, glass)));
        assert_eq!(decode_sources(&bytes, 7), None, "there is no object 7");
        for end in [3, 12, 19, bytes.len() - 1] {
            assert_eq!(decode_sources(&bytes[..end], 8), None, "cut at {end}");
        }
        let mut endless = bytes;
        endless[..4].fill(0xff);
        assert_eq!(decode_sources(&endless, 8), None);
    }
}
