use std::ops::Range;
use std::thread;

use bytemuck::{AnyBitPattern, NoUninit, Pod, Zeroable};
use glam::Mat3;

use super::layout::{Entry, Header};
use super::*;
use crate::Rgba8;
use trimaran_proto::ObjectSet;

/// A triangle.
fn triangle() -> Geometry {
    let vertex = |x, y| Vertex::new([x, y, 0.0], Rgba8([9, 8, 7, 255]));
    Geometry { vertices: vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)], indices: vec![0, 1, 2] }
}

fn object(source_index: u32, name_start: u32, name_length: u32) -> ObjectRecord {
    ObjectRecord { source: 0, source_index, name_start, name_length, node: Node::NONE }
}

/// A root with two leaves that share one triangle.
fn two_leaves() -> SceneArrays {
    let node = Node {
        world_max: [4.0, 1.0, 0.0],
        local_max: [4.0, 1.0, 0.0],
        first_child: 1,
        child_count: 2,
        drawable_count: 1,
        ..Node::default()
    };
    let leaf = |x: f64, object: u32| Node {
        world_min: [x, 0.0, 0.0],
        world_max: [x + 1.0, 1.0, 0.0],
        origin: [x, 0.0, 0.0],
        local_max: [1.0, 1.0, 0.0],
        parent: 0,
        first_child: 0,
        child_count: 0,
        first_drawable: object + 1,
        object,
        ..node
    };
    let drawable = Drawable { node: 1, triangles: 1, ..Zeroable::zeroed() };
    SceneArrays {
        nodes: vec![node, leaf(0.0, 0), leaf(3.0, 1)],
        drawables: vec![
            Drawable { error: 0.5, node: 0, ..drawable },
            drawable,
            Drawable { node: 2, ..drawable },
        ],
        geometries: vec![triangle()],
        objects: vec![object(4, 0, 5), object(9, 5, 1)],
        names: "Röhrz".to_owned(),
        sources: vec!["a.RVM".to_owned()],
        see_through: ObjectSet::default(),
        hierarchy: Hierarchy {
            groups: vec![group("a.RVM", None, 0..2), group("/ZONE", Some(0), 1..2)],
            attributes: vec![ObjectAttributes { object: 1, attributes: vec![tag()] }],
        },
    }
}

fn group(name: &str, parent: Option<u32>, objects: Range<u32>) -> Group {
    Group { name: name.into(), parent, objects, attributes: vec![tag()], extent: Extent::default() }
}

fn tag() -> Attribute {
    Attribute { name: "TAG".into(), value: "Röhr".into() }
}

#[test]
fn a_file_has_the_hierarchy_and_what_its_groups_take() {
    let scene = Scene::from_arrays(two_leaves()).unwrap();
    let hierarchy = scene.hierarchy().unwrap();
    assert_eq!(hierarchy.attributes_of(1), [tag()]);
    let zone = &hierarchy.groups[1];
    assert_eq!((&*zone.name, zone.parent, zone.objects.clone()), ("/ZONE", Some(0), 1..2));
    assert_eq!(zone.extent, Extent { min: [3.0, 0.0, 0.0], max: [4.0, 1.0, 0.0], triangles: 1 });
    let all = Extent { min: [0.0; 3], max: [4.0, 1.0, 0.0], triangles: 2 };
    assert_eq!(hierarchy.groups[0].extent, all);

    let mut file = Apart::of(two_leaves());
    file.edit(Section::Hierarchy, 0, |bytes: &mut [u8]| bytes[0] = 9);
    let error = opened(&file.bytes()).unwrap().hierarchy().unwrap_err();
    assert!(matches!(error.cause, ReadCause::Damaged), "{error}");
    let mut arrays = two_leaves();
    arrays.hierarchy.groups[1].objects.end = 3;
    let error = Scene::from_arrays(arrays).unwrap_err().to_string();
    assert!(error.contains("group 1"), "{error}");
}

/// Packed, it has next to no bytes: a small file would take much memory.
#[test]
fn texts_take_memory_by_the_bytes_that_they_have_in_the_file() {
    let mut arrays = two_leaves();
    let long: Arc<str> = "x".repeat(50 << 20).into();
    arrays.hierarchy.groups[0].name = Arc::clone(&long);
    let file = encoded(arrays);
    assert!(file.len() > 1 << 20, "a file that is honest about it has room for it: {} bytes", file.len());
    assert!(opened(&file).unwrap().hierarchy().unwrap().groups[0].name == long);

    let mut small = Apart::new(&file);
    let number = small.number(Section::Hierarchy, 0);
    let unpacked = small.directory[number].unpacked as usize;
    let hierarchy = zstd::bulk::decompress(&small.pages[number], unpacked).unwrap();
    small.replace(Section::Hierarchy, 0, &hierarchy);
    let small = small.bytes();
    assert!(small.len() < 100 << 10, "{}", small.len());
    let error = opened(&small).unwrap().hierarchy().unwrap_err();
    assert!(matches!(error.cause, ReadCause::Damaged), "{error}");
}

/// The nodes of [`tree`].
const TREE: usize = 1 + 8 + 64 + 512 + 4096;

/// A tree of eight children a node and five levels of nodes. Each has a level with a triangle of its own.
fn tree() -> SceneArrays {
    let inner = TREE as u32 - 4096;
    let mut arrays = SceneArrays { sources: vec!["a.RVM".to_owned()], ..SceneArrays::default() };
    for index in 0..TREE as u32 {
        let leaf = index >= inner;
        arrays.nodes.push(Node {
            world_max: [1.0; 3],
            local_max: [1.0; 3],
            parent: index.checked_sub(1).map_or(Node::NONE, |before| before / 8),
            first_child: if leaf { 0 } else { 8 * index + 1 },
            child_count: if leaf { 0 } else { 8 },
            first_drawable: index,
            drawable_count: 1,
            object: if leaf { index - inner } else { Node::NONE },
            ..Node::default()
        });
        if leaf {
            let name = format!("leaf {index}");
            arrays.objects.push(object(index, arrays.names.len() as u32, name.len() as u32));
            arrays.names.push_str(&name);
        }
        let mut geometry = triangle();
        geometry.vertices[1].position[0] = index as f32 / TREE as f32;
        arrays.add_level(index, if leaf { 0.0 } else { 0.5 }, geometry);
    }
    arrays
}

/// The bytes of a file of these arrays, whose records are not checked.
fn encoded(arrays: SceneArrays) -> Vec<u8> {
    encode::encode(arrays).unwrap()
}

fn opened(bytes: &[u8]) -> Result<Scene, OpenError> {
    Scene::open_bytes(Path::new("a.scene"), bytes)
}

/// A file taken apart. Putting it together sets correct lengths and hashes, whatever was changed.
struct Apart {
    header: Header,
    directory: Vec<Entry>,
    /// As stored in the file.
    pages: Vec<Vec<u8>>,
}

