//! `trimaran role`: one role of a deployment on several machines.

use std::{
    future::pending,
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use tokio::runtime::Runtime;
use trimaran::vulkan::VulkanPair;
use trimaran::{
    config::{DisplayConfig, PairSeat, PeerFile, RoleConfig, SessionConfig, SwitchConfig, security},
    metrics::{LinkMetrics, Serving},
    report::schema::Seat as ReportSeat,
    walkthrough::{PathChoice, Plan, SceneFile, Trail},
};
use trimaran_actors::{
    JoinError, Joined, Link, OccluderPolicy, PairRole, Place, Seat, Stop, Stopwatch, Turns, again,
    join_session, leave_unable, max_frame, role_of,
};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene};
use trimaran_proto::{BatchSize, EpsilonPx, PictureSize, Role};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Instant, Net, Options, TokioNet, sleep_until};

use super::{
    Failure,
    args::{RoleArgs, RoleCommand, RoleName},
    display::{DisplayStage, LostForGood, Show},
    recording::{check_trace, open_folder},
    walking::{self, gpu_options, stop_on_signal},
};

/// How long the last links of a process may take to tell that they are gone.
const LETTING_GO: Duration = Duration::from_millis(50);

pub(super) fn run(command: &RoleCommand) -> Result<(), Failure> {
    match command {
        RoleCommand::Switch(args) => on_runtime(|runtime| switch(&load(args)?, runtime)),
        RoleCommand::Display(args) => on_runtime(|runtime| display(&load(args)?, runtime)),
    }
}

/// Plays a role. However it ends, a link that is dropped without a close tells its peer once the runtime
/// runs again: over QUIC the peer would otherwise wait for the end of the idle timeout.
fn on_runtime(role: impl FnOnce(&Runtime) -> Result<(), Failure>) -> Result<(), Failure> {
    let runtime = walking::runtime()?;
    let result = role(&runtime);
    let net = TokioNet::new(runtime.handle().clone());
    runtime.block_on(sleep_until(&net, net.now().after(LETTING_GO)));
    result
}

fn load<C: RoleConfig>(args: &RoleArgs<C::Layer>) -> Result<(C, Options), Failure>
where
    C::Layer: clap::Args + Clone,
{
    C::load(args.flags.clone(), &args.links.options, args.config.as_deref()).map_err(Failure::bad_input)
}

/// A configuration file with every key.
pub(super) fn template(role: RoleName) -> String {
    match role {
        RoleName::Switch => SwitchConfig::template(),
        RoleName::Display => DisplayConfig::template(),
    }
}

