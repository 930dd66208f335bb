//! Shared by `run`, `sweep` and the roles: makes a plan from flags, and a runtime to run it on.

use std::{
    io,
    net::SocketAddr,
    path::Path,
    sync::Arc,
    thread,
    time::{Duration, SystemTime},
};

use bytesize::ByteSize;
use tokio::{
    runtime::{Builder, Runtime},
    signal::unix::{SignalKind, signal},
};
use trimaran::{
    config::{CommonConfig, GpuConfig},
    culling::CullingMethod,
    metrics::{DeviceMemory, Metrics, Opened, SceneReading, Serving},
    report::schema::SceneInfo,
    walkthrough::{CameraPath, Pace, PathChoice, Plan, SceneFile, ViewStates, scene_info},
};
use trimaran_actors::{Stop, Stopper, again};
use trimaran_gpu::{DeviceChoice, Gpu, GpuOptions, GpuScene};
use trimaran_proto::{BatchSize, LodRule, OcclusionTestKind, Viewport};
use trimaran_scene::Scene;
use trimaran_transport::{Net, Options, TokioNet, ws::WsOptions};

use super::{
    Failure,
    args::{CullerArgs, DeviceArgs, OcclusionTestArg, WalkArgs},
    log::SAID,
    service_manager::ServiceManager,
    stopping::stoppable_service,
};

/// The plan that the flags ask for.
pub(super) fn plan(
    walk: &WalkArgs,
    cullers: CullerArgs,
    epsilon_px: f64,
    culling: CullingMethod,
    visible: bool,
    pace: Pace,
) -> Result<Plan, Failure> {
    let occlusion_test = match walk.occlusion_test {
        OcclusionTestArg::Query => OcclusionTestKind::Query,
        OcclusionTestArg::Raster => OcclusionTestKind::Raster,
        OcclusionTestArg::Hzb => OcclusionTestKind::Hzb,
    };
    if walk.few_pixels && !culling.counts_pixels(occlusion_test) {
        let why = if culling == CullingMethod::Trimaran {
            "--few-pixels needs an occlusion test that counts pixels: add --occlusion-test raster or --occlusion-test query".to_owned()
        } else {
            format!("--culling {culling} counts no pixels: leave --few-pixels out")
        };
        return Err(Failure::bad_input(why));
    }
    cullers.check()?;
    Ok(Plan {
        viewport: Viewport::new(walk.size.width, walk.size.height).map_err(Failure::bad_input)?,
        lod: LodRule::new(epsilon_px).map_err(Failure::bad_input)?.stopping_at_few_pixels(walk.few_pixels),
        batch: BatchSize::new(walk.batch.into()).map_err(Failure::bad_input)?,
        coding: walk.coding.into(),
        culling,
        occlusion_test,
        pace,
        schedule: cullers.schedule.into(),
        audit_every: walk.audit_every,
        visible,
        alone: walk.alone,
    })
}

/// The pace given by `--live`.
pub(super) fn pace(live_hz: Option<f64>) -> Pace {
    live_hz.map_or(Pace::Lockstep, |hz| Pace::Live { hz })
}

/// The path that the flags ask for, through `scene`, seen in the view states of a file.
pub(super) fn path(
    walk: &WalkArgs,
    plan: &Plan,
    scene: &Scene,
    states: Option<&Path>,
) -> Result<CameraPath, Failure> {
    let choice = PathChoice::parse(&walk.path, walk.seed);
    let views = view_states(states, plan, scene)?;
    CameraPath::find(&choice, scene, views, walk.frames).map_err(Failure::bad_input)
}

/// The view states of a walk: those of a file, if there is one.
pub(super) fn view_states(file: Option<&Path>, plan: &Plan, scene: &Scene) -> Result<ViewStates, Failure> {
    match file {
        Some(file) => ViewStates::read(file, scene, plan.settings().into()).map_err(Failure::bad_input),
        None => Ok(ViewStates::from(plan.settings())),
    }
}

