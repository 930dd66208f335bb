//! Whole scenes: cooking's guarantees about trees, boxes, levels and errors.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use trimaran_cook::{CookError, CookOptions, cook};
use trimaran_cook::{Mesh, Model, Object, Source};
use trimaran_proto::DrawableId;
use trimaran_scene::{Level, Node, NodeId, Rgba8, Scene};

/// A pipe along x: `sides` sides, `rings` rings, radius 0.1, length 2.
fn pipe(sides: u32, rings: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        for side in 0..sides {
            let angle = std::f32::consts::TAU * side as f32 / sides as f32;
            let x = 2.0 * ring as f32 / rings as f32;
            mesh.positions.push(Vec3::new(x, 0.1 * angle.cos(), 0.1 * angle.sin()));
            mesh.colours.push(Rgba8([200, 100, 50, 255]));
        }
    }
    for ring in 0..rings {
        for side in 0..sides {
            let (a, b) = (ring * sides + side, ring * sides + (side + 1) % sides);
            mesh.indices.extend([a, b, a + sides, b, b + sides, a + sides]);
        }
    }
    mesh
}

fn object(mesh: u32, to_world: DAffine3, index: u32) -> Object {
    Object { mesh, to_world, name: format!("pipe {index}"), source: 0, source_index: index }
}

/// Pipes in a grid, every third sheared, every fifth mirrored, some far away.
fn rack() -> Model {
    let mut objects = Vec::new();
    for index in 0..150_u32 {
        let (x, y, z) = (index % 5, index / 5 % 6, index / 30);
        let linear = if index % 3 == 0 {
            DMat3::from_cols(DVec3::X * 2.0, DVec3::new(0.7, 1.0, 0.0), DVec3::Z)
        } else if index % 5 == 0 {
            DMat3::from_diagonal(DVec3::new(-1.0, 0.5, 3.0))
        } else {
            DMat3::from_rotation_y(f64::from(index))
        };
        let away = if index == 77 { 5e4 } else { 0.0 };
        let place = DVec3::new(3.0 * f64::from(x) + away, 0.4 * f64::from(y), 2.0 * f64::from(z));
        objects.push(object(index % 2, DAffine3::from_mat3_translation(linear, place), index));
    }
    Model {
        meshes: vec![pipe(24, 12), pipe(8, 1)],
        objects,
        sources: vec![Source { name: "rack.glb".to_owned() }],
        ..Model::default()
    }
}

fn cooked(model: &Model) -> Scene {
    cook(model, &CookOptions::default(), &()).unwrap()
}

/// The vertices of each drawable in the world, with its node.
fn world_vertices(scene: &Scene) -> impl Iterator<Item = (usize, u32, DVec3)> {
    scene.drawables().iter().enumerate().flat_map(move |(id, d)| {
        let node = scene.nodes()[d.node as usize];
        let place = move |local: Vec3| node.origin() + node.linear().as_dmat3() * local.as_dvec3();
        scene.triangles(d).flatten().map(move |local| (id, d.node, place(local)))
    })
}

/// The topmost node of each object.
fn object_nodes(scene: &Scene) -> impl Iterator<Item = &Node> {
    scene.nodes().iter().filter(|node| {
        let parent = scene.nodes().get(node.parent as usize);
        node.object != Node::NONE && parent.is_none_or(|parent| parent.object == Node::NONE)
    })
}

#[test]
fn each_object_is_one_subtree_whose_leaves_have_all_its_triangles() {
    let model = rack();
    let scene = cooked(&model);
    let mut seen = vec![0; model.objects.len()];
    object_nodes(&scene).for_each(|node| seen[node.object as usize] += 1);
    assert!(seen.iter().all(|&count| count == 1));
    let mut triangles = vec![0; model.objects.len()];
    for leaf in scene.nodes().iter().filter(|node| node.is_leaf()) {
        let finest = scene.drawables()[leaf.first_drawable as usize];
        triangles[leaf.object as usize] += finest.triangles as usize;
        assert_eq!(finest.error, 0.0);
    }
    let expected: Vec<_> =
        model.objects.iter().map(|object| model.meshes[object.mesh as usize].triangle_count()).collect();
    assert_eq!(triangles, expected);
    assert_eq!(scene.totals().full_detail_triangles, expected.iter().sum::<usize>() as u64);
    let clusters = scene.nodes().iter().filter(|node| node.is_leaf() && node.object == 2).count();
    assert!(clusters > 5, "576 triangles make clusters, not {clusters}");
    assert_eq!(scene.object_name(7), Some("pipe 7"));
    assert!(scene.nodes().iter().all(|node| node.child_count <= 8));
}

