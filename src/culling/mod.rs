//! How a culler finds the visible nodes: Trimaran's own method, and those that it is compared with.
//!
//! All of them choose levels by one rule, over one tree, and draw in one order: only the culling differs.

#[cfg(feature = "lab")]
mod chc;
#[cfg(feature = "lab")]
mod exact;
mod frustum;
#[cfg(feature = "lab")]
mod gigawalk;
mod method;
#[cfg(feature = "lab")]
mod rays;
#[cfg(feature = "lab")]
mod whole;
mod work;

use std::sync::Arc;

#[cfg(feature = "lab")]
use trimaran_actors::OccluderPolicy;
use trimaran_actors::{RoleError, SceneCulling, Turns};
use trimaran_gpu::{GpuError, GpuScene, VulkanCuller, VulkanCullerError};
#[cfg(feature = "lab")]
use trimaran_proto::OcclusionTestKind;
use trimaran_proto::Settings;
use trimaran_scene::Scene;

#[cfg(feature = "lab")]
use chc::Chc;
#[cfg(feature = "lab")]
use exact::Exact;
use frustum::Frustum;
#[cfg(feature = "lab")]
use gigawalk::GigaWalk;
pub use method::CullingMethod;
#[cfg(feature = "lab")]
use whole::Whole;
pub use work::Culling;
use work::{FrameCuller, WholeFrames};

/// Converts an error of the device into that of a session that was `doing` something.
fn failed<E: Into<VulkanCullerError>>(doing: &'static str) -> impl FnOnce(E) -> RoleError {
    move |error| RoleError::of_device::<VulkanCuller>(doing)(error.into())
}

impl Culling {
    /// Culls `scene`, whose copy on the device is `drawn`, by `method` and the display's `settings`. Measures
    /// by the clock of `turns`.
    ///
    /// # Errors
    /// If the device cannot draw that size, or memory does not suffice.
    pub fn open(
        method: CullingMethod,
        scene: &Arc<Scene>,
        drawn: &Arc<GpuScene>,
        settings: &Settings,
        turns: &Turns,
    ) -> Result<Self, RoleError> {
        let opening = failed::<GpuError>;
        let size = settings.viewport;
        let culler: Box<dyn FrameCuller> = match method {
            CullingMethod::Trimaran => {
                let device = VulkanCuller::new(drawn, size, settings.occlusion_test);
                let device = device.map_err(opening("opening it"))?;
                return Ok(SceneCulling::new(scene, device, settings, turns).into());
            }
            #[cfg(feature = "lab")]
            CullingMethod::Paper => {
                let test = OcclusionTestKind::Query;
                let device = VulkanCuller::new(drawn, size, test).map_err(opening("opening it"))?;
                let policy = OccluderPolicy::PAPER;
                return Ok(Self::from(SceneCulling::with(scene, device, settings, turns, policy)).by(test));
            }
            #[cfg(feature = "lab")]
            CullingMethod::GigaWalk => {
                Box::new(GigaWalk::new(scene, drawn, settings).map_err(opening("opening it"))?)
            }
            #[cfg(feature = "lab")]
            CullingMethod::Chc => Box::new(Chc::new(scene, drawn, size).map_err(opening("opening it"))?),
            CullingMethod::Frustum => Box::new(Frustum::new(scene)),
            #[cfg(feature = "lab")]
            CullingMethod::Rays => Box::new(trimaran_rays::Rays::new(scene)),
            #[cfg(feature = "lab")]
            CullingMethod::Whole => Box::new(Whole::new(scene)),
            #[cfg(feature = "lab")]
            CullingMethod::Exact => Box::new(Exact::new(scene, drawn, size).map_err(opening("opening it"))?),
        };
        let grid = drawn.gpu().info().sub_pixel_grid;
        Ok(WholeFrames::new(scene, culler, grid, settings, turns).into())
    }
}
