//! Pages that are read on demand, and damaged ones.

use std::thread;

use super::*;

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
                let mut found = 0;
                let read = scene.reading(|| {
                    if ahead {
                        scene.nodes().read_ahead(numbers.iter().copied());
                    }
                    found = numbers.iter().filter(|number| scene.nodes().get(**number).is_some()).count();
                });
                (found, read.err().map(|fault| fault.bytes))
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
    let ask = || scene.nodes().get(4352);
    assert!(scene.reading(ask).is_err() && other.reading(ask).is_ok(), "scenes are told apart");
    assert!(scene.reading(|| scene.reading(ask)).is_err(), "work around it has left it out as well");
    assert_eq!(scene.reading(|| 7).ok(), Some(7), "that was other work");
    assert_eq!(scene.nodes().read(4352).unwrap_err().bytes, range);
    assert_eq!(scene.nodes().read(TREE).ok(), Some(None));
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

    // A piece is culled by its box.
    let mut file = Apart::of(two_leaves());
    file.places(|places| places[0].local_max[0] *= 0.5);
    assert!(opened(&file.bytes()).unwrap().geometry(0).is_err());

    // Bytes not made by the codec.
    let mut file = Apart::of(two_leaves());
    file.edit(Section::Geometry, 0, |bytes: &mut [u8]| {
        bytes[12..].iter_mut().for_each(|byte| *byte = !*byte);
    });
    let error = opened(&file.bytes()).unwrap().check().unwrap_err();
    assert!(matches!(error.cause, ReadCause::Geometry(GeometryError::Vertices)), "{error}");
}
