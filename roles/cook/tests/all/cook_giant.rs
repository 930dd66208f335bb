//! Giant meshes: their parts have levels of their own, which meet without cracks and keep their certified
//! errors.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec3, Vec3};
use trimaran_cook::{CookOptions, cook};
use trimaran_cook::{Mesh, Model, Object, Source};
use trimaran_scene::{Drawable, Level, Node, Rgba8, Scene};

/// Uneven ground, metres.
fn height(x: f64, z: f64) -> f64 {
    4.0 * (x / 31.0).sin() * (z / 23.0).cos() + 0.3 * (x / 9.1).cos() + 0.2 * ((x + 2.0 * z) / 12.3).sin()
}

/// A height field of `2 * n * n` triangles over 200 m by 200 m.
fn field(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=n {
            let [x, z] = [i, j].map(|k| 200.0 * f64::from(k) / f64::from(n));
            mesh.positions.push(DVec3::new(x, height(x, z), z).as_vec3());
        }
    }
    for i in 0..n {
        for j in 0..n {
            let a = i * (n + 1) + j;
            mesh.indices.extend([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1]);
        }
    }
    mesh
}

/// A closed surface of `4 * n * (n - 1)` triangles, a ball with bumps, about 200 m across.
fn hull(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let sectors = 2 * n;
    for ring in 1..n {
        for sector in 0..sectors {
            let (polar, round) =
                (PI * f64::from(ring) / f64::from(n), TAU * f64::from(sector) / f64::from(sectors));
            let radius = 100.0
                + 3.0 * (7.0 * polar).sin() * (5.0 * round).cos()
                + 0.2 * (40.0 * round).sin() * polar.sin();
            let point = DVec3::new(polar.sin() * round.cos(), polar.cos(), polar.sin() * round.sin());
            mesh.positions.push((radius * point).as_vec3());
        }
    }
    let top = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::Y * 100.0, Vec3::Y * -100.0]);
    let at = |ring: u32, sector: u32| ring * sectors + sector % sectors;
    for sector in 0..sectors {
        let (this, next, last) = (sector, sector + 1, n - 2);
        mesh.indices.extend([top, at(0, next), at(0, this), top + 1, at(last, this), at(last, next)]);
        for ring in 0..last {
            let [a, b, c, d] = [at(ring, this), at(ring, next), at(ring + 1, next), at(ring + 1, this)];
            mesh.indices.extend([a, b, c, a, c, d]);
        }
    }
    mesh
}

/// `count` octahedra strewn about: a file without parts, or noise of a scanner.
fn rubble(count: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for index in 0..count {
        let turn = |step: f64| 100.0 * (f64::from(index) * step).fract();
        let place = DVec3::new(turn(0.618_034), 0.1 * turn(0.414_214), turn(0.732_051)).as_vec3();
        let size = 0.1 + 0.02 * (index % 20) as f32;
        let first = mesh.positions.len() as u32;
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            mesh.positions.extend([place + size * axis, place - size * axis]);
        }
        for [x, y, z] in
            [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
        {
            mesh.indices.extend([first + x, first + y, first + z]);
        }
    }
    mesh
}

fn cooked(mut mesh: Mesh, places: &[DVec3]) -> Scene {
    mesh.colours = vec![Rgba8([120, 110, 90, 255]); mesh.positions.len()];
    let object = |(index, &place): (usize, &DVec3)| Object {
        mesh: 0,
        to_world: DAffine3::from_translation(place),
        name: format!("giant {index}"),
        source: 0,
        source_index: 7 + index as u32,
    };
    let model = Model {
        meshes: vec![mesh],
        objects: places.iter().enumerate().map(object).collect(),
        sources: vec![Source { name: "site.obj".to_owned() }],
        ..Model::default()
    };
    cook(&model, &CookOptions::default(), &()).unwrap()
}

