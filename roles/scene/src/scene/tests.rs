use super::*;
use crate::Rgba8;

/// A root with two leaves that share one triangle.
fn two_leaves() -> SceneArrays {
    let node = Node {
        world_min: [0.0; 3],
        world_max: [4.0, 1.0, 0.0],
        origin: [0.0; 3],
        linear: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        local_min: [0.0; 3],
        local_max: [4.0, 1.0, 0.0],
        parent: Node::NONE,
        first_child: 1,
        child_count: 2,
        first_drawable: 0,
        drawable_count: 1,
        object: Node::NONE,
        reserved: 0,
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
    let drawable = Drawable { node: 1, index_count: 3, vertex_count: 3, ..bytemuck::Zeroable::zeroed() };
    let vertex = |x, y| Vertex::new([x, y, 0.0], Rgba8([9, 8, 7, 255]));
    SceneArrays {
        nodes: vec![node, leaf(0.0, 0), leaf(3.0, 1)],
        drawables: vec![
            Drawable { error: 0.5, node: 0, ..drawable },
            drawable,
            Drawable { node: 2, ..drawable },
        ],
        vertices: vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)],
        indices: vec![0, 1, 2],
        objects: vec![
            ObjectRecord { source: 0, source_index: 4, name_start: 0, name_length: 5 },
            ObjectRecord { source: 0, source_index: 9, name_start: 5, name_length: 1 },
        ],
        names: "Röhrz".to_owned(),
        sources: vec!["a.RVM".to_owned()],
    }
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
}

