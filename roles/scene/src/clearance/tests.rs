use std::{
    ops::Range,
    sync::atomic::{AtomicUsize, Ordering},
};

use glam::{DAffine3, DQuat, DVec3, Mat3, Vec3};
use proptest::prelude::*;
use trimaran_cook::{CookOptions, Mesh, Model, Object, Source, cook};
use trimaran_proto::ObjectSet;

use super::{triangles::closest, *};
use crate::{FlatObject, Level, Rgba8, SceneArrays};

/// A box by its sides, with its lower corner at a place of the world.
fn cuboid(at: [f64; 3], sides: [f32; 3]) -> FlatObject {
    let corner = |corner: u32| Vec3::from_array([0, 1, 2].map(|axis| (corner >> axis & 1) as f32));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    FlatObject {
        positions: (0..8).map(|of| corner(of) * Vec3::from_array(sides)).collect(),
        indices: faces.into_iter().flat_map(|[a, b, c, d]| [a, b, c, a, c, d]).collect(),
        colour: Rgba8([200; 4]),
        linear: Mat3::IDENTITY,
        origin: DVec3::from_array(at),
    }
}

fn scene(objects: &[FlatObject]) -> Scene {
    Scene::from_arrays(SceneArrays::flat(objects)).unwrap()
}

fn set(objects: impl IntoIterator<Item = u32>) -> ObjectSet {
    objects.into_iter().collect()
}

fn all(scene: &Scene) -> ObjectSet {
    set(0..scene.objects().len() as u32)
}

fn shortest(scene: &Scene, a: u32, b: u32) -> Clearance {
    Clearances::new(scene).shortest(&set([a]), &set([b]), &|| false).unwrap().unwrap()
}

/// The pairs that clash, with their distances.
fn clashes(scene: &Scene, between: &ObjectSet, and: &ObjectSet, tolerance: f64) -> Vec<([u32; 2], f64)> {
    let rule = ClashRule { between, and, tolerance, groups: &[], most: 1000 };
    let Clashes { found, ignored } = Clearances::new(scene).clashes(&rule, &()).unwrap();
    assert_eq!(ignored, 0);
    found.iter().map(|one| (one.objects, one.distance)).collect()
}

/// All triangles of an object at full detail, about a place of the world.
fn triangles(scene: &Scene, object: u32, about: DVec3) -> Vec<[DVec3; 3]> {
    let mut found = Vec::new();
    let nodes = scene.nodes();
    let mut open = vec![scene.objects()[object as usize].node];
    while let Some(node) = open.pop().map(|id| &nodes[id as usize]) {
        open.extend(node.children());
        let finest = scene.levels(node).next().filter(|_| node.is_leaf());
        for id in finest.into_iter().flat_map(Level::pieces) {
            let (linear, origin) = (node.linear().as_dmat3(), node.origin() - about);
            let place = |corner: Vec3| linear * corner.as_dvec3() + origin;
            found.extend(scene.triangles(&scene.drawables()[id.index()]).map(|corners| corners.map(place)));
        }
    }
    found
}

/// The same as [`shortest`], by all pairs of triangles.
fn by_brute_force(scene: &Scene, a: u32, b: u32) -> f64 {
    let about = scene.nodes()[scene.objects()[a as usize].node as usize].origin();
    let (a, b) = (triangles(scene, a, about), triangles(scene, b, about));
    let squares = a.iter().flat_map(|a| b.iter().map(|b| closest(a, b).square));
    squares.fold(f64::INFINITY, f64::min).sqrt()
}

#[test]
fn boxes_apart_have_the_gap_between_them() {
    let scene = scene(&[cuboid([0.0; 3], [1.0; 3]), cuboid([3.0, 0.5, 0.25], [1.0; 3])]);
    let found = shortest(&scene, 0, 1);
    assert_eq!((found.objects, found.distance, found.is_hard()), ([0, 1], 2.0, false));
    assert_eq!([found.points[0].x, found.points[1].x], [1.0, 3.0]);
    assert!(found.points[0].distance(found.points[1]) == 2.0 && found.rounding < 1e-6);
    assert_eq!(shortest(&scene, 1, 0).objects, [1, 0]);
}