/// A cut through the tree: `choose` returns the level at which to draw a node, or none to visit its children.
/// Leaves are drawn at some level.
fn cut(scene: &Scene, mut choose: impl FnMut(&Node, &[Drawable]) -> Option<usize>) -> Vec<Drawable> {
    let pieces = |level: Level| level.pieces().map(|id| scene.drawables()[id.index()]);
    let mut drawn = Vec::new();
    let mut open = vec![0];
    while let Some(index) = open.pop() {
        let node = &scene.nodes()[index as usize];
        let levels: Vec<Level> = scene.levels(node).collect();
        let firsts: Vec<Drawable> =
            levels.iter().map(|level| scene.drawables()[level.first().index()]).collect();
        match choose(node, &firsts) {
            Some(level) => drawn.extend(pieces(levels[level])),
            None if node.is_leaf() => drawn.extend(pieces(levels[0])),
            None => open.extend(node.children()),
        }
    }
    drawn
}

fn triangles(scene: &Scene, drawable: &Drawable) -> Vec<[DVec3; 3]> {
    let node = scene.nodes()[drawable.node as usize];
    let place = |local: Vec3| node.origin() + node.linear().as_dmat3() * local.as_dvec3();
    scene.triangles(drawable).map(|corners| corners.map(place)).collect()
}

/// The edges not used equally often in both directions: borders and cracks.
fn open_edges(scene: &Scene, drawn: &[Drawable]) -> usize {
    let mut runs: HashMap<[[u64; 3]; 2], i64> = HashMap::new();
    for [a, b, c] in drawn.iter().flat_map(|drawable| triangles(scene, drawable)) {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let [from, to] = [from, to].map(|p| p.to_array().map(f64::to_bits));
            *runs.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
        }
    }
    runs.values().filter(|&&count| count != 0).count()
}

/// A random cut: the same for the same seed.
fn random_cut(scene: &Scene, seed: u64) -> Vec<Drawable> {
    let mut state = seed;
    cut(scene, |_, levels| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let (stop, level) = ((state >> 33).is_multiple_of(3), (state >> 40) as usize);
        (stop && !levels.is_empty()).then(|| level % levels.len())
    })
}

/// Parts and the nodes over them: nodes of an object with levels that have an error.
fn with_levels(scene: &Scene) -> impl Iterator<Item = (u32, &Node)> {
    let coarse = |node: &Node| node.drawables().any(|id| scene.drawables()[id.index()].error > 0.0);
    (0..).zip(scene.nodes()).filter(move |(_, node)| node.object != Node::NONE && coarse(node))
}

/// The finest triangles of the leaves at and below a node.
fn finest_below(scene: &Scene, node: u32) -> Vec<[DVec3; 3]> {
    let mut finest = Vec::new();
    let mut open = vec![node];
    while let Some(index) = open.pop() {
        let node = &scene.nodes()[index as usize];
        if node.is_leaf() {
            finest.extend(triangles(scene, &scene.drawables()[node.first_drawable as usize]));
        }
        open.extend(node.children());
    }
    finest
}

fn distance_to_segment(point: DVec3, from: DVec3, to: DVec3) -> f64 {
    let part = (point - from).dot(to - from) / from.distance_squared(to);
    point.distance(from.lerp(to, part.clamp(0.0, 1.0)))
}

fn distance_to_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside = |from: DVec3, to: DVec3| (to - from).cross(point - from).dot(normal) >= 0.0;
    if normal != DVec3::ZERO && inside(a, b) && inside(b, c) && inside(c, a) {
        return (point - a).dot(normal).abs();
    }
    distance_to_segment(point, a, b)
        .min(distance_to_segment(point, b, c))
        .min(distance_to_segment(point, c, a))
}

/// The largest distance of corners and middles of some triangles of `from` from those of `to`.
fn farthest(from: &[[DVec3; 3]], to: &[[DVec3; 3]], samples: usize) -> f64 {
    let some = from.iter().step_by(from.len().div_ceil(samples));
    some.flat_map(|&[a, b, c]| [a, (a + b + c) / 3.0])
        .map(|point| to.iter().map(|&t| distance_to_triangle(point, t)).fold(f64::INFINITY, f64::min))
        .fold(0.0, f64::max)
}

