//! How long a picture stands still when a culler is lost: real processes, real signals, a live walk.
//!
//! `cargo bench --bench faults -- X.scene [TRIALS] [CULLERS]`: for each fault so many trials, 50 if not
//! given, on a display with so many cullers, 2 if not given. Pictures after a fault are held against those
//! without culling. With `FAULT=Killed` in the environment it is that fault alone.
//!
//! Pulling cables needs root, as do stopped threads of a driver that draws on the CPU.
#![allow(clippy::disallowed_methods, reason = "real programs keep real time")]

use std::{
    collections::BTreeSet,
    env,
    error::Error,
    fs,
    net::TcpListener,
    path::PathBuf,
    process::{Child, Command, Stdio},
    sync::Arc,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

use nix::{
    sys::{
        ptrace,
        wait::{WaitPidFlag, waitpid},
    },
    unistd::Pid,
};
use tokio::runtime::Builder;
use trimaran::{
    netem::Emulation,
    report::Frame,
    vulkan::{VulkanCuller, VulkanDisplay},
    walkthrough::{Auditor, CameraPath, FrameRecord, Pace, PathChoice, Plan, Recorder, SceneOnDevices},
};
use trimaran_actors::{
    CullerId, DisplayRole, PeerEndpoint, Peers, PeersConfig, SceneCulling, ScenePictures, Stop, Stopwatch,
    Turns, max_frame,
};
use trimaran_cull::{LodRule, Viewport};
use trimaran_gpu::GpuOptions;
use trimaran_netsim::Profile;
use trimaran_proto::{Identity, Role, SessionKey, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Net, Options, TokioNet};

type Failed = Box<dyn Error + Send + Sync>;

/// Poses of the path a second.
const HZ: f64 = 30.0;
/// How many trials a walk has; between them the culler is brought back.
const TRIALS_A_WALK: usize = 10;
/// From a fault to its repair, and from there to the next fault.
const FAULTY: Duration = Duration::from_millis(700);
const SOUND: Duration = Duration::from_millis(1500);
const SIDE: u32 = 512;
/// How many pictures after a fault are held against those without culling.
const AUDITED: usize = 6;

/// A culler's fault.
#[derive(Debug, Clone, Copy)]
enum Fault {
    /// Its process is killed, and started again later.
    Killed,
    /// Its process is stopped, and goes on later.
    Stopped,
    /// Its device makes no progress, and goes on later; the rest of the process lives.
    DeviceHung,
    /// Its cable is pulled, and put back later.
    Unplugged,
    /// All of them are killed.
    AllKilled,
}

/// A culler's process.
struct Culler {
    child: Child,
    endpoint: Endpoint,
    scene: PathBuf,
    /// The network namespace that it is in, if it has one of its own.
    place: Option<String>,
}

impl Culler {
    fn start(scene: &PathBuf, endpoint: &Endpoint, place: Option<String>) -> Result<Self, Failed> {
        let program = env!("CARGO_BIN_EXE_trimaran");
        let mut command = match &place {
            Some(place) => {
                let mut inside = Command::new("ip");
                inside.args(["netns", "exec", place, program]);
                inside
            }
            None => Command::new(program),
        };
        command.args(["role", "culler", "--listen", &endpoint.to_string(), "--scene"]).arg(scene);
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
        Ok(Self { child, endpoint: endpoint.clone(), scene: scene.clone(), place })
    }

    fn signal(&self, name: &str) -> Result<(), Failed> {
        let kill = format!("kill -{name} {}", self.child.id());
        if Command::new("sh").args(["-c", &kill]).status()?.success() { Ok(()) } else { Err(kill.into()) }
    }

    fn kill(&mut self) -> Result<(), Failed> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(())
    }

    fn again(&mut self) -> Result<(), Failed> {
        *self = Self::start(&self.scene, &self.endpoint, self.place.clone())?;
        Ok(())
    }

    /// Takes its machine off the network, or puts it back.
    fn cable(&self, state: &str) -> Result<(), Failed> {
        let place = self.place.as_deref().ok_or("it has no machine of its own")?;
        let done = Command::new("ip").args(["-n", place, "link", "set", "net0", state]).status()?;
        if done.success() { Ok(()) } else { Err(format!("cannot set the link of {place} {state}").into()) }
    }

    /// The threads on which Mesa's CPU driver draws.
    fn drawing_threads(&self) -> Result<Vec<Pid>, Failed> {
        let mut threads = Vec::new();
        for thread in fs::read_dir(format!("/proc/{}/task", self.child.id()))? {
            let path = thread?.path();
            if fs::read_to_string(path.join("comm"))?.starts_with("llvmpipe") {
                let id =
                    path.file_name().and_then(|name| name.to_str()).ok_or("a thread without a number")?;
                threads.push(Pid::from_raw(id.parse()?));
            }
        }
        if threads.is_empty() {
            Err("no thread of a driver that draws on the CPU".into())
        } else {
            Ok(threads)
        }
    }

    /// Stops these threads. Only the thread that did so can let them go on.
    fn hang(&self) -> Result<(), Failed> {
        for thread in self.drawing_threads()? {
            ptrace::seize(thread, ptrace::Options::empty())?;
            ptrace::interrupt(thread)?;
            waitpid(thread, Some(WaitPidFlag::__WALL))?;
        }
        Ok(())
    }

    fn go_on(&self) -> Result<(), Failed> {
        Ok(self.drawing_threads()?.into_iter().try_for_each(|thread| ptrace::detach(thread, None))?)
    }
}

