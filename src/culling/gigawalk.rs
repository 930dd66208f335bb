//! GigaWalk's culling, for comparison: a hierarchical Z-buffer on the CPU.

use std::sync::Arc;

use trimaran_actors::{RoleError, Stop};
use trimaran_cull::{Culler, DepthPyramid, DrawOrder, OccluderMapper, RectangleTest, View};
use trimaran_gpu::{DeviceKind, GpuError, GpuScene, OccluderPass};
use trimaran_proto::{Camera, CullCounts, DrawableId, FrameNumber, Settings};
use trimaran_scene::Scene;

use super::{
    failed,
    work::{FrameCuller, Seen},
};

/// Draws all that was visible in the last frame, nearest first, and tests rectangles against the depth read
/// back. A device with memory of its own reduces the depth by half first, so that a quarter of it is copied.
/// On a CPU driver a copy takes less time than that.
pub(super) struct GigaWalk {
    pass: OccluderPass,
    reads_half: bool,
    culler: Culler,
    mapper: OccluderMapper,
    order: DrawOrder,
    pyramid: DepthPyramid,
    occluders: Vec<DrawableId>,
}

impl GigaWalk {
    pub(super) fn new(
        scene: &Arc<Scene>,
        drawn: &Arc<GpuScene>,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let no_view = View::new(Camera::at_origin(FrameNumber(0)), settings.viewport);
        Ok(Self {
            pass: OccluderPass::new(drawn, settings.viewport)?,
            reads_half: drawn.gpu().info().kind != DeviceKind::Cpu || drawn.gpu().checks_traversals(),
            culler: Culler::new(Arc::clone(scene)),
            mapper: OccluderMapper::new(Arc::clone(scene), no_view, settings.lod),
            order: DrawOrder::default(),
            pyramid: DepthPyramid::default(),
            occluders: Vec::new(),
        })
    }

    fn draw(&mut self, view: &View) -> Result<(), GpuError> {
        self.pass.begin(view)?;
        self.pass.draw(&self.occluders)?;
        self.pass.finish()?;
        // The classic method tests on the CPU, so reading back is a part of drawing.
        if self.reads_half {
            self.pass.read_half_depth()?;
        } else {
            self.pass.read_depth()?;
        }
        Ok(())
    }
}

impl FrameCuller for GigaWalk {
    fn cancel_on(&mut self, stop: &Stop) {
        let stop = stop.clone();
        self.pass.cancel_when(move || stop.requested());
    }

    fn draw_occluders(&mut self, seen: Seen<'_>, last: &[DrawableId]) -> Result<&[DrawableId], RoleError> {
        self.occluders.clear();
        self.mapper.begin(*seen.view, seen.rule);
        self.mapper.push(last, &mut self.occluders)?;
        seen.rule.retain_solid(self.culler.scene(), &mut self.occluders);
        self.order.sort(self.culler.scene(), seen.view, &mut self.occluders);
        self.draw(seen.view).map_err(failed("drawing occluders"))?;
        Ok(&self.occluders)
    }

    fn cull(&mut self, seen: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError> {
        let image = if self.reads_half {
            let half = self.pass.read_half_depth().map_err(failed("reading half the depth"))?;
            self.pyramid.rebuild_over_half(seen.view.viewport(), half);
            None
        } else {
            let image = self.pass.read_depth().map_err(failed("reading the depth"))?;
            self.pyramid.rebuild(image);
            Some(image)
        };
        let mut test = RectangleTest::new(image, &self.pyramid);
        let stats = self.culler.cull(seen.view, seen.rule, &mut test, |ids| found.extend_from_slice(ids));
        let stats = stats.map_err(|error| RoleError::Cull(error.into()))?;
        Ok(stats.counts)
    }
}