/// A mesh of some clusters, placed a thousand times: no node is made if there would be too many.
#[test]
fn more_nodes_than_allowed_are_refused_with_the_object_that_takes_most() {
    let mut model = rack();
    let nodes = cooked(&model).nodes().len();
    let within = |model: &Model, max_nodes| {
        let options = CookOptions { max_nodes, ..CookOptions::default() };
        cook(model, &options, &()).map(|scene| scene.nodes().len())
    };
    assert_eq!(within(&model, 2 * nodes).unwrap(), nodes);
    assert!(matches!(within(&model, nodes / 2), Err(CookError::TooManyNodes { .. })));
    // Mesh 0 is small, and this one in clusters.
    model.meshes.push(pipe(48, 100));
    let fine = model.meshes.len() as u32 - 1;
    model.objects.extend((0..1000).map(|index| object(fine, DAffine3::IDENTITY, 5000 + index)));
    let error = within(&model, 2 * nodes).unwrap_err();
    let CookError::TooManyNodes { object: 150, ref name, nodes, own, .. } = error else {
        unreachable!("{error}")
    };
    assert!(name == "pipe 5000" && own > 100 && nodes > 1000 * own, "{error}");
    assert!(error.to_string().contains("--max-nodes"), "{error}");
}

#[test]
fn boxes_hold_every_level_of_the_node_and_of_all_below() {
    let scene = cooked(&rack());
    let mut pieces = 0;
    for (id, node, point) in world_vertices(&scene) {
        let (drawable, part) = scene.part(DrawableId(id as u32)).unwrap();
        let (low, high) = part.world_box();
        assert!(point.cmpge(low).all() && point.cmple(high).all(), "drawable {id}: {point}");
        pieces += usize::from(drawable.pieces > 1);
        for (NodeId(up), record) in scene.ancestors(NodeId(node)) {
            let (low, high) = record.world_box();
            assert!(point.cmpge(low).all() && point.cmple(high).all(), "drawable {id}, node {up}: {point}");
        }
    }
    assert!(pieces > 1000, "{pieces} vertices are of levels in pieces");
}

#[test]
fn instances_share_levels_and_scale_their_errors() {
    let scene = cooked(&rack());
    let levels = |object: u32| {
        let node = object_nodes(&scene).find(|n| n.object == object).unwrap();
        let first = node.first_drawable as usize;
        scene.drawables().range(first..first + node.drawable_count as usize).collect::<Vec<_>>()
    };
    // 10 is mirrored and stretched threefold along one axis, 2 is only turned; both are the finer pipe.
    let (stretched, plain) = (levels(10), levels(2));
    assert!(plain.len() > 1, "the pipe has 576 triangles and should have levels");
    for (s, p) in stretched.iter().zip(&plain) {
        assert_eq!((s.geometry, s.triangles), (p.geometry, p.triangles));
        assert!((f64::from(s.error) - 3.0 * f64::from(p.error)).abs() <= 1e-5 * f64::from(s.error));
    }
}

fn triangles_of(scene: &Scene, level: Level) -> u32 {
    level.pieces().map(|id| scene.drawables()[id.index()].triangles).sum()
}

#[test]
fn coarse_levels_of_a_clustered_mesh_have_at_most_a_quarter_of_its_triangles() {
    let mut model = rack();
    model.meshes = vec![pipe(64, 9), pipe(8, 8)];
    let scene = cooked(&model);
    let triangles = |mesh: u32| -> Vec<u32> {
        let object = model.objects.iter().position(|object| object.mesh == mesh).unwrap();
        let node = object_nodes(&scene).find(|node| node.object == object as u32).unwrap();
        scene.levels(node).map(|level| triangles_of(&scene, level)).collect()
    };
    let (clustered, whole) = (triangles(0), triangles(1));
    assert!(clustered.len() > 1 && clustered.iter().all(|level| 4 * level <= 2 * 64 * 9), "{clustered:?}");
    assert!(whole.len() > 1 && 2 * whole[1] <= whole[0] && 4 * whole[1] > whole[0], "{whole:?}");
}