/// One machine of the pair, from start to close.
fn switch((config, options): &(SwitchConfig, Options), runtime: &Runtime) -> Result<(), Failure> {
    let seat = match config.seat {
        PairSeat::First => Seat::First,
        PairSeat::Second => Seat::Second,
    };
    let place = |endpoint: &Endpoint, name, role, peer: &Option<PathBuf>| {
        let peer = PeerFile { name, role: Some(role), path: peer.as_deref() };
        let known = security(options, &endpoint.clone().into(), config.keys.as_deref(), &[peer]);
        let options = Options { security: known.map_err(Failure::bad_input)?, ..options.clone() };
        Ok::<_, Failure>(Place { endpoint: endpoint.clone(), options })
    };
    let mut display = place(&config.display, "peers.display", Role::Display, &config.peers.display)?;
    let mut pair = place(&config.pair, "peers.other", role_of(seat.other()), &config.peers.other)?;
    let gpu = gpu_options(config.device.as_deref(), config.device_timeout_s);
    let start = Start::new(runtime, config.join_timeout_s);
    let Some(file) = start.until(async || scene(&config.scene))? else { return Ok(()) };
    for place in [&mut display, &mut pair] {
        place.options.link.max_frame = max_frame(&file.scene);
    }
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    let Some(mut metrics) = start.until(async || Metrics::show(config.metrics, runtime))? else {
        return Ok(());
    };
    let Start { net, stop, .. } = start;
    let scene = file.scene.hash();
    let (mut wait_s, mut lost) = (config.join_timeout_s, None);
    loop {
        let deadline = deadline(&net, wait_s);
        let join = || join_session(&net, seat, scene, &display, &pair, deadline);
        let joining = again(&net, deadline, JoinError::is_early, join);
        let Some(joined) = stop.unless_requested(runtime.handle(), joining) else { return Ok(()) };
        let Joined { display, other, settings } = joined.map_err(|e| match lost.take() {
            Some(lost) => Failure::broken(LostForGood { seconds: wait_s, lost }),
            None => not_joined(e),
        })?;
        tracing::info!(%settings, "joined the session");
        metrics.watch([&display, &other]);
        let device = match VulkanPair::new(&drawn, settings.size, settings.tester) {
            Ok(device) => device,
            Err(error) => {
                leave_unable(runtime.handle(), [display, other], &error.to_string());
                return Err(Failure::broken(error));
            }
        };
        let (scene, occluders) = (Arc::clone(&file.scene), OccluderPolicy::default());
        let (clock, turns) = (Stopwatch::start(), Turns::at_once());
        let role = PairRole { seat, scene, device, display, other, settings, occluders, clock, turns };
        let Err(error) = role.run(runtime.handle(), &stop) else { return Ok(()) };
        if config.reconnect_s <= 0.0 || !error.lost_a_peer() {
            return Err(Failure::broken(error));
        }
        let said = Failure::broken(error);
        eprintln!("trimaran: {said}; joining again for {} s", config.reconnect_s);
        (wait_s, lost) = (config.reconnect_s, Some(said.to_string().into()));
    }
}

/// What may pass is no fault of the configuration: whoever starts roles again when they fail may do so.
pub(super) fn not_joined(error: JoinError) -> Failure {
    if error.may_pass() { Failure::broken(error) } else { Failure::bad_input(error) }
}

/// The display of a deployment: waits for the pair, walks the path, writes the report.
fn display((config, options): &(DisplayConfig, Options), runtime: &Runtime) -> Result<(), Failure> {
    let plan = session_plan(&config.session)?;
    let choice = PathChoice::parse(&config.session.path, config.session.seed);
    let (first, second) = (config.peers.first.as_deref(), config.peers.second.as_deref());
    let peers = [
        PeerFile { name: "peers.first", role: Some(role_of(Seat::First)), path: first },
        PeerFile { name: "peers.second", role: Some(role_of(Seat::Second)), path: second },
    ];
    let known = security(options, &config.listen, config.keys.as_deref(), &peers);
    let mut options = Options { security: known.map_err(Failure::bad_input)?, ..options.clone() };
    check_trace(config.record.as_deref())?;
    let gpu = gpu_options(config.device.as_deref(), config.device_timeout_s);
    let start = Start::new(runtime, config.join_timeout_s);
    let Some(folder) = start.until(async || open_folder(&config.out))? else { return Ok(()) };
    let Some(file) = start.until(async || scene(&config.scene))? else { return Ok(()) };
    options.link.max_frame = max_frame(&file.scene);
    let trail =
        Trail::find(&choice, &file.scene, plan.size, config.session.frames).map_err(Failure::bad_input)?;
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    let Some(metrics) = start.until(async || Metrics::show(config.metrics, runtime))? else { return Ok(()) };
    let listen =
        || DisplayStage::set(&file, Arc::clone(&drawn), &plan, &trail, runtime, &config.listen, &options);
    let Some(stage) = start.until(listen)? else { return Ok(()) };
    eprintln!("trimaran: the display listens on {}", stage.listener.local_endpoints());
    let info = stage.info().clone();
    let show = Show {
        folder: Some(folder),
        plan,
        trail,
        path: config.session.path.clone(),
        seed: config.session.seed,
        devices: vec![(ReportSeat::Display, info)],
        join_timeout_s: config.join_timeout_s,
        reconnect_s: config.reconnect_s,
        metrics,
        trace: config.record.clone(),
    };
    match stage.show(&file, show, runtime, &start.stop, pending()) {
        // A service that waits is stopped as any other.
        Err(failure) if failure.is_stop() => Ok(()),
        shown => shown?.conclude(&config.out, false),
    }
}

