//! The device of a culler: an occluder pass with one of its occlusion tests.

use std::sync::Arc;

use thiserror::Error;
use trimaran_cull::{
    Answer, Cancel, CullerDevice, CutRule, DepthImage, DepthPyramid, DeviceClass, HzbError, HzbTest,
    OcclusionTest, Outline, SubPixelGrid, TestBox, View, Viewport, WholeTraversal,
};
use trimaran_proto::{DeviceTimes, DrawableId, OcclusionTestKind};

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

/// The host maps fewer ids: at a few tenths of a microsecond each it should be done before a wait for the
/// device would end.
const MAPPED_ON_DEVICE: usize = 1000;

/// The device of a culler.
pub struct VulkanCuller {
    class: DeviceClass,
    grid: SubPixelGrid,
    pass: OccluderPass,
    occlusion_test: OcclusionTestKind,
    hzb_place: HzbPlace,
    /// Whether traversals on the device are compared with the host's.
    is_checked: bool,
    /// On the host, if the pyramid is there.
    pyramid: DepthPyramid,
    /// Of work that was not done when its frame ended.
    late: DeviceTimes,
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
            grid: scene.gpu().info().sub_pixel_grid,
            pass: OccluderPass::new(scene, size)?,
            occlusion_test,
            hzb_place: if is_checked { HzbPlace::Device } else { scene.gpu().info().hzb_place },
            is_checked,
            pyramid: DepthPyramid::default(),
            late: DeviceTimes::default(),
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

    fn grid(&self) -> SubPixelGrid {
        self.grid
    }

    fn cancel_on(&mut self, cancel: &Cancel) {
        self.pass.pass.cancel_when(cancel);
    }

    fn change_occlusion_test(&mut self, kind: OcclusionTestKind) {
        self.occlusion_test = kind;
    }

    fn begin_occluders(&mut self, view: &View) -> Result<(), VulkanCullerError> {
        // Beginning waits as well.
        self.late = self.pass.pass.take_times()?;
        Ok(self.pass.begin(view)?)
    }