#[test]
fn boxes_that_intersect_or_touch_are_at_no_distance() {
    let boxes = [
        cuboid([0.0; 3], [1.0; 3]),
        cuboid([0.5, 0.5, 0.5], [1.0; 3]),
        // Side by side: they share a face, an edge and a corner with the first one.
        cuboid([-1.0, 0.0, 0.0], [1.0; 3]),
        cuboid([-1.0, -1.0, 0.0], [1.0; 3]),
        cuboid([-1.0, -1.0, -1.0], [1.0; 3]),
        // A part of one face lies in a part of another.
        cuboid([0.25, 0.25, -2.0], [0.5, 5.0, 2.0]),
    ];
    let scene = scene(&boxes);
    for other in 1..6 {
        let found = shortest(&scene, 0, other);
        assert!(found.distance == 0.0 && found.is_hard(), "{other}: {found:?}");
    }
}

/// No inside: what is told is how far the surfaces are from each other.
#[test]
fn a_solid_within_another_is_as_far_as_their_surfaces() {
    let scene = scene(&[cuboid([0.0; 3], [5.0; 3]), cuboid([2.0, 1.5, 1.0], [1.0; 3])]);
    let found = shortest(&scene, 0, 1);
    assert_eq!((found.distance, found.is_hard()), (1.0, false));
    assert_eq!(clashes(&scene, &set([0]), &set([1]), 0.5), []);
}

#[test]
fn surfaces_that_touch_but_for_rounding_are_hard() {
    // The sides are no binary fractions, and the frames are far from the corners.
    let mut left = cuboid([0.0; 3], [0.1, 0.7, 0.3]);
    for position in &mut left.positions {
        position.x += 33.3;
    }
    let right = cuboid([33.4, 0.2, 0.1], [0.1; 3]);
    let scene = scene(&[left, right]);
    let found = shortest(&scene, 0, 1);
    assert!(found.distance > 0.0 && found.distance <= found.rounding, "{found:?}");
    assert!(found.is_hard() && found.rounding < 1e-5);
    assert_eq!(clashes(&scene, &all(&scene), &all(&scene), 0.0).len(), 1);
}

#[test]
fn a_distance_as_large_as_the_rounding_is_hard() {
    let at = |distance| Clearance { objects: [0, 1], distance, points: [DVec3::ZERO; 2], rounding: 1e-6 };
    assert_eq!([0.0, 1e-6, 1.1e-6].map(|distance| at(distance).is_hard()), [true, true, false]);
}

#[test]
fn ten_thousand_kilometres_away_a_millimetre_is_a_millimetre() {
    let far = [1e7, -1e7, 1e7];
    let beside = |gap: f64| [far[0] + 1.0 + gap, far[1], far[2]];
    for gap in [0.001, 0.005, 0.1] {
        let scene = scene(&[cuboid(far, [1.0; 3]), cuboid(beside(gap), [1.0; 3])]);
        let found = shortest(&scene, 0, 1);
        // A coordinate there is a multiple of 1.9 nm.
        assert!((found.distance - gap).abs() < 4e-9, "{gap}: {found:?}");
        assert!(found.points[0].distance(DVec3::from_array(far)) < 2.0, "{found:?}");
        assert_eq!(clashes(&scene, &all(&scene), &all(&scene), gap).len(), 1, "{gap}");
        assert_eq!(clashes(&scene, &all(&scene), &all(&scene), gap - 1e-5), [], "{gap}");
    }
}

