//! Visibility by rays cast on the CPU, for machines without a GPU.

use trimaran_actors::RoleError;
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_rays::Rays;

use super::work::{FrameCuller, Seen};

impl FrameCuller for Rays {
    fn draw_occluders(&mut self, seen: Seen<'_>, _: &[DrawableId]) -> Result<&[DrawableId], RoleError> {
        Ok(self.place(seen.view, seen.rule))
    }

    fn cull(&mut self, seen: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError> {
        Ok(self.cast(seen.view, found))
    }
}