impl Apart {
    fn new(bytes: &[u8]) -> Self {
        let header: Header = bytemuck::pod_read_unaligned(&bytes[..size_of::<Header>()]);
        let directory: Vec<Entry> = bytemuck::pod_collect_to_vec(&bytes[header.directory as usize..]);
        let page = |entry: &Entry| bytes[entry.offset as usize..][..entry.length as usize].to_vec();
        Self { header, pages: directory.iter().map(page).collect(), directory }
    }

    fn of(arrays: SceneArrays) -> Self {
        Self::new(&encoded(arrays))
    }

    fn number(&self, section: Section, page: usize) -> usize {
        self.header.pages(section).nth(page).unwrap()
    }

    /// The place of a page in the file.
    fn range(&self, section: Section, page: usize) -> Range<u64> {
        let entry = self.directory[self.number(section, page)];
        entry.offset..entry.offset + u64::from(entry.length)
    }

    fn entry(&mut self, section: Section, page: usize) -> &mut Entry {
        let number = self.number(section, page);
        &mut self.directory[number]
    }

    fn records<T: AnyBitPattern + NoUninit>(&self, section: Section, page: usize) -> Vec<T> {
        let number = self.number(section, page);
        let unpacked = self.directory[number].unpacked as usize;
        bytemuck::pod_collect_to_vec(&zstd::bulk::decompress(&self.pages[number], unpacked).unwrap())
    }

    /// Replaces a page, keeping its declared unpacked length.
    fn replace(&mut self, section: Section, page: usize, unpacked: &[u8]) {
        let number = self.number(section, page);
        self.pages[number] = zstd::bulk::compress(unpacked, 3).unwrap();
    }

    fn edit<T: Pod>(&mut self, section: Section, page: usize, edit: impl FnOnce(&mut [T])) {
        let mut records = self.records(section, page);
        edit(&mut records);
        self.replace(section, page, bytemuck::cast_slice(&records));
    }

    fn nodes(&mut self, edit: impl FnOnce(&mut [Node])) {
        self.edit(Section::Nodes, 0, edit);
    }

    fn drawables(&mut self, edit: impl FnOnce(&mut [Drawable])) {
        self.edit(Section::Drawables, 0, edit);
    }

    fn places(&mut self, edit: impl FnOnce(&mut [GeometryPlace])) {
        self.edit(Section::Places, 0, edit);
    }

    fn objects(&mut self, edit: impl FnOnce(&mut [ObjectRecord])) {
        self.edit(Section::Objects, 0, edit);
    }

    /// Pages one behind the other, then the directory.
    fn lay_out(&mut self) {
        let mut end = size_of::<Header>() as u64;
        for (entry, page) in self.directory.iter_mut().zip(&self.pages) {
            (entry.offset, entry.length) = (end, page.len() as u32);
            end += page.len() as u64;
        }
        self.header.pages = self.directory.len() as u32;
        self.header.directory = end;
        self.header.file_length = end + size_of_val(&*self.directory) as u64;
    }

    /// The file, with right hashes.
    fn seal(mut self) -> Vec<u8> {
        for (entry, page) in self.directory.iter_mut().zip(&self.pages) {
            entry.hash = *blake3::hash(page).as_bytes();
        }
        self.header.seal(&self.directory);
        let directory = bytemuck::cast_slice(&self.directory);
        [bytemuck::bytes_of(&self.header), &self.pages.concat(), directory].concat()
    }

    fn bytes(mut self) -> Vec<u8> {
        self.lay_out();
        self.seal()
    }
}

#[test]
fn a_file_taken_apart_is_put_together_as_it_was() {
    let bytes = encoded(tree());
    assert!(Apart::new(&bytes).bytes() == bytes);
}

fn refusal(change: impl FnOnce(&mut SceneArrays)) -> String {
    let mut arrays = two_leaves();
    change(&mut arrays);
    Scene::from_arrays(arrays).map(|scene| scene.hash()).unwrap_err().to_string()
}

#[test]
fn a_sound_scene_is_accepted_and_names_its_objects() {
    let scene = Scene::from_arrays(two_leaves()).unwrap();
    assert_eq!(scene.object_name(0), Some("Röhr"));
    assert_eq!(scene.object_name(1), Some("z"));
    assert_eq!(scene.object_name(2), None);
    assert_eq!(scene.source_name(0), Some("a.RVM"));
    assert_eq!(scene.source_name(1), None);
    assert!(scene.fault().is_none(), "what is past the end is no fault");
}

#[test]
fn every_broken_rule_is_named_with_its_record() {
    type Change = fn(&mut SceneArrays);
    let cases: [(Change, &str); 31] = [
        (|a| a.nodes.clear(), "the scene has no nodes"),
        (|a| a.nodes[0].parent = 0, "node 0 is malformed: it is the root"),
        (|a| a.nodes[0].first_child = 2, "node 0 is malformed: its children are not next"),
        (|a| a.nodes[0].first_child = 0, "node 0 is malformed: its children are not next"),
        (|a| a.nodes[1].child_count = 1, "node 1 is malformed: its children are not next"),
        (|a| a.nodes[0].child_count = 3, "node 0 is malformed: its children lie past"),
        (|a| a.nodes[0].child_count = 1, "node 2 is malformed: its parent is not"),
        (|a| a.nodes[2].parent = 1, "node 2 is malformed: its parent"),
        (|a| a.nodes[2].parent = 2, "node 2 is malformed: its parent"),
        (|a| a.nodes[2].world_max[0] = 4.5, "node 2 is malformed: its box sticks out"),
        (|a| a.nodes[1].origin[1] = f64::NAN, "node 1 is malformed: its box, origin"),
        (|a| a.nodes[1].local_min[2] = 1.0, "node 1 is malformed: its box has a lower corner"),
        (|a| a.nodes[0].first_drawable = 1, "node 0 is malformed: its levels are not next"),
        (|a| a.nodes[2].first_drawable = 1, "node 2 is malformed: its levels are not next"),
        (|a| a.nodes[2].drawable_count = 2, "node 2 is malformed: its levels lie past"),
        (|a| a.nodes[1].drawable_count = 0, "node 1 is malformed: it is a leaf without"),
        (|a| a.nodes[1].object = 2, "node 1 is malformed: it is a leaf whose object"),
        (|a| a.nodes[0].object = 0, "node 2 is malformed: it is not of the object"),
        (|a| a.nodes[0].object = 2, "node 0 is malformed: its object does not exist"),
        (
            |a| a.nodes[0].linear[0] = 2.0,
            "node 0 is malformed: it stands for several objects, but its matrix",
        ),
        (|a| a.drawables[1].node = 2, "drawable 1 is malformed: its node does not have it"),
        (|a| a.drawables[0].error = f32::NAN, "drawable 0 is malformed: its error is no distance"),
        (|a| a.drawables[0].error = -0.5, "drawable 0 is malformed: its error is no distance"),
        (
            |a| a.drawables[1].error = 0.25,
            "drawable 1 is malformed: it is the finest level of a leaf and has",
        ),
        (|a| a.drawables[2].geometry = 1, "drawable 2 is malformed: its geometry does not exist"),
        (|a| a.drawables[2].triangles = 2, "drawable 2 is malformed: its number of triangles is not that"),
        (
            |a| a.drawables[1].sides = bytemuck::cast(1_u32 << 24),
            "drawable 1 is malformed: which sides of its triangles show",
        ),
        (|a| a.objects[1].name_start = 2, "object 1 is malformed: its name is not a range"),
        (|a| a.objects[1].name_length = 2, "object 1 is malformed: its name is not a range"),
        (|a| a.objects[1].source = 1, "object 1 is malformed: its source file does not exist"),
        (
            |a| a.drawables.push(a.drawables[0]),
            "drawable 3 is malformed: its node does not have it among its levels",
        ),
    ];
    for (change, expected) in cases {
        let message = refusal(change);
        assert!(message.starts_with(expected), "expected {expected:?}, got {message:?}");
    }
}