impl Drop for Culler {
    fn drop(&mut self) {
        let _gone = self.kill();
    }
}

/// A walk: its frames, and when faults happened, on one clock.
struct Walked {
    frames: Vec<FrameRecord>,
    faults: Vec<Duration>,
}

fn main() -> Result<(), Failed> {
    // `cargo bench` adds a flag of its own.
    let mut args = env::args().skip(1).filter(|arg| !arg.starts_with("--"));
    let Some(file) = args.next() else {
        println!("skipped: give a cooked scene: cargo bench --bench faults -- X.scene [TRIALS] [CULLERS]");
        return Ok(());
    };
    let file = std::path::absolute(file)?;
    let trials: usize = args.next().map_or(Ok(50), |text| text.parse())?;
    let cullers: usize = args.next().map_or(Ok(2), |text| text.parse())?;
    let scene = Arc::new(Scene::open(&file)?);
    let devices = SceneOnDevices::open(&scene, 0, &GpuOptions::default())?;
    let plan = plan()?;
    println!(
        "| fault | trials | to the next picture, ms: p50, max | longest pause after it, ms: p50, max | usual frame, ms: p50, p99 | wrong pixels, in frames | out of order |"
    );
    println!("|---|---|---|---|---|---|---|");
    let all = [Fault::Killed, Fault::Stopped, Fault::DeviceHung, Fault::Unplugged, Fault::AllKilled];
    let asked = env::var("FAULT").unwrap_or_default();
    for fault in all.into_iter().filter(|fault| format!("{fault:?}").contains(&asked)) {
        let (mut next, mut pauses, mut usual) = (Vec::new(), Vec::new(), Vec::new());
        let (mut wrong, mut audited, mut disorder) = (0, 0, 0);
        while next.len() < trials {
            let walked = walk_on_machines(&file, &devices, &plan, cullers, fault)?;
            for at in &walked.faults {
                let after = |span: Duration| {
                    let shown = walked.frames.iter().map(|frame| frame.shown).filter(|shown| shown > at);
                    shown.take_while(|shown| *shown < *at + span).collect::<Vec<_>>()
                };
                let second = after(FAULTY);
                let Some(first) = second.first() else {
                    return Err("no picture until the fault is over".into());
                };
                next.push(first.saturating_sub(*at));
                let starts = std::iter::once(at).chain(&second);
                pauses.extend(starts.zip(&second).map(|(a, b)| b.saturating_sub(*a)).max());
            }
            let shown = walked.frames.windows(2);
            usual.extend(shown.map(|pair| pair[1].shown.saturating_sub(pair[0].shown)));
            disorder += disorders(&walked.frames);
            let (pixels, frames) = audit(&devices, &plan, &walked)?;
            (wrong, audited) = (wrong + pixels, audited + frames);
        }
        let [next, pauses, usual] = [next, pauses, usual].map(sorted);
        println!(
            "| {fault:?} | {} | {}, {} | {}, {} | {}, {} | {wrong} in {audited} | {disorder} |",
            next.len(),
            ms(&next, 0.5),
            ms(&next, 1.0),
            ms(&pauses, 0.5),
            ms(&pauses, 1.0),
            ms(&usual, 0.5),
            ms(&usual, 0.99),
        );
    }
    Ok(())
}

