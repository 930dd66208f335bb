//! Uncooked scenes for this module's tests: each object a leaf with its one level, under one root.

use glam::{DAffine3, DVec3, Vec3};

use trimaran_cook::{Mesh, Model, Object, Rgba8, Source};

use crate::{FlatObject, Scene, SceneArrays};

/// A scene with every object of the model, only at its finest level.
pub(crate) fn uncooked(model: &Model) -> Scene {
    let flat = |object: &Object| {
        let Mesh { positions, indices, .. } = model.meshes[object.mesh as usize].clone();
        let DAffine3 { matrix3, translation: origin } = object.to_world;
        FlatObject { positions, indices, colour: crate::Rgba8([200; 4]), linear: matrix3.as_mat3(), origin }
    };
    Scene::from_arrays(SceneArrays::flat(&model.objects.iter().map(flat).collect::<Vec<_>>())).unwrap()
}

/// A model of boxes, each given by its corners.
pub(crate) fn boxes(corners: &[([f64; 3], [f64; 3])]) -> Model {
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
    Model {
        meshes: vec![cube],
        objects,
        sources: vec![Source { name: "test".to_owned() }],
        ..Model::default()
    }
}