#[test]
fn geometry_that_cannot_be_packed_is_named() {
    type Change = fn(&mut Geometry);
    let cases: [(Change, &str); 5] = [
        (|g| g.indices[2] = 3, "one of its indices points past its vertices"),
        (|g| g.vertices[1].position[0] = f32::INFINITY, "a position of it is not finite"),
        (|g| g.indices.truncate(2), "its indices are not a multiple of three above zero, or"),
        (|g| g.indices.clear(), "its indices are not a multiple of three above zero, or"),
        (|g| g.vertices.push(g.vertices[0]), "its indices are not a multiple of three above zero, or"),
    ];
    for (change, why) in cases {
        let message = refusal(|a| {
            a.geometries.push(triangle());
            change(&mut a.geometries[1]);
        });
        assert!(message.starts_with(&format!("geometry 1 is malformed: {why}")), "{why:?}: {message:?}");
    }
}

/// Rules for fields that [`Scene::from_arrays`] computes itself.
#[test]
fn every_rule_that_only_a_file_can_break_is_named_with_its_record() {
    type Change = fn(&mut Apart);
    let outside = "geometry 0 is malformed: it lies outside of the file";
    let cases: [(Change, &str); 10] = [
        (|f| f.nodes(|n| n[1].reach = 1.0), "node 1 is malformed: its vertices reach farther than it says"),
        (
            |f| f.nodes(|n| n[0].reach = f32::NAN),
            "node 0 is malformed: its vertices reach farther than it says",
        ),
        (
            |f| f.nodes(|n| n[2].reach = 99.0),
            "node 2 is malformed: its vertices reach farther than its parent's",
        ),
        (|f| f.places(|p| p[0].length += 1), outside),
        (|f| f.places(|p| p[0].offset = u32::MAX), outside),
        (|f| f.places(|p| p[0].page = 1), outside),
        (|f| f.objects(|o| o[1].node = 3), "object 1 is malformed: its node does not exist"),
        (
            |f| {
                f.places(|p| p[0].triangles = 0);
                f.drawables(|d| d.iter_mut().for_each(|d| d.triangles = 0));
            },
            "drawable 0 is malformed: its number of triangles is not that of its geometry",
        ),
        (
            |f| f.header.leaves = 3,
            "node 2 is malformed: the leaves up to it are not as many as the directory says",
        ),
        (|f| f.objects(|o| o[1].node = Node::NONE), ""),
    ];
    for (change, expected) in cases {
        let mut file = Apart::of(two_leaves());
        change(&mut file);
        let refused = opened(&file.bytes()).map_err(|error| match error {
            OpenError::Read(error) => error,
            other => panic!("expected {expected:?}, got {other}"),
        });
        match refused.and_then(|scene| scene.check()) {
            Ok(()) => assert_eq!(expected, ""),
            Err(ReadError { cause: ReadCause::Malformed(error), .. }) => {
                assert_eq!(error.to_string(), expected);
            }
            Err(other) => panic!("expected {expected:?}, got {other}"),
        }
    }
}

/// The directory has the first children and levels of each page, by which a page is checked.
#[test]
fn a_directory_that_says_other_firsts_is_found_by_the_page_before_and_the_page_itself() {
    let refused = |change: fn(&mut Entry)| {
        let mut file = Apart::of(tree());
        change(file.entry(Section::Nodes, 1));
        opened(&file.bytes()).unwrap_err().to_string()
    };
    let message = refused(|entry| entry.firsts.child += 1);
    assert!(message.contains("(nodes 0 to 255)"), "{message}");
    let message = refused(|entry| entry.firsts.drawable += 1);
    assert!(message.contains("(nodes 0 to 255)"), "{message}");
    let mut file = Apart::of(tree());
    file.entry(Section::Nodes, 3).firsts.leaf += 1;
    let message = opened(&file.bytes()).unwrap_err().to_string();
    assert!(message.contains("(nodes 512 to 767)"), "{message}");

    // Without the page before it, like a lazy reader that starts there.
    let mut file = Apart::of(tree());
    file.entry(Section::Nodes, 18).firsts.drawable -= 1;
    let scene = opened(&file.bytes()).unwrap();
    assert_eq!(scene.nodes().get(TREE - 1), None);
    let ReadCause::Malformed(error) = &scene.fault().unwrap().cause else { panic!("{:?}", scene.fault()) };
    assert_eq!(
        error.to_string(),
        "node 4608 is malformed: its levels are not next to those of the node before it"
    );
}

#[test]
fn errors_never_fall_from_node_to_parent() {
    let message = refusal(|a| {
        a.drawables.push(Drawable { error: 0.75, ..a.drawables[2] });
        a.nodes[2].drawable_count = 2;
    });
    assert_eq!(
        message,
        "drawable 0 is malformed: its error is below that of a finer level, or of a node below its own"
    );
}

#[test]
fn errors_never_fall_from_a_level_to_the_next() {
    let message = refusal(|a| {
        a.drawables.push(Drawable { error: 0.5, ..a.drawables[2] });
        a.drawables.push(Drawable { error: 0.25, ..a.drawables[2] });
        a.nodes[2].drawable_count = 3;
    });
    assert_eq!(
        message,
        "drawable 4 is malformed: its error is below that of a finer level, or of a node below its own"
    );
}

/// A root, `count` nodes below it and a leaf below each of those.
fn a_leaf_below_each_of(count: u32) -> SceneArrays {
    let mut arrays = two_leaves();
    let (root, leaf) = (arrays.nodes[0], arrays.nodes[1]);
    let middle = Node { parent: 0, drawable_count: 0, ..root };
    arrays.nodes = vec![Node { child_count: count, ..root }];
    arrays.drawables.truncate(1);
    let inner = (1..=count).map(|node| Node { first_child: count + node, child_count: 1, ..middle });
    arrays.nodes.extend(inner);
    for parent in 1..=count {
        arrays.nodes.push(Node { parent, first_drawable: parent, ..leaf });
        arrays.drawables.push(Drawable { error: 0.0, node: count + parent, ..arrays.drawables[0] });
    }
    arrays
}