#[test]
fn degenerate_triangles_have_distances_too() {
    let mut needle = cuboid([0.0, 2.0, 0.0], [0.0, 1.0, 0.0]);
    needle.indices.truncate(6);
    needle.positions.truncate(4);
    let mut point = cuboid([0.0, 0.0, 7.0], [0.0; 3]);
    (point.indices, point.positions) = (vec![0; 3], vec![Vec3::ZERO]);
    let scene = scene(&[cuboid([0.0; 3], [1.0; 3]), needle, point]);
    assert_eq!(shortest(&scene, 0, 1).distance, 1.0);
    assert_eq!(shortest(&scene, 0, 2).distance, 6.0);
    assert_eq!(shortest(&scene, 1, 2).distance, 53_f64.sqrt());
}

#[test]
fn each_pair_comes_once_the_nearest_first() {
    // A row of boxes, 10, 20, 30 cm apart.
    let row = [0.0, 1.1, 2.3, 3.6].map(|x| cuboid([x, 0.0, 0.0], [1.0; 3]));
    let scene = scene(&row);
    let pairs = |between: &ObjectSet, and: &ObjectSet, tolerance| -> Vec<[u32; 2]> {
        clashes(&scene, between, and, tolerance).into_iter().map(|(pair, _)| pair).collect()
    };
    let whole = all(&scene);
    assert_eq!(pairs(&whole, &whole, 0.05), [[0; 2]; 0]);
    assert_eq!(pairs(&whole, &whole, 0.1), [[0, 1]]);
    assert_eq!(pairs(&whole, &whole, 0.25), [[0, 1], [1, 2]]);
    assert_eq!(pairs(&whole, &whole, 0.3), [[0, 1], [1, 2], [2, 3]]);
    // One against all the rest; the first of a pair is of the first set.
    assert_eq!(pairs(&set([1]), &set([0, 2, 3]), 0.3), [[1, 0], [1, 2]]);
    assert_eq!(pairs(&set([1]), &whole, 0.3), [[1, 0], [1, 2]]);
    assert_eq!(pairs(&whole, &set([1]), 0.3), [[0, 1], [2, 1]]);
    // The sets share objects 1 and 2.
    assert_eq!(pairs(&set([0, 1, 2]), &set([1, 2, 3]), 0.3), [[0, 1], [1, 2], [2, 3]]);
    assert_eq!(pairs(&set([]), &whole, 9.0), [[0; 2]; 0]);
    // Numbers that the scene lacks.
    let huge = ObjectSet::try_from(vec![(2, u32::MAX - 3)]).unwrap();
    assert_eq!(pairs(&huge, &huge, 0.3), [[2, 3]]);
    assert!(Clearances::new(&scene).shortest(&set([9]), &huge, &|| false).unwrap().is_none());
    assert!(Clearances::new(&scene).shortest(&set([3]), &set([3]), &|| false).unwrap().is_none());
}

#[test]
fn clashes_within_a_group_are_counted_and_not_listed() {
    // Each box touches the next one.
    let scene = scene(&[0.0, 1.0, 2.0, 3.0].map(|x| cuboid([x, 0.0, 0.0], [1.0; 3])));
    let (whole, clearances) = (all(&scene), Clearances::new(&scene));
    let search = |groups: &[Range<u32>], most| {
        let rule = ClashRule { between: &whole, and: &whole, tolerance: 0.0, groups, most };
        let Clashes { found, ignored } = clearances.clashes(&rule, &())?;
        Ok::<_, ClearanceError>((found.iter().map(|one| one.objects).collect::<Vec<_>>(), ignored))
    };
    // Those that are ignored do not count towards the most.
    assert_eq!(search(&[0..2, 0..2, 2..4, 2..4], 1).unwrap(), (vec![[1, 2]], 2));
    assert_eq!(search(&[0..4, 0..4, 0..4, 0..4], 0).unwrap(), (vec![], 3));
    // The group of only one of them has the other one.
    assert_eq!(search(&[0..1, 0..2, 0..4, 3..4], 3).unwrap(), (vec![[0, 1], [1, 2], [2, 3]], 0));
    // Objects past the end are in no group.
    assert_eq!(search(&[0..4, 0..4], 2).unwrap(), (vec![[1, 2], [2, 3]], 1));
    assert!(matches!(search(&[0..2, 0..2], 1), Err(ClearanceError::TooMany { most: 1 })));
}

