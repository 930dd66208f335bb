//! A walkthrough with all roles in this process.

use std::{sync::Arc, thread, time::Duration};

use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_actors::{CullerId, LocalSession, Observer, SessionError, Stop, Turns};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene};
use trimaran_proto::Settings;
use trimaran_scene::Scene;

use super::{path::CameraPath, plan::Plan};
use crate::{culling::Culling, vulkan::VulkanDisplay};

/// A scene on the devices of a display and its cullers. Each role has its own Vulkan device, so that its work
/// does not queue behind another's.
pub struct SceneOnDevices {
    /// The scene.
    pub scene: Arc<Scene>,
    /// On the cullers' devices.
    pub cullers: Vec<Arc<GpuScene>>,
    /// On the display's, which also culls there if no culler does.
    pub display: Arc<GpuScene>,
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
    /// Opens the devices of a display and this many cullers, and copies the scene to each.
    ///
    /// # Errors
    /// The feature that the machine lacks.
    pub fn open(scene: &Arc<Scene>, cullers: usize, options: &GpuOptions) -> Result<Self, GpuError> {
        let open = |_: &()| GpuScene::new(&Gpu::open(options)?, scene);
        Self::in_parallel(scene, &vec![(); cullers], &(), open)
    }

    /// Copies the scene to open devices.
    ///
    /// # Errors
    /// If the scene has no room on a device.
    pub fn new(scene: &Arc<Scene>, cullers: &[Arc<Gpu>], display: &Arc<Gpu>) -> Result<Self, GpuError> {
        Self::in_parallel(scene, cullers, display, |gpu| GpuScene::new(gpu, scene))
    }

    /// The start is mostly loading drivers and copying, and the devices are independent.
    fn in_parallel<T: Sync>(
        scene: &Arc<Scene>,
        cullers: &[T],
        display: &T,
        upload: impl Fn(&T) -> Result<Arc<GpuScene>, GpuError> + Sync,
    ) -> Result<Self, GpuError> {
        let upload = &upload;
        let (display, cullers) = thread::scope(|scope| {
            let cullers: Vec<_> = cullers.iter().map(|culler| scope.spawn(move || upload(culler))).collect();
            let finish = |device: thread::ScopedJoinHandle<'_, _>| {
                device.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            (upload(display), cullers.into_iter().map(finish).collect::<Result<_, _>>())
        });
        Ok(Self { scene: Arc::clone(scene), cullers: cullers?, display: display? })
    }

    /// The scene on every device, the display's last.
    pub fn drawn(&self) -> impl Iterator<Item = &Arc<GpuScene>> {
        self.cullers.iter().chain([&self.display])
    }

    /// The scene on a culler's device, or without a culler on the display's.
    #[must_use]
    pub fn drawn_by(&self, culler: Option<CullerId>) -> &Arc<GpuScene> {
        culler.and_then(|id| self.cullers.get(id.index())).unwrap_or(&self.display)
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
        let session = LocalSession {
            pace: plan.frames(path.frames()),
            cullers: self.cullers.len(),
            schedule: plan.schedule,
            turns: if plan.alone { Turns::alone() } else { Turns::at_once() },
            ..LocalSession::new(&self.scene, plan.settings(), path.frames())
        };
        let display = VulkanDisplay::new(&self.display, plan.viewport)?;
        let turns = session.turns.clone();
        let cull = |culler, settings: &Settings| {
            Culling::open(plan.culling, &self.scene, self.drawn_by(culler), settings, &turns)
        };
        let mut cameras = path.cameras(plan.pace, Duration::ZERO);
        session.run_with(cull, display, &mut *cameras, observer, runtime, stop)?;
        Ok(())
    }
}
