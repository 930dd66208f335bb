//! Scenes with deliberate errors, which checks must notice.

use trimaran_scene::{Coordinates, Drawable, Hierarchy, Node, ObjectRecord, Scene, SceneArrays, SceneError};

/// The scene with other nodes and drawables, and without names or coordinates of a plant.
///
/// # Errors
/// If the scene's own rules no longer hold.
pub fn with_records(scene: &Scene, nodes: Vec<Node>, drawables: Vec<Drawable>) -> Result<Scene, SceneError> {
    let unnamed = |object: &ObjectRecord| ObjectRecord { name_start: 0, name_length: 0, ..*object };
    let mut reader = scene.reader();
    let geometries = (0..scene.places().len() as u32).map(|number| reader.read(number).unwrap_or_default());
    Scene::from_arrays(SceneArrays {
        nodes,
        drawables,
        geometries: geometries.collect(),
        objects: scene.objects().iter().map(unnamed).collect(),
        names: String::new(),
        sources: scene.sources().to_vec(),
        see_through: scene.see_through().clone(),
        hierarchy: Hierarchy::default(),
        coordinates: Coordinates::default(),
    })
}

/// The scene with the boxes of its leaves half as large, about the same centres.
///
/// # Errors
/// As [`with_records`]; none is expected.
pub fn with_halved_boxes(scene: &Scene) -> Result<Scene, SceneError> {
    let mut nodes = scene.nodes().to_vec();
    for node in nodes.iter_mut().filter(|node| node.is_leaf()) {
        for axis in 0..3 {
            let (low, high) = (node.local_min[axis], node.local_max[axis]);
            let (near, far) = (low * 0.75 + high * 0.25, low * 0.25 + high * 0.75);
            (node.local_min[axis], node.local_max[axis]) = (near, far);
            let (low, high) = (node.world_min[axis], node.world_max[axis]);
            let (near, far) = (low * 0.75 + high * 0.25, low * 0.25 + high * 0.75);
            (node.world_min[axis], node.world_max[axis]) = (near, far);
        }
    }
    with_records(scene, nodes, scene.drawables().to_vec())
}
