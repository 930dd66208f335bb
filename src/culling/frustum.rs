//! Frustum culling only, without occlusion culling.

use std::sync::Arc;

use trimaran_actors::RoleError;
use trimaran_cull::{CullError, lod_cut};
use trimaran_gpu::VulkanCuller;
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_scene::Scene;

use super::work::{FrameCuller, Seen};

/// Finds the whole LOD cut in the frustum.
pub(super) struct Frustum {
    scene: Arc<Scene>,
}

impl Frustum {
    pub(super) fn new(scene: &Arc<Scene>) -> Self {
        Self { scene: Arc::clone(scene) }
    }
}

impl FrameCuller for Frustum {
    fn draw_occluders(&mut self, _: Seen<'_>, _: &[DrawableId]) -> Result<&[DrawableId], RoleError> {
        Ok(&[])
    }

    fn cull(&mut self, seen: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError> {
        let cut = self.scene.reading(|| lod_cut(&self.scene, seen.view, seen.rule));
        found.extend(cut.map_err(|fault| RoleError::of_culling::<VulkanCuller>(CullError::Scene(fault)))?);
        let emitted = u32::try_from(found.len()).unwrap_or(u32::MAX);
        Ok(CullCounts { emitted, ..CullCounts::default() })
    }
}
