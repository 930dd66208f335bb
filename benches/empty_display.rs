//! How soon a display that begins without the scene shows exact pictures, and what that takes: by network and
//! transport, in the simulator's time. Computing takes no time there, so all of it is the network's.
//!
//! `cargo bench --bench empty_display -- X.scene [FRAMES [EPSILON]]`: a walk of 120 frames at 2 px, if not
//! given. *Coarse* and *exact* are from the moment at which the display begins to connect to a picture that may
//! lack something, and to one that does not, over 16 views with an empty display each. *Jump* is from the camera to the picture, where one display jumps from view to view. *Walk*
//! is an automatic walk without a jump, at 30 frames a second.
#![allow(clippy::disallowed_methods, reason = "keys are drawn at random")]

use std::{cell::RefCell, error::Error, path::Path, pin::pin, sync::Arc, time::Duration};

use trimaran::vulkan::{VulkanCuller, VulkanDisplay};
use trimaran_actors::{
    BoxedError, Cameras, CullerEvent, CullerId, CullerService, DisplayRole, Observer, Pace, PeerEndpoint,
    Peers, RoleError, SceneCulling, ScenePictures, Schedule, ServiceEndpoints, ShownFrame, Sought, Stop,
    Supplied, Turns, WhileLoading, max_frame,
};
use trimaran_cull::{LodRule, Viewport};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene};
use trimaran_netsim::{Profile, Simulation};
use trimaran_proto::{Camera, FrameNumber, Identity, OcclusionTestKind, Role, SessionKey, Settings};
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, Pose, auto},
};
use trimaran_transport::{
    Endpoint, Net, Options, StatsHandle,
    keys::{Keys, Security},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

const SIDE: u32 = 1024;
/// Views that the display is begun with.
const VIEWS: usize = 16;
/// Frames a second of a walk, for its rate.
const HZ: f64 = 30.0;
/// Bytes of geometry that a display keeps.
const CACHE: u64 = 256 << 20;

/// Networks: a name, and bits a second, milliseconds each way and the share of packets that is lost.
const NETWORKS: [(&str, &str, &str, &str); 4] = [
    ("1 Gbit/s, 0.1 ms", "1 Gbit/s", "100us", "0"),
    ("100 Mbit/s, 20 ms", "100 Mbit/s", "20ms", "0"),
    ("100 Mbit/s, 20 ms, 1 % lost", "100 Mbit/s", "20ms", "0.01"),
    ("20 Mbit/s, 40 ms", "20 Mbit/s", "40ms", "0"),
];

fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let [scene, rest @ ..] = words.as_slice() else {
        println!(
            "skipped: give a cooked scene: cargo bench --bench empty_display -- X.scene [FRAMES [EPSILON]]"
        );
        return Ok(());
    };
    let frames = rest.first().map_or(Ok(120), |word| word.parse())?;
    let epsilon = rest.get(1).map_or(Ok(2.0), |word| word.parse())?;
    let bench = Bench::new(Path::new(scene), frames, epsilon)?;
    println!(
        "| network | transport | coarse: median, max, MB | exact: median, max, MB | jump: median, max | \
         walk: median, p95, MB, Mbit/s |"
    );
    println!("|---|---|---|---|---|---|");
    for (name, rate, delay, loss) in NETWORKS {
        for scheme in ["tcp", "quic", "udp"] {
            let network = profile(rate, delay, loss)?;
            let (mut any, mut first) = (Vec::new(), Vec::new());
            let (mut any_bytes, mut bytes) = (0, 0);
            // A seed for each: lost packets are others each time.
            for (seed, view) in (1..).zip(&bench.views) {
                let seen = bench.walk(&network, scheme, seed, std::slice::from_ref(view), Pace::Live)?;
                any.extend(seen.shown.first().map(|shown| shown.at_ms));
                first.extend(seen.shown.last().map(|shown| shown.at_ms));
                any_bytes += seen.first_bytes;
                bytes += seen.bytes;
            }
            let lockstep = |cameras: &[Camera]| Pace::Lockstep { frames: Some(cameras.len() as u32) };
            let jumps = bench.walk(&network, scheme, 1, &bench.views, lockstep(&bench.views))?;
            // The first one is no jump.
            let jumped: Vec<_> = jumps.latencies().skip(1).collect();
            let walk = bench.walk(&network, scheme, 1, &bench.path, lockstep(&bench.path))?;
            let later: Vec<_> = walk.latencies().skip(1).collect();
            println!(
                "| {name} | {scheme} | {:.0} ms, {:.0} ms, {:.2} | {:.0} ms, {:.0} ms, {:.2} \
                 | {:.0} ms, {:.0} ms | {:.0} ms, {:.0} ms, {:.2}, {:.2} |",
                share(&any, 0.5),
                share(&any, 1.0),
                any_bytes as f64 / 1e6 / bench.views.len() as f64,
                share(&first, 0.5),
                share(&first, 1.0),
                bytes as f64 / 1e6 / bench.views.len() as f64,
                share(&jumped, 0.5),
                share(&jumped, 1.0),
                share(&later, 0.5),
                share(&later, 0.95),
                walk.bytes as f64 / 1e6,
                8e-6 * (walk.bytes - walk.first_bytes) as f64 * HZ / (walk.shown.len() - 1) as f64,
            );
        }
    }
    Ok(())
}

