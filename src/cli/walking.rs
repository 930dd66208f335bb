//! What `run`, `sweep` and the roles share: from flags to a plan, and a runtime to run it on.

use std::{
    path::Path,
    sync::Arc,
    time::{Duration, SystemTime},
};

use tokio::runtime::{Builder, Runtime};
use trimaran::walkthrough::{CameraPath, Pace, PathChoice, Plan, SceneFile};
use trimaran_actors::{Stop, Stopper};
use trimaran_gpu::{DeviceChoice, GpuOptions};
use trimaran_proto::{BatchSize, EpsilonPx, PictureSize, TesterKind};
use trimaran_scene::Scene;

use super::{
    Failure,
    args::{Tester, WalkArgs},
};

/// The plan that the flags ask for.
pub(super) fn plan(walk: &WalkArgs, epsilon_px: f64, visible: bool, pace: Pace) -> Result<Plan, Failure> {
    if walk.few_pixels && walk.tester == Tester::Hzb {
        let why = "--few-pixels needs a tester that counts pixels: add --tester raster or --tester query";
        return Err(Failure::bad_input(why));
    }
    Ok(Plan {
        size: PictureSize::new(walk.size.width, walk.size.height).map_err(Failure::bad_input)?,
        epsilon: EpsilonPx::new(epsilon_px).map_err(Failure::bad_input)?,
        batch: BatchSize::new(walk.batch.into()).map_err(Failure::bad_input)?,
        coding: walk.coding.into(),
        tester: match walk.tester {
            Tester::Query => TesterKind::Query,
            Tester::Raster => TesterKind::Raster,
            Tester::Hzb => TesterKind::Hzb,
        },
        pace,
        few_pixels: walk.few_pixels,
        audit_every: walk.audit_every,
        visible,
        alone: walk.alone,
    })
}

/// The pace that `--live` asks for.
pub(super) fn pace(live_hz: Option<f64>) -> Pace {
    live_hz.map_or(Pace::Lockstep, |hz| Pace::Live { hz })
}

/// The path that the flags ask for, through `scene`.
pub(super) fn path(walk: &WalkArgs, plan: &Plan, scene: &Scene) -> Result<CameraPath, Failure> {
    let choice = PathChoice::parse(&walk.path, walk.seed);
    CameraPath::find(&choice, scene, plan.size, walk.frames).map_err(Failure::bad_input)
}

/// Opens a cooked scene.
pub(super) fn open(path: &Path) -> Result<SceneFile, Failure> {
    let scene = Scene::open(path).map_err(Failure::bad_input)?;
    Ok(SceneFile { path: path.to_owned(), scene: Arc::new(scene) })
}

/// How to open the device that the flags ask for, which may make no progress for `timeout_s` seconds.
pub(super) fn gpu_options(device: Option<&str>, timeout_s: f64) -> GpuOptions {
    let device = device.map_or(DeviceChoice::Best, |name| DeviceChoice::Named(name.to_owned()));
    let timeout = Duration::try_from_secs_f64(timeout_s).unwrap_or(Duration::MAX);
    GpuOptions { device, timeout, ..GpuOptions::default() }
}

/// When it is, for a person: by a clock that may be set at any time.
#[expect(clippy::disallowed_methods, reason = "a report has a date")]
pub(super) fn date() -> SystemTime {
    SystemTime::now()
}

/// A runtime for links; its threads keep sockets going while roles are busy with their devices.
pub(super) fn runtime() -> Result<Runtime, Failure> {
    Builder::new_multi_thread().worker_threads(1).enable_all().build().map_err(Failure::broken)
}

/// A stop that Ctrl-C and the termination signal of systemd set; a second one insists.
pub(super) fn stop_on_signal(runtime: &Runtime) -> Stop {
    let (stopper, stop) = Stop::new();
    runtime.spawn(wait_for_signal(stopper));
    stop
}

async fn wait_for_signal(stopper: Stopper) {
    use tokio::signal::unix::{SignalKind, signal};
    let (Ok(mut interrupt), Ok(mut terminate)) =
        (signal(SignalKind::interrupt()), signal(SignalKind::terminate()))
    else {
        return;
    };
    loop {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        stopper.stop();
    }
}
