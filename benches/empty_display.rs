//! How soon a display that begins without the scene shows exact pictures, and what that takes: by network and
//! transport, in the simulator's time. Computing takes no time there, so all of it is the network's.
//!
//! `cargo bench --bench empty_display -- X.scene [FRAMES [EPSILON]]`: a walk of 120 frames at 2 px, if not
//! given. *Coarse* and *exact* are from the moment at which the display begins to connect to a picture that
//! may lack something, and to one that does not, over 16 views with an empty display each. *Jump* is from
//! the camera to the exact picture, where one display jumps from view to view. *Walk* is an automatic walk
//! without a jump, at 30 poses and 60 pictures a second: from the camera to the picture, how many pictures
//! lacked something, what came after the first exact picture, and how much of what was sent ahead was used.
#![allow(clippy::disallowed_methods, reason = "keys are drawn at random")]

use std::{cell::RefCell, error::Error, path::Path, pin::pin, sync::Arc, time::Duration};

use trimaran::vulkan::{VulkanCuller, VulkanDisplay};
use trimaran_actors::{
    AheadUse, BoxedError, Cameras, CullerEvent, CullerId, CullerService, DisplayRole, DisplayWork, Observer,
    Pace, PeerEndpoint, Peers, PeersConfig, RoleError, SceneCulling, ScenePictures, ServiceEndpoints,
    SessionLimits, ShownFrame, Stop, Supplied, Turns, WhileLoading, max_frame,
};
use trimaran_cull::{Image, LodRule, Viewport};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene};
use trimaran_netsim::{Profile, Simulation};
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, Identity, OcclusionTestKind, Role, SessionKey, Settings,
};
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, Pose, auto},
};
use trimaran_transport::{
    Endpoint, Instant, Net, Options, StatsHandle,
    keys::{Keys, Security},
    sleep_until,
};

type Outcome<T> = Result<T, Box<dyn Error>>;

const SIDE: u32 = 1024;
/// Views that the display is begun with.
const VIEWS: usize = 16;
/// Frames a second of a walk, for its rate.
const HZ: f64 = 30.0;
/// How long a screen shows a picture of a walk.
const REFRESH: Duration = Duration::from_micros(16_667);
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
        "| network | transport | coarse: median, max, MB | exact: median, max, MB | jump: median, max \
         | walk: median, p95 | lacked something | MB, Mbit/s | ahead: MB, used |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, rate, delay, loss) in NETWORKS {
        for scheme in ["tcp", "quic", "udp"] {
            let network = profile(rate, delay, loss)?;
            let (mut any, mut first) = (Vec::new(), Vec::new());
            let (mut any_bytes, mut bytes) = (0, 0);
            // A seed for each: lost packets are others each time.
            for (seed, view) in (1..).zip(&bench.views) {
                let seen = bench.walk(&network, scheme, seed, std::slice::from_ref(view), Walk::First)?;
                any.extend(seen.shown.first().map(|shown| shown.at_ms));
                first.extend(seen.shown.last().map(|shown| shown.at_ms));
                any_bytes += seen.first_bytes;
                bytes += seen.bytes;
            }
            let jumps = bench.walk(&network, scheme, 1, &bench.views, Walk::Jumps)?;
            // The first one is no jump.
            let jumped: Vec<_> = jumps.latencies().skip(1).collect();
            let walk = bench.walk(&network, scheme, 1, &bench.path, Walk::Live)?;
            let later: Vec<_> = walk.latencies().skip(1).collect();
            let lacked = walk.shown.iter().filter(|shown| !shown.is_exact).count();
            let seconds = bench.path.len() as f64 / HZ;
            println!(
                "| {name} | {scheme} | {:.0} ms, {:.0} ms, {:.2} | {:.0} ms, {:.0} ms, {:.2} \
                 | {:.0} ms, {:.0} ms | {:.0} ms, {:.0} ms | {lacked} of {} | {:.2}, {:.2} \
                 | {:.2}, {:.0} % |",
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
                walk.shown.len(),
                walk.bytes as f64 / 1e6,
                8e-6 * (walk.bytes - walk.exact_bytes.unwrap_or(0)) as f64 / seconds,
                walk.ahead.bytes as f64 / 1e6,
                100.0 * walk.ahead.used_bytes as f64 / walk.ahead.bytes.max(1) as f64,
            );
        }
    }
    Ok(())
}