/// Each page of records is checked alone; this tests its relations to other pages.
#[test]
fn rules_between_far_nodes_are_checked() {
    let page = Section::Nodes.per_page() as u32;
    let sound = || a_leaf_below_each_of(12 * page - 1);
    assert!(Scene::from_arrays(sound()).is_ok());
    let refusal = |arrays| Scene::from_arrays(arrays).unwrap_err().to_string();

    // The children of one whole page of nodes change places with those of the next.
    let mut arrays = sound();
    for node in page..2 * page {
        let (a, b) = (node as usize, (node + page) as usize);
        let (below_a, below_b) = (arrays.nodes[a].first_child, arrays.nodes[b].first_child);
        arrays.nodes[a].first_child = below_b;
        arrays.nodes[b].first_child = below_a;
        arrays.nodes[below_a as usize].parent = node + page;
        arrays.nodes[below_b as usize].parent = node;
    }
    assert_eq!(refusal(arrays), "node 256 is malformed: its children are not next in breadth-first order");

    // A box that exceeds that of a node many pages before it.
    let last = sound().nodes.len() - 1;
    let mut arrays = sound();
    arrays.nodes[last].world_min[0] = -1.0;
    assert_eq!(refusal(arrays), format!("node {last} is malformed: its box sticks out of its parent's"));

    // The last leaf's coarser level is worse than the root's, and the node between them has no level.
    let mut arrays = sound();
    arrays.nodes[last].drawable_count = 2;
    arrays.drawables.push(Drawable { error: 0.75, node: last as u32, ..arrays.drawables[0] });
    let message = refusal(arrays);
    assert!(message.starts_with("drawable 0 is malformed: its error is below that"), "{message}");

    // The first level on a page is better than the one before it, the last on the page before.
    let mut arrays = sound();
    let node = arrays.drawables[1023].node as usize;
    arrays.nodes[node].drawable_count = 3;
    arrays.nodes[node + 1..].iter_mut().for_each(|node| node.first_drawable += 2);
    let level = arrays.drawables[1022];
    assert_eq!(level.node as usize, node - 1);
    let levels = [0.4, 0.3].map(|error| Drawable { error, node: node as u32, ..level });
    arrays.drawables.splice(1024..1024, levels);
    let message = refusal(arrays);
    assert!(message.starts_with("drawable 1025 is malformed: its error is below that"), "{message}");

    // A drawable that no node has.
    let mut arrays = sound();
    arrays.drawables.push(arrays.drawables[0]);
    assert_eq!(refusal(arrays), "drawable 3072 is malformed: its node does not have it among its levels");
}

#[test]
fn what_depends_on_the_nodes_below_is_worked_out() {
    let mut arrays = two_leaves();
    // In its own frame a leaf may reach farther than the nodes above it do in theirs.
    arrays.nodes[2].linear = (Mat3::IDENTITY * 8.0).to_cols_array();
    for node in &mut arrays.nodes {
        (node.reach, node.objects) = (f32::NAN, 77);
    }
    arrays.objects.push(object(1, 0, 0));
    arrays.objects.iter_mut().for_each(|object| object.node = 99);
    let scene = Scene::from_arrays(arrays).unwrap();
    let reach: Vec<f32> = scene.nodes().iter().map(|node| node.reach).collect();
    let (near, far) = (2.0_f32.sqrt(), 128.0_f32.sqrt());
    for (found, least) in reach.iter().zip([far, near, far]) {
        assert!(*found >= least && *found <= least * 1.000_001, "{found} for {least}");
    }
    assert_eq!(reach[0], reach[2]);
    let counts: Vec<u32> = scene.nodes().iter().map(|node| node.objects).collect();
    assert_eq!(counts, [2, 1, 1]);
    let nodes: Vec<u32> = scene.objects().iter().map(|object| object.node).collect();
    assert_eq!(nodes, [1, 2, Node::NONE], "the last one has no triangles");
}

#[test]
fn parts_of_an_object_are_one_object_whose_node_is_the_whole() {
    let mut arrays = two_leaves();
    arrays.nodes.iter_mut().for_each(|node| node.object = 1);
    let scene = Scene::from_arrays(arrays).unwrap();
    assert!(scene.nodes().iter().all(|node| node.objects == 1));
    assert_eq!((scene.objects()[0].node, scene.objects()[1].node), (Node::NONE, 0));
}

#[test]
fn leaves_are_found_by_their_numbers() {
    let mut arrays = tree();
    // A leaf among the inner nodes: the 512 last nodes become 504, and each of the page's starts moves.
    let gone = arrays.nodes.len() - 8..arrays.nodes.len();
    arrays.nodes.truncate(gone.start);
    arrays.drawables.truncate(gone.start);
    let last = 584;
    (arrays.nodes[last].child_count, arrays.nodes[last].object) = (0, 9);
    arrays.drawables[last].error = 0.0;
    let leaves: Vec<u32> = (0..).zip(&arrays.nodes).filter(|(_, n)| n.is_leaf()).map(|(id, _)| id).collect();
    assert_eq!((leaves.len(), leaves[0], leaves[1]), (4089, 584, 585));
    let bytes = encoded(arrays);
    let scene = opened(&bytes).unwrap();
    assert_eq!(scene.leaf_count(), 4089);
    for (number, id) in (0..).zip(leaves) {
        let (NodeId(found), node) = scene.leaf(number).unwrap();
        assert!(
            found == id && std::ptr::eq(node, &scene.nodes()[id as usize]),
            "leaf {number}: node {found}"
        );
    }
    for past in [4089, 4090, u32::MAX] {
        assert!(scene.leaf(past).is_none());
    }
    // A page far from all loaded ones is loaded with those of its ancestors.
    let scene = opened(&bytes).unwrap();
    let before = scene.resident_bytes();
    assert!(scene.leaf(4088).is_some());
    let page = (Section::Nodes.per_page() * size_of::<Node>()) as u64;
    assert!(scene.resident_bytes() - before <= 3 * page);
}

#[test]
fn totals_count_instances_each_and_what_is_stored_once() {
    let totals = Scene::from_arrays(two_leaves()).unwrap().totals();
    assert_eq!(totals, Totals { full_detail_triangles: 2, stored_triangles: 1, stored_vertices: 3 });
    let totals = Scene::from_arrays(tree()).unwrap().totals();
    let stored = TREE as u64;
    let expected =
        Totals { full_detail_triangles: 4096, stored_triangles: stored, stored_vertices: 3 * stored };
    assert_eq!(totals, expected);
}

/// A folder of its own with the scene in it, and the scene's bytes.
fn saved(arrays: SceneArrays) -> (tempfile::TempDir, std::path::PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scene");
    Scene::from_arrays(arrays).unwrap().save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (folder, path, bytes)
}

