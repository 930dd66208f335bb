use super::*;
use crate::{ObjectRecord, Rgba8, SceneArrays, Vertex};

fn geometry(triangles: u32) -> Geometry {
    let vertex = |at: u32| Vertex::new([at as f32, (at % 2) as f32, 0.0], Rgba8([9, 8, 7, 255]));
    let indices = (0..triangles).flat_map(|first| [first, first + 1, first + 2]).collect();
    Geometry { vertices: (0..triangles + 2).map(vertex).collect(), indices }
}

/// A root with a level of its own, and two leaves of an object each; the second is see-through. The pieces of
/// geometry have one, two and three triangles.
fn scene() -> Scene {
    let root = Node {
        world_max: [4.0, 1.0, 0.0],
        local_max: [4.0, 1.0, 0.0],
        first_child: 1,
        child_count: 2,
        drawable_count: 1,
        ..Node::default()
    };
    let leaf = |object: u32| Node {
        origin: [f64::from(object), 0.0, 0.0],
        parent: 0,
        first_child: 0,
        child_count: 0,
        first_drawable: object + 1,
        object,
        ..root
    };
    let drawable = |number: u32| Drawable {
        error: if number == 0 { 0.5 } else { 0.0 },
        node: number,
        geometry: number,
        triangles: number + 1,
        sides: Sides::BOTH,
        piece: 0,
        pieces: 1,
    };
    let object = ObjectRecord { source: 0, source_index: 0, name_start: 0, name_length: 0, node: Node::NONE };
    let arrays = SceneArrays {
        nodes: vec![root, leaf(0), leaf(1)],
        drawables: (0..3).map(drawable).collect(),
        geometries: (1..4).map(geometry).collect(),
        objects: vec![object; 2],
        sources: vec![String::new()],
        see_through: [1].into_iter().collect(),
        ..SceneArrays::default()
    };
    Scene::from_arrays(arrays).unwrap()
}

fn entry(number: u32) -> DrawableEntry {
    DrawableEntry::of(&scene(), DrawableId(number)).unwrap().unwrap()
}

fn packed(number: u32) -> Bytes {
    scene().packed_geometry(number).unwrap().into()
}

fn empty() -> Scene {
    Scene::empty(scene().outline())
}

#[test]
fn what_the_model_has_see_through_comes_with_its_record() {
    let (whole, empty) = (scene(), empty());
    let known = |scene: &Scene| [1, 2].map(|node| scene.is_see_through(NodeId(node), node - 1));
    assert_eq!((whole.has_see_through(), known(&whole)), (true, [false, true]));
    empty.give(&entry(1)).unwrap();
    assert_eq!((empty.has_see_through(), known(&empty)), (false, [false, false]));
    empty.give(&entry(2)).unwrap();
    assert_eq!((empty.has_see_through(), known(&empty)), (true, [false, true]));
    assert_eq!(empty.nodes().get(2).map(|node| node.objects), whole.nodes().get(2).map(|node| node.objects));
    let solid = DrawableEntry { objects: entry(2).objects & !DrawableEntry::SEE_THROUGH, ..entry(2) };
    assert_eq!(empty.give(&solid), Err(GiveError::Other(DrawableId(2))));
}

#[test]
fn the_outline_of_a_scene_is_that_of_an_empty_one_made_of_it() {
    let whole = scene();
    let outline = whole.outline();
    assert_eq!(outline.hash, whole.hash());
    let counts = [outline.nodes, outline.drawables, outline.geometries, outline.objects];
    assert_eq!(counts, [3, 3, 3, 2]);
    let empty = Scene::empty(outline);
    assert_eq!(empty.outline(), outline);
    assert!(whole.is_whole() && !empty.is_whole());
    assert_eq!((empty.drawables().get(0), empty.nodes().get(0), empty.places().get(0)), (None, None, None));
    assert!(empty.geometry(0).is_err());
}

#[test]
fn a_level_of_several_objects_names_one_of_them() {
    let entries = [0, 1, 2].map(entry);
    assert_eq!(entries.map(|entry| entry.objects), [2, 1, 1 | DrawableEntry::SEE_THROUGH]);
    assert_eq!(entries.map(|entry| entry.object), [0, 0, 1]);
    assert_eq!(DrawableEntry::of(&scene(), DrawableId(3)).unwrap(), None);
}

#[test]
fn what_was_given_is_there() {
    let (whole, empty) = (scene(), empty());
    for number in [2, 0] {
        empty.give(&entry(number)).unwrap();
        assert_eq!(empty.has(DrawableId(number)), Ok(false), "its geometry is missing");
        empty.give_geometry(number, packed(number)).unwrap();
        assert_eq!(empty.has(DrawableId(number)), Ok(true));
        assert_eq!(empty.geometry(number).unwrap(), whole.geometry(number).unwrap());
        assert_eq!(DrawableEntry::of(&empty, DrawableId(number)).unwrap(), Some(entry(number)));
    }
    assert_eq!(empty.has(DrawableId(1)), Ok(false));
    let counts = |scene: &Scene| (scene.drawables().iter().count(), scene.places().iter().count());
    assert_eq!((counts(&empty), counts(&whole)), ((2, 2), (3, 3)));
    assert_eq!([0, 2, 3].map(|id| whole.has(DrawableId(id))), [Ok(true), Ok(true), Ok(false)]);
}

