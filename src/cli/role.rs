//! `trimaran role`: one role of a deployment on several machines.

use std::{future::pending, net::SocketAddr, path::PathBuf, sync::Arc, time::Duration};

use tokio::runtime::Runtime;
use trimaran::{
    config::{DisplayConfig, PairSeat, RoleConfig, SessionConfig, SwitchConfig},
    metrics::{LinkMetrics, Serving},
    report::schema::Seat as ReportSeat,
    walkthrough::{PathChoice, Plan, SceneFile, Trail, viewport},
};
use trimaran_actors::{
    JoinError, Joined, OccluderPolicy, PairRole, Place, Seat, Stopwatch, Turns, VulkanPair, again,
    join_session,
};
use trimaran_gpu::{Gpu, GpuScene};
use trimaran_proto::{BatchSize, EpsilonPx, PictureSize};
use trimaran_transport::{Endpoint, Instant, Link, Net, TokioNet, sleep_until};

use super::{
    Failure,
    args::{RoleArgs, RoleCommand, RoleName},
    display::{DisplayStage, LostForGood, Show},
    run::conclude,
    walking::{self, gpu_options, open, stop_on_signal},
};

/// How long the last links of a process may take to tell that they are gone.
const LETTING_GO: Duration = Duration::from_millis(50);

pub(super) fn run(command: &RoleCommand) -> Result<(), Failure> {
    match command {
        RoleCommand::Switch(args) => on_runtime(|runtime| switch(&load(args)?, runtime)),
        RoleCommand::Display(args) => on_runtime(|runtime| display(&load(args)?, runtime)),
    }
}

/// Plays a role. However it ends, a link that is dropped without a goodbye tells its peer once the runtime runs again: over QUIC the peer
/// would otherwise wait for the end of the lease.
fn on_runtime(role: impl FnOnce(&Runtime) -> Result<(), Failure>) -> Result<(), Failure> {
    let runtime = walking::runtime()?;
    let result = role(&runtime);
    let net = TokioNet::new(runtime.handle().clone());
    runtime.block_on(sleep_until(&net, net.now().after(LETTING_GO)));
    result
}

fn load<C: RoleConfig>(args: &RoleArgs<C::Layer>) -> Result<C, Failure>
where
    C::Layer: clap::Args + Clone,
{
    C::load(args.flags.clone(), args.config.as_deref()).map_err(Failure::bad_input)
}

/// A configuration file with every key.
pub(super) fn template(role: RoleName) -> String {
    match role {
        RoleName::Switch => SwitchConfig::template(),
        RoleName::Display => DisplayConfig::template(),
    }
}

