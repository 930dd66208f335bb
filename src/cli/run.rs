//! `trimaran run`: walks a camera through a scene with the three roles and writes the report.

use std::{future::pending, sync::Arc};

use trimaran::{
    config,
    report::schema::Machine,
    vulkan::VulkanCuller,
    walkthrough::{SceneFile, SceneOnDevices, Walk},
};
use trimaran_actors::{CullerIndex, JoinTimeouts, LocalCullers, Turns, max_frame};
use trimaran_proto::Settings;
use trimaran_transport::{Net, TokioNet};

use super::{
    Failure,
    args::{LinkKind, RunArgs},
    display::{DisplaySession, about, listen, role_info},
    processes::{CullerProcesses, Keyring, endpoints},
    recording::{Outcome, check_trace, open_folder},
    walking::{self, Metrics, gpu_options, open, stop_on_signal, upload},
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
    walk(args, &open(&args.scene)?, None)?.conclude(&args.out, args.json)
}

/// Opens the devices of three roles in this process.
pub(super) fn open_devices(
    file: &SceneFile,
    device: Option<&str>,
    timeout_s: f64,
) -> Result<SceneOnDevices, Failure> {
    SceneOnDevices::open(&file.scene, &gpu_options(device, timeout_s)).map_err(Failure::broken)
}

/// Walks and reports. Roles of one process use `devices`, or open their own.
pub(super) fn walk(
    args: &RunArgs,
    file: &SceneFile,
    devices: Option<&SceneOnDevices>,
) -> Result<Outcome, Failure> {
    let RunArgs { walk, link, .. } = args;
    let plan = walking::plan(walk, args.epsilon, args.visible, walking::pace(args.live))?;
    let path = walking::path(walk, &plan, &file.scene)?;
    check_trace(args.record.as_deref())?;
    let folder = open_folder(&args.out)?;
    let opened = match (link, devices) {
        (LinkKind::Inproc, None) => Some(open_devices(file, walk.device.as_deref(), walk.device_timeout)?),
        _ => None,
    };
    let devices = devices.or(opened.as_ref());

    let runtime = walking::runtime()?;
    let stop = stop_on_signal(&runtime);
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let configs = tempfile::tempdir().map_err(Failure::broken)?;
    let (display, meet) = endpoints(*link, configs.path())?;
    let mut options = config::options(&args.links.options, toml::Table::new()).map_err(Failure::bad_input)?;
    let keyring =
        if config::needs_keys(&options, &display) { Some(Keyring::make(configs.path())?) } else { None };
    options.security = keyring.as_ref().map(|keyring| keyring.security.clone());
    options.link.max_frame = max_frame(&file.scene);
    let drawn = match devices {
        Some(devices) => Arc::clone(&devices.drawn[2]),
        None => upload(file, &gpu_options(walk.device.as_deref(), walk.device_timeout))?,
    };
    let listening = display.into();
    let way = Walk { file, drawn: &drawn, plan: &plan, path: &path };
    let listening = listen(way, &net, &listening, &options);
    let listener = runtime.block_on(listening)?;
    let display = listener.local_endpoint().clone();
    let drawn_by = |index: usize| devices.map_or(&drawn, |devices| &devices.drawn[index]);
    let machines = [Machine::FirstCuller, Machine::SecondCuller, Machine::Display];
    let roles = machines.into_iter().zip(0..).map(|(machine, index)| role_info(machine, drawn_by(index)));
    let turns = if plan.alone { Turns::alone() } else { Turns::at_once() };
    let session = DisplaySession {
        walk: way,
        about: about(way, &walk.path, walk.seed, roles.collect()),
        folder: Some(folder),
        timeouts: JoinTimeouts::ONCE,
        metrics: Metrics::show(args.metrics, &runtime)?,
        trace: args.record.clone(),
        net,
        endpoints: listener.local_endpoints().clone(),
        listener: Some(listener),
        options: options.clone(),
        turns: turns.clone(),
    };
    let Some(SceneOnDevices { drawn, .. }) = devices else {
        let folder = configs.path();
        let mut cullers =
            CullerProcesses::start(args, &options, &display, &meet, keyring.as_ref(), folder, &runtime)?;
        let outcome = session.show(&runtime, &stop, cullers.ended_early(), |walk| walk())?;
        if !outcome.report.summary.ended.early() {
            runtime.block_on(cullers.ended_well())?;
        }
        return Ok(outcome);
    };
    let (scene, timeouts) = (Arc::clone(&file.scene), JoinTimeouts::ONCE);
    let cullers = LocalCullers { scene, display, meet, options, timeouts, turns };
    let device = |culler: CullerIndex, settings: &Settings| {
        Ok(VulkanCuller::new(&drawn[culler.index()], settings.viewport, settings.occlusion_test)?)
    };
    session.show(&runtime, &stop, pending(), |walk| cullers.beside(device, runtime.handle(), &stop, walk))
}