fn plan() -> Result<Plan, Failed> {
    let settings = Settings::new(Viewport::new(SIDE, SIDE)?, LodRule::new(2.0)?);
    Ok(Plan { pace: Pace::Live { hz: HZ }, ..Plan::new(settings) })
}

/// Walks live while cullers fail and come back, each on a machine of its own where a cable is to be pulled.
fn walk_on_machines(
    file: &PathBuf,
    devices: &SceneOnDevices,
    plan: &Plan,
    count: usize,
    fault: Fault,
) -> Result<Walked, Failed> {
    let emulation = if matches!(fault, Fault::Unplugged) { Some(machines(count)?) } else { None };
    let mut places = Vec::new();
    for (host, namespace) in emulation.iter().flat_map(Emulation::machines).take(count) {
        places.push((format!("tcp://{}:7400", host.v4()).parse()?, Some(namespace.name().to_owned())));
    }
    while places.len() < count {
        places.push((free_endpoint()?, None));
    }
    // On a thread of its own, which stays in the display's namespace.
    let display = emulation.as_ref().and_then(|emulation| emulation.machines().last());
    let walked = thread::scope(|scope| {
        let walk = scope.spawn(move || {
            display.map_or(Ok(()), |(_, namespace)| namespace.enter())?;
            walk(file, devices, plan, &places, fault)
        });
        walk.join().map_err(|_| "the display panicked")?
    });
    if let Some(emulation) = emulation {
        emulation.finish()?;
    }
    walked
}

/// So many cullers and a display on a network that takes no time to speak of.
fn machines(cullers: usize) -> Result<Emulation, Failed> {
    let name = |index| format!("trimaran-faults-{index}-{}", std::process::id());
    let lan = "about = \"a cable\"\nsources = []\n[up]\ndelay = \"0.1ms\"\n";
    let names: Vec<_> = (0..=cullers).map(name).collect();
    Ok(Emulation::start(&Profile::parse("cable", lan)?, &names, 1)?)
}

/// Walks live while cullers fail and come back.
fn walk(
    file: &PathBuf,
    devices: &SceneOnDevices,
    plan: &Plan,
    places: &[(Endpoint, Option<String>)],
    fault: Fault,
) -> Result<Walked, Failed> {
    let seconds = (FAULTY + SOUND).as_secs_f64() * (TRIALS_A_WALK as f64 + 1.0);
    let path = CameraPath::find(
        &PathChoice::Auto { seed: 1 },
        &devices.scene,
        plan.settings().into(),
        Some((seconds * HZ) as u32),
    )?;
    let start = |(endpoint, place): &(Endpoint, Option<String>)| Culler::start(file, endpoint, place.clone());
    let mut cullers = places.iter().map(start).collect::<Result<Vec<_>, _>>()?;
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let (settings, turns, key) = (plan.settings(), Turns::at_once(), SessionKey(net.random()?));
    let mut options = Options::default();
    options.link.max_frame = max_frame(&devices.scene);
    let peer = |culler: &Culler| PeerEndpoint { endpoint: culler.endpoint.clone(), options: options.clone() };
    let sought = PeersConfig {
        identity: Identity {
            role: Role::Display,
            scene: Some(devices.scene.outline()),
            session: Some((key, settings)),
        },
        role: Role::Culler,
        endpoints: cullers.iter().map(peer).collect(),
        listener: None,
        most: CullerId::MOST,
    };
    let culler = VulkanCuller::new(&devices.display, plan.viewport, plan.occlusion_test)?;
    let display = VulkanDisplay::new(&devices.display, plan.viewport)?;
    let work = ScenePictures::new(&devices.scene, display, &settings);
    let (peers, drawables) = (Peers::seek(&net, sought), max_frame(&devices.scene));
    let role = DisplayRole {
        alone: Some(SceneCulling::new(&devices.scene, culler, &settings, &turns)),
        schedule: plan.schedule,
        pace: plan.frames(path.frames()),
        join_timeout: Duration::from_secs(60),
        turns: turns.clone(),
        ..DisplayRole::new(work, peers, key, settings, drawables, &net)
    };
    let began = AtomicBool::new(false);
    let mut advance = |_| began.store(true, Ordering::Relaxed);
    let mut recorder = Recorder::new(0, &mut advance);
    let (_stopper, stop) = Stop::new();
    let faults = thread::scope(|scope| {
        let clock = turns.clock();
        let (cullers, began) = (&mut cullers, &began);
        let breaking = scope.spawn(move || break_cullers(cullers, fault, clock, began));
        runtime.block_on(role.run(&mut *path.cameras(plan.pace, Duration::ZERO), &mut recorder, &stop))?;
        breaking.join().map_err(|_| "the thread that breaks cullers panicked")?
    })?;
    Ok(Walked { frames: recorder.into_frames(), faults })
}