/// One machine of the pair, from start to goodbye.
fn switch(config: &SwitchConfig, runtime: &Runtime) -> Result<(), Failure> {
    let file = open(&config.scene)?;
    let drawn = upload(&file, config.device.as_deref())?;
    let stop = stop_on_signal(runtime);
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let seat = match config.seat {
        PairSeat::First => Seat::First,
        PairSeat::Second => Seat::Second,
    };
    let place = |endpoint: &Endpoint, name, peer: &Option<PathBuf>| {
        let guard = config.link.security(
            &endpoint.clone().into(),
            config.keys.as_deref(),
            &[(name, peer.as_deref())],
        );
        let options = config.link.options(guard.map_err(Failure::bad_input)?);
        Ok::<_, Failure>(Place { endpoint: endpoint.clone(), options })
    };
    let display = place(&config.display, "peers.display", &config.peers.display)?;
    let pair = place(&config.pair, "peers.other", &config.peers.other)?;
    let scene = file.scene.hash();
    let (mut metrics, mut wait_s, mut lost) = (Metrics::new(config.metrics), config.patience_s, None);
    loop {
        let deadline = deadline(&net, wait_s);
        let join = || join_session(&net, seat, scene, &display, &pair, deadline);
        let joining = async {
            match &lost {
                None => join().await,
                // The others may not have noticed yet, and their old sockets may need a moment to be gone.
                Some(_) => again(&net, deadline, join).await,
            }
        };
        let Some(joined) = stop.unless_requested(runtime.handle(), joining) else { return Ok(()) };
        let Joined { display, other, settings } = joined.map_err(|e| match lost.take() {
            Some(lost) => Failure::broken(LostForGood { seconds: wait_s, lost }),
            None => not_joined(e),
        })?;
        tracing::info!(%settings, "joined the session");
        metrics.watch([&display, &other], runtime)?;
        let size = viewport(settings.size).map_err(Failure::bad_input)?;
        let device = VulkanPair::new(&drawn, size, settings.tester).map_err(Failure::broken)?;
        let (scene, occluders) = (Arc::clone(&file.scene), OccluderPolicy::default());
        let (clock, turns) = (Stopwatch::start(), Turns::at_once());
        let role = PairRole { seat, scene, device, display, other, settings, occluders, clock, turns };
        let Err(error) = role.run(runtime.handle(), &stop) else { return Ok(()) };
        if config.reconnect_s <= 0.0 || !error.lost_a_peer() || stop.requested() {
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
fn display(config: &DisplayConfig, runtime: &Runtime) -> Result<(), Failure> {
    let file = open(&config.scene)?;
    let plan = session_plan(&config.session)?;
    let choice = PathChoice::parse(&config.session.path, config.session.seed);
    let size = viewport(plan.size).map_err(Failure::bad_input)?;
    let trail = Trail::find(&choice, &file.scene, size, config.session.frames).map_err(Failure::bad_input)?;
    let peers =
        [("peers.first", config.peers.first.as_deref()), ("peers.second", config.peers.second.as_deref())];
    let guard =
        config.link.security(&config.listen, config.keys.as_deref(), &peers).map_err(Failure::bad_input)?;
    let options = config.link.options(guard);
    let device = config.device.as_deref();
    let stage = DisplayStage::set(&file, device, &plan, &trail, runtime, &config.listen, &options)?;
    eprintln!("trimaran: the display listens on {}", stage.listener.local_endpoints());
    let info = stage.info().clone();
    let show = Show {
        plan,
        trail,
        path: config.session.path.clone(),
        seed: config.session.seed,
        devices: vec![(ReportSeat::Display, info)],
        patience_s: config.patience_s,
        reconnect_s: config.reconnect_s,
        metrics: config.metrics,
        trace: config.record.clone(),
    };
    let report = stage.show(&file, show, &config.out, runtime, pending())?;
    conclude(&report, &config.out, false)
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

/// What the links carry, shown once there are any.
pub(super) struct Metrics {
    at: Option<SocketAddr>,
    links: LinkMetrics,
    shown: Option<Serving>,
}

impl Metrics {
    /// To be shown at this address, or nowhere.
    pub(super) fn new(at: Option<SocketAddr>) -> Self {
        Self { at, links: LinkMetrics::default(), shown: None }
    }

    /// Shows what `links` carry, for as long as this lives or until there are others.
    pub(super) fn watch(&mut self, links: [&Link; 2], runtime: &Runtime) -> Result<(), Failure> {
        self.links.watch(links);
        if let (Some(at), None) = (self.at, &self.shown) {
            let serving = self.links.clone().serve(at, runtime.handle()).map_err(Failure::bad_input)?;
            eprintln!("trimaran: metrics on http://{}/metrics", serving.address());
            self.shown = Some(serving);
        }
        Ok(())
    }
}

/// The scene on the device of this name.
pub(super) fn upload(file: &SceneFile, device: Option<&str>) -> Result<Arc<GpuScene>, Failure> {
    let gpu = Gpu::open(&gpu_options(device)).map_err(Failure::broken)?;
    GpuScene::upload(&gpu, &file.scene).map_err(Failure::broken)
}

/// So many seconds from now.
pub(super) fn deadline(net: &Arc<dyn Net>, seconds: f64) -> Instant {
    net.now().after(Duration::try_from_secs_f64(seconds).unwrap_or_default())
}
