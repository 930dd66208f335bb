//! The description of a scene that a page gets first: its extent, and where to begin.

use std::{path::PathBuf, sync::Arc};

use serde::{Serialize, Serializer};
use trimaran_proto::{ObjectSet, Viewport};
use trimaran_scene::{Bounds, Overview, PlantFrame, Scene, heightfield::Heightfield, path::AutoPathError};
use trimaran_transport::{Endpoint, Name};

use super::network::{self, SimulatedNetwork};

/// A scene's description for the page. Lengths are metres, in world space with y up.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct SceneDescription {
    /// The model's name: see [`model_name`].
    pub name: String,
    /// The scene's fingerprint, 32 hexadecimal digits.
    pub fingerprint: String,
    /// How many objects it has.
    pub objects: u32,
    /// Corners of the box around it.
    pub min: [f64; 3],
    /// The upper corner.
    pub max: [f64; 3],
    /// The plant's coordinates.
    pub plant: PlantFrame,
    /// The box around it without the few objects that lie far from all others.
    pub core: Bounds,
    /// Points that a view of all of that must show.
    pub outermost: Vec<[f64; 3]>,
    /// The model's see-through objects, with which the page begins. Runs, as [`ObjectSet`] codes them.
    pub see_through: ObjectSet,
    /// Whether there are floors to walk on.
    pub has_floors: bool,
    /// Height of the eye above floors.
    pub eye_height: f64,
    /// Side of a tile of the heightfield: see [`Heightfield`].
    pub tile_side: f64,
    /// The smallest distance between a walking eye and the scene.
    pub clearance: f64,
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
    /// Where to begin.
    pub start: Start,
    /// The largest width and height that the service culls for, pixels.
    pub max_picture: Viewport,
    /// Where cullers of the service connect to each other, when a page uses two of them in turn.
    #[serde(serialize_with = "as_text")]
    pub meeting: Endpoint,
    /// The networks that can be simulated between the page and its culler.
    pub networks: Vec<SimulatedNetwork>,
}

fn as_text<S: Serializer>(endpoint: &Endpoint, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(endpoint)
}

/// Where a person begins.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Start {
    /// The eye's position.
    pub eye: [f64; 3],
    /// Its viewing direction, a unit vector.
    pub forward: [f64; 3],
}

/// The name of a model of these files: that of the first, without its extension.
#[must_use]
pub fn model_name(files: &[PathBuf]) -> String {
    let stem = files.first().and_then(|file| file.file_stem());
    let name = stem.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    match files.len() {
        0 | 1 => name,
        count => format!("{name} and {} more", count - 1),
    }
}

impl SceneDescription {
    /// The description of a scene of this name, without a picture limit.
    ///
    /// # Errors
    /// As [`Scene::overview`].
    pub fn new(name: String, scene: &Arc<Scene>) -> Result<Self, AutoPathError> {
        let Overview { core, eye, forward, has_floors, eye_height, clearance, vfov_deg } =
            scene.overview()?;
        let (min, max) = scene.nodes().first().map(trimaran_scene::Node::world_box).unwrap_or_default();
        Ok(Self {
            name,
            fingerprint: format!("{:032x}", scene.outline().hash.0),
            objects: scene.outline().objects,
            min: min.to_array(),
            max: max.to_array(),
            plant: scene.coordinates()?.plant,
            outermost: scene.outermost_points(&core)?,
            core,
            see_through: scene.see_through().clone(),
            has_floors,
            eye_height,
            tile_side: Heightfield::new(scene, eye_height).tile_side(),
            clearance,
            vfov_deg,
            start: Start { eye, forward },
            max_picture: Viewport::LARGEST,
            meeting: Endpoint::Inproc(Name::unique()),
            networks: network::names(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_is_called_as_its_files_are() {
        let name = |files: &[&str]| model_name(&files.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(name(&["models/WD1-PSUP.rvm"]), "WD1-PSUP");
        assert_eq!(name(&["deck.1.obj", "b.obj", "c.obj"]), "deck.1 and 2 more");
        assert_eq!(name(&[]), "");
    }
}
