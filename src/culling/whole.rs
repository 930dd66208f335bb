//! The whole model at full detail, without levels and culling.

use trimaran_actors::RoleError;
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_scene::{Level, Scene};

use super::work::{FrameCuller, Seen};

/// Takes the same drawables in each frame: those of the finest level of every leaf.
pub(super) struct Whole {
    finest: Vec<DrawableId>,
}

impl Whole {
    pub(super) fn new(scene: &Scene) -> Self {
        let leaves = scene.nodes().iter().filter(|node| node.is_leaf());
        let finest = leaves.flat_map(|leaf| scene.levels(leaf).next().into_iter().flat_map(Level::pieces));
        Self { finest: finest.collect() }
    }
}

impl FrameCuller for Whole {
    fn draw_occluders(&mut self, _: Seen<'_>, _: &[DrawableId]) -> Result<&[DrawableId], RoleError> {
        Ok(&[])
    }

    fn cull(&mut self, _: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError> {
        found.extend_from_slice(&self.finest);
        let emitted = u32::try_from(found.len()).unwrap_or(u32::MAX);
        Ok(CullCounts { emitted, ..CullCounts::default() })
    }
}
