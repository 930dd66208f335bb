//! Encodes arrays as a cooked file: the same arrays always make the same bytes.

use bytemuck::{NoUninit, Zeroable};
use rayon::prelude::*;
use trimaran_proto::ObjectSet;

use super::geometry::GeometryPlace;
use super::layout::{Entry, Firsts, Header, MAGIC, Section, Totals, VERSION};
use super::{Drawable, Extent, Geometry, Node, SceneArrays, SceneError, hierarchy_bytes};
use crate::Overview;

/// The size from which a page of geometry counts as full: reading one piece reads and checks its whole page.
const GEOMETRY_PAGE: usize = 32 << 10;

/// zstd's level: higher ones gain little on pages of this size, and cook longer.
const ZSTD_LEVEL: i32 = 3;

/// Begins a zstd skippable frame; its length follows (RFC 8878, 3.1.2).
const SKIPPED: u32 = 0x184D_2A50;

/// A page: its bytes in the file, and its directory entry.
struct Page {
    bytes: Vec<u8>,
    entry: Entry,
}

/// The bytes of a file of these arrays, whose records are not checked yet.
pub(super) fn encode(mut arrays: SceneArrays) -> Result<Vec<u8>, SceneError> {
    check_counts(&arrays)?;
    set_sums(&mut arrays.nodes);
    set_nodes(&mut arrays);
    let packed = pack(&arrays.geometries)?;
    let (places, geometry) = place(&arrays.geometries, &packed)?;
    let sources = encode_sources(&arrays.sources, &arrays.see_through);
    set_extents(&mut arrays)?;
    let hierarchy = hierarchy_bytes::encode(&arrays)?;
    let mut pages = records(&arrays.nodes, Section::Nodes);
    set_firsts(&mut pages, &arrays.nodes);
    pages.extend(records(&arrays.drawables, Section::Drawables));
    pages.extend(records(&places, Section::Places));
    pages.extend(records(&arrays.objects, Section::Objects));
    let texts = [arrays.names.as_bytes(), &sources, &hierarchy];
    let sections = [Section::Names, Section::Sources, Section::Hierarchy];
    pages.extend(texts.into_iter().zip(sections).map(|(text, section)| Page::packed(text, section)));
    pages.extend(geometry);
    let mut header = Header {
        magic: MAGIC,
        version: VERSION,
        pages: count("pages", pages.len())?,
        file_length: 0,
        directory: 0,
        nodes: arrays.nodes.len() as u32,
        drawables: arrays.drawables.len() as u32,
        geometries: arrays.geometries.len() as u32,
        objects: arrays.objects.len() as u32,
        leaves: arrays.nodes.iter().filter(|node| node.is_leaf()).count() as u32,
        overviews: 0,
        names: arrays.names.len() as u64,
        totals: totals(&arrays),
        fingerprint: [0; 32],
        check: [0; 8],
    };
    drop((arrays, packed));
    let mut end = size_of::<Header>() as u64;
    for page in &mut pages {
        page.entry.offset = end;
        end += u64::from(page.entry.length);
    }
    let directory: Vec<Entry> = pages.iter().map(|page| page.entry).collect();
    header.end_with(&directory, end);
    header.seal(&directory);
    let mut file = Vec::with_capacity(usize::try_from(header.file_length).unwrap_or_default());
    file.extend_from_slice(bytemuck::bytes_of(&header));
    for page in pages {
        file.extend_from_slice(&page.bytes);
    }
    file.extend_from_slice(bytemuck::cast_slice(&directory));
    Ok(file)
}

/// Adds a page with the overview to a file that has none.
pub(super) fn add_overview(
    file: &mut Vec<u8>,
    header: &mut Header,
    directory: &mut Vec<Entry>,
    overview: &Overview,
) {
    let mut page = Page::packed(&overview.encode(), Section::Overview);
    page.entry.offset = header.directory;
    file.truncate(header.directory as usize);
    file.extend_from_slice(&page.bytes);
    directory.push(page.entry);
    (header.pages, header.overviews) = (header.pages + 1, 1);
    header.end_with(directory, file.len() as u64);
    header.seal(directory);
    file.extend_from_slice(bytemuck::cast_slice(directory));
    if let Some(start) = file.first_chunk_mut::<{ size_of::<Header>() }>() {
        start.copy_from_slice(bytemuck::bytes_of(header));
    }
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

fn pack(geometries: &[Geometry]) -> Result<Vec<Vec<u8>>, SceneError> {
    let packed = geometries.par_iter().enumerate().map(|(index, geometry)| {
        geometry.pack().ok_or_else(|| SceneError::Malformed {
            what: "geometry",
            index,
            why: match geometry.check() {
                Some(super::GeometryError::Position(_)) => "a position of it is not finite",
                Some(_) => "one of its indices points past its vertices",
                None => "its indices are not a multiple of three above zero, or its vertices too many",
            },
        })
    });
    packed.collect()
}

/// Puts pieces into pages, in order.
fn place(geometries: &[Geometry], packed: &[Vec<u8>]) -> Result<(Vec<GeometryPlace>, Vec<Page>), SceneError> {
    let (mut places, mut pages, mut open) = (Vec::with_capacity(packed.len()), Vec::new(), Vec::new());
    for (geometry, bytes) in geometries.iter().zip(packed) {
        if !open.is_empty() && open.len() + bytes.len() > GEOMETRY_PAGE {
            pages.push(std::mem::take(&mut open));
        }
        count("bytes of geometry", bytes.len())?;
        places.push(GeometryPlace {
            page: count("pages", pages.len())?,
            offset: count("bytes of a page", open.len())?,
            ..GeometryPlace::alone(geometry, bytes.len())
        });
        open.extend_from_slice(bytes);
    }
    if !open.is_empty() {
        pages.push(open);
    }
    let packed = pages.into_par_iter().map(|page| Page::packed(&page, Section::Geometry));
    Ok((places, packed.collect()))
}

fn records<T: NoUninit + Sync>(records: &[T], section: Section) -> Vec<Page> {
    let pages = records.par_chunks(section.per_page());
    pages.map(|page| Page::packed(bytemuck::cast_slice(page), section)).collect()
}

/// Sets the first numbers of each page of nodes in the directory.
fn set_firsts(pages: &mut [Page], nodes: &[Node]) {
    let mut firsts = Firsts::START;
    for (page, nodes) in pages.iter_mut().zip(nodes.chunks(Section::Nodes.per_page())) {
        page.entry.firsts = firsts;
        firsts = nodes.iter().fold(firsts, Firsts::after);
    }
}

/// The pieces of a node's finest level.
fn finest<'d>(drawables: &'d [Drawable], node: &Node) -> impl Iterator<Item = &'d Drawable> + use<'d> {
    let own = drawables.iter().skip(node.first_drawable as usize).take(node.drawable_count as usize);
    let pieces = own.clone().next().map_or(0, |first| first.pieces.into());
    own.take(pieces)
}

fn totals(arrays: &SceneArrays) -> Totals {
    let leaves = arrays.nodes.par_iter().filter(|node| node.is_leaf());
    let finest = leaves.flat_map_iter(|leaf| finest(&arrays.drawables, leaf));
    let stored = arrays.geometries.par_iter();
    Totals {
        full_detail_triangles: finest.map(|drawable| u64::from(drawable.triangles)).sum(),
        stored_triangles: stored.clone().map(|geometry| geometry.triangles() as u64).sum(),
        stored_vertices: stored.map(|geometry| geometry.vertices.len() as u64).sum(),
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