#[test]
fn a_merged_level_is_as_near_as_it_claims() {
    let scene = cooked(&rack());
    let fine: Vec<DVec3> = world_vertices(&scene)
        .filter(|&(id, node, _)| {
            let node = &scene.nodes()[node as usize];
            node.is_leaf() && scene.drawables()[id].error == 0.0
        })
        .map(|(_, _, point)| point)
        .collect();
    let root = scene.nodes()[0];
    let inner = scene.nodes().iter().filter(|n| n.object == Node::NONE && n.drawable_count > 0).count();
    assert!(inner > 0, "144 objects below {} children should be merged somewhere", root.child_count);
    // Coarse vertices are some of the fine ones, so each has one within the error; dense sampling is in
    // cook_hausdorff.
    for (id, node, point) in world_vertices(&scene) {
        if scene.nodes()[node as usize].object != Node::NONE {
            continue;
        }
        let nearest = fine.iter().map(|q| q.distance(point)).fold(f64::INFINITY, f64::min);
        assert!(nearest <= f64::from(scene.drawables()[id].error), "drawable {id}: {nearest}");
    }
}

/// The least squared distance to a dense grid of points on a triangle.
fn squared_distance_to(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let n = 24;
    let grid = (0..=n)
        .flat_map(|i| (0..=n - i).map(move |j| (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n))));
    grid.map(|(u, v)| point.distance_squared(a + (b - a) * u + (c - a) * v)).fold(f64::INFINITY, f64::min)
}

#[test]
fn no_point_of_the_finest_geometry_is_farther_from_a_merged_level_than_its_error() {
    let scene = cooked(&rack());
    let triangles = |id: usize| -> Vec<[DVec3; 3]> {
        let corners: Vec<DVec3> = world_vertices(&scene).filter(|v| v.0 == id).map(|v| v.2).collect();
        corners.as_chunks::<3>().0.to_vec()
    };
    let is_below = |node: u32, top: u32| scene.ancestors(NodeId(node)).any(|(above, _)| above.0 == top);
    // The finest levels below: those without an error.
    let merged = scene.nodes().iter().filter(|node| node.object == Node::NONE);
    let mut checked = 0;
    for pieces in merged.flat_map(|node| scene.levels(node)) {
        let id = pieces.first();
        let level = scene.drawables()[id.index()];
        let coarse: Vec<[DVec3; 3]> = pieces.pieces().flat_map(|id| triangles(id.index())).collect();
        let longest = coarse
            .iter()
            .flat_map(|&[a, b, c]| [a.distance(b), b.distance(c), c.distance(a)])
            .fold(0.0, f64::max);
        let finest = scene
            .drawables()
            .iter()
            .enumerate()
            .filter(|(_, d)| d.error == 0.0 && is_below(d.node, level.node));
        for (fine, _) in finest.step_by(7) {
            for [a, b, c] in triangles(fine).into_iter().step_by(29) {
                for point in [a, (a + b) / 2.0, (a + b + c) / 3.0] {
                    let squared =
                        coarse.iter().map(|&t| squared_distance_to(point, t)).fold(f64::INFINITY, f64::min);
                    // The grid on the coarse triangles overestimates distances by at most its spacing.
                    let most = f64::from(level.error) + longest / 24.0;
                    assert!(squared.sqrt() <= most, "drawable {id}: {} of {most}", squared.sqrt());
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 100, "{checked}");
}

/// A level that left out distant parts would be useless: its error would be their distance.
#[test]
fn merged_levels_are_small_and_near_what_they_stand_for() {
    let mut model = rack();
    model.objects.clear();
    for index in 0..1000_u32 {
        let (x, y, z) = (index % 10, index / 10 % 10, index / 100);
        let place = 8.0 * DVec3::new(f64::from(x), f64::from(y), f64::from(z));
        let turn = DMat3::from_rotation_y(f64::from(index));
        model.objects.push(object(0, DAffine3::from_mat3_translation(turn, place), index));
    }
    let most = CookOptions::default().merged_triangles as u32;
    let scene = cooked(&model);
    let merged = scene.drawables().iter().filter(|d| scene.nodes()[d.node as usize].object == Node::NONE);
    for level in merged {
        let (low, high) = scene.nodes()[level.node as usize].world_box();
        let part = f64::from(level.error) / low.distance(high);
        assert!(part < 0.15, "an error of {part} of node {}", level.node);
        assert!(level.triangles <= most, "{} triangles", level.triangles);
    }
    let root = scene.nodes()[0];
    let first = |level: Level| scene.drawables()[level.first().index()];
    let errors: Vec<f32> = scene.levels(&root).map(|level| first(level).error).collect();
    let (low, high) = root.world_box();
    assert_eq!(errors.len(), 2, "the root stands for all, finely and coarsely");
    assert!(errors[0] * 1.2 < errors[1] && f64::from(errors[0]) < 0.1 * low.distance(high), "{errors:?}");
}

#[test]
fn the_same_model_makes_the_same_bytes_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cooked(&rack()).hash())
    };
    assert_eq!(on(1), on(2));
    assert_eq!(on(1), on(7));
}