struct Bench {
    scene: Arc<Scene>,
    drawn: Arc<GpuScene>,
    display: Arc<Gpu>,
    settings: Settings,
    path: Vec<Camera>,
    views: Vec<Camera>,
}

impl Bench {
    fn new(scene: &Path, frames: u32, epsilon: f64) -> Outcome<Self> {
        let scene = Arc::new(Scene::open(scene)?);
        let drawn = GpuScene::new(&Gpu::open(&GpuOptions::default())?, &scene)?;
        let find = |seed, frames, teleport| {
            let options = AutoPathOptions { frames, seed, teleport, ..AutoPathOptions::default() };
            Ok::<_, Box<dyn Error>>(auto(&scene, &options)?.path)
        };
        let walk = find(1, frames, false)?;
        let near = walk.near().unwrap_or(0.1);
        let camera = |pose: &Pose| pose.camera(walk.vfov_deg(), near, FrameNumber(0));
        let path = walk.frames().iter().map(camera).collect::<Result<Vec<_>, _>>()?;
        // The first pose of a walk, and that behind its jump.
        let mut views = Vec::new();
        for seed in 2..2 + VIEWS as u64 / 2 {
            views.extend(find(seed, 2, true)?.frames().iter().map(camera).collect::<Result<Vec<_>, _>>()?);
        }
        Ok(Self {
            scene,
            drawn,
            display: Gpu::open(&GpuOptions::default())?,
            settings: Settings::new(Viewport::new(SIDE, SIDE)?, LodRule::new(epsilon)?),
            path,
            views,
        })
    }

    /// What a display that begins empty shows of these cameras, one frame each; live, it ends with the first
    /// picture that lacks nothing.
    fn walk(
        &self,
        network: &Profile,
        scheme: &str,
        seed: u64,
        cameras: &[Camera],
        pace: Pace,
    ) -> Outcome<Seen> {
        let (topology, machines) = network.topology(1);
        let simulation = Simulation::new(&topology, seed);
        let (listener, host) = (Arc::new(simulation.net(machines.cullers[0])), machines.cullers[0]);
        let (listener, net): (Arc<dyn Net>, Arc<dyn Net>) =
            (listener, Arc::new(simulation.net(machines.display)));
        let [ours, theirs] = acquainted(max_frame(&self.scene))?;
        let at = format!("{scheme}://{}:7400", host.v4()).parse()?;
        let turns = Turns::at_once();
        let supplied = Supplied {
            scene: Arc::new(Scene::empty(self.scene.outline())),
            memory: CACHE,
            while_loading: WhileLoading::default(),
        };
        let shown_on = GpuScene::new(&self.display, &supplied.scene)?;
        let pictures = VulkanDisplay::new(&shown_on, self.settings.viewport)?;
        let sought = Sought {
            identity: Identity {
                role: Role::Display,
                scene: None,
                session: Some((SessionKey(1), self.settings)),
            },
            role: Role::Culler,
            endpoints: vec![PeerEndpoint { endpoint: at, options: ours }],
            listener: None,
            most: CullerId::MOST,
        };
        let (_stopper, stop) = Stop::new();
        let culling = async {
            let at = format!("{scheme}://0.0.0.0:7400").parse::<Endpoint>()?;
            let at = ServiceEndpoints { listen: Some(at.into()), displays: Vec::new(), options: theirs };
            let mut service = CullerService::start(&listener, self.scene.outline(), at).await?;
            let session = service.next().await?;
            let work = |settings: &Settings| {
                let culler = VulkanCuller::new(&self.drawn, settings.viewport, OcclusionTestKind::Hzb);
                let culler = culler.map_err(RoleError::device("opening it"))?;
                Ok(SceneCulling::new(&self.scene, culler, settings, &turns))
            };
            session.play(work, &turns, max_frame(&self.scene), Some(&self.scene), &stop).await?;
            Ok::<_, Box<dyn Error>>(())
        };
        let seen = RefCell::new(Seen::default());
        let showing = async {
            let role = DisplayRole {
                work: ScenePictures::new(&supplied.scene, pictures, &self.settings),
                alone: None::<SceneCulling<VulkanCuller>>,
                supplied: Some(supplied.clone()),
                cullers: Peers::seek(&net, sought),
                session: SessionKey(1),
                settings: self.settings,
                schedule: Schedule::Independent,
                pace,
                first: FrameNumber(0),
                join_timeout: Duration::from_secs(30),
                drawables: max_frame(&self.scene),
                net: Arc::clone(&net),
                turns: turns.clone(),
            };
            let mut watch = Watch { net: &net, seen: &seen };
            let mut hand_out = HandOut { net: &net, seen: &seen, cameras, is_live: pace == Pace::Live };
            role.run(&mut hand_out, &mut watch, &stop).await
        };
        let (culled, shown) = simulation.run(async {
            let (mut culling, mut showing) = (pin!(culling), pin!(showing));
            tokio::join!(&mut culling, &mut showing)
        })?;
        shown?;
        culled?;
        Ok(seen.into_inner())
    }
}

