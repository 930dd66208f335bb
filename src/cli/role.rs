//! `trimaran role`: one role of a deployment on several machines.

use std::{path::PathBuf, time::Duration};

use tokio::runtime::Runtime;
use trimaran::{
    config::{CullerConfig, DisplayConfig, PeerFile, RoleConfig, SessionConfig, Which, security},
    report::schema::Machine,
    vulkan::VulkanCuller,
    walkthrough::{CameraPath, PathChoice, Plan, Walk},
};
use trimaran_actors::{
    CullerIndex, CullerSession, PeerEndpoint, RoleError, SceneCulling, SessionError, SessionEvent, Turns,
    max_frame,
};
use trimaran_proto::{BatchSize, LodRule, Role, Settings, Viewport};
use trimaran_transport::{Endpoint, Net, Options, TokioNet, causes, sleep_until};

use super::{
    Failure,
    args::{RoleArgs, RoleCommand, RoleName},
    display::{DisplaySession, about, listen, role_info},
    recording::{check_trace, open_folder},
    walking::{self, Metrics, Start, gpu_options, not_joined, scene, upload},
};

/// How long the last links of a process may take to tell that they are gone.
const LETTING_GO: Duration = Duration::from_millis(50);

pub(super) fn run(command: &RoleCommand) -> Result<(), Failure> {
    match command {
        RoleCommand::Culler(args) => on_runtime(|runtime| culler(&load(args)?, runtime)),
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
        RoleName::Culler => CullerConfig::template(),
        RoleName::Display => DisplayConfig::template(),
    }
}

/// A culler, from start to close.
fn culler((config, options): &(CullerConfig, Options), runtime: &Runtime) -> Result<(), Failure> {
    let index = match config.index {
        Which::First => CullerIndex::First,
        Which::Second => CullerIndex::Second,
    };
    let peer = |endpoint: &Endpoint, name, role, peer: &Option<PathBuf>| {
        let peer = PeerFile { name, role: Some(role), path: peer.as_deref() };
        let known = security(options, &endpoint.clone().into(), config.keys.as_deref(), &[peer]);
        let options = Options { security: known.map_err(Failure::bad_input)?, ..options.clone() };
        Ok::<_, Failure>(PeerEndpoint { endpoint: endpoint.clone(), options })
    };
    let mut display = peer(&config.display, "peers.display", Role::Display, &config.peers.display)?;
    let mut other = peer(&config.pair, "peers.other", index.other().role(), &config.peers.other)?;
    let gpu = gpu_options(config.device.as_deref(), config.device_timeout_s);
    let start = Start::new(runtime, config.join_timeout_s, config.reconnect_s);
    let Some(file) = start.until(async || scene(&config.scene))? else { return Ok(()) };
    for peer in [&mut display, &mut other] {
        peer.options.link.max_frame = max_frame(&file.scene);
    }
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    let Some(mut metrics) = start.until(async || Metrics::show(config.metrics, runtime))? else {
        return Ok(());
    };
    let Start { net, stop, timeouts, .. } = start;
    let turns = Turns::at_once();
    let session = CullerSession {
        index,
        scene: file.scene.hash(),
        net,
        display,
        other,
        timeouts,
        turns: turns.clone(),
        work: |settings: &Settings| {
            let device = VulkanCuller::new(&drawn, settings.viewport, settings.occlusion_test);
            let device = device.map_err(RoleError::device("opening it"))?;
            Ok(SceneCulling::new(&file.scene, device, settings, &turns))
        },
        watch: |event: SessionEvent<'_>| match event {
            SessionEvent::Joined(joined) => {
                tracing::info!(settings = %joined.settings, "joined the session");
                metrics.watch([&joined.display, &joined.other]);
            }
            SessionEvent::Lost(error) => {
                let said = causes(error);
                eprintln!("trimaran: {said}; joining again for {} s", config.reconnect_s);
            }
        },
    };
    runtime.block_on(session.run(&stop)).map_err(|error| match error {
        SessionError::Join(error) => not_joined(error),
        error => Failure::broken(error),
    })
}

/// The display of a deployment: waits for the cullers, walks the path, writes the report.
fn display((config, options): &(DisplayConfig, Options), runtime: &Runtime) -> Result<(), Failure> {
    let plan = session_plan(&config.session)?;
    let choice = PathChoice::parse(&config.session.path, config.session.seed);
    let (first, second) = (config.peers.first.as_deref(), config.peers.second.as_deref());
    let peers = [
        PeerFile { name: "peers.first", role: Some(CullerIndex::First.role()), path: first },
        PeerFile { name: "peers.second", role: Some(CullerIndex::Second.role()), path: second },
    ];
    let known = security(options, &config.listen, config.keys.as_deref(), &peers);
    let mut options = Options { security: known.map_err(Failure::bad_input)?, ..options.clone() };
    check_trace(config.record.as_deref())?;
    let gpu = gpu_options(config.device.as_deref(), config.device_timeout_s);
    let start = Start::new(runtime, config.join_timeout_s, config.reconnect_s);
    let Some(folder) = start.until(async || open_folder(&config.out))? else { return Ok(()) };
    let Some(file) = start.until(async || scene(&config.scene))? else { return Ok(()) };
    options.link.max_frame = max_frame(&file.scene);
    let path = CameraPath::find(&choice, &file.scene, plan.viewport, config.session.frames)
        .map_err(Failure::bad_input)?;
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    let Some(metrics) = start.until(async || Metrics::show(config.metrics, runtime))? else { return Ok(()) };
    let walk = Walk { file: &file, drawn: &drawn, plan: &plan, path: &path };
    let listening = || listen(walk, &start.net, &config.listen, &options);
    let Some(listener) = start.until(listening)? else { return Ok(()) };
    eprintln!("trimaran: the display listens on {}", listener.local_endpoints());
    let roles = vec![role_info(Machine::Display, &drawn)];
    let session = DisplaySession {
        walk,
        about: about(walk, &config.session.path, config.session.seed, roles),
        folder: Some(folder),
        timeouts: start.timeouts,
        metrics,
        trace: config.record.clone(),
        net: start.net,
        endpoints: listener.local_endpoints().clone(),
        listener: Some(listener),
        options,
        turns: Turns::at_once(),
    };
    match session.show_to_others(runtime, &start.stop) {
        // A service that waits is stopped as any other.
        Err(failure) if failure.is_stop() => Ok(()),
        shown => shown?.conclude(&config.out, false),
    }
}

/// What the configuration asks for.
fn session_plan(session: &SessionConfig) -> Result<Plan, Failure> {
    Ok(Plan {
        viewport: Viewport::new(session.width, session.height).map_err(Failure::bad_input)?,
        lod: LodRule::new(session.epsilon_px)
            .map_err(Failure::bad_input)?
            .stopping_at_few_pixels(session.few_pixels),
        batch: BatchSize::new(session.batch.into()).map_err(Failure::bad_input)?,
        coding: session.coding.parse().map_err(Failure::bad_input)?,
        occlusion_test: session.occlusion_test.parse().map_err(Failure::bad_input)?,
        pace: walking::pace(session.live_hz),
        audit_every: session.audit_every,
        visible: session.visible,
        alone: false,
    })
}