#[test]
fn geometry_that_was_taken_back_can_be_given_again() {
    let empty = empty();
    empty.give(&entry(1)).unwrap();
    assert_eq!(empty.take_back_geometry(1), 0, "it was not there");
    empty.give_geometry(1, packed(1)).unwrap();
    let bytes = empty.resident_bytes();
    assert_eq!(empty.take_back_geometry(1), packed(1).len());
    assert_eq!(empty.resident_bytes(), bytes - packed(1).len() as u64);
    assert_eq!(empty.take_back_geometry(1), 0);
    assert_eq!(empty.has(DrawableId(1)), Ok(false));
    assert!(empty.geometry(1).is_err() && empty.places().get(1).is_some());
    empty.give_geometry(1, packed(1)).unwrap();
    assert_eq!(empty.has(DrawableId(1)), Ok(true));
    assert_eq!(scene().take_back_geometry(1), 0, "a scene of a file keeps its own");
}

#[test]
fn numbers_that_are_not_in_the_outline_are_refused() {
    let (sound, none) = (entry(1), u32::MAX);
    for (entry, what, number, count) in [
        (DrawableEntry { id: 3, ..sound }, "drawable", 3, 3),
        (DrawableEntry { node: 3, ..sound }, "node", 3, 3),
        (DrawableEntry { geometry: none, ..sound }, "geometry", none, 3),
        (DrawableEntry { object: 2, ..sound }, "object", 2, 2),
    ] {
        let empty = empty();
        assert_eq!(empty.give(&entry), Err(GiveError::Number { what, number, count }));
        assert_eq!((empty.drawables().iter().count(), empty.nodes().iter().count()), (0, 0));
    }
    let why = GiveError::Number { what: "geometry", number: 3, count: 3 };
    assert_eq!(empty().give_geometry(3, packed(0)), Err(why));
}

#[test]
fn records_that_no_cooked_scene_has_are_refused() {
    let sound = entry(1);
    let unknown = bytemuck::cast::<u32, Sides>(1 << 24);
    for (entry, why) in [
        (DrawableEntry { origin: [0.0, f64::NAN, 0.0], ..sound }, "a number is not finite"),
        (DrawableEntry { linear: [f32::INFINITY; 9], ..sound }, "a number is not finite"),
        (DrawableEntry { world_max: [f64::INFINITY; 3], ..sound }, "a number is not finite"),
        (DrawableEntry { world_min: [f64::NAN; 3], ..sound }, "a number is not finite"),
        (DrawableEntry { world_min: [5.0, 0.0, 0.0], ..sound }, "its box is inside out"),
        (DrawableEntry { sides: unknown, ..sound }, "its sides are unknown"),
        (DrawableEntry { triangles: 0, ..sound }, "it has no triangles"),
    ] {
        let empty = empty();
        assert_eq!(empty.give(&entry), Err(GiveError::Malformed(DrawableId(1), why)));
        assert_eq!((empty.drawables().iter().count(), empty.nodes().iter().count()), (0, 0));
    }
}

#[test]
fn a_record_that_is_another_one_than_before_is_refused_and_nothing_of_it_is_taken() {
    let empty = empty();
    let first = entry(1);
    empty.give(&first).unwrap();
    empty.give(&first).unwrap();
    for other in [
        DrawableEntry { triangles: 7, ..first },
        DrawableEntry { geometry: 0, ..first },
        DrawableEntry { sides: Sides::FRONT, ..first },
        DrawableEntry { node: 2, ..first },
        DrawableEntry { origin: [9.0; 3], ..first },
        DrawableEntry { object: 1, ..first },
    ] {
        assert_eq!(empty.give(&other), Err(GiveError::Other(DrawableId(1))));
    }
    // The same node elsewhere, under another drawable.
    let other = DrawableEntry { id: 2, level: 2, origin: [9.0; 3], ..first };
    assert_eq!(empty.give(&other), Err(GiveError::Other(DrawableId(2))));
    // A drawable has a box of its own.
    let other = DrawableEntry { world_max: [9.0; 3], ..first };
    assert_eq!(empty.give(&other), Err(GiveError::Other(DrawableId(1))));
    let none = DrawableEntry { level: 0, ..first };
    assert_eq!(empty.give(&none), Err(GiveError::Malformed(DrawableId(1), "it is no piece of its level")));
    assert_eq!(DrawableEntry::of(&empty, DrawableId(1)).unwrap(), Some(first));
    assert_eq!((empty.drawables().iter().count(), empty.nodes().iter().count()), (1, 1));
    empty.give(&entry(2)).unwrap();
}

#[test]
fn geometry_that_cannot_be_unpacked_or_is_another_one_is_refused() {
    let empty = empty();
    let whole = packed(1);
    let short = GiveError::Geometry { number: 1, cause: GeometryError::Length(5) };
    assert_eq!(empty.give_geometry(1, whole.slice(..5)), Err(short));
    assert_eq!(empty.places().get(1), None);
    empty.give_geometry(1, whole.clone()).unwrap();
    assert_eq!(empty.give_geometry(1, packed(2)), Err(GiveError::OtherGeometry(1)));
    assert_eq!(empty.geometry(1).unwrap(), scene().geometry(1).unwrap());
}

#[test]
fn a_drawable_and_a_geometry_of_another_number_of_triangles_do_not_go_together() {
    let empty = empty();
    empty.give(&DrawableEntry { geometry: 2, ..entry(1) }).unwrap();
    assert_eq!(empty.has(DrawableId(1)), Ok(false));
    empty.give_geometry(2, packed(2)).unwrap();
    assert_eq!(empty.has(DrawableId(1)), Err(GiveError::Triangles(DrawableId(1))));
}

#[test]
fn a_scene_of_a_file_takes_nothing() {
    let whole = scene();
    assert_eq!(whole.give(&DrawableEntry { triangles: 0, ..entry(1) }), Ok(()));
    assert_eq!(whole.give_geometry(0, Bytes::new()), Ok(()));
    assert_eq!(DrawableEntry::of(&whole, DrawableId(1)).unwrap(), Some(entry(1)));
    assert_eq!(whole.geometry(0).unwrap().triangles(), 1);
}
