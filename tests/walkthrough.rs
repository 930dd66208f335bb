//! Whole sessions: three roles, real devices, a generated plant.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

use std::{sync::Arc, thread};

use tokio::runtime::{Builder, Runtime};
use trimaran::walkthrough::{FrameRecord, PathChoice, Plan, Recorder, Stage, Trail, in_process, viewport};
use trimaran_actors::{
    DisplayRole, Joined, PairRole, Seat, Stop, VulkanDisplay, VulkanPair, await_pair, join_session,
};
use trimaran_gpu::{GpuError, GpuOptions};
use trimaran_proto::{BatchSize, EpsilonPx, Identity, PictureSize, Role, TesterKind};
use trimaran_scene::{
    Scene,
    cook::{CookOptions, cook},
    generate::{PlantOptions, plant},
};
use trimaran_transport::{
    Net, TokioNet,
    tcp::{Listener, Options},
};

const FRAMES: u32 = 12;

fn plan(tester: TesterKind) -> Plan {
    Plan {
        size: PictureSize::new(233, 160).unwrap(),
        epsilon: EpsilonPx::new(2.0).unwrap(),
        batch: BatchSize::new(16).unwrap(),
        tester,
        audit_every: 1,
        visible: false,
    }
}

/// A plant on three devices, or `None` where there is no Vulkan loader and none is required.
fn stage() -> Option<Stage> {
    let model = plant(&PlantOptions { objects: 700, triangles: 70_000, ..PlantOptions::small(3) });
    let scene: Arc<Scene> = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
    match Stage::set(&scene, &GpuOptions { validation: true, ..GpuOptions::default() }) {
        Ok(stage) => Some(stage),
        Err(error) if std::env::var_os("TRIMARAN_REQUIRE_GPU").is_none() => {
            println!("skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn runtime() -> Runtime {
    Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}

fn trail(stage: &Stage, plan: &Plan) -> Trail {
    let size = viewport(plan.size).unwrap();
    Trail::find(&PathChoice::Auto { seed: 7 }, &stage.scene, size, Some(FRAMES)).unwrap()
}

/// What a session must do the same way every time.
fn essence(records: &[FrameRecord]) -> Vec<(Vec<u32>, u64)> {
    records.iter().map(|r| (r.ids.iter().map(|id| id.0).collect(), r.picture.unwrap())).collect()
}

fn walk_in_process(stage: &Stage, plan: &Plan) -> Vec<FrameRecord> {
    let (runtime, (_stopper, stop)) = (runtime(), Stop::new());
    let mut quiet = |_| {};
    let mut recorder = Recorder::new(1, &mut quiet);
    in_process(stage, plan, &mut trail(stage, plan), &mut recorder, runtime.handle(), &stop).unwrap();
    recorder.into_frames()
}

/// The same session with the three roles joined over TCP on loopback, as separate processes are.
fn walk_over_tcp(stage: &Stage, plan: &Plan) -> Vec<FrameRecord> {
    let (runtime, (_stopper, stop)) = (runtime(), Stop::new());
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let deadline = net.now().after(std::time::Duration::from_secs(60));
    let size = viewport(plan.size).unwrap();
    let settings = plan.settings(FRAMES);
    let scene = stage.scene.hash();
    let [first, second, display] = &stage.drawn;
    let identity = Identity { role: Role::Display, scene, settings: Some(settings) };
    let listener =
        runtime.block_on(Listener::bind(&net, "127.0.0.1:0", identity, &Options::default())).unwrap();
    let address = listener.local_addr().to_string();
    let pair = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut quiet = |_| {};
    let mut recorder = Recorder::new(1, &mut quiet);
    thread::scope(|scope| {
        for (seat, drawn) in [(Seat::First, first), (Seat::Second, second)] {
            let (address, pair, net, stop, runtime) = (&address, &pair, &net, &stop, &runtime);
            scope.spawn(move || {
                let options = Options::default();
                let joining = join_session(net, seat, scene, address, pair, &options, deadline);
                let Joined { display, other, settings } = runtime.block_on(joining).unwrap();
                assert_eq!(settings, plan.settings(FRAMES));
                let device = VulkanPair::new(drawn, size, settings.tester).unwrap();
                let role =
                    PairRole { seat, scene: Arc::clone(&stage.scene), device, display, other, settings };
                role.run(runtime.handle(), stop).unwrap();
            });
        }
        let [first, second] = runtime.block_on(await_pair(listener, deadline)).unwrap();
        let device = VulkanDisplay::new(display, size).unwrap();
        let role = DisplayRole { scene: Arc::clone(&stage.scene), device, first, second, settings };
        role.run(&mut trail(stage, plan), &mut recorder, runtime.handle(), &stop).unwrap();
    });
    recorder.into_frames()
}

fn assert_no_validation_messages(stage: &Stage) -> Result<(), GpuError> {
    for drawn in &stage.drawn {
        assert_eq!(drawn.gpu().validation_messages(), Vec::<String>::new());
    }
    Ok(())
}

#[test]
fn a_session_is_the_same_in_process_and_over_tcp() -> Result<(), GpuError> {
    let Some(stage) = stage() else { return Ok(()) };
    let plan = plan(TesterKind::Hzb);
    let inproc = walk_in_process(&stage, &plan);
    assert_eq!(inproc.len(), FRAMES as usize);
    assert!(inproc.iter().any(|record| record.ids.len() > 16), "no frame fills a batch");
    let again = walk_in_process(&stage, &plan);
    assert_eq!(essence(&inproc), essence(&again), "a session repeats itself");
    let tcp = walk_over_tcp(&stage, &plan);
    assert_eq!(essence(&inproc), essence(&tcp), "TCP shows what one process shows");
    assert_no_validation_messages(&stage)
}

#[test]
fn every_tester_shows_the_unculled_cut() -> Result<(), Box<dyn std::error::Error>> {
    let Some(stage) = stage() else { return Ok(()) };
    let mut pictures = Vec::new();
    for tester in TesterKind::ALL {
        let plan = plan(tester);
        let records = walk_in_process(&stage, &plan);
        let rule = trimaran_cull::CutRule::new(plan.epsilon.pixels())?;
        let [_, _, display] = &stage.drawn;
        let mut auditor =
            trimaran::walkthrough::Auditor::new(&stage.scene, display, viewport(plan.size)?, rule)?;
        for record in &records {
            let mut frame = trimaran::report::Frame::default();
            auditor.audit(record, false, &mut frame, &mut Default::default())?;
            assert_eq!(frame.false_culled_pixels, Some(0), "{tester}: {}", record.camera.frame());
            assert_eq!(frame.cut_mismatch_pixels, Some(0), "{tester}: {}", record.camera.frame());
            assert!(frame.nodes_exact.is_some_and(|exact| exact > 0), "something shows");
        }
        pictures.push(records.iter().map(|record| record.picture).collect::<Vec<_>>());
        let drawn: usize = records.iter().map(|record| record.ids.len()).sum();
        let cut: usize = records.iter().map(|r| uncut_count(&stage, &plan, r)).sum();
        assert!(drawn * 2 < cut, "{tester} drew {drawn} of {cut}: a plant hides more than half");
    }
    assert!(
        pictures.windows(2).all(|pair| pair[0] == pair[1]),
        "the testers differ in what they draw, not in what shows"
    );
    assert_no_validation_messages(&stage)?;
    Ok(())
}

fn uncut_count(stage: &Stage, plan: &Plan, record: &FrameRecord) -> usize {
    let view = trimaran_cull::View::new(record.camera, viewport(plan.size).unwrap());
    let rule = trimaran_cull::CutRule::new(plan.epsilon.pixels()).unwrap();
    trimaran_cull::level_cut(&stage.scene, &view, rule).len()
}