/// A display's walk.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Walk {
    /// It shows the first camera until it has an exact picture.
    First,
    /// It shows an exact picture of each camera.
    Jumps,
    /// It shows what it has of the newest camera.
    Live,
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
            let options = AutoPathOptions { frames, seed, teleport };
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

    /// The pictures of a display that begins empty, from these cameras.
    fn walk(
        &self,
        network: &Profile,
        scheme: &str,
        seed: u64,
        cameras: &[Camera],
        walk: Walk,
    ) -> Outcome<Seen> {
        let pace = match walk {
            Walk::Jumps => Pace::Lockstep { frames: Some(cameras.len() as u32) },
            Walk::First | Walk::Live => Pace::Live,
        };
        let mut network = network.sites();
        let [host, display] = [network.near("culler"), network.far("display")];
        let simulation = Simulation::new(&network.topology, seed);
        let [listener, net] = [host, display].map(|host| Arc::new(simulation.net(host)) as Arc<dyn Net>);
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
        let sought = PeersConfig {
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
            let at = ServiceEndpoints {
                listen: Some(at.into()),
                displays: Vec::new(),
                cullers: Vec::new(),
                options: theirs,
            };
            let mut service = CullerService::start(&listener, self.scene.outline(), at).await?;
            let session = service.next().await?;
            let work = |settings: &Settings| {
                let culler = VulkanCuller::new(&self.drawn, settings.viewport, OcclusionTestKind::Hzb);
                let culler = culler.map_err(RoleError::device("opening it"))?;
                Ok(SceneCulling::new(&self.scene, culler, settings, &turns))
            };
            let limits = SessionLimits::none();
            let drawables = max_frame(&self.scene);
            session.play(work, &turns, drawables, Some(&self.scene), &limits, &stop).await?;
            Ok::<_, Box<dyn Error>>(())
        };
        let seen = RefCell::new(Seen::default());
        let showing = async {
            let screen = Screen {
                pictures: ScenePictures::new(&supplied.scene, pictures, &self.settings),
                net: Arc::clone(&net),
                takes: if walk == Walk::Live { REFRESH } else { Duration::ZERO },
            };
            let (cullers, drawables) = (Peers::seek(&net, sought), max_frame(&self.scene));
            let role = DisplayRole {
                alone: None::<SceneCulling<VulkanCuller>>,
                supplied: Some(supplied.clone()),
                pace,
                join_timeout: Duration::from_secs(30),
                turns: turns.clone(),
                ..DisplayRole::new(screen, cullers, SessionKey(1), self.settings, drawables, &net)
            };
            let mut watch = Watch { net: &net, seen: &seen };
            let mut hand_out = HandOut { net: &net, seen: &seen, cameras, walk, began: None };
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

/// The frames shown, in the simulator's time.
#[derive(Default)]
struct Seen {
    /// When each camera was handed out first, milliseconds.
    handed_out: Vec<(Camera, f64)>,
    shown: Vec<Shown>,
    /// Bytes of geometry, of all frames and until the first.
    bytes: u64,
    first_bytes: u64,
    /// The same until the first exact picture.
    exact_bytes: Option<u64>,
    ahead: AheadUse,
    link: Option<StatsHandle>,
}

struct Shown {
    camera: Camera,
    /// Milliseconds.
    at_ms: f64,
    is_exact: bool,
}

impl Seen {
    /// From handing a camera out, or showing the frame before if that was later, to the picture: ms.
    fn latencies(&self) -> impl Iterator<Item = f64> + '_ {
        let before = std::iter::once(0.0).chain(self.shown.iter().map(|shown| shown.at_ms));
        self.shown.iter().zip(before).map(|(shown, before)| {
            let handed_out = self.handed_out.iter().find(|(camera, _)| *camera == shown.camera);
            shown.at_ms - handed_out.map_or(0.0, |(_, at_ms)| *at_ms).max(before)
        })
    }
}

/// Draws pictures, each of which takes so long at least: as on a screen.
struct Screen<W> {
    pictures: W,
    net: Arc<dyn Net>,
    takes: Duration,
}

impl<W: DisplayWork> DisplayWork for Screen<W> {
    async fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> Result<usize, RoleError> {
        let until = self.net.now().after(self.takes);
        let drawn = self.pictures.draw(camera, ids, missing).await;
        sleep_until(&*self.net, until).await;
        drawn
    }

    fn device_time(&self) -> Duration {
        self.pictures.device_time()
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        self.pictures.picture()
    }
}

/// Hands out these cameras.
struct HandOut<'w> {
    net: &'w Arc<dyn Net>,
    seen: &'w RefCell<Seen>,
    cameras: &'w [Camera],
    walk: Walk,
    /// When the first one was.
    began: Option<Instant>,
}

impl HandOut<'_> {
    /// Which camera is the newest.
    fn newest(&self) -> usize {
        let since = self.began.map_or(Duration::ZERO, |began| self.net.now().since(began));
        (since.as_secs_f64() * HZ) as usize
    }
}

impl Cameras for HandOut<'_> {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        let now = self.net.now();
        self.began.get_or_insert(now);
        let place = match self.walk {
            Walk::First => 0,
            Walk::Jumps => frame.0 as usize,
            Walk::Live => self.newest().min(self.cameras.len() - 1),
        };
        let camera = self.cameras[place];
        let mut seen = self.seen.borrow_mut();
        if seen.handed_out.last().is_none_or(|(last, _)| *last != camera) {
            seen.handed_out.push((camera, milliseconds(now)));
        }
        camera.for_frame(frame)
    }

    fn is_over(&self) -> bool {
        match self.walk {
            Walk::First => self.seen.borrow().exact_bytes.is_some(),
            Walk::Jumps => false,
            Walk::Live => self.newest() >= self.cameras.len(),
        }
    }
}

fn milliseconds(time: Instant) -> f64 {
    time.as_nanos() as f64 * 1e-6
}

struct Watch<'w> {
    net: &'w Arc<dyn Net>,
    seen: &'w RefCell<Seen>,
}

impl Observer for Watch<'_> {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        let mut seen = self.seen.borrow_mut();
        let (at_ms, is_exact) = (milliseconds(self.net.now()), frame.lacking == 0);
        seen.shown.push(Shown { camera: frame.camera.for_frame(FrameNumber(0)), at_ms, is_exact });
        seen.bytes = seen.link.as_ref().map_or(0, |link| link.read().received.bulk.bytes);
        if seen.shown.len() == 1 {
            seen.first_bytes = seen.bytes;
        }
        if is_exact && seen.exact_bytes.is_none() {
            seen.exact_bytes = Some(seen.bytes);
        }
        Ok(())
    }

    fn ahead(&mut self, sent: &AheadUse) {
        self.seen.borrow_mut().ahead = *sent;
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
        let security =
            Some(Security { keys: keys.clone(), peers: vec![other.public().clone().into()].into() });
        let mut options = Options::default().with_security(security);
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