#[test]
fn a_saved_scene_opens_as_it_was() {
    for arrays in [two_leaves(), tree()] {
        let (folder, path, _) = saved(arrays.clone());
        let before = Scene::from_arrays(arrays.clone()).unwrap();
        let after = Scene::open(&path).unwrap();
        assert_eq!(after.check().map_err(|error| error.to_string()), Ok(()));
        // Node and object records have computed fields.
        assert_eq!(after.nodes(), before.nodes());
        let plain = |node: &Node| Node { reach: 0.0, objects: 0, depth: 0, ..*node };
        assert!(after.nodes().iter().map(plain).eq(arrays.nodes.iter().map(plain)));
        assert_eq!(after.objects(), before.objects());
        let plain = |object: &ObjectRecord| ObjectRecord { node: 0, ..*object };
        assert!(after.objects().iter().map(plain).eq(arrays.objects.iter().map(plain)));
        assert_eq!(after.drawables().to_vec(), arrays.drawables);
        assert_eq!(after.places(), before.places());
        let mut reader = after.reader();
        for (number, geometry) in arrays.geometries.iter().enumerate().rev() {
            assert_eq!(&reader.read(number as u32).unwrap(), geometry, "{number}");
        }
        for (index, object) in (0..).zip(&arrays.objects) {
            assert_eq!(after.object_name(index), arrays.name_of(object));
        }
        assert_eq!(after.sources(), arrays.sources);
        assert_eq!(after.hash(), before.hash());
        assert_eq!(after.totals(), before.totals());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }
}

#[test]
fn an_older_scene_is_replaced_whole_while_it_is_open() {
    let (_folder, path, _) = saved(two_leaves());
    let old = Scene::open(&path).unwrap();
    let mut arrays = two_leaves();
    arrays.geometries[0].vertices[1].position[0] = 0.5;
    Scene::from_arrays(arrays).unwrap().save(&path).unwrap();
    let x = |scene: &Scene| scene.geometry(0).unwrap().vertices[1].position[0];
    assert_eq!(x(&old), 1.0);
    assert_eq!(x(&Scene::open(&path).unwrap()), 0.5);
}

#[test]
fn the_same_arrays_make_the_same_bytes_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| saved(tree()).2)
    };
    let bytes = on(1);
    assert!(bytes == on(4));
    assert!(bytes == encoded(tree()), "what is saved is what was encoded");
    // Saved again by the process that opened it.
    let (_folder, path, _) = saved(two_leaves());
    opened(&bytes).unwrap().save(&path).unwrap();
    assert!(std::fs::read(&path).unwrap() == bytes);
}

#[test]
fn the_fingerprint_changes_with_every_record_vertex_and_name() {
    type Change = fn(&mut SceneArrays);
    let changes: [Change; 13] = [
        |_| (),
        |a| a.nodes[2].world_min[2] = -0.0,
        |a| a.nodes[1].linear[4] = 0.5,
        |a| a.drawables[0].error = 0.75,
        |a| a.drawables[1].sides = Sides::BOTH,
        |a| a.geometries[0].vertices[2].position[1] = 0.5,
        |a| a.geometries[0].vertices[2].colour = Rgba8([9, 8, 7, 254]),
        |a| a.geometries[0].vertices[0].normal = Normal([1, 2]),
        |a| a.geometries[0].indices = vec![1, 2, 0],
        |a| a.geometries.push(triangle()),
        |a| a.objects[0].source_index = 5,
        |a| a.names = "Röhry".to_owned(),
        |a| a.sources[0].push('x'),
    ];
    let hashes: Vec<_> = changes
        .iter()
        .map(|change| {
            let mut arrays = two_leaves();
            change(&mut arrays);
            Scene::from_arrays(arrays).unwrap().hash()
        })
        .collect();
    for (index, hash) in hashes.iter().enumerate() {
        assert_eq!(hashes.iter().position(|other| other == hash), Some(index), "change {index} shows");
    }
    assert_eq!(hashes[0], Scene::from_arrays(two_leaves()).unwrap().hash());
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let (_folder, path, bytes) = saved(two_leaves());
    for length in 0..bytes.len() {
        std::fs::write(&path, &bytes[..length]).unwrap();
        match Scene::open(&path) {
            Err(OpenError::Truncated { actual, .. }) if actual == length as u64 => {}
            other => panic!("cut to {length}: {other:?}"),
        }
    }
    std::fs::write(&path, [&bytes[..], b"x"].concat()).unwrap();
    let message = Scene::open(&path).unwrap_err().to_string();
    assert!(message.contains("longer than it was when written"), "{message}");
}

/// Every byte is covered: the header's by itself, the directory's by the fingerprint, and each page's by the
/// directory.
#[test]
fn a_flipped_bit_anywhere_is_refused_or_is_a_fault_where_it_is() {
    let bytes = encoded(two_leaves());
    let pages = size_of::<Header>()..Apart::new(&bytes).header.directory as usize;
    let (mut at_open, mut later) = (0, 0);
    for index in 0..bytes.len() {
        for bit in [0x01, 0x10, 0x80] {
            let mut broken = bytes.clone();
            broken[index] ^= bit;
            match opened(&broken) {
                Err(OpenError::Foreign { .. }) => assert!(index < 8),
                Err(OpenError::Version { .. }) => assert!((8..12).contains(&index)),
                Err(OpenError::Damaged { .. }) => assert!(!pages.contains(&index), "byte {index}"),
                Err(OpenError::Read(fault)) => {
                    assert!(matches!(fault.cause, ReadCause::Damaged), "byte {index}: {fault}");
                    assert!(fault.bytes.contains(&(index as u64)), "byte {index}: {fault}");
                    at_open += 1;
                }
                Err(other) => panic!("byte {index}: {other}"),
                Ok(scene) => {
                    let fault = scene.check().unwrap_err();
                    assert!(matches!(fault.cause, ReadCause::Damaged), "byte {index}: {fault}");
                    assert!(fault.bytes.contains(&(index as u64)), "byte {index}: {fault}");
                    later += 1;
                }
            }
        }
    }
    assert_eq!(at_open + later, 3 * pages.len());
    // Opening a small scene reads nodes, drawables, places, and the sources.
    let file = Apart::new(&bytes);
    let lazy = [Section::Objects, Section::Names, Section::Hierarchy, Section::Geometry]
        .map(|section| file.range(section, 0));
    assert_eq!(later, 3 * lazy.iter().map(|range| (range.end - range.start) as usize).sum::<usize>());
}