#[test]
fn the_shortest_distance_between_sets_is_that_of_their_nearest_objects() {
    let row = [0.0, 5.0, 2.25, 9.0, 7.5].map(|x| cuboid([x, 0.0, 0.0], [1.0; 3]));
    let scene = scene(&row);
    let found = Clearances::new(&scene).shortest(&set([0, 1]), &set([2, 3, 4]), &|| false).unwrap().unwrap();
    assert_eq!((found.objects, found.distance), ([0, 2], 1.25));
}

struct Watched {
    most: usize,
    seen: AtomicUsize,
}

impl Watch for Watched {
    fn advance(&self, done: usize, of: usize) {
        assert!(done <= of);
        self.seen.fetch_max(done, Ordering::Relaxed);
    }

    fn is_stopped(&self) -> bool {
        self.seen.load(Ordering::Relaxed) >= self.most
    }
}

#[test]
fn a_search_tells_how_far_it_is_and_can_be_stopped() {
    let many: Vec<_> = (0..400).map(|at| cuboid([f64::from(at) * 1.01, 0.0, 0.0], [1.0; 3])).collect();
    let scene = scene(&many);
    let (whole, clearances) = (all(&scene), Clearances::new(&scene));
    let rule = ClashRule { between: &whole, and: &whole, tolerance: 0.02, groups: &[], most: 399 };
    let watched = |most| Watched { most, seen: AtomicUsize::new(0) };
    let to_the_end = watched(usize::MAX);
    assert_eq!(clearances.clashes(&rule, &to_the_end).unwrap().found.len(), 399);
    assert_eq!(to_the_end.seen.into_inner(), 400);
    let stopped = watched(20);
    assert!(matches!(clearances.clashes(&rule, &stopped), Err(ClearanceError::Stopped)));
    assert!(stopped.seen.into_inner() < 200, "it ends soon");
    let too_many = clearances.clashes(&ClashRule { most: 398, ..rule }, &());
    assert!(matches!(too_many, Err(ClearanceError::TooMany { most: 398 })));
}

/// A ball of 1 m. It has so many triangles that it is cooked in clusters, with levels of detail.
fn ball(round: u32) -> Mesh {
    let mut positions = Vec::new();
    for ring in 0..=round {
        for column in 0..round {
            let angle = |part: u32, turn: f32| part as f32 / round as f32 * turn;
            let (up, around) = (angle(ring, std::f32::consts::PI), angle(column, std::f32::consts::TAU));
            positions.push(Vec3::new(up.sin() * around.cos(), up.cos(), up.sin() * around.sin()));
        }
    }
    let at = |ring: u32, column: u32| ring * round + column % round;
    let faces = (0..round).flat_map(|ring| (0..round).map(move |column| (ring, column)));
    let indices = faces.flat_map(|(ring, column)| {
        let [a, b] = [at(ring, column), at(ring, column + 1)];
        let [c, d] = [at(ring + 1, column), at(ring + 1, column + 1)];
        [a, b, c, b, d, c]
    });
    Mesh {
        colours: vec![trimaran_cook::Rgba8([200; 4]); positions.len()],
        indices: indices.collect(),
        positions,
    }
}

fn cooked(mesh: Mesh, places: &[DAffine3]) -> Scene {
    let object = |to_world: &DAffine3| Object {
        mesh: 0,
        to_world: *to_world,
        name: String::new(),
        source: 0,
        source_index: 0,
    };
    let model = Model {
        meshes: vec![mesh],
        objects: places.iter().map(object).collect(),
        sources: vec![Source { name: String::new() }],
        ..Model::default()
    };
    // The cook's scenes are of this crate without its tests.
    let file = tempfile::NamedTempFile::new().unwrap();
    cook(&model, &CookOptions::default(), &()).unwrap().save(file.path()).unwrap();
    Scene::open(file.path()).unwrap()
}