/// Opens a cooked scene.
pub(super) fn open(path: &Path) -> Result<SceneFile, Failure> {
    let scene = Scene::open(path).map_err(Failure::bad_input)?;
    Ok(SceneFile { path: path.to_owned(), scene: Arc::new(scene) })
}

/// How to open the device that the flags ask for, which may make no progress for `timeout_s` seconds.
pub(super) fn gpu_options(
    device: Option<&str>,
    memory: Option<ByteSize>,
    timeout_s: f64,
    check_traversals: bool,
) -> GpuOptions {
    let device = device.map_or_else(DeviceChoice::from_environment, DeviceChoice::from);
    let timeout = Duration::try_from_secs_f64(timeout_s).unwrap_or(Duration::MAX);
    let memory = memory.map(|size| size.as_u64());
    GpuOptions { device, timeout, memory, check_traversals, ..GpuOptions::default() }
}

/// The same for a role of a deployment.
pub(super) fn role_gpu(gpu: &GpuConfig) -> GpuOptions {
    gpu_options(gpu.device.as_deref(), gpu.gpu_memory, gpu.device_timeout_s, gpu.check_device)
}

impl DeviceArgs {
    /// How to open the device that the flags ask for.
    pub(super) fn gpu_options(&self) -> GpuOptions {
        gpu_options(self.device.as_deref(), self.gpu_memory, self.device_timeout, self.check_device)
    }
}

impl WalkArgs {
    /// How to open the devices that the flags ask for.
    pub(super) fn gpu_options(&self) -> GpuOptions {
        gpu_options(self.device.as_deref(), self.gpu_memory, self.device_timeout, self.check_device)
    }
}

/// The date, for people: the clock may be set at any time.
#[expect(clippy::disallowed_methods, reason = "a report has a date")]
pub(super) fn date() -> SystemTime {
    SystemTime::now()
}

/// A runtime for links; its threads keep sockets going while roles are busy with their devices.
pub(super) fn runtime() -> Result<Runtime, Failure> {
    Builder::new_multi_thread().worker_threads(1).enable_all().build().map_err(Failure::broken)
}

/// A stop that Ctrl-C and the termination signal of systemd set; a second one enforces it.
pub(super) fn stop_on_signal(runtime: &Runtime) -> Stop {
    let (stopper, stop) = Stop::new();
    stops_on_signal(stopper, runtime);
    stop
}

fn stops_on_signal(stopper: Stopper, runtime: &Runtime) {
    let _within = runtime.enter();
    // Here, not in the task, so that a signal before the task runs is received as well.
    let signals = (signal(SignalKind::interrupt()), signal(SignalKind::terminate()));
    if let (Ok(mut interrupt), Ok(mut terminate)) = signals {
        runtime.spawn(async move {
            loop {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
                ServiceManager::stopping();
                stopper.stop();
            }
        });
    }
}

/// Requests a stop at the end of standard input.
fn stops_with_input(stopper: Stopper) {
    thread::spawn(move || {
        // The input is discarded. An error counts as its end.
        let _ended = io::copy(&mut io::stdin(), &mut io::sink());
        stopper.stop();
    });
}

/// The start of a role: it waits for things that are missing yet, such as a scene that is being copied or a
/// port in use.
pub(super) struct Start<'r> {
    runtime: &'r Runtime,
    pub(super) net: Arc<dyn Net>,
    pub(super) stop: Stop,
    /// How long it waits for them.
    pub(super) join_timeout: Duration,
}

impl<'r> Start<'r> {
    pub(super) fn new(runtime: &'r Runtime, join_timeout_s: f64, until_input_ends: bool) -> Self {
        let (stopper, stop) = Stop::new();
        stops_on_signal(stopper.clone(), runtime);
        Self::stopped_by((stopper, stop), runtime, join_timeout_s, until_input_ends)
    }