/// What was shown, in the simulator's time.
#[derive(Default)]
struct Seen {
    /// When each frame's camera was handed out, nanoseconds.
    handed_out: Vec<u64>,
    shown: Vec<Shown>,
    /// Bytes of geometry, of all frames and until the first.
    bytes: u64,
    first_bytes: u64,
    link: Option<StatsHandle>,
}

#[derive(Clone, Copy)]
struct Shown {
    frame: u32,
    /// Milliseconds.
    at_ms: f64,
    is_exact: bool,
}

impl Seen {
    /// From handing a camera out, or showing the frame before if that was later, to the picture: ms.
    fn latencies(&self) -> impl Iterator<Item = f64> + '_ {
        let before = std::iter::once(0.0).chain(self.shown.iter().map(|shown| shown.at_ms));
        self.shown.iter().zip(before).map(|(shown, before)| {
            let handed_out = self.handed_out.get(shown.frame as usize).map_or(0.0, |at| *at as f64 * 1e-6);
            shown.at_ms - handed_out.max(before)
        })
    }
}

/// Hands out these cameras, in lockstep one a frame, live the first one alone.
struct HandOut<'w> {
    net: &'w Arc<dyn Net>,
    seen: &'w RefCell<Seen>,
    cameras: &'w [Camera],
    is_live: bool,
}

impl Cameras for HandOut<'_> {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.seen.borrow_mut().handed_out.push(self.net.now().as_nanos());
        self.cameras[if self.is_live { 0 } else { frame.0 as usize }].for_frame(frame)
    }

    fn is_over(&self) -> bool {
        self.seen.borrow().shown.last().is_some_and(|shown| shown.is_exact)
    }
}

struct Watch<'w> {
    net: &'w Arc<dyn Net>,
    seen: &'w RefCell<Seen>,
}

impl Observer for Watch<'_> {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        let mut seen = self.seen.borrow_mut();
        let at_ms = self.net.now().as_nanos() as f64 * 1e-6;
        seen.shown.push(Shown { frame: frame.camera.frame().0, at_ms, is_exact: frame.lacking == 0 });
        seen.bytes = seen.link.as_ref().map_or(0, |link| link.read().received.bulk.bytes);
        if seen.shown.len() == 1 {
            seen.first_bytes = seen.bytes;
        }
        Ok(())
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        if let CullerEvent::Came(_, link) = event {
            self.seen.borrow_mut().link = Some(link.stats.clone());
        }
    }
}

/// A network of these properties between a culler and a display.
fn profile(rate: &str, delay: &str, loss: &str) -> Outcome<Profile> {
    let text = format!(
        "about = \"a line\"\nsources = [\"assumed\"]\n[up]\nrate = \"{rate}\"\ndelay = \"1us\"\n[wan]\n\
         rate = \"{rate}\"\ndelay = \"{delay}\"\nloss = {{ independent = {loss} }}\n"
    );
    Ok(Profile::parse("line", &text)?)
}

/// Options of a display and a culler that know each other.
fn acquainted(max_frame: u32) -> Outcome<[Options; 2]> {
    let (ours, theirs) = (Keys::generate("display".parse()?)?, Keys::generate("culler".parse()?)?);
    let knowing = |keys: &Keys, other: &Keys| {
        let security = Some(Security { keys: keys.clone(), peers: vec![other.public().clone().into()] });
        let mut options = Options { security, ..Options::default() };
        options.link.max_frame = max_frame;
        options
    };
    Ok([knowing(&ours, &theirs), knowing(&theirs, &ours)])
}

/// The value that this share of the values does not exceed.
fn share(values: &[f64], share: f64) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let place = (share * values.len() as f64).ceil() as usize;
    values.get(place.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}
