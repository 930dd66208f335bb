//! The device of a culler: an occluder pass with one of its occlusion tests.

use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_cull::{
    Answer, Cancel, CullerDevice, CutRule, DepthImage, DepthPyramid, DeviceClass, HzbError, HzbTest,
    OcclusionTest, Outline, TestBox, View, Viewport, WholeTraversal,
};
use trimaran_proto::{DrawableId, OcclusionTestKind};

use crate::{DeviceKind, GpuError, GpuScene, HzbPlace, OccluderPass, Optional};

/// Why a culler cannot draw or test.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VulkanCullerError {
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Boxes were to be tested before the depth was complete.
    #[error(transparent)]
    Hzb(#[from] HzbError),
}

/// The device of a culler.
pub struct VulkanCuller {
    class: DeviceClass,
    pass: OccluderPass,
    occlusion_test: OcclusionTestKind,
    hzb_place: HzbPlace,
    /// Whether traversals on the device are compared with the host's.
    is_checked: bool,
    /// On the host, if the pyramid is there.
    pyramid: DepthPyramid,
}

impl VulkanCuller {
    /// Draws occluders of `scene` into a depth buffer of `size` and tests boxes against it by
    /// `occlusion_test`: a depth pyramid is at the place that suits the device.
    ///
    /// # Errors
    /// If the device cannot draw that size, or memory does not suffice.
    pub fn new(
        scene: &Arc<GpuScene>,
        size: Viewport,
        occlusion_test: OcclusionTestKind,
    ) -> Result<Self, GpuError> {
        let lacks_float64 = scene.gpu().info().lacks.contains(&Optional::Float64);
        let is_checked = scene.gpu().checks_traversals() && !lacks_float64;
        if scene.gpu().checks_traversals() && lacks_float64 {
            tracing::warn!("no frame is compared with the host's: the device has no f64 in shaders");
        }
        Ok(Self {
            class: match scene.gpu().info().kind {
                DeviceKind::Cpu => DeviceClass::Cpu,
                _ => DeviceClass::Gpu,
            },
            pass: OccluderPass::new(scene, size)?,
            occlusion_test,
            hzb_place: if is_checked { HzbPlace::Device } else { scene.gpu().info().hzb_place },
            is_checked,
            pyramid: DepthPyramid::default(),
        })
    }

    /// The same with the depth pyramid at this place, to compare the two.
    #[must_use]
    pub fn with_hzb_at(self, hzb_place: HzbPlace) -> Self {
        Self { hzb_place, ..self }
    }
}

impl CullerDevice for VulkanCuller {
    fn is_lost(error: &VulkanCullerError) -> bool {
        matches!(error, VulkanCullerError::Gpu(error) if error.is_lost())
    }

    fn class(&self) -> DeviceClass {
        self.class
    }

    fn cancel_on(&mut self, cancel: &Cancel) {
        self.pass.pass.cancel_when(cancel);
    }

    fn change_occlusion_test(&mut self, kind: OcclusionTestKind) {
        self.occlusion_test = kind;
    }

    fn begin_occluders(&mut self, view: &View) -> Result<(), VulkanCullerError> {
        Ok(self.pass.begin(view)?)
    }

    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), VulkanCullerError> {
        self.pass.draw(ids)?;
        Ok(self.pass.flush()?)
    }

    fn finish_occluders(&mut self) -> Result<Duration, VulkanCullerError> {
        let timing = self.pass.finish()?;
        if (self.occlusion_test, self.hzb_place) == (OcclusionTestKind::Hzb, HzbPlace::Host) {
            self.pyramid.rebuild(self.pass.read_depth()?);
        }
        Ok(Duration::try_from_secs_f64(timing.device_ms * 1e-3).unwrap_or_default())
    }

    /// On the device the next submission waits for this one.
    fn submit_occluders(&mut self) -> Result<Duration, VulkanCullerError> {
        if (self.occlusion_test, self.hzb_place) != (OcclusionTestKind::Hzb, HzbPlace::Device) {
            return self.finish_occluders();
        }
        self.pass.flush()?;
        Ok(Duration::ZERO)
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, VulkanCullerError> {
        Ok(self.pass.read_depth()?)
    }
}

impl OcclusionTest for VulkanCuller {
    type Error = VulkanCullerError;

    fn test(
        &mut self,
        view: &View,
        boxes: &[TestBox],
        visible: &mut Vec<u32>,
    ) -> Result<(), VulkanCullerError> {
        match (self.occlusion_test, self.hzb_place) {
            (OcclusionTestKind::Query, _) => self.pass.query_test()?.test(view, boxes, visible)?,
            (OcclusionTestKind::Raster, _) => self.pass.raster_test()?.test(view, boxes, visible)?,
            (OcclusionTestKind::Hzb, HzbPlace::Device) => self.pass.hzb_test()?.test(view, boxes, visible)?,
            (OcclusionTestKind::Hzb, HzbPlace::Host) => {
                HzbTest::new(self.pass.read_depth()?, &self.pyramid)?.test(view, boxes, visible)?;
            }
        }
        Ok(())
    }

    fn traverse(&mut self, view: &View, rule: &CutRule) -> Result<Option<WholeTraversal>, VulkanCullerError> {
        match (self.occlusion_test, self.hzb_place) {
            (OcclusionTestKind::Hzb, HzbPlace::Device) => {
                let found = self.pass.hzb_test()?.traverse(view, rule)?;
                if found.is_some() {
                    // The device is done, and other geometry may take the occluders' place.
                    self.pass.finish()?;
                }
                Ok(found)
            }
            _ => Ok(None),
        }
    }

    fn is_checked(&self) -> bool {
        self.is_checked
    }

    fn outline(&self) -> Outline {
        match self.occlusion_test {
            OcclusionTestKind::Query | OcclusionTestKind::Raster => Outline::InBox,
            OcclusionTestKind::Hzb => Outline::OnScreen,
        }
    }

    fn answer(&self) -> Answer {
        match self.occlusion_test {
            OcclusionTestKind::Query | OcclusionTestKind::Raster => Answer::PixelCount,
            OcclusionTestKind::Hzb => Answer::YesNo,
        }
    }
}