/// What the configuration asks for.
fn session_plan(session: &SessionConfig) -> Result<Plan, Failure> {
    Ok(Plan {
        size: PictureSize::new(session.width, session.height).map_err(Failure::bad_input)?,
        epsilon: EpsilonPx::new(session.epsilon_px).map_err(Failure::bad_input)?,
        batch: BatchSize::new(session.batch.into()).map_err(Failure::bad_input)?,
        coding: session.coding.parse().map_err(Failure::bad_input)?,
        tester: session.tester.parse().map_err(Failure::bad_input)?,
        pace: walking::pace(session.live_hz),
        few_pixels: session.few_pixels,
        audit_every: session.audit_every,
        visible: session.visible,
        alone: false,
    })
}

/// How a role starts: what is not there yet, such as a scene that is being copied or a port in use, is waited
/// for.
struct Start<'r> {
    runtime: &'r Runtime,
    net: Arc<dyn Net>,
    stop: Stop,
    join_timeout_s: f64,
}

impl<'r> Start<'r> {
    fn new(runtime: &'r Runtime, join_timeout_s: f64) -> Self {
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        Self { runtime, net, stop: stop_on_signal(runtime), join_timeout_s }
    }

    /// What `attempt` gives once it works; `None` if the role is asked to stop before. It is tried again
    /// while what it fails with may pass, for as long as the role waits for others.
    fn until<T>(&self, attempt: impl AsyncFn() -> Result<T, Failure>) -> Result<Option<T>, Failure> {
        let deadline = deadline(&self.net, self.join_timeout_s);
        let attempts = again(&self.net, deadline, Failure::may_pass, || attempt());
        self.stop.unless_requested(self.runtime.handle(), attempts).transpose()
    }
}

/// The scene, which may be being copied.
fn scene(path: &Path) -> Result<SceneFile, Failure> {
    let scene = Scene::open(path).map_err(Failure::broken)?;
    Ok(SceneFile { path: path.to_owned(), scene: Arc::new(scene) })
}

/// What the links carry, once there are any.
pub(super) struct Metrics {
    links: LinkMetrics,
    _shown: Option<Serving>,
}

impl Metrics {
    /// Shows them at this address, if there is one, for as long as this lives.
    pub(super) fn show(at: Option<SocketAddr>, runtime: &Runtime) -> Result<Self, Failure> {
        let links = LinkMetrics::default();
        let shown = at.map(|at| links.clone().serve(at, runtime.handle())).transpose();
        let shown = shown.map_err(Failure::broken)?;
        if let Some(serving) = &shown {
            eprintln!("trimaran: metrics on http://{}/metrics", serving.address());
        }
        Ok(Self { links, _shown: shown })
    }

    /// Shows what `links` carry from now on.
    pub(super) fn watch(&mut self, links: [&Link; 2]) {
        self.links.watch(links);
    }
}

/// The scene on a device.
pub(super) fn upload(file: &SceneFile, gpu: &GpuOptions) -> Result<Arc<GpuScene>, Failure> {
    let gpu = Gpu::open(gpu).map_err(Failure::broken)?;
    GpuScene::upload(&gpu, &file.scene).map_err(Failure::broken)
}

/// So many seconds from now.
pub(super) fn deadline(net: &Arc<dyn Net>, seconds: f64) -> Instant {
    net.now().after(Duration::try_from_secs_f64(seconds).unwrap_or_default())
}
