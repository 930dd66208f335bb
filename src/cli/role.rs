//! `trimaran role`: one role of a deployment on several machines.

use std::{sync::Arc, time::Duration};

use tokio::runtime::Runtime;
use trimaran::{
    config::{CullerConfig, DisplayConfig, RoleConfig, RoleNeeds},
    culling::CullingMethod,
    report::{Run, Writer, schema::Machine},
    walkthrough::{CameraPath, PathChoice, Plan, Progress, Walk},
};
use trimaran_actors::{
    CullerService, Listener, PeerEndpoint, ServiceEndpoints, SessionLimits, Turns, max_frame,
};
use trimaran_gpu::Gpu;
use trimaran_proto::{BatchSize, Identity, LodRule, SessionKey, SettingsError, Viewport};
use trimaran_transport::{Endpoint, Endpoints, ListenError, Net, Options, TokioNet, sleep_until, until};

use super::{
    Failure,
    args::{RoleArgs, RoleCommand},
    culling::{Host, largest, limits},
    display::{Cullers, DisplaySession, EmptyScene, about, identity, role_info, seek},
    log::{Filter, SAID},
    progress,
    reconfigure::{Live, Reconfigure},
    recording::{self, Outcome, Recording, open_folder},
    relay,
    service_manager::ServiceManager,
    walking::{self, MetricsServer, Start, role_gpu, scene, upload},
};

/// How long the last links of a process may take to send their closes.
const LETTING_GO: Duration = Duration::from_millis(50);

pub(super) fn run(command: &RoleCommand) -> Result<(), Failure> {
    match command {
        RoleCommand::Culler(args) => on_runtime(|runtime| culler(load(args, runtime)?, runtime)),
        RoleCommand::Display(args) => on_runtime(|runtime| display(load(args, runtime)?, runtime)),
        RoleCommand::Relay(args) => on_runtime(|runtime| relay::relay(load(args, runtime)?, runtime)),
        RoleCommand::Watcher(args) => on_runtime(|runtime| relay::watcher(load(args, runtime)?, runtime)),
    }
}

/// Plays a role, then lets the runtime run for a moment, so that a link dropped without a close still tells
/// its peer. Over QUIC the peer would otherwise wait for the idle timeout.
fn on_runtime(role: impl FnOnce(&Runtime) -> Result<(), Failure>) -> Result<(), Failure> {
    let runtime = walking::runtime()?;
    let result = role(&runtime);
    let net = TokioNet::new(runtime.handle().clone());
    runtime.block_on(sleep_until(&net, net.now().after(LETTING_GO)));
    result
}

/// A role's configuration.
pub(super) struct Configured<C: RoleConfig>
where
    C::Layer: clap::Args,
{
    pub(super) config: C,
    /// The options of its links, with the keys.
    pub(super) options: Options,
    pub(super) until_input_ends: bool,
    pub(super) reconfigure: Reconfigure<C::Layer>,
}

fn load<C: RoleConfig + RoleNeeds>(
    args: &RoleArgs<C::Layer>,
    runtime: &Runtime,
) -> Result<Configured<C>, Failure>
where
    C::Layer: clap::Args + Clone + Send + Sync + 'static,
{
    let (config, options): (C, _) = args.load()?;
    if let Some(log) = &config.common().log {
        Filter::new(Some(log))?.set();
    }
    let security = config.security(&options).map_err(Failure::bad_input)?;
    let (options, until_input_ends) = (options.with_security(security), args.until_input_ends);
    Ok(Configured { config, options, until_input_ends, reconfigure: Reconfigure::listen(args, runtime)? })
}

