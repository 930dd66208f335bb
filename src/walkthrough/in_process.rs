//! A walkthrough with three roles in this process.

use std::{sync::Arc, thread};

use crate::vulkan::{VulkanDisplay, VulkanPair, VulkanPairError};
use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_actors::{Devices, Observer, SessionError, Stop, Turns, in_process as join};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene, ItemPass};
use trimaran_scene::Scene;
use trimaran_transport::{Net, TokioNet};

use super::{Plan, path::Trail};

/// A scene on the devices of three roles: a Vulkan device each, so that one role's work does not queue behind
/// another's.
pub struct Stage {
    /// The scene.
    pub scene: Arc<Scene>,
    /// On the pair's first machine, the pair's second, and the display.
    pub drawn: [Arc<GpuScene>; 3],
}

/// Why a walkthrough in one process failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StageError {
    /// A device could not be opened, filled or sized.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The session failed.
    #[error("the walkthrough failed")]
    Session(#[from] Box<SessionError<VulkanPairError, GpuError>>),
}

impl Stage {
    /// Opens the devices and copies the scene to each.
    ///
    /// # Errors
    /// Says what the machine lacks.
    pub fn set(scene: &Arc<Scene>, options: &GpuOptions) -> Result<Self, StageError> {
        let upload = || GpuScene::upload(&Gpu::open(options)?, scene);
        // Most of a start is the drivers' loading and the copies, and no device needs another.
        let drawn = thread::scope(|scope| {
            let devices = [scope.spawn(upload), scope.spawn(upload), scope.spawn(upload)];
            devices.map(|device| device.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        let [first, second, display] = drawn;
        Ok(Self { scene: Arc::clone(scene), drawn: [first?, second?, display?] })
    }
}

/// Walks `trail` on `stage` and shows each frame to `observer`.
///
/// # Errors
/// The first role to fail.
pub fn in_process(
    stage: &Stage,
    plan: &Plan,
    trail: &Trail,
    observer: &mut dyn Observer,
    runtime: &Handle,
    stop: &Stop,
) -> Result<(), StageError> {
    let [first, second, display] = &stage.drawn;
    if plan.audit_every > 0 {
        ItemPass::check(display)?;
    }
    let pair = |drawn| VulkanPair::new(drawn, plan.size, plan.tester);
    let devices = Devices {
        first: pair(first)?,
        second: pair(second)?,
        display: VulkanDisplay::new(display, plan.size)?,
    };
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
    let settings = plan.settings(trail.frames());
    let mut cameras = trail.cameras(plan.pace);
    let turns = if plan.alone { Turns::alone() } else { Turns::at_once() };
    join(&stage.scene, settings, devices, &mut *cameras, observer, &net, runtime, stop, &turns)
        .map_err(Box::new)?;
    Ok(())
}
