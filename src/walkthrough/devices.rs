//! A walkthrough with three roles in this process.

use std::{sync::Arc, thread};

use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_actors::{CullerIndex, LocalSession, Observer, SessionError, Stop, Turns};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene};
use trimaran_scene::Scene;

use super::{path::CameraPath, plan::Plan};
use crate::vulkan::{VulkanCuller, VulkanDisplay};

/// A scene on the devices of three roles: a Vulkan device each, so that one role's work does not queue behind
/// another's.
pub struct SceneOnDevices {
    /// The scene.
    pub scene: Arc<Scene>,
    /// On the first culler, the second, and the display.
    pub drawn: [Arc<GpuScene>; 3],
}

/// Why a walkthrough in one process failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WalkthroughError {
    /// A device could not be sized.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The session failed.
    #[error("the walkthrough failed")]
    Session(#[from] SessionError),
}

impl SceneOnDevices {
    /// Opens the devices and copies the scene to each.
    ///
    /// # Errors
    /// Says what the machine lacks.
    pub fn open(scene: &Arc<Scene>, options: &GpuOptions) -> Result<Self, GpuError> {
        let upload = || GpuScene::upload(&Gpu::open(options)?, scene);
        // Most of a start is the drivers' loading and the copies, and no device needs another.
        let drawn = thread::scope(|scope| {
            let devices = [scope.spawn(upload), scope.spawn(upload), scope.spawn(upload)];
            devices.map(|device| device.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        let [first, second, display] = drawn;
        Ok(Self { scene: Arc::clone(scene), drawn: [first?, second?, display?] })
    }

    /// Walks `path` and shows each frame to `observer`. All roles are in this process.
    ///
    /// # Errors
    /// The first role to fail.
    pub fn walk(
        &self,
        plan: &Plan,
        path: &CameraPath,
        observer: &mut dyn Observer,
        runtime: &Handle,
        stop: &Stop,
    ) -> Result<(), WalkthroughError> {
        let mut session = LocalSession::new(&self.scene, plan.settings(path.frames()));
        if plan.alone {
            session.turns = Turns::alone();
        }
        let [.., display] = &self.drawn;
        let display = VulkanDisplay::new(display, plan.viewport)?;
        let device = |culler: CullerIndex| {
            Ok(VulkanCuller::new(&self.drawn[culler.index()], plan.viewport, plan.occlusion_test)?)
        };
        let mut cameras = path.cameras(plan.pace);
        session.run(device, display, &mut *cameras, observer, runtime, stop)?;
        Ok(())
    }
}
