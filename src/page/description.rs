//! What the page is told of a scene before anything of it comes: where it lies, and where to begin.

use std::{path::PathBuf, sync::Arc};

use serde::{Serialize, Serializer};
use trimaran_netsim::Profile;
use trimaran_proto::{ObjectSet, Viewport};
use trimaran_scene::{
    Scene,
    heightfield::Heightfield,
    path::{AutoPathError, AutoPathOptions, PathKind, auto},
};
use trimaran_transport::{Endpoint, Name};

use super::extents::{Bounds, core};

/// A scene as the page is told of it. Lengths are metres, in world space with y up.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct SceneDescription {
    /// What the model is called: see [`model_name`].
    pub name: String,
    /// The scene's fingerprint, 32 hexadecimal digits.
    pub fingerprint: String,
    /// How many objects it has.
    pub objects: u32,
    /// Corners of the box around it.
    pub min: [f64; 3],
    /// The upper corner.
    pub max: [f64; 3],
    /// The box around it without the few objects that lie far from all others.
    pub core: Bounds,
    /// What the model has see-through: the page begins with it so. Runs, as [`ObjectSet`] codes them.
    pub see_through: ObjectSet,
    /// Whether there are floors to walk on.
    pub has_floors: bool,
    /// Height of the eye above floors.
    pub eye_height: f64,
    /// Side of a tile of what is solid: see [`Heightfield`].
    pub tile_side: f64,
    /// Nothing comes nearer to an eye of a walk than this.
    pub clearance: f64,
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
    /// Where to begin.
    pub start: Start,
    /// The widest and the highest picture that the service culls for, pixels.
    pub max_picture: Viewport,
    /// Where cullers of the service meet each other, when a page asks two of them to take turns.
    #[serde(serialize_with = "as_text")]
    pub meeting: Endpoint,
    /// The networks that can be simulated between the page and its culler.
    pub networks: Vec<Network>,
}

fn as_text<S: Serializer>(endpoint: &Endpoint, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(endpoint)
}

/// A network that can be simulated.
#[derive(Debug, Clone, Serialize)]
pub struct Network {
    /// What it is called.
    pub name: String,
    /// What it is.
    pub about: String,
}

/// Where a person begins.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Start {
    /// The eye.
    pub eye: [f64; 3],
    /// Which way it looks, a unit vector.
    pub forward: [f64; 3],
}

/// What a model of these files is called: as the first of them, without its ending.
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
    /// That of a scene of this name, for pictures of any size. Looks for a place to begin, which takes a moment
    /// in a large scene.
    ///
    /// # Errors
    /// When there is no place, which a scene of any shape has.
    pub fn new(name: String, scene: &Arc<Scene>) -> Result<Self, AutoPathError> {
        let options = AutoPathOptions { frames: 1, teleport: false, ..AutoPathOptions::default() };
        let found = auto(scene, &options)?;
        let (min, max) = scene.nodes().first().map(trimaran_scene::Node::world_box).unwrap_or_default();
        let pose = found.path.frames().first();
        let start = Start {
            eye: pose.map_or([0.0; 3], |pose| pose.eye().to_array()),
            forward: pose.map_or([0.0, 0.0, -1.0], |pose| pose.forward().to_array()),
        };
        Ok(Self {
            name,
            fingerprint: format!("{:032x}", scene.outline().hash.0),
            objects: scene.outline().objects,
            min: min.to_array(),
            max: max.to_array(),
            core: core(scene, 0..scene.outline().objects),
            see_through: scene.see_through().clone(),
            has_floors: found.kind == PathKind::Floors,
            eye_height: found.eye_height,
            tile_side: Heightfield::new(scene, found.eye_height).tile_side(),
            clearance: found.clearance,
            vfov_deg: found.path.vfov_deg(),
            start,
            max_picture: Viewport::LARGEST,
            meeting: Endpoint::Inproc(Name::unique()),
            networks: Profile::names()
                .filter_map(|name| Profile::find(name).ok())
                .map(|Profile { name, about, .. }| Network { name, about })
                .collect(),
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
