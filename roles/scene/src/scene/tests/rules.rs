//! The rules of records, each broken once.

use std::thread;

use super::*;

fn refusal(change: impl FnOnce(&mut SceneArrays)) -> String {
    let mut arrays = two_leaves();
    change(&mut arrays);
    Scene::from_arrays(arrays).map(|scene| scene.hash()).unwrap_err().to_string()
}

/// The rule that the records at a fault break.
fn broken_rule(fault: &ReadError) -> String {
    let ReadCause::Malformed(error) = &fault.cause else { panic!("{fault}") };
    error.to_string()
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
    let cases: [(Change, &str); 33] = [
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
        (
            |a| {
                a.drawables.push(Drawable { error: 0.75, ..a.drawables[2] });
                a.nodes[2].drawable_count = 2;
            },
            "drawable 0 is malformed: its error is below that of a finer level, or of a node below its own",
        ),
        (
            |a| {
                a.drawables.push(Drawable { error: 0.5, ..a.drawables[2] });
                a.drawables.push(Drawable { error: 0.25, ..a.drawables[2] });
                a.nodes[2].drawable_count = 3;
            },
            "drawable 4 is malformed: its error is below that of a finer level, or of a node below its own",
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
            Err(error) => assert_eq!(broken_rule(&error), expected),
        }
    }
}

/// The directory has the first children and levels of each page, by which a page is checked.
#[test]
fn a_directory_that_says_other_firsts_is_found_by_the_page_before_and_the_page_itself() {
    type Change = fn(&mut Entry);
    let cases: [(usize, Change, &str); 3] = [
        (1, |entry| entry.firsts.child += 1, "(nodes 0 to 255)"),
        (1, |entry| entry.firsts.drawable += 1, "(nodes 0 to 255)"),
        (3, |entry| entry.firsts.leaf += 1, "(nodes 512 to 767)"),
    ];
    for (page, change, expected) in cases {
        let mut file = Apart::of(tree());
        change(file.entry(Section::Nodes, page));
        let message = opened(&file.bytes()).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }

    // Without the page before it, like a lazy reader that starts there.
    let mut file = Apart::of(tree());
    file.entry(Section::Nodes, 18).firsts.drawable -= 1;
    let scene = opened(&file.bytes()).unwrap();
    assert_eq!(scene.nodes().get(TREE - 1), None);
    let expected = "node 4608 is malformed: its levels are not next to those of the node before it";
    assert_eq!(broken_rule(scene.fault().unwrap()), expected);
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
    let OpenError::Read(error) = error else { panic!("{error}") };
    assert_eq!(broken_rule(&error), "node 1025 is malformed: it is deeper in the tree than any may be");
}

#[test]
fn sums_that_are_not_those_of_the_records_are_found_by_a_check() {
    let mut file = Apart::of(two_leaves());
    file.header.totals.stored_vertices += 1;
    let error = opened(&file.bytes()).unwrap().check().unwrap_err();
    assert_eq!(broken_rule(&error), "header 0 is malformed: its sums are not those of its records");
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
        assert_eq!((broken_rule(fault).as_str(), fault.what.as_str()), (expected, "names"));
    }
}
