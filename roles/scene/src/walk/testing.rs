//! Uncooked scenes for this module's tests: each object a leaf with its one level, under one root.

use glam::{DAffine3, DVec3, Vec3};

use trimaran_cook::{Mesh, Model, Object, Rgba8, Source};

use crate::{Drawable, Node, ObjectRecord, Scene, SceneArrays, Vertex};

/// A scene with every object of the model at its finest level only.
pub(super) fn uncooked(model: &Model) -> Scene {
    let mut arrays = SceneArrays { sources: vec!["test".to_owned()], ..SceneArrays::default() };
    let ranges: Vec<(u32, u32)> = model
        .meshes
        .iter()
        .map(|mesh| {
            let range = (arrays.indices.len() as u32, arrays.vertices.len() as u32);
            arrays.indices.extend(&mesh.indices);
            let vertices = mesh.positions.iter().zip(&mesh.colours);
            arrays
                .vertices
                .extend(vertices.map(|(p, &colour)| Vertex::new(p.to_array(), crate::Rgba8(colour.0))));
            range
        })
        .collect();
    let leaves: Vec<Node> =
        model.objects.iter().zip(0..).map(|(object, index)| leaf(model, object, index)).collect();
    let (min, max) = leaves.iter().map(Node::world_box).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap();
    let root = Node {
        world_min: min.to_array(),
        world_max: max.to_array(),
        origin: min.to_array(),
        linear: glam::Mat3::IDENTITY.to_cols_array(),
        local_min: [-1e-3; 3],
        local_max: (max - min).as_vec3().map(|c| c * 1.001 + 1e-3).to_array(),
        parent: Node::NONE,
        first_child: 1,
        child_count: leaves.len() as u32,
        first_drawable: 0,
        drawable_count: 0,
        object: Node::NONE,
        reserved: 0,
    };
    arrays.nodes = [root].into_iter().chain(leaves).collect();
    for (object, index) in model.objects.iter().zip(0_u32..) {
        let mesh = &model.meshes[object.mesh as usize];
        let (first_index, vertex_offset) = ranges[object.mesh as usize];
        arrays.drawables.push(Drawable {
            error: 0.0,
            node: index + 1,
            first_index,
            index_count: mesh.indices.len() as u32,
            vertex_offset,
            vertex_count: mesh.positions.len() as u32,
        });
        arrays.objects.push(ObjectRecord { source: 0, source_index: index, name_start: 0, name_length: 0 });
    }
    Scene::from_arrays(arrays).unwrap()
}

fn leaf(model: &Model, object: &Object, index: u32) -> Node {
    let mesh = &model.meshes[object.mesh as usize];
    let local = |p: &Vec3| (p.to_array(), object.to_world.transform_point3(p.as_dvec3()));
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    let (mut min, mut max) = (DVec3::MAX, DVec3::MIN);
    for (point, world) in mesh.positions.iter().map(local) {
        low = std::array::from_fn(|a| low[a].min(point[a]));
        high = std::array::from_fn(|a| high[a].max(point[a]));
        (min, max) = (min.min(world), max.max(world));
    }
    Node {
        world_min: (min - 1e-4).to_array(),
        world_max: (max + 1e-4).to_array(),
        origin: object.to_world.translation.to_array(),
        linear: object.to_world.matrix3.as_mat3().to_cols_array(),
        local_min: low,
        local_max: high,
        parent: 0,
        first_child: 0,
        child_count: 0,
        first_drawable: index,
        drawable_count: 1,
        object: index,
        reserved: 0,
    }
}

/// A model of boxes, each given by its corners.
pub(super) fn boxes(corners: &[([f64; 3], [f64; 3])]) -> Model {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32);
    let cube = Mesh {
        positions: (0..8).map(corner).collect(),
        colours: vec![Rgba8([200; 4]); 8],
        indices: [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
            .iter()
            .flat_map(|&[a, b, c, d]| [a, b, c, a, c, d])
            .collect(),
    };
    let objects = corners
        .iter()
        .map(|&(min, max)| {
            let (min, max) = (DVec3::from_array(min), DVec3::from_array(max));
            let to_world = DAffine3::from_scale_rotation_translation(max - min, glam::DQuat::IDENTITY, min);
            Object { mesh: 0, to_world, name: String::new(), source: 0, source_index: 0 }
        })
        .collect();
    Model { meshes: vec![cube], objects, sources: vec![Source { name: "test".to_owned() }] }
}
