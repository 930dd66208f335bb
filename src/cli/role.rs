//! `trimaran role`: one role of a deployment on several machines.

use std::{
    future::pending,
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::Arc,
    time::SystemTime,
};

use tokio::runtime::Runtime;
use trimaran::{
    config::{DisplayConfig, PairSeat, RoleConfig, SessionConfig, SwitchConfig},
    metrics::{LinkMetrics, Serving},
    report::{Report, schema::Seat as ReportSeat},
    walkthrough::{PathChoice, Plan, Recorder, ReportPlan, SceneFile, Trail, viewport, write_report},
};
use trimaran_actors::{
    DisplayRole, Joined, OccluderPolicy, PairRole, Place, Seat, VulkanDisplay, VulkanPair, await_pair,
    join_session,
};
use trimaran_gpu::{Gpu, GpuInfo, GpuScene};
use trimaran_proto::{BatchSize, EpsilonPx, Identity, PictureSize, Role};
use trimaran_transport::{Endpoint, Endpoints, Instant, Link, Listener, Net, Options, TokioNet};

use super::{
    Failure,
    args::{RoleArgs, RoleCommand, RoleName},
    progress,
    run::{conclude, notes, record, report_on},
    walking::{self, gpu_options, open, stop_on_signal},
};

pub(super) fn run(command: &RoleCommand) -> Result<(), Failure> {
    match command {
        RoleCommand::Switch(args) => switch(&load(args)?),
        RoleCommand::Display(args) => display(&load(args)?),
    }
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
fn switch(config: &SwitchConfig) -> Result<(), Failure> {
    let file = open(&config.scene)?;
    let drawn = upload(&file, config.device.as_deref())?;
    let runtime = walking::runtime()?;
    let stop = stop_on_signal(&runtime);
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
    let deadline = deadline(&net, config.patience_s);
    let joining = join_session(&net, seat, file.scene.hash(), &display, &pair, deadline);
    let Some(joined) = stop.unless_requested(runtime.handle(), joining) else { return Ok(()) };
    let Joined { display, other, settings } = joined.map_err(Failure::bad_input)?;
    tracing::info!(%settings, "joined the session");
    let _shown = show_metrics(config.metrics, [&display, &other], &runtime)?;
    let size = viewport(settings.size).map_err(Failure::bad_input)?;
    let device = VulkanPair::new(&drawn, size, settings.tester).map_err(Failure::broken)?;
    let occluders = OccluderPolicy::default();
    let role = PairRole { seat, scene: file.scene, device, display, other, settings, occluders };
    role.run(runtime.handle(), &stop).map_err(Failure::broken)
}

/// The display of a deployment: waits for the pair, walks the path, writes the report.
fn display(config: &DisplayConfig) -> Result<(), Failure> {
    let file = open(&config.scene)?;
    let plan = session_plan(&config.session)?;
    let choice = PathChoice::parse(&config.session.path, config.session.seed);
    let size = viewport(plan.size).map_err(Failure::bad_input)?;
    let trail = Trail::find(&choice, &file.scene, size, config.session.frames).map_err(Failure::bad_input)?;
    let runtime = walking::runtime()?;
    let peers =
        [("peers.first", config.peers.first.as_deref()), ("peers.second", config.peers.second.as_deref())];
    let guard =
        config.link.security(&config.listen, config.keys.as_deref(), &peers).map_err(Failure::bad_input)?;
    let options = config.link.options(guard);
    let device = config.device.as_deref();
    let stage = DisplayStage::set(&file, device, &plan, &trail, &runtime, &config.listen, &options)?;
    eprintln!("trimaran: the display listens on {}", stage.listener.local_endpoints());
    let info = stage.drawn.gpu().info().clone();
    let show = Show {
        plan,
        trail,
        path: config.session.path.clone(),
        seed: config.session.seed,
        devices: vec![(ReportSeat::Display, info)],
        patience_s: config.patience_s,
        metrics: config.metrics,
        trace: None,
    };
    let report = stage.show(&file, show, &config.out, &runtime, pending())?;
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
    })
}

/// Shows what `links` carry for as long as what it gives lives.
fn show_metrics(
    at: Option<SocketAddr>,
    links: [&Link; 2],
    runtime: &Runtime,
) -> Result<Option<Serving>, Failure> {
    let Some(at) = at else { return Ok(None) };
    let serving = LinkMetrics::of(links).serve(at, runtime.handle()).map_err(Failure::bad_input)?;
    eprintln!("trimaran: metrics on http://{}/metrics", serving.address());
    Ok(Some(serving))
}