    /// The same for a service, which ends soon after a stop request: see [`stoppable_service`].
    pub(super) fn of_service(
        runtime: &'r Runtime,
        join_timeout_s: f64,
        until_input_ends: bool,
    ) -> Result<Self, Failure> {
        Ok(Self::stopped_by(stoppable_service()?, runtime, join_timeout_s, until_input_ends))
    }

    fn stopped_by(
        (stopper, stop): (Stopper, Stop),
        runtime: &'r Runtime,
        join_timeout_s: f64,
        until_input_ends: bool,
    ) -> Self {
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let join_timeout = Duration::try_from_secs_f64(join_timeout_s).unwrap_or_default();
        if until_input_ends {
            stops_with_input(stopper);
        }
        Self { runtime, net, stop, join_timeout }
    }

    /// The runtime of its links.
    pub(super) const fn runtime(&self) -> &'r Runtime {
        self.runtime
    }

    /// The result of `attempt` once it succeeds; `None` if the role is stopped before. Errors that may pass
    /// are retried until `join_timeout`.
    pub(super) fn until<T>(
        &self,
        attempt: impl AsyncFn() -> Result<T, Failure>,
    ) -> Result<Option<T>, Failure> {
        let deadline = self.net.now().after(self.join_timeout);
        let attempts = again(&self.net, deadline, Failure::may_pass, || attempt());
        self.runtime.block_on(self.stop.unless_requested(attempts)).transpose()
    }

    /// The metrics that a role shows; `None` if it is stopped before.
    pub(super) fn metrics(
        &self,
        role: &'static str,
        common: &CommonConfig,
        at: &Options,
    ) -> Result<Option<MetricsServer>, Failure> {
        self.until(async || MetricsServer::start(role, common.metrics, &at.ws, self.runtime))
    }
}

/// Opens a cooked scene; it may still be being copied.
pub(super) fn scene(path: &Path) -> Result<SceneFile, Failure> {
    let scene = Scene::open(path).map_err(Failure::broken)?;
    Ok(SceneFile { path: path.to_owned(), scene: Arc::new(scene) })
}

/// The scene on a device.
pub(super) fn upload(file: &SceneFile, gpu: &GpuOptions) -> Result<Arc<GpuScene>, Failure> {
    let gpu = Gpu::open(gpu).map_err(Failure::broken)?;
    GpuScene::new(&gpu, &file.scene).map_err(Failure::broken)
}

/// The figures of this process, and the server that shows them.
pub(super) struct MetricsServer {
    pub(super) metrics: Metrics,
    _server: Option<Serving>,
}

impl MetricsServer {
    /// Shows those of this role at this address, if there is one, while this lives, to clients that use an
    /// allowed host name.
    pub(super) fn start(
        role: &'static str,
        at: Option<SocketAddr>,
        names: &WsOptions,
        runtime: &Runtime,
    ) -> Result<Self, Failure> {
        let metrics = Metrics::new(role);
        let server = at.map(|at| metrics.clone().serve(at, names, runtime.handle())).transpose();
        let server = server.map_err(Failure::broken)?;
        if let Some(serving) = &server {
            tracing::info!(target: SAID, "metrics on http://{}/metrics", serving.address());
        }
        Ok(Self { metrics, _server: server })
    }
}

/// The figures of an open scene on its device.
pub(super) fn opened(file: &SceneFile, drawn: &Arc<GpuScene>) -> Opened {
    let SceneInfo { file, hash, triangles, objects, .. } = scene_info(file);
    let name = Path::new(&file).file_name().map_or(file.clone(), |name| name.to_string_lossy().into_owned());
    let scene = SceneReading { name, fingerprint: hash, triangles, objects };
    let device = drawn.gpu().info().name.clone();
    let drawn = Arc::downgrade(drawn);
    let memory = move || {
        let geometry = drawn.upgrade().map_or(0, |drawn| drawn.working_set().taken_bytes);
        DeviceMemory { geometry, depth: 0 }
    };
    Opened { scene, device, memory: Box::new(memory), pages: None }
}