fn place(turn: f64, at: [f64; 3]) -> DAffine3 {
    let turned = DQuat::from_rotation_y(turn) * DQuat::from_rotation_x(0.3 * turn);
    DAffine3::from_rotation_translation(turned, DVec3::from_array(at))
}

#[test]
fn objects_with_levels_of_detail_are_compared_at_full_detail() {
    let places = [place(0.0, [0.0; 3]), place(0.7, [2.5, 0.4, 0.1]), place(1.9, [0.3, 2.3, 0.2])];
    let scene = cooked(ball(24), &places);
    assert!(scene.drawables().len() > 30, "there are levels and clusters");
    for [a, b] in [[0, 1], [0, 2], [1, 2]] {
        let (found, expected) = (shortest(&scene, a, b), by_brute_force(&scene, a, b));
        assert!(expected > 0.1 && (found.distance - expected).abs() < 1e-12, "{found:?} {expected}");
        let apart = found.points[0].distance(found.points[1]);
        assert!((apart - found.distance).abs() < 1e-12, "{found:?}");
    }
}

/// A mesh of a few triangles, many of them degenerate or in one plane.
fn soup() -> impl Strategy<Value = FlatObject> {
    let coordinate = prop_oneof![(-2_i8..=2).prop_map(f32::from), -2.0..2.0_f32];
    let corner = prop::array::uniform3(coordinate).prop_map(Vec3::from_array);
    let mesh = prop::collection::vec(prop::array::uniform3(corner), 1..30);
    let place = prop::array::uniform3(prop_oneof![(-4_i8..=4).prop_map(f64::from), -4.0..4.0_f64]);
    (mesh, place, 0.0..6.0_f32, any::<bool>()).prop_map(|(mesh, origin, turn, is_turned)| FlatObject {
        indices: (0..3 * mesh.len() as u32).collect(),
        positions: mesh.into_flattened(),
        colour: Rgba8([200; 4]),
        linear: if is_turned { Mat3::from_rotation_y(turn) } else { Mat3::IDENTITY },
        origin: DVec3::from_array(origin),
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(120))]

    #[test]
    fn distances_and_clashes_are_those_of_all_pairs_of_triangles(
        mut objects in prop::collection::vec(soup(), 2..7),
        tolerance in prop_oneof![Just(0.0), 0.0..2.0_f64],
        far in prop_oneof![Just(0.0), Just(1e7)],
        split in any::<prop::sample::Index>(),
    ) {
        for object in &mut objects {
            object.origin += DVec3::splat(far);
        }
        let scene = scene(&objects);
        let count = objects.len() as u32;
        let within = if far == 0.0 { 1e-12 } else { 1e-8 };
        let mut expected = Vec::new();
        for (a, b) in (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))) {
            let (found, distance) = (shortest(&scene, a, b), by_brute_force(&scene, a, b));
            prop_assert!((found.distance - distance).abs() <= within, "{:?} {}", found, distance);
            if distance <= tolerance + found.rounding {
                expected.push([a, b]);
            }
        }
        let whole = all(&scene);
        let pairs = |between: &ObjectSet, and: &ObjectSet| {
            let found = clashes(&scene, between, and, tolerance);
            assert!(found.is_sorted_by(|(_, a), (_, b)| a <= b));
            let mut pairs: Vec<[u32; 2]> = found.into_iter().map(|(pair, _)| pair).collect();
            pairs.sort();
            pairs
        };
        prop_assert_eq!(&pairs(&whole, &whole), &expected);
        let middle = split.index(objects.len()) as u32;
        let (low, high) = (set(0..middle), set(middle..count));
        expected.retain(|[a, b]| *a < middle && *b >= middle);
        prop_assert_eq!(pairs(&low, &high), expected);
    }
}