/// A culler: serves displays until it is stopped.
fn culler(
    Configured { config, mut options, until_input_ends, reconfigure }: Configured<CullerConfig>,
    runtime: &Runtime,
) -> Result<(), Failure> {
    let gpu = role_gpu(&config.gpu);
    let start = Start::of_service(runtime, config.common.join_timeout_s, until_input_ends)?;
    let Some(server) = start.metrics("culler", &config.common, &options)? else { return Ok(()) };
    let Some(file) = start.until(async || scene(&config.scene))? else { return Ok(()) };
    options.link.max_frame = max_frame(&file.scene);
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    let peer = |endpoint: &Endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: options.clone() };
    let at = ServiceEndpoints {
        listen: config.listen.clone(),
        displays: config.displays.iter().flat_map(Endpoints::iter).map(peer).collect(),
        cullers: config.cullers.iter().flat_map(Endpoints::iter).cloned().collect(),
        options: options.clone(),
    };
    let serve = async || {
        let started = CullerService::start(&start.net, file.scene.outline(), at.clone()).await;
        started.map_err(|e| if e.may_pass() { Failure::broken(e) } else { Failure::bad_input(e) })
    };
    let Some(service) = start.until(serve)? else { return Ok(()) };
    // A parent process that has started it knows the endpoints.
    if let Some(endpoints) = service.endpoints().filter(|_| !until_input_ends) {
        tracing::info!(target: SAID, "the culler listens on {endpoints}");
    }
    let of_sessions = {
        let drawn = Arc::clone(&drawn);
        move |config: &CullerConfig| {
            let picture =
                config.max_picture.parse().map_err(|error: SettingsError| Failure::bad_input(error))?;
            Ok(limits(&drawn, largest(&drawn, picture), config.depth_memory))
        }
    };
    let limits = of_sessions(&config)?;
    let (metrics, places) = (server.metrics.clone(), options.limits.peers);
    let live = Live {
        metrics: metrics.clone(),
        peers: options.security.as_ref().map(|security| security.peers.clone()),
        limits: service.listener().map(|listener| listener.limits.clone()),
        sessions: Some(limits.clone()),
    };
    let _reconfigured = reconfigure.begin(live, of_sessions, runtime);
    let for_one_session = config.for_one_session.then_some(start.join_timeout);
    let (method, pages, file, drawn) = (config.culling, None, &file, &drawn);
    let host = Host { file, drawn, runtime, metrics, method, limits, places, pages, for_one_session };
    host.serve(service, &start.stop)
}

/// The display of a deployment: finds its cullers, walks the path, writes the report.
fn display(
    Configured { config, mut options, until_input_ends, reconfigure }: Configured<DisplayConfig>,
    runtime: &Runtime,
) -> Result<(), Failure> {
    let plan = session_plan(&config)?;
    let choice = PathChoice::parse(&config.session.path, config.session.seed);
    let gpu = role_gpu(&config.gpu);
    let start = Start::new(runtime, config.common.join_timeout_s, until_input_ends);
    let Some(folder) = start.until(async || open_folder(Writer::open, &config.out))? else {
        return Ok(());
    };
    let mut folder = if config.resumable { folder.resumable() } else { folder };
    let Some(metrics) = start.metrics("display", &config.common, &options)? else { return Ok(()) };
    let Some(path) = &config.scene else {
        return display_without_scene(&config, options, &plan, (folder, metrics), reconfigure, &start);
    };
    let Some(file) = start.until(async || scene(path))? else { return Ok(()) };
    options.link.max_frame = max_frame(&file.scene);
    let views = walking::view_states(config.session.state.as_deref(), &plan, &file.scene)?;
    let path =
        CameraPath::find(&choice, &file.scene, views, config.session.frames).map_err(Failure::bad_input)?;
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    let empty = match config.empty_display {
        true => {
            let gpu = Gpu::open(&gpu).map_err(Failure::broken)?;
            Some(EmptyScene::new(file.scene.outline(), &gpu, config.geometry_cache, config.while_loading)?)
        }
        false => None,
    };
    let walk = Walk { file: &file, drawn: &drawn, plan: &plan, path: &path };
    let peer = |endpoint: &Endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: options.clone() };
    let progress = match Progress::resume(&mut folder, walk, walking::date()).map_err(Failure::broken)? {
        Some(progress) => progress,
        None => Progress::new(SessionKey(start.net.random().map_err(Failure::broken)?)),
    };
    if let Some(went_on) = progress.went_on() {
        tracing::info!(target: SAID, "{went_on}");
    }
    // Cullers that come by themselves learn the session from the handshake.
    let key = progress.session;
    let listening = async || match &config.listen {
        Some(at) => {
            let scene = (!config.empty_display).then_some(&*file.scene);
            listen(&start.net, at, identity(scene, key, plan.settings()), &options).await.map(Some)
        }
        None => Ok(None),
    };
    let Some(listener) = start.until(listening)? else { return Ok(()) };
    if let Some(listener) = &listener {
        tracing::info!(target: SAID, "the display listens on {}", listener.local_endpoints());
    }
    let live = live(&metrics, &options, listener.as_ref());
    let _reconfigured = reconfigure.begin(live, no_sessions::<DisplayConfig>, runtime);
    let roles = vec![role_info(Machine::Display, &drawn)];
    let about = about(walk, &config.session.path, config.session.seed, roles);
    // A live walk does not wait unless it is asked to.
    let waits = config.session.live_hz.is_none() || config.await_cullers.is_some();
    let join_timeout = if waits { start.join_timeout } else { Duration::ZERO };
    let session = DisplaySession {
        walk,
        about: Run { started: progress.started.clone().unwrap_or(about.started), ..about },
        folder: Some(folder),
        join_timeout,
        metrics,
        trace: config.record.clone(),
        net: Arc::clone(&start.net),
        key,
        progress: Some(progress),
        cullers: Cullers {
            endpoints: config.cullers.iter().flat_map(Endpoints::iter).map(peer).collect(),
            listener,
            sought: None,
            awaited: config.await_cullers,
        },
        empty,
        turns: Turns::at_once(),
        bar: Some(progress::walk(plan.pace, &path)),
    };
    shown_and_reported(session, &start)?.map_or(Ok(()), |reported| reported.conclude(&config.out, false))
}