#[test]
fn coincident_objects_and_a_lone_one_make_trees() {
    let mut model = rack();
    for object in &mut model.objects {
        object.to_world = DAffine3::IDENTITY;
    }
    assert_eq!(object_nodes(&cooked(&model)).count(), 150);
    model.objects.truncate(1);
    let scene = cooked(&model);
    assert!(scene.nodes().iter().all(|node| node.object == 0), "the root is the object itself");
}

#[test]
fn nothing_to_draw_is_an_error_and_empty_objects_have_no_leaf() {
    let mut model = rack();
    model.meshes[1] = Mesh::default();
    assert_eq!(object_nodes(&cooked(&model)).count(), 75);
    let point = Vec3::splat(2.0);
    model.meshes[0] =
        Mesh { positions: vec![point; 3], colours: vec![Rgba8([0; 4]); 3], indices: vec![0, 1, 2] };
    assert!(matches!(cook(&model, &CookOptions::default(), &()), Err(CookError::Empty { objects: 150 })));
    assert!(matches!(
        cook(&Model::default(), &CookOptions::default(), &()),
        Err(CookError::Empty { objects: 0 })
    ));
}

#[test]
fn a_placement_beyond_single_precision_is_refused_by_name() {
    let mut model = rack();
    model.objects[3].to_world.matrix3 *= 1e60;
    let message = cook(&model, &CookOptions::default(), &()).unwrap_err().to_string();
    assert!(message.contains("pipe 3"), "{message}");
}

/// Slats of 32 triangles: half of them would be saved, but that is less than a draw costs, and the slats
/// would separate.
#[test]
fn a_small_part_is_drawn_as_it_is() {
    let mut model = rack();
    model.meshes = vec![pipe(8, 2), pipe(8, 4)];
    let scene = cooked(&model);
    let levels = |mesh: u32| {
        let object = model.objects.iter().position(|object| object.mesh == mesh).unwrap();
        scene.levels(object_nodes(&scene).find(|node| node.object == object as u32).unwrap()).count()
    };
    assert_eq!(levels(0), 1, "of 32 triangles 16 could be saved");
    assert!(levels(1) > 1, "of 64 triangles 32 are");
}

#[test]
fn a_mesh_has_the_same_levels_at_any_size() {
    let mut model = rack();
    model.meshes = vec![pipe(64, 1), pipe(64, 1)];
    model.meshes[0].positions.iter_mut().for_each(|p| *p /= 16_384.0);
    model.objects.truncate(2);
    let scene = cooked(&model);
    let triangles = |object: u32| -> Vec<u32> {
        let node = object_nodes(&scene).find(|node| node.object == object).unwrap();
        scene.levels(node).map(|level| triangles_of(&scene, level)).collect()
    };
    assert_eq!(triangles(0), triangles(1));
    assert!(triangles(1).len() > 2, "{:?}", triangles(1));
}
