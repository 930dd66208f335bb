//! Whole sessions of three roles, in this process and over TCP on loopback.

use std::{sync::Arc, thread, time::Duration};

use tokio::runtime::{Builder, Runtime};
use trimaran::vulkan::{VulkanCuller, VulkanDisplay};
use trimaran::walkthrough::{CameraPath, FrameRecord, PathChoice, Plan, Recorder, Stage, in_process};
use trimaran_actors::{
    CullerDevice, CullerIndex, CullerRole, Devices, DisplayRole, Joined, Listener, OccluderPolicy,
    PeerEndpoint, Stop, Stopwatch, Turns, await_cullers, join_session,
};
use trimaran_cull::{LodRule, View, lod_cut};
use trimaran_proto::{Identity, Role};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Net, Options, TokioNet};

use super::ports::unused_port;

/// A scene on three devices, or `None` where there is no device and none is required.
pub(crate) fn stage(scene: &Arc<Scene>) -> Option<Stage> {
    super::unless_required(Stage::set(scene, &super::options()))
}

/// The first `frames` cameras of a path.
pub(crate) fn trail(stage: &Stage, plan: &Plan, path: &PathChoice, frames: u32) -> CameraPath {
    CameraPath::find(path, &stage.scene, plan.size, Some(frames)).unwrap()
}

/// Walks with the three roles in this process; every picture is read back.
pub(crate) fn walk_in_process(stage: &Stage, plan: &Plan, trail: &CameraPath) -> Vec<FrameRecord> {
    let (runtime, (_stopper, stop)) = (runtime(), Stop::new());
    let mut quiet = |_| {};
    let mut recorder = Recorder::new(1, &mut quiet);
    in_process(stage, plan, trail, &mut recorder, runtime.handle(), &stop).unwrap();
    recorder.into_frames()
}

/// The same with a pair of other devices.
pub(crate) fn walk_with<P: CullerDevice + Send>(
    stage: &Stage,
    plan: &Plan,
    trail: &CameraPath,
    [first, second]: [P; 2],
) -> Vec<FrameRecord> {
    let (runtime, (_stopper, stop)) = (runtime(), Stop::new());
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let display = VulkanDisplay::new(&stage.drawn[2], plan.size).unwrap();
    let mut quiet = |_| {};
    let mut recorder = Recorder::new(1, &mut quiet);
    let settings = plan.settings(trail.frames());
    let devices = Devices { first, second, display };
    trimaran_actors::in_process(
        &stage.scene,
        settings,
        devices,
        &mut trail.clone(),
        &mut recorder,
        &net,
        runtime.handle(),
        &stop,
        &Turns::at_once(),
    )
    .unwrap();
    recorder.into_frames()
}

/// The same session with the three roles joined over TCP on loopback, as separate processes are.
pub(crate) fn walk_over_tcp(stage: &Stage, plan: &Plan, trail: &CameraPath) -> Vec<FrameRecord> {
    let (runtime, (_stopper, stop)) = (runtime(), Stop::new());
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let deadline = net.now().after(Duration::from_secs(60));
    let settings = plan.settings(trail.frames());
    let scene = stage.scene.hash();
    let [first, second, display] = &stage.drawn;
    let identity = Identity { role: Role::Display, scene, settings: Some(settings) };
    let listener = runtime
        .block_on(Listener::bind(&net, &"tcp://127.0.0.1:0".parse().unwrap(), identity, &Options::default()))
        .unwrap();
    let address = listener.local_endpoint().clone();
    let pair: Endpoint = format!("tcp://127.0.0.1:{}", unused_port()).parse().unwrap();
    let mut quiet = |_| {};
    let mut recorder = Recorder::new(1, &mut quiet);
    thread::scope(|scope| {
        for (index, drawn) in [(CullerIndex::First, first), (CullerIndex::Second, second)] {
            let (address, pair, net, stop, runtime) = (&address, &pair, &net, &stop, &runtime);
            scope.spawn(move || {
                let place = |endpoint: &Endpoint| PeerEndpoint {
                    endpoint: endpoint.clone(),
                    options: Options::default(),
                };
                let (address, pair) = (place(address), place(pair));
                let joining = join_session(net, index, scene, &address, &pair, deadline);
                let Joined { display, other, settings } = runtime.block_on(joining).unwrap();
                assert_eq!(settings, plan.settings(trail.frames()));
                let device = VulkanCuller::new(drawn, plan.size, settings.tester).unwrap();
                let role = CullerRole {
                    index,
                    scene: Arc::clone(&stage.scene),
                    device,
                    display,
                    other,
                    settings,
                    occluders: OccluderPolicy::default(),
                    clock: Stopwatch::start(),
                    turns: Turns::at_once(),
                };
                role.run(runtime.handle(), stop).unwrap();
            });
        }
        let [first, second] = runtime.block_on(await_cullers(listener, deadline)).unwrap();
        let device = VulkanDisplay::new(display, plan.size).unwrap();
        let net = Arc::clone(&net);
        let (scene, clock, turns) = (Arc::clone(&stage.scene), Stopwatch::start(), Turns::at_once());
        let role = DisplayRole { scene, device, first, second, settings, net, clock, turns };
        role.run(&mut trail.clone(), &mut recorder, runtime.handle(), &stop).unwrap();
    });
    recorder.into_frames()
}

/// What a session must do the same way every time: the ids drawn and the picture's hash, a frame.
pub(crate) fn essence(records: &[FrameRecord]) -> Vec<(Vec<u32>, u64)> {
    records.iter().map(|r| (r.ids.iter().map(|id| id.0).collect(), r.picture.unwrap())).collect()
}

/// How many drawables the frame's level cut has before culling.
pub(crate) fn uncut_count(stage: &Stage, plan: &Plan, record: &FrameRecord) -> usize {
    let view = View::new(record.camera, plan.size);
    lod_cut(&stage.scene, &view, LodRule::new(plan.epsilon.pixels()).unwrap()).len()
}

/// Fails if the validation layer had anything to say.
pub(crate) fn assert_no_validation_messages(stage: &Stage) {
    for drawn in &stage.drawn {
        assert_eq!(drawn.gpu().validation_messages(), Vec::<String>::new());
    }
}

fn runtime() -> Runtime {
    Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}