fn upload(file: &SceneFile, device: Option<&str>) -> Result<Arc<GpuScene>, Failure> {
    let gpu = Gpu::open(&gpu_options(device)).map_err(Failure::broken)?;
    GpuScene::upload(&gpu, &file.scene).map_err(Failure::broken)
}

fn deadline(net: &Arc<dyn Net>, seconds: f64) -> Instant {
    net.now().after(std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default())
}

/// A display that listens for its pair, its device ready.
pub(super) struct DisplayStage {
    drawn: Arc<GpuScene>,
    pub(super) listener: Listener,
    net: Arc<dyn Net>,
}

/// What a display shows.
pub(super) struct Show {
    pub(super) plan: Plan,
    pub(super) trail: Trail,
    /// As the user named it.
    pub(super) path: String,
    pub(super) seed: u64,
    /// The devices that the report names.
    pub(super) devices: Vec<(ReportSeat, GpuInfo)>,
    /// How long to wait for the pair, seconds.
    pub(super) patience_s: f64,
    /// Where to show what the links carry.
    pub(super) metrics: Option<SocketAddr>,
    /// Where to record what each frame asked of the roles.
    pub(super) trace: Option<PathBuf>,
}

impl DisplayStage {
    /// Opens the device and listens.
    pub(super) fn set(
        file: &SceneFile,
        device: Option<&str>,
        plan: &Plan,
        trail: &Trail,
        runtime: &Runtime,
        listen: &Endpoints,
        options: &Options,
    ) -> Result<Self, Failure> {
        let drawn = upload(file, device)?;
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let settings = plan.settings(trail.frames());
        let identity = Identity { role: Role::Display, scene: file.scene.hash(), settings: Some(settings) };
        let listening = Listener::bind_all(&net, listen, identity, options);
        let listener = runtime.block_on(listening).map_err(Failure::bad_input)?;
        Ok(Self { drawn, listener, net })
    }

    /// The device's own words.
    pub(super) fn info(&self) -> &GpuInfo {
        self.drawn.gpu().info()
    }

    /// Waits for the pair, walks and writes the report into `out`. When `hopeless` ends, the pair cannot come any more.
    pub(super) fn show(
        self,
        file: &SceneFile,
        show: Show,
        out: &Path,
        runtime: &Runtime,
        hopeless: impl Future<Output = Failure>,
    ) -> Result<Report, Failure> {
        let Self { drawn, listener, net } = self;
        let Show { plan, trail, path, seed, devices, patience_s, metrics, trace } = show;
        let started = SystemTime::now();
        let stop = stop_on_signal(runtime);
        let coming = async {
            tokio::select! {
                biased;
                pair = await_pair(listener, deadline(&net, patience_s)) => pair.map_err(Failure::bad_input),
                failure = hopeless => Err(failure),
            }
        };
        let Some(pair) = stop.unless_requested(runtime.handle(), coming) else {
            return Err(Failure::broken("interrupted before the pair had come"));
        };
        let [first, second] = pair?;
        let _shown = show_metrics(metrics, [&first, &second], runtime)?;
        let [a, b] = [first.peer.address, second.peer.address];
        let (link, transport) = if a.transport() == b.transport() {
            (a.transport().to_owned(), format!("{}: {a} and {b}", a.transport()))
        } else {
            let (one, other) = (a.transport(), b.transport());
            (format!("{one} and {other}"), format!("{one}: {a}; {other}: {b}"))
        };
        let settings = plan.settings(trail.frames());
        let size = viewport(plan.size).map_err(Failure::bad_input)?;
        let device = VulkanDisplay::new(&drawn, size).map_err(Failure::broken)?;
        let role = DisplayRole { scene: Arc::clone(&file.scene), device, first, second, settings, net };
        let bar = progress::walk(plan.pace, &trail);
        let mut advance = |_| bar.inc(1);
        let mut recorder = Recorder::new(plan.audit_every, &mut advance);
        role.run(&mut *trail.cameras(plan.pace), &mut recorder, runtime.handle(), &stop)
            .map_err(Failure::broken)?;
        let records = recorder.into_frames();
        bar.finish_and_clear();
        record(trace.as_deref(), file, &plan, &records)?;
        let about = ReportPlan {
            command_line: std::env::args().collect(),
            started,
            link,
            transport,
            seed: (path == "auto").then_some(seed),
            path,
            devices,
            notes: notes(&trail),
        };
        report_on(&records, &stop, |records, advance| {
            write_report(out, file, &drawn, &plan, &about, &trail, records, advance)
        })
    }
}