    fn map_occluders(
        &mut self,
        view: &View,
        rule: &CutRule,
        ids: &[DrawableId],
    ) -> Result<Option<Vec<DrawableId>>, VulkanCullerError> {
        let is_worth_it = ids.len() >= MAPPED_ON_DEVICE || self.is_checked;
        match (self.occlusion_test, self.hzb_place) {
            (OcclusionTestKind::Hzb, HzbPlace::Device) if is_worth_it => {
                Ok(self.pass.hzb_test()?.map(view, rule, ids)?)
            }
            _ => Ok(None),
        }
    }

    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), VulkanCullerError> {
        self.pass.draw(ids)?;
        Ok(self.pass.flush()?)
    }

    fn finish_occluders(&mut self) -> Result<(), VulkanCullerError> {
        self.pass.pass.complete()?;
        if (self.occlusion_test, self.hzb_place) == (OcclusionTestKind::Hzb, HzbPlace::Host) {
            self.pyramid.rebuild(self.pass.read_depth()?);
        }
        Ok(())
    }

    /// On the device the next submission waits for this one.
    fn submit_occluders(&mut self) -> Result<(), VulkanCullerError> {
        if (self.occlusion_test, self.hzb_place) != (OcclusionTestKind::Hzb, HzbPlace::Device) {
            return self.finish_occluders();
        }
        Ok(self.pass.flush()?)
    }

    fn take_times(&mut self) -> Result<DeviceTimes, VulkanCullerError> {
        Ok(std::mem::take(&mut self.late) + self.pass.pass.take_times_if_done()?)
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
                    self.pass.pass.complete()?;
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

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use trimaran_cull::LodRule;
    use trimaran_proto::{Settings, ViewState};

    use super::*;
    use crate::common::{self, CheckedGpu, ids, upload, view};
    use crate::timing::Stopwatch;

    const TESTS: [(OcclusionTestKind, HzbPlace); 4] = [
        (OcclusionTestKind::Query, HzbPlace::Host),
        (OcclusionTestKind::Raster, HzbPlace::Host),
        (OcclusionTestKind::Hzb, HzbPlace::Host),
        (OcclusionTestKind::Hzb, HzbPlace::Device),
    ];

    /// A box behind the wall.
    const BEHIND: TestBox = TestBox { centre: Vec3::new(0.0, 0.0, -4.0), axes: [Vec3::X, Vec3::Y, Vec3::Z] };

    struct Walled {
        culler: VulkanCuller,
        view: View,
    }

    impl Walled {
        /// A wall 2 m away, and the tests that run on the device: `None` if it cannot.
        fn new(gpu: &CheckedGpu, (kind, place): (OcclusionTestKind, HzbPlace)) -> Option<Self> {
            if place == HzbPlace::Device && common::lacks_float64(gpu) {
                return None;
            }
            let scene = upload(gpu, &[common::wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0)]);
            let view = view(64, 64, DVec3::ZERO);
            let culler = VulkanCuller::new(&scene, view.viewport(), kind).unwrap().with_hzb_at(place);
            Some(Self { culler, view })
        }

        fn draw(&mut self) {
            self.culler.begin_occluders(&self.view).unwrap();
            self.culler.draw_occluders(&ids(1)).unwrap();
            self.culler.submit_occluders().unwrap();
        }

        fn test_box(&mut self) {
            let mut visible = Vec::new();
            self.culler.test(&self.view, &[BEHIND], &mut visible).unwrap();
            assert_eq!(visible, [0]);
        }

        /// The times until here, which count once.
        fn take_times(&mut self) -> DeviceTimes {
            let times = self.culler.take_times().unwrap();
            assert_eq!(self.culler.take_times().unwrap(), DeviceTimes::default());
            times
        }
    }

    fn is_some(times: DeviceTimes) -> [bool; 3] {
        [times.drawing_ns, times.pyramid_ns, times.culling_ns].map(|time| time > 0)
    }

    #[test]
    fn each_pass_on_the_device_has_a_time_and_together_they_are_no_longer_than_the_frame() {
        let Some(gpu) = CheckedGpu::open() else { return };
        for test in TESTS {
            let Some(mut walled) = Walled::new(&gpu, test) else { continue };
            for _ in 0..2 {
                let mut frame = Stopwatch::default();
                let times = frame.measure(|| {
                    walled.draw();
                    walled.test_box();
                    walled.take_times()
                });
                let on_device = test.1 == HzbPlace::Device;
                let expected = [true, on_device, on_device || test.0 != OcclusionTestKind::Hzb];
                assert_eq!(is_some(times), expected, "{test:?}: {times:?}");
                let sum = times.drawing_ns + times.pyramid_ns + times.culling_ns;
                assert!(sum as f64 * 1e-6 <= frame.take_ms(), "{test:?}: {times:?}");
                // The pyramid is there already.
                walled.test_box();
                assert_eq!(is_some(walled.take_times()), [false, false, expected[2]], "{test:?}");
            }
        }
    }

    #[test]
    fn a_traversal_and_its_pyramid_have_times_of_their_own() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let Some(mut walled) = Walled::new(&gpu, (OcclusionTestKind::Hzb, HzbPlace::Device)) else { return };
        let scene = Arc::clone(walled.culler.pass.pass.scene().scene());
        let settings = Settings::new(walled.view.viewport(), LodRule::new(1.0).unwrap());
        let rule = CutRule::new(&scene, &ViewState::from(settings));
        // The first traversal brings the tree, which takes further submissions.
        for _ in 0..2 {
            walled.draw();
            assert!(walled.culler.traverse(&walled.view, &rule).unwrap().is_some());
            assert_eq!(is_some(walled.take_times()), [true; 3]);
        }
    }

    #[test]
    fn work_that_outlives_its_frame_counts_in_the_next_one() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let Some(mut walled) = Walled::new(&gpu, (OcclusionTestKind::Hzb, HzbPlace::Device)) else { return };
        walled.draw();
        assert_eq!(walled.take_times(), DeviceTimes::default(), "nobody waits for the device");
        walled.culler.begin_occluders(&walled.view).unwrap();
        assert_eq!(is_some(walled.take_times()), [true, false, false]);
    }

    #[test]
    fn a_device_without_timestamps_has_no_times() {
        for test in TESTS {
            let Some(mut gpu) = CheckedGpu::open() else { return };
            Arc::get_mut(&mut gpu).unwrap().forget_timestamps();
            let Some(mut walled) = Walled::new(&gpu, test) else { continue };
            walled.draw();
            walled.test_box();
            assert_eq!(walled.take_times(), DeviceTimes::default(), "{test:?}");
        }
    }
}