#[test]
fn foreign_and_newer_files_are_told_apart() {
    let (_folder, path, mut bytes) = saved(two_leaves());
    bytes[8] = 200;
    std::fs::write(&path, &bytes).unwrap();
    let message = Scene::open(&path).unwrap_err().to_string();
    assert!(message.contains("format 200") && message.contains("use a newer build"), "{message}");
    bytes[8] = 1;
    std::fs::write(&path, &bytes).unwrap();
    let message = Scene::open(&path).unwrap_err().to_string();
    assert!(message.contains("format 1,") && message.contains("import again with this build"), "{message}");

    std::fs::write(&path, b"glTF, not a scene").unwrap();
    let message = Scene::open(&path).unwrap_err().to_string();
    assert!(message.contains("is not a cooked scene"), "{message}");

    let message = Scene::open(&path.with_extension("none")).unwrap_err().to_string();
    assert!(message.contains("cannot read"), "{message}");
}

#[test]
fn a_well_written_file_of_a_malformed_scene_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.scene");
    let mut arrays = two_leaves();
    arrays.drawables[2].geometry = 1;
    std::fs::write(&path, encoded(arrays)).unwrap();
    match Scene::open(&path) {
        Err(OpenError::Read(ReadError {
            cause: ReadCause::Malformed(SceneError::Malformed { what: "drawable", index: 2, .. }),
            path: named,
            ..
        })) => assert_eq!(named, path),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_directory_that_does_not_go_with_the_header_is_refused() {
    type Change = fn(&mut Apart);
    let changes: [(Change, &str); 13] = [
        (|f| f.header.nodes = 4, "does not go with"),
        (|f| f.header.nodes = u32::MAX, "does not go with"),
        (|f| f.header.drawables = 0, "does not go with"),
        (|f| f.header.geometries = 1025, "does not go with"),
        (|f| f.header.objects = u32::MAX, "does not go with"),
        (|f| f.header.names = u64::MAX, "does not go with"),
        (|f| f.directory[0].unpacked -= 1, "does not go with"),
        (|f| f.directory[0].firsts.child = 0, "does not go with"),
        (|f| f.directory[1].offset = f.directory[0].offset, "does not go with"),
        (|f| f.directory[1].offset = u64::MAX, "does not go with"),
        (|f| f.directory[6].length = u32::MAX, "does not go with"),
        (|f| f.header.pages -= 1, "directory does not end it"),
        (|f| f.header.directory = u64::MAX, "directory does not end it"),
    ];
    for (number, (change, expected)) in changes.into_iter().enumerate() {
        let mut file = Apart::of(two_leaves());
        file.lay_out();
        change(&mut file);
        match opened(&file.seal()) {
            Err(OpenError::Damaged { what, .. }) => assert!(what.contains(expected), "{number}: {what}"),
            other => panic!("{number}: {other:?}"),
        }
    }
    let mut file = Apart::of(tree());
    file.entry(Section::Nodes, 3).firsts.child = 2;
    let refused = opened(&file.bytes()).unwrap_err().to_string();
    assert!(refused.contains("does not go with"), "{refused}");
}

#[test]
fn a_page_that_unpacks_to_more_or_less_than_it_says_is_damaged() {
    let names = |unpacked: &[u8], says: u32| {
        let mut file = Apart::of(two_leaves());
        file.replace(Section::Names, 0, unpacked);
        file.entry(Section::Names, 0).unpacked = says;
        file.header.names = u64::from(says);
        let range = {
            file.lay_out();
            file.range(Section::Names, 0)
        };
        let scene = opened(&file.bytes()).unwrap();
        match scene.check() {
            Ok(()) => true,
            Err(ReadError { bytes, what, cause: ReadCause::Damaged, .. }) => {
                assert_eq!((bytes, what.as_str()), (range, "names"));
                assert_eq!(scene.object_name(0), None);
                assert!(scene.fault().is_some());
                false
            }
            Err(other) => panic!("{other}"),
        }
    };
    let right = "Röhrz".as_bytes();
    assert!(names(right, 6));
    assert!(!names(right, 7));
    assert!(!names(&[right, b"x"].concat(), 6));
    assert!(!names(b"R\xffhrzz", 6), "no UTF-8");
    // Two gigabytes out of a few bytes: such memory is not allocated.
    assert!(!names(right, 1 << 31));
    // Sixteen megabytes out of about a thousand bytes, were they unpacked.
    assert!(!names(&[b'x'; 1 << 24], 1 << 24));
}

#[test]
fn a_name_that_ends_within_a_character_is_a_fault() {
    let mut file = Apart::of(two_leaves());
    file.replace(Section::Names, 0, "Rohr\u{e9}".as_bytes());
    let bytes = file.bytes();
    let expected = "object 0 is malformed: its name is not a range of whole characters of the names";
    let scene = opened(&bytes).unwrap();
    assert_eq!(scene.object_name(0), None);
    let asked = scene.fault().unwrap();
    let checked = opened(&bytes).unwrap().check().unwrap_err();
    for fault in [asked, &checked] {
        let ReadCause::Malformed(error) = &fault.cause else { panic!("{fault}") };
        assert_eq!((error.to_string().as_str(), fault.what.as_str()), (expected, "names"));
    }
}

#[test]
fn sources_that_are_no_list_are_refused_at_open() {
    let mut file = Apart::of(two_leaves());
    file.edit(Section::Sources, 0, |bytes: &mut [u8]| bytes[0] = 6);
    match opened(&file.bytes()) {
        Err(OpenError::Read(ReadError { what, cause: ReadCause::Damaged, .. })) => {
            assert_eq!(what, "names of sources");
        }
        other => panic!("{other:?}"),
    }
}

/// zstd packs all-equal names very tightly.
#[test]
fn names_that_are_all_alike_are_saved_and_read() {
    let name = "Rohr".repeat(1 << 20);
    let mut arrays = two_leaves();
    arrays.objects[1] = object(9, 0, name.len() as u32);
    arrays.names.clone_from(&name);
    let (_folder, path, bytes) = saved(arrays);
    assert!(bytes.len() < 4000, "{} bytes", bytes.len());
    let scene = Scene::open(&path).unwrap();
    assert!(scene.object_name(1) == Some(&name));
    assert_eq!(scene.object_name(0), Some("RohrR"));
}

/// Nodes with only one child each.
fn a_chain_of(count: u32) -> SceneArrays {
    let mut arrays = two_leaves();
    let (root, leaf) = (arrays.nodes[0], arrays.nodes[1]);
    let link = |index: u32| Node {
        parent: index.checked_sub(1).unwrap_or(Node::NONE),
        first_child: index + 1,
        child_count: 1,
        drawable_count: u32::from(index == 0),
        ..root
    };
    arrays.nodes = (0..count - 1).map(link).collect();
    arrays.nodes.push(Node { parent: count - 2, ..leaf });
    arrays.drawables = vec![arrays.drawables[0], Drawable { node: count - 1, ..arrays.drawables[1] }];
    arrays
}

#[test]
fn a_tree_is_as_deep_as_it_may_be_and_no_deeper() {
    let deepest = Scene::from_arrays(a_chain_of(Node::DEEPEST + 1)).unwrap();
    assert_eq!(deepest.nodes()[Node::DEEPEST as usize].depth, Node::DEEPEST);
    let message = Scene::from_arrays(a_chain_of(Node::DEEPEST + 2)).unwrap_err().to_string();
    assert_eq!(message, "node 1025 is malformed: it is deeper in the tree than any may be");
}

/// A page needs the one before it, and no stack is deep enough for all.
#[test]
fn a_hostile_chain_of_nodes_is_refused_from_its_end() {
    let bytes = encoded(a_chain_of(200_000));
    // Reads the second drawable, which in turn reads its node, the last.
    let read = move || opened(&bytes).map(|scene| scene.hash()).unwrap_err();
    let error = thread::Builder::new().stack_size(128 << 10).spawn(read).unwrap().join().unwrap();
    let OpenError::Read(ReadError { cause: ReadCause::Malformed(error), .. }) = error else {
        panic!("{error}");
    };
    assert_eq!(error.to_string(), "node 1025 is malformed: it is deeper in the tree than any may be");
}

#[test]
fn sums_that_are_not_those_of_the_records_are_found_by_a_check() {
    let mut file = Apart::of(two_leaves());
    file.header.totals.stored_vertices += 1;
    let error = opened(&file.bytes()).unwrap().check().unwrap_err();
    let ReadCause::Malformed(error) = &error.cause else { panic!("{error}") };
    assert_eq!(error.to_string(), "header 0 is malformed: its sums are not those of its records");
}

#[test]
fn records_are_there_up_to_the_last_and_no_farther() {
    let arrays = tree();
    let scene = Scene::from_arrays(arrays.clone()).unwrap();
    let drawables = scene.drawables();
    assert_eq!(drawables.len(), TREE);
    assert!(!drawables.is_empty());
    assert_eq!(drawables.first(), Some(&arrays.drawables[0]));
    assert_eq!(drawables.get(TREE - 1), arrays.drawables.last());
    for past in [TREE, TREE + 1, 5 << 10, usize::MAX] {
        assert_eq!(drawables.get(past), None, "{past}");
    }
    // Across the end of a page, and past the last one.
    assert!(drawables.range(1000..1050).eq(&arrays.drawables[1000..1050]));
    assert!(drawables.range(TREE - 2..TREE + 2).eq(&arrays.drawables[TREE - 2..]));
    assert!(drawables.iter().rev().eq(arrays.drawables.iter().rev()));
    assert_eq!(drawables[1024], arrays.drawables[1024]);
    assert!(scene.fault().is_none());
    let missing = scene.geometry(TREE as u32).unwrap_err();
    assert!(missing.to_string().contains("(geometry 4681)"), "{missing}");
}

#[test]
fn opening_reads_the_top_and_more_when_it_is_asked_for() {
    let arrays = tree();
    let objects = arrays.objects.len() * size_of::<ObjectRecord>();
    let all = TREE * (size_of::<Node>() + size_of::<Drawable>() + size_of::<GeometryPlace>()) + objects;
    let scene = opened(&encoded(arrays.clone())).unwrap();
    let top = scene.resident_bytes();
    assert!(top > 0 && top < all as u64 / 4, "{top} of {all} bytes are read at once");
    // Loaded pages take nothing more.
    assert!(scene.nodes().get(255).is_some());
    assert_eq!(scene.resident_bytes(), top);

    // A leaf at the end: its page, and those of its ancestors.
    assert!(scene.nodes().get(TREE - 1).is_some_and(|node| node.object == 4095));
    let page = (Section::Nodes.per_page() * size_of::<Node>()) as u64;
    let grown = scene.resident_bytes() - top;
    assert!((1..=3 * page).contains(&grown), "{grown} bytes for one leaf");
    assert_eq!(scene.object_name(4095), Some("leaf 4680"));
    assert!(scene.resident_bytes() < all as u64 / 2);

    assert_eq!(scene.check().map_err(|error| error.to_string()), Ok(()));
    assert_eq!(scene.resident_bytes(), all as u64);
}

#[test]
fn what_is_read_ahead_is_what_was_asked_for() {
    let arrays = tree();
    let scene = opened(&encoded(arrays.clone())).unwrap();
    let before = scene.resident_bytes();
    // Two pages, the second of which is the last. The nodes above them were read at open.
    let numbers = [4352, 4400, TREE - 1, 4607, TREE + 500, usize::MAX];
    assert!(scene.nodes().read_ahead(numbers.into_iter()));
    assert!(!scene.nodes().read_ahead(numbers.into_iter()), "all of them were read");
    let page = |first: usize| TREE.min(first + 256) - first;
    let read = (page(4352) + page(4608)) * size_of::<Node>();
    assert_eq!(scene.resident_bytes() - before, read as u64);
    assert_eq!(scene.nodes().get(4352).map(|node| node.first_drawable), Some(4352));
    assert_eq!(scene.resident_bytes() - before, read as u64);
    assert!(scene.fault().is_none());
}

#[test]
fn all_threads_that_ask_at_once_find_the_same() {
    let arrays = tree();
    let bytes = encoded(arrays.clone());
    let expected = Scene::from_arrays(arrays).unwrap();
    for round in 0..20 {
        let scene = opened(&bytes).unwrap();
        let numbers: Vec<usize> = (0..TREE).map(|index| (index * 1009 + round) % TREE).collect();
        numbers.par_iter().for_each(|&index| {
            assert_eq!(scene.nodes().get(index), expected.nodes().get(index));
            assert_eq!(scene.drawables().get(index), expected.drawables().get(index));
        });
        assert!(scene.fault().is_none());
    }
}

/// The tree saved, with the byte in the middle of a page flipped; and where the page lies.
fn damaged(section: Section, page: usize) -> (tempfile::TempDir, std::path::PathBuf, Range<u64>) {
    let (folder, path, mut bytes) = saved(tree());
    let range = Apart::new(&bytes).range(section, page);
    bytes[u64::midpoint(range.start, range.end) as usize] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    (folder, path, range)
}

#[test]
fn a_damaged_page_of_nodes_is_a_fault_once_one_of_them_is_asked_for() {
    let (_folder, path, range) = damaged(Section::Nodes, 17);
    let scene = Scene::open(&path).unwrap();
    let before = scene.nodes().get(4700 - 349).copied();
    assert!(before.is_some_and(|node| node.object == 4351 - 585), "the last one before the page");
    assert!(scene.fault().is_none(), "nobody has asked for one of the page");

    assert_eq!(scene.nodes().get(4352), None);
    let fault = scene.fault().unwrap();
    assert_eq!((&fault.path, &fault.bytes), (&path, &range));
    assert_eq!(fault.what, "nodes 4352 to 4607");
    assert!(matches!(fault.cause, ReadCause::Damaged));
    let message = fault.to_string();
    for part in [
        "a.scene",
        &format!("bytes {} to {}", range.start, range.end),
        "nodes 4352 to 4607",
        "copy it again, or import again",
    ] {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
    assert_eq!(scene.nodes().get(4351).copied(), before, "what was read stays");
    assert_eq!(scene.check().unwrap_err().bytes, range);
}

#[test]
fn a_fault_stays_the_first_one() {
    let (_folder, path, first) = damaged(Section::Nodes, 17);
    let mut bytes = std::fs::read(&path).unwrap();
    let names = Apart::new(&bytes).range(Section::Names, 0);
    bytes[names.start as usize + 9] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let scene = Scene::open(&path).unwrap();
    assert_eq!(scene.object_name(0), None);
    assert_eq!(scene.fault().unwrap().bytes, names);
    assert_eq!(scene.nodes().get(4352), None);
    assert_eq!(scene.fault().unwrap().bytes, names);
    // In another order.
    let scene = Scene::open(&path).unwrap();
    assert_eq!(scene.nodes().get(4352), None);
    assert_eq!(scene.object_name(0), None);
    assert_eq!(scene.fault().unwrap().bytes, first);
}

#[test]
fn a_fault_is_of_those_threads_that_asked_for_it_and_the_rest_of_the_scene_is_read_on() {
    let (_folder, path, range) = damaged(Section::Nodes, 17);
    let scene = Scene::open(&path).unwrap();
    let asks = |numbers: &[usize], ahead: bool| {
        thread::scope(|scope| {
            let ask = scope.spawn(|| {
                if ahead {
                    scene.nodes().read_ahead(numbers.iter().copied());
                }
                let found = numbers.iter().filter(|number| scene.nodes().get(**number).is_some()).count();
                (found, scene.fault_here().map(|fault| fault.bytes))
            });
            ask.join().unwrap()
        })
    };
    assert_eq!(asks(&[0, 300], false), (2, None));
    assert_eq!(asks(&[4352, 0], false), (1, Some(range.clone())));
    assert_eq!(asks(&[600, 900], false), (2, None), "pages that were not read before");
    assert_eq!(asks(&[4352], false), (0, Some(range.clone())), "whoever comes later is told as well");
    assert_eq!(asks(&[1200, 1500], true), (2, None));
    assert_eq!(asks(&[1800, 4353, 2100], true), (2, Some(range.clone())), "read by other threads");
    let other = Scene::open_bytes(Path::new("other"), &Apart::of(two_leaves()).bytes()).unwrap();
    assert_eq!(scene.nodes().get(4352), None);
    assert!(scene.fault_here().is_some() && other.fault_here().is_none(), "scenes are told apart");
    assert_eq!(scene.fault().unwrap().bytes, range);
}

#[test]
fn a_damaged_top_is_refused_at_open() {
    for section in [Section::Nodes, Section::Drawables, Section::Sources] {
        let (_folder, path, range) = damaged(section, 0);
        match Scene::open(&path) {
            Err(OpenError::Read(fault)) => assert_eq!((fault.path, fault.bytes), (path, range)),
            other => panic!("{section:?}: {other:?}"),
        }
    }
}

#[test]
fn a_damaged_page_of_geometry_is_an_error_of_its_pieces_alone() {
    let (_folder, path, range) = damaged(Section::Geometry, 1);
    let arrays = tree();
    let scene = Scene::open(&path).unwrap();
    let (mut broken, mut whole) = (0, 0);
    let mut reader = scene.reader();
    for (number, place) in (0..).zip(scene.places()) {
        match reader.read(number) {
            Ok(geometry) => {
                assert_eq!(geometry, arrays.geometries[number as usize]);
                assert_ne!(place.page, 1);
                whole += 1;
            }
            Err(error) => {
                assert_eq!((place.page, &error.bytes, &error.path), (1, &range, &path));
                assert_eq!(error.what, format!("geometry {number}"));
                assert!(matches!(error.cause, ReadCause::Damaged), "{error}");
                broken += 1;
            }
        }
    }
    assert!(broken > 10 && whole > 10 * broken / 2, "{broken} pieces are broken, {whole} are not");
    assert!(scene.fault().is_none(), "the records are whole");
    assert_eq!(scene.check().unwrap_err().bytes, range);

    // A reader of triangles learns of it from the scene.
    let drawable = scene.drawables().iter().find(|d| scene.places()[d.geometry as usize].page == 1).unwrap();
    assert_eq!(scene.triangles(&scene.drawables()[0]).count(), 1);
    assert!(scene.fault().is_none());
    assert_eq!(scene.triangles(drawable).count(), 0);
    assert_eq!(scene.fault().unwrap().bytes, range);
}

#[test]
fn geometry_of_other_sizes_than_its_place_says_is_an_error() {
    let mut file = Apart::of(two_leaves());
    file.places(|places| places[0].triangles = 2);
    file.drawables(|drawables| drawables.iter_mut().for_each(|drawable| drawable.triangles = 2));
    let scene = opened(&file.bytes()).unwrap();
    let error = scene.geometry(0).unwrap_err();
    assert!(matches!(error.cause, ReadCause::Geometry(GeometryError::Length(_))), "{error}");
    assert!(error.to_string().contains("report this if it happens again"), "{error}");

    let mut file = Apart::of(two_leaves());
    file.places(|places| places[0].vertices = 4);
    assert!(opened(&file.bytes()).unwrap().geometry(0).is_err());

    // Bytes not made by the codec.
    let mut file = Apart::of(two_leaves());
    file.pages[7].iter_mut().skip(12).for_each(|byte| *byte = !*byte);
    let error = opened(&file.bytes()).unwrap().check().unwrap_err();
    assert!(matches!(error.cause, ReadCause::Geometry(GeometryError::Vertices)), "{error}");
}

#[test]
fn a_damaged_scene_is_not_copied_and_an_older_file_stays() {
    let (folder, path, range) = damaged(Section::Geometry, 1);
    let scene = Scene::open(&path).unwrap();
    let copy = folder.path().join("copy.scene");
    std::fs::write(&copy, b"older").unwrap();
    match scene.save(&copy) {
        Err(SaveError::Read(error)) => assert_eq!((error.bytes, error.path), (range, path)),
        other => panic!("{other:?}"),
    }
    assert_eq!(std::fs::read(&copy).unwrap(), b"older");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file is left");
}

#[test]
fn a_folder_that_is_missing_is_named() {
    let path = Path::new("no/such/folder/x.scene");
    let message = Scene::from_arrays(two_leaves()).unwrap().save(path).unwrap_err().to_string();
    assert!(message.contains("no/such/folder/x.scene") && message.contains("bytes free"), "{message}");
}

#[test]
fn a_full_disk_leaves_nothing_behind() {
    // A write that fails midway, as on a full disk, without needing one.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.scene");
    let failed = file::write_atomically(&path, |out| {
        out.write_all(&[1; 100])?;
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
    });
    assert_eq!(failed.unwrap_err().kind(), std::io::ErrorKind::StorageFull);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