/// Walks, and reports; `None` if it was stopped before there was anything to report.
fn shown_and_reported(session: DisplaySession<'_>, start: &Start<'_>) -> Result<Option<Outcome>, Failure> {
    let manager = ServiceManager::of_this_process();
    manager.ready("waits for cullers");
    let shown = session.show_to_others(start.runtime(), &start.stop);
    let _reporting = manager.meanwhile(start.runtime());
    match shown.and_then(Recording::report) {
        // A service that waits is stopped as any other.
        Err(failure) if failure.is_stop() => Ok(None),
        reported => reported.map(Some),
    }
}

/// A display that has only what its cullers send: the first of them tells it the scene. It begins anew each
/// time it is started.
fn display_without_scene(
    config: &DisplayConfig,
    mut options: Options,
    plan: &Plan,
    (folder, metrics): (Writer, MetricsServer),
    reconfigure: Reconfigure<<DisplayConfig as confique::Config>::Layer>,
    start: &Start<'_>,
) -> Result<(), Failure> {
    // The number of ids in a frame is not known, and not checked, before the first culler has come.
    options.link.max_frame = u32::MAX;
    let gpu = role_gpu(&config.gpu);
    let gpu = Gpu::open(&gpu).map_err(Failure::broken)?;
    let runtime = start.runtime();
    let key = SessionKey(start.net.random().map_err(Failure::broken)?);
    let identity = identity(None, key, plan.settings());
    let listening = async || match &config.listen {
        Some(at) => listen(&start.net, at, identity, &options).await.map(Some),
        None => Ok(None),
    };
    let Some(listener) = start.until(listening)? else { return Ok(()) };
    let live = live(&metrics, &options, listener.as_ref());
    let _reconfigured = reconfigure.begin(live, no_sessions::<DisplayConfig>, runtime);
    let from =
        config.cullers.iter().chain(&config.listen).map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let peer = |endpoint: &Endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: options.clone() };
    let endpoints: Vec<_> = config.cullers.iter().flat_map(Endpoints::iter).map(peer).collect();
    let mut peers = runtime.block_on(async { seek(&start.net, identity, endpoints.clone(), listener) });
    let first = async {
        loop {
            let arrival = peers.next().await.map_err(Failure::bad_input)?;
            if let Some(outline) = arrival.link.peer.hello.scene {
                peers.put_back(arrival);
                return Ok(outline);
            }
        }
    };
    let deadline = start.net.now().after(start.join_timeout);
    let manager = ServiceManager::of_this_process();
    manager.ready("waits for a culler with a scene");
    metrics.metrics.ready();
    let first = until(&*start.net, deadline, start.stop.unless_requested(first));
    let first = manager.watching(&*start.net, first);
    let outline = match runtime.block_on(first) {
        Some(Some(outline)) => outline?,
        Some(None) => return Ok(()),
        None => {
            return Err(Failure::broken(format!("no culler has come from {from}: there is nothing to show")));
        }
    };
    let empty = EmptyScene::new(outline, &gpu, config.geometry_cache, config.while_loading)?;
    let (file, drawn) = (empty.file(&from), Arc::clone(empty.drawn()));
    let choice = PathChoice::parse(&config.session.path, config.session.seed);
    let views = walking::view_states(None, plan, &file.scene)?;
    let path = CameraPath::find(&choice, &file.scene, views, config.session.frames);
    let path = path.map_err(Failure::bad_input)?;
    let walk = Walk { file: &file, drawn: &drawn, plan, path: &path };
    let roles = vec![role_info(Machine::Display, &drawn)];
    let about = about(walk, &config.session.path, config.session.seed, roles);
    let session = DisplaySession {
        walk,
        empty: Some(empty),
        about,
        folder: Some(folder),
        // The first culler has come.
        join_timeout: if config.await_cullers.is_some() { start.join_timeout } else { Duration::ZERO },
        metrics,
        trace: config.record.clone(),
        net: Arc::clone(&start.net),
        key,
        progress: None,
        cullers: Cullers { endpoints, listener: None, sought: Some(peers), awaited: config.await_cullers },
        turns: Turns::at_once(),
        bar: Some(progress::walk(plan.pace, &path)),
    };
    shown_and_reported(session, start)?.map_or(Ok(()), |reported| reported.conclude(&config.out, false))
}

