//! `trimaran run`: walks a camera through a scene with a display and its cullers, and writes the report.

use std::sync::Arc;

use indicatif::ProgressBar;
use tokio::runtime::Runtime;
use trimaran::{
    config,
    culling::Culling,
    report::{Writer, schema::Machine},
    walkthrough::{SceneFile, SceneOnDevices, Walk},
};
use trimaran_actors::{CullerId, LocalCullers, Stop, Turns, max_frame};
use trimaran_gpu::Gpu;
use trimaran_proto::{SessionKey, Settings};
use trimaran_transport::{Net, TokioNet};

use super::{
    Failure,
    args::{LinkKind, RunArgs, WalkArgs},
    display::{Cullers, DisplaySession, EmptyScene, about, role_info},
    processes::{CullerProcesses, Keyring, endpoints},
    progress,
    recording::{self, Outcome, Recording, open_folder},
    walking::{self, MetricsServer, open, stop_on_signal, upload},
};

pub(super) fn run(args: &RunArgs) -> Result<(), Failure> {
    if args.walk.alone && (args.link != LinkKind::Inproc || args.live.is_some()) {
        return Err(Failure::bad_input(
            "--alone lets the roles of one process take turns: leave --link and --live out",
        ));
    }
    if args.link == LinkKind::Inproc && args.metrics.is_some() {
        return Err(Failure::bad_input(
            "--metrics shows what links between processes carry: add --link unix, tcp, quic or udp",
        ));
    }
    if args.empty_display && args.cullers.cullers == 0 {
        return Err(Failure::bad_input(
            "--empty-display is sent what becomes visible by a culler: give --cullers 1 or more",
        ));
    }
    if args.while_loading.is_some() && !args.empty_display {
        return Err(Failure::bad_input(
            "--while-loading is for a display that begins without the scene: add --empty-display",
        ));
    }
    if args.while_loading.is_some() && args.live.is_none() {
        return Err(Failure::bad_input(
            "--while-loading is for walks by the clock: add --live HZ. In lockstep the display always waits",
        ));
    }
    if args.state.is_some() && args.record.is_some() {
        return Err(Failure::bad_input(
            "--record keeps walks of one view state: leave --state or --record out",
        ));
    }
    walk(args, &open(&args.scene)?, None)?.conclude(&args.out, args.json)
}

/// Opens the devices of a display and this many cullers in this process.
pub(super) fn open_devices(
    file: &SceneFile,
    cullers: usize,
    walk: &WalkArgs,
) -> Result<SceneOnDevices, Failure> {
    let options = walk.gpu_options();
    SceneOnDevices::open(&file.scene, cullers, &options).map_err(Failure::broken)
}

/// Walks and reports. Roles of one process use `devices`, or open their own.
pub(super) fn walk(
    args: &RunArgs,
    file: &SceneFile,
    devices: Option<&SceneOnDevices>,
) -> Result<Outcome, Failure> {
    let RunArgs { walk, link, .. } = args;
    let pace = walking::pace(args.live);
    let plan = walking::plan(walk, args.cullers, args.epsilon, args.culling, args.visible, pace)?;
    let path = walking::path(walk, &plan, &file.scene, args.state.as_deref())?;
    recording::check(&plan, args.record.as_deref())?;
    let folder = open_folder(Writer::create, &args.out)?;
    let opened = match (link, devices) {
        (LinkKind::Inproc, None) => Some(open_devices(file, args.cullers.cullers.into(), walk)?),
        _ => None,
    };
    let devices = devices.or(opened.as_ref());
    let drawn = match devices {
        Some(devices) => Arc::clone(&devices.display),
        None => upload(file, &walk.gpu_options())?,
    };
    let way = Walk { file, drawn: &drawn, plan: &plan, path: &path };
    let runtime = walking::runtime()?;
    let stop = stop_on_signal(&runtime);
    let bar = Some(progress::walk(plan.pace, &path));
    record(args, way, devices, Some(folder), bar, (&runtime, &stop))?.report()
}

/// Walks, and records into `folder` as it goes. With `devices` the cullers are threads of this process, else
/// processes of their own.
pub(super) fn record<'w>(
    args: &RunArgs,
    way: Walk<'w>,
    devices: Option<&SceneOnDevices>,
    folder: Option<Writer>,
    bar: Option<ProgressBar>,
    (runtime, stop): (&Runtime, &Stop),
) -> Result<Recording<'w>, Failure> {
    let RunArgs { walk, link, .. } = args;
    let Walk { file, drawn, plan, .. } = way;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let turns = if plan.alone { Turns::alone() } else { Turns::at_once() };
    let cullers = CullerId::first(args.cullers.cullers.into());
    let machines = cullers.clone().map(Some).chain([None]);
    let drawn_by = |culler| devices.map_or(drawn, |devices| devices.drawn_by(culler));
    let roles = machines.map(|culler| role_info(Machine::of(culler), drawn_by(culler)));
    let empty = match args.empty_display {
        true => {
            let gpu = Gpu::open(&walk.gpu_options()).map_err(Failure::broken)?;
            let while_loading = args.while_loading.unwrap_or_default();
            Some(EmptyScene::new(file.scene.outline(), &gpu, args.geometry_cache, while_loading)?)
        }
        false => None,
    };
    let mut options = config::options(&args.links.options, toml::Table::new()).map_err(Failure::bad_input)?;
    options.link.max_frame = max_frame(&file.scene);
    let session = DisplaySession {
        walk: way,
        about: about(way, &walk.path, walk.seed, roles.collect()),
        folder,
        join_timeout: JOIN_TIMEOUT,
        metrics: MetricsServer::start("display", args.metrics, &options.ws, runtime)?,
        trace: args.record.clone(),
        key: SessionKey(net.random().map_err(Failure::broken)?),
        progress: None,
        net,
        cullers: Cullers { endpoints: Vec::new(), listener: None, sought: None, awaited: None },
        empty,
        turns: turns.clone(),
        bar,
    };
    let Some(devices) = devices else {
        let folder = tempfile::tempdir().map_err(Failure::broken)?;
        let endpoints = endpoints(*link, cullers.len(), folder.path())?;
        let needs_keys = endpoints.iter().any(|endpoint| config::needs_keys(&options, endpoint));
        let keyring = if needs_keys { Some(Keyring::make(folder.path(), cullers.len())?) } else { None };
        options.security = keyring.as_ref().map(|keyring| keyring.security.clone());
        let mut children =
            CullerProcesses::start(args, &options, endpoints, keyring.as_ref(), folder.path(), runtime)?;
        let cullers = Cullers { endpoints: children.peers(&options), ..session.cullers };
        let session = DisplaySession { cullers, ..session };
        return session.show(runtime, stop, children.ended_early(), |walk| walk());
    };
    let local = LocalCullers { options, ..LocalCullers::new(&file.scene, cullers.len(), &turns) };
    let cull = |culler: CullerId, settings: &Settings| {
        Culling::open(args.culling, &file.scene, devices.drawn_by(Some(culler)), settings, &turns)
    };
    let cullers = Cullers { endpoints: local.peers().collect(), ..session.cullers };
    let session = DisplaySession { cullers, ..session };
    session.show(runtime, stop, std::future::pending(), |walk| local.beside(cull, runtime.handle(), walk))
}

/// How long the cullers may take to load and copy a large scene.
const JOIN_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(120);