/// Breaks a culler and mends it again, so many times; says when it broke.
fn break_cullers(
    cullers: &mut [Culler],
    fault: Fault,
    clock: Stopwatch,
    began: &AtomicBool,
) -> Result<Vec<Duration>, Failed> {
    while !began.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(1));
    }
    let mut faults = Vec::new();
    for trial in 0..TRIALS_A_WALK {
        // At another moment within a frame each time.
        thread::sleep(SOUND + Duration::from_micros(7919 * trial as u64));
        let count = cullers.len().max(1);
        let Some(culler) = cullers.get_mut(trial % count) else { break };
        faults.push(clock.elapsed());
        match fault {
            Fault::Killed => culler.kill()?,
            Fault::Stopped => culler.signal("STOP")?,
            Fault::DeviceHung => culler.hang()?,
            Fault::Unplugged => culler.cable("down")?,
            Fault::AllKilled => cullers.iter_mut().try_for_each(Culler::kill)?,
        }
        thread::sleep(FAULTY);
        let Some(culler) = cullers.get_mut(trial % count) else { break };
        match fault {
            Fault::Killed => culler.again()?,
            Fault::Stopped => culler.signal("CONT")?,
            Fault::DeviceHung => culler.go_on()?,
            Fault::Unplugged => culler.cable("up")?,
            Fault::AllKilled => cullers.iter_mut().try_for_each(Culler::again)?,
        }
    }
    Ok(faults)
}

/// How many frames were shown out of order, or have a pose that is older than that of the frame before.
fn disorders(frames: &[FrameRecord]) -> usize {
    let numbers = frames.iter().zip(0..).filter(|(frame, number)| frame.camera.frame().0 != *number).count();
    let poses = frames.windows(2).filter(|pair| pair[1].published < pair[0].published).count();
    numbers + poses
}

/// How many pixels differ from the pictures without culling, and in how many frames that was looked at: the
/// first ones after each fault, and some others.
fn audit(devices: &SceneOnDevices, plan: &Plan, walked: &Walked) -> Result<(u64, usize), Failed> {
    let Walked { frames, faults } = walked;
    let after = |at: &Duration| frames.partition_point(|frame| frame.shown <= *at);
    let first = faults.iter().map(after).flat_map(|first| first..first + AUDITED);
    let looked_at: BTreeSet<_> = first.chain((0..frames.len()).step_by(100)).collect();
    let mut auditor = Auditor::new(&devices.scene, &devices.display, plan.settings())?;
    let mut machine = VulkanCuller::new(&devices.display, plan.viewport, plan.occlusion_test)?;
    let (mut wrong, mut audited) = (0, 0);
    for index in looked_at {
        let Some(walk) = frames.get(..=index) else { break };
        let mut frame = Frame::default();
        auditor.audit(Some(&mut machine), walk, false, &mut frame, &mut Default::default())?;
        let pixels = frame.cut_mismatch_pixels.unwrap_or(0);
        if let Some(record) = walk.last().filter(|_| pixels > 0) {
            let FrameRecord { camera, culler, stats, .. } = record;
            eprintln!("{pixels} wrong: {:?} of {culler:?}, {camera:?}, {stats:?}", frame.false_culls);
        }
        wrong += pixels;
        audited += 1;
    }
    Ok((wrong, audited))
}

fn free_endpoint() -> Result<Endpoint, Failed> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    Ok(format!("tcp://{}", listener.local_addr()?).parse()?)
}

fn sorted(mut times: Vec<Duration>) -> Vec<Duration> {
    times.sort_unstable();
    times
}

/// The time that this share of `sorted` does not exceed, milliseconds.
fn ms(sorted: &[Duration], share: f64) -> String {
    let place = (share * sorted.len() as f64).ceil() as usize;
    let time = sorted.get(place.saturating_sub(1)).copied().unwrap_or_default();
    format!("{:.0}", time.as_secs_f64() * 1e3)
}
