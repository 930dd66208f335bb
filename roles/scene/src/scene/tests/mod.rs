//! Tests of scenes and their files; here the scenes that they share.

mod apart;
mod derived;
mod files;
mod pages;
mod rules;

use std::ops::Range;
use std::path::PathBuf;

use bytemuck::Zeroable;
use tempfile::TempDir;

use super::layout::{Entry, Header};
use super::*;
use apart::Apart;

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
    let drawable = Drawable { node: 1, triangles: 1, pieces: 1, ..Zeroable::zeroed() };
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
        coordinates: Coordinates::default(),
    }
}

fn group(name: &str, parent: Option<u32>, objects: Range<u32>) -> Group {
    Group { name: name.into(), parent, objects, attributes: vec![tag()], extent: Extent::default() }
}

/// The scene's one file has z up and millimetres, and its plant is far away.
fn elsewhere() -> Coordinates {
    Coordinates {
        plant: PlantFrame { origin: [432_100.25, 6_789_012.5, 17.0], north_deg: -32.5 },
        files: vec![FileFrame { up: UpAxis::Z, metres_per_unit: Some(0.001) }],
    }
}

fn tag() -> Attribute {
    Attribute { name: "TAG".into(), value: "Röhr".into() }
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

/// A folder of its own with the scene in it, and the scene's bytes.
fn saved(arrays: SceneArrays) -> (TempDir, PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scene");
    Scene::from_arrays(arrays).unwrap().save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (folder, path, bytes)
}

/// The tree saved, with the byte in the middle of a page flipped; and where the page lies.
fn damaged(section: Section, page: usize) -> (TempDir, PathBuf, Range<u64>) {
    let (folder, path, mut bytes) = saved(tree());
    let range = Apart::new(&bytes).range(section, page);
    bytes[u64::midpoint(range.start, range.end) as usize] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    (folder, path, range)
}
