//! The parts of a scene that follow from its arrays.

use glam::Mat3;

use super::*;

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