#[test]
fn whatever_levels_parts_are_drawn_at_a_closed_surface_stays_closed() {
    let scene = cooked(hull(130), &[DVec3::ZERO]);
    assert!(with_levels(&scene).count() > 5, "a node for each of at least five parts");
    let mut mixed = 0;
    for seed in 0..60 {
        let drawn = random_cut(&scene, seed);
        let coarse = drawn.iter().filter(|drawable| drawable.error > 0.0).count();
        mixed += usize::from(coarse > 1 && coarse < drawn.len());
        assert_eq!(open_edges(&scene, &drawn), 0, "cut {seed} of {} drawables", drawn.len());
    }
    assert!(mixed > 10, "{mixed} cuts mix levels");
    let coarsest = scene.levels(&scene.nodes()[0]).next_back().unwrap();
    let coarsest: u32 = coarsest.pieces().map(|id| scene.drawables()[id.index()].triangles).sum();
    assert!(coarsest < 100, "{coarsest} triangles of the whole at its coarsest");
}

#[test]
fn small_things_between_parts_are_whole_or_not_there() {
    let scene = cooked(rubble(9000), &[DVec3::ZERO]);
    for seed in 0..40 {
        let drawn = random_cut(&scene, seed);
        assert_eq!(open_edges(&scene, &drawn), 0, "cut {seed} of {} drawables", drawn.len());
    }
    let coarsest = cut(&scene, |_, levels| levels.len().checked_sub(1));
    let coarsest: u32 = coarsest.iter().map(|drawable| drawable.triangles).sum();
    assert!(coarsest < 72_000 / 6, "{coarsest} of 72,000 triangles at the coarsest levels");
}

#[test]
fn near_one_corner_only_that_corner_is_fine() {
    let scene = cooked(field(300), &[DVec3::ZERO]);
    let eye = DVec3::new(0.0, height(0.0, 0.0) + 1.7, 0.0);
    // A five-hundredth of the distance is two pixels of a picture a thousand pixels high.
    let drawn = cut(&scene, |node, levels| {
        let (min, max) = node.world_box();
        let distance = eye.distance(eye.clamp(min, max));
        levels.iter().rposition(|level| f64::from(level.error) <= 2e-3 * distance)
    });
    let count = |finest: bool| -> u32 {
        let counted = drawn.iter().filter(|drawable| (drawable.error == 0.0) == finest);
        counted.map(|drawable| drawable.triangles).sum()
    };
    let (fine, coarse) = (count(true), count(false));
    assert!((1..=1 << 13).contains(&fine), "{fine} of 180,000 triangles are at their finest");
    assert!(coarse < 12_000, "{coarse} triangles of the rest");
}

#[test]
fn no_level_of_a_part_is_farther_from_the_finest_than_it_claims() {
    let scene = cooked(hull(130), &[DVec3::new(1e6, 0.0, -3e5)]);
    let mut checked = 0;
    for (index, node) in with_levels(&scene) {
        let finest = finest_below(&scene, index);
        for pieces in scene.levels(node) {
            let drawable = scene.drawables()[pieces.first().index()];
            let pieces = pieces.pieces().map(|id| scene.drawables()[id.index()]);
            let level: Vec<_> = pieces.flat_map(|piece| triangles(&scene, &piece)).collect();
            let found = farthest(&finest, &level, 60).max(farthest(&level, &finest, 60));
            assert!(found <= f64::from(drawable.error), "node {index}: {found} for {}", drawable.error);
            checked += usize::from(found > 0.1 * f64::from(drawable.error));
        }
    }
    assert!(checked > 20, "the samples come near what {checked} levels claim");
}

#[test]
fn a_giant_is_one_object_its_instances_share_its_levels_and_its_bytes_are_the_same_on_any_number_of_threads()
{
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cooked(field(184), &[DVec3::ZERO, DVec3::new(0.0, 300.0, 0.0)]))
    };
    let scene = on(3);
    let levels = |object: u32| -> Vec<(u32, u32)> {
        let drawables = scene.drawables().iter();
        let own = drawables.filter(|drawable| scene.nodes()[drawable.node as usize].object == object);
        own.map(|d| (d.geometry, d.triangles)).collect()
    };
    assert_eq!(levels(0), levels(1));
    assert!(levels(0).len() > 500, "clusters, parts and levels");
    assert_eq!(scene.totals().full_detail_triangles, 2 * 2 * 184 * 184);
    assert!(scene.nodes().iter().all(|node| node.child_count <= 8));
    assert!(scene.objects().iter().map(|object| object.source_index).eq([7, 8]));
    assert_eq!(scene.hash(), on(1).hash());
}