/// The parts of a display that its configuration may change.
fn live(server: &MetricsServer, options: &Options, listener: Option<&Listener>) -> Live {
    Live {
        metrics: server.metrics.clone(),
        peers: options.security.as_ref().map(|security| security.peers.clone()),
        limits: listener.map(Listener::limits),
        sessions: None,
    }
}

/// The sessions' limits of a role that serves none.
pub(super) fn no_sessions<C>(_: &C) -> Result<SessionLimits, Failure> {
    Ok(SessionLimits::none())
}

/// Listens for cullers that come by themselves.
async fn listen(
    net: &Arc<dyn Net>,
    at: &Endpoints,
    identity: Identity,
    options: &Options,
) -> Result<Listener, Failure> {
    let bound = Listener::bind_all(net, at, identity, options).await;
    bound.map_err(|e: ListenError| if e.may_pass() { Failure::broken(e) } else { Failure::bad_input(e) })
}

/// The plan that the configuration asks for, which this program can record as it is asked to.
pub(super) fn session_plan(
    DisplayConfig { session, schedule, record, .. }: &DisplayConfig,
) -> Result<Plan, Failure> {
    let plan = Plan {
        // Cullers choose their own method; without cullers the display uses Trimaran's.
        culling: CullingMethod::Trimaran,
        viewport: Viewport::new(session.width, session.height).map_err(Failure::bad_input)?,
        lod: LodRule::new(session.epsilon_px)
            .map_err(Failure::bad_input)?
            .stopping_at_few_pixels(session.few_pixels),
        batch: BatchSize::new(session.batch.into()).map_err(Failure::bad_input)?,
        coding: session.coding.parse().map_err(Failure::bad_input)?,
        occlusion_test: session.occlusion_test.parse().map_err(Failure::bad_input)?,
        pace: walking::pace(session.live_hz),
        schedule: schedule.parse().map_err(Failure::bad_input)?,
        audit_every: if cfg!(feature = "lab") { session.audit_every } else { 0 },
        visible: session.visible,
        alone: false,
    };
    recording::check(&plan, record.as_deref())?;
    Ok(plan)
}