#[test]
fn every_broken_rule_is_named_with_its_record() {
    type Change = fn(&mut SceneArrays);
    let cases: [(Change, &str); 25] = [
        (|a| a.nodes.clear(), "the scene has no nodes"),
        (|a| a.nodes[0].parent = 0, "node 0 is malformed: it is the root"),
        (|a| a.nodes[0].first_child = 2, "node 0 is malformed: its children are not next"),
        (|a| a.nodes[1].child_count = 1, "node 1 is malformed: its children are not next"),
        (|a| a.nodes[0].child_count = 3, "node 0 is malformed: its children lie past"),
        (|a| a.nodes[0].child_count = 1, "node 2 is malformed: its parent is not"),
        (|a| a.nodes[2].parent = 1, "node 2 is malformed: its parent"),
        (|a| a.nodes[2].world_max[0] = 4.5, "node 2 is malformed: its box sticks out"),
        (|a| a.nodes[1].origin[1] = f64::NAN, "node 1 is malformed: its box, origin"),
        (|a| a.nodes[1].local_min[2] = 1.0, "node 1 is malformed: its box has a lower corner"),
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
        (|a| a.drawables[1].error = 0.25, "node 1 is malformed: it is a leaf whose finest"),
        (|a| a.drawables[2].index_count = 2, "drawable 2 is malformed: its number of indices"),
        (|a| a.drawables[2].first_index = u32::MAX, "drawable 2 is malformed: its indices lie past"),
        (|a| a.drawables[2].vertex_count = 2, "drawable 2 is malformed: one of its indices"),
        (|a| a.vertices[1].position[0] = f32::INFINITY, "vertex 1 is malformed"),
        (
            |a| a.drawables[1].sides = bytemuck::cast(2_u32),
            "drawable 1 is malformed: which sides of its triangles show",
        ),
        (|a| a.objects[1].name_start = 2, "object 1 is malformed: its name"),
    ];
    for (change, expected) in cases {
        let message = refusal(change);
        assert!(message.starts_with(expected), "expected {expected:?}, got {message:?}");
    }
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

/// The checks run over thousands of nodes at a time; what they pass from one run to the next is looked at
/// here.
#[test]
fn rules_between_far_nodes_are_checked() {
    let run = 4096;
    let sound = || a_leaf_below_each_of(3 * run - 1);
    assert!(Scene::from_arrays(sound()).is_ok());

    // The children of one whole run of nodes change places with those of the next.
    let mut arrays = sound();
    for node in run..2 * run {
        let (a, b) = (node as usize, (node + run) as usize);
        let (below_a, below_b) = (arrays.nodes[a].first_child, arrays.nodes[b].first_child);
        arrays.nodes[a].first_child = below_b;
        arrays.nodes[b].first_child = below_a;
        arrays.nodes[below_a as usize].parent = node + run;
        arrays.nodes[below_b as usize].parent = node;
    }
    let message = Scene::from_arrays(arrays).unwrap_err().to_string();
    assert_eq!(message, "node 4096 is malformed: its children are not next in breadth-first order");

    // The last leaf's coarser level is worse than the root's, and the node between them has no level.
    let mut arrays = sound();
    let last = arrays.nodes.len() - 1;
    arrays.nodes[last].drawable_count = 2;
    arrays.drawables.push(Drawable { error: 0.75, node: last as u32, ..arrays.drawables[0] });
    let message = Scene::from_arrays(arrays).unwrap_err().to_string();
    assert!(message.starts_with("drawable 0 is malformed: its error is below that"), "{message}");

    // A drawable that no node has.
    let mut arrays = sound();
    arrays.drawables.push(arrays.drawables[0]);
    let message = Scene::from_arrays(arrays).unwrap_err().to_string();
    assert_eq!(message, "drawable 12288 is malformed: its node does not have it among its levels");
}

/// A folder of its own with the scene in it, and the scene's bytes.
fn saved() -> (tempfile::TempDir, std::path::PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.scene");
    Scene::from_arrays(two_leaves()).unwrap().save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (folder, path, bytes)
}

#[test]
fn a_saved_scene_opens_as_it_was() {
    let (folder, path, _) = saved();
    let before = Scene::from_arrays(two_leaves()).unwrap();
    let after = Scene::open(&path).unwrap();
    assert_eq!(after.nodes(), before.nodes());
    assert_eq!(after.drawables(), before.drawables());
    assert_eq!(after.vertices(), before.vertices());
    assert_eq!(after.indices(), before.indices());
    assert_eq!(after.objects(), before.objects());
    assert_eq!(after.object_name(0), Some("Röhr"));
    assert_eq!(after.sources(), before.sources());
    assert_eq!(after.hash(), before.hash());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
}

#[test]
fn an_older_scene_is_replaced_whole_while_it_is_open() {
    let (_folder, path, _) = saved();
    let old = Scene::open(&path).unwrap();
    let mut arrays = two_leaves();
    arrays.vertices[1].position[0] = 0.5;
    Scene::from_arrays(arrays).unwrap().save(&path).unwrap();
    assert_eq!(old.vertices()[1].position[0], 1.0);
    assert_eq!(Scene::open(&path).unwrap().vertices()[1].position[0], 0.5);
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let (_folder, path, bytes) = saved();
    for length in 0..bytes.len() {
        std::fs::write(&path, &bytes[..length]).unwrap();
        match Scene::open(&path) {
            Err(OpenError::Truncated { actual, .. }) if actual == length as u64 => {}
            other => panic!("cut to {length}: {other:?}"),
        }
    }
}

#[test]
fn a_flipped_bit_anywhere_is_refused_or_lies_in_a_gap() {
    let (_folder, path, bytes) = saved();
    let original = Scene::open(&path).unwrap().hash();
    let mut harmless = 0;
    for index in 0..bytes.len() {
        let mut broken = bytes.clone();
        broken[index] ^= 0x10;
        std::fs::write(&path, &broken).unwrap();
        match Scene::open(&path) {
            Ok(scene) => {
                assert_eq!(scene.hash(), original);
                assert_eq!(bytes[index], 0);
                harmless += 1;
            }
            Err(OpenError::Foreign { .. }) => assert!(index < 8),
            Err(OpenError::Version { .. }) => assert!((8..12).contains(&index)),
            Err(OpenError::Damaged { .. }) => {}
            Err(other) => panic!("byte {index}: {other}"),
        }
    }
    assert!(harmless < 7 * 64, "{harmless} bytes are not covered by a checksum");
}

#[test]
fn foreign_and_newer_files_are_told_apart() {
    let (_folder, path, mut bytes) = saved();
    bytes[8] = 200;
    std::fs::write(&path, &bytes).unwrap();
    let message = Scene::open(&path).unwrap_err().to_string();
    assert!(message.contains("format 200") && message.contains("use a newer build"), "{message}");

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
    arrays.indices[2] = 3;
    let hash = hash::fingerprint(&arrays.parts());
    Scene { storage: Storage::Memory(arrays), hash }.save(&path).unwrap();
    match Scene::open(&path) {
        Err(OpenError::Malformed { source: SceneError::Malformed { what: "drawable", .. }, .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_folder_that_is_missing_is_named() {
    let path = std::path::Path::new("no/such/folder/x.scene");
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
