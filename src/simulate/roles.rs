//! The roles of a session, to be played on any network.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use trimaran_actors::{
    BoxedError, CullerId, CullerService, DisplayRole, Observer, Pace, PeerEndpoint, Peers, Schedule,
    ServiceEndpoints, SessionError, SessionLimits, ShownFrame, Sought, Stop, Supplied, Turns, WhileLoading,
    max_frame, sent_bytes,
};
use trimaran_netsim::{HostId, Machines};
use trimaran_proto::{
    DrawableId, FrameStats, Identity, LodRule, OcclusionTestKind, Role, SceneHash, SentBytes, SessionKey,
    Settings, Viewport,
};
use trimaran_scene::Scene;
use trimaran_transport::keys::{Keys, KnownPeer, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Net, Options, sleep_until, until};

use super::error::SimulateError;
use super::outcome::FrameTimes;
use super::recorded::{RecordedCulling, RecordedPictures, Recording};
use super::scenario::{Geometry, Knobs, Scenario, Transport};
use crate::trace::Trace;

/// How long the roles may take to find each other.
const JOIN_TIMEOUT: Duration = Duration::from_secs(60);
/// After the handshakes everything is quiet for so long before the first camera, so that they are not
/// counted.
const PAUSE: Duration = Duration::from_secs(1);
/// What the roles' scene is called where none of its geometry is sent: which one it is does not matter then.
const SCENE: SceneHash = SceneHash(0);
const SESSION: SessionKey = SessionKey(0);

/// The roles of a scenario. Each is played on a network of its own machine, which has the address that
/// [`Profile::topology`](trimaran_netsim::Profile::topology) gives it; whether that network is simulated or
/// real is the same to them.
///
/// Each role takes two of them: `net` for its links, and `clock` for what is not the network's: computing,
/// and when things happen. All clocks must begin at the same time.
#[derive(Debug)]
pub struct Roles {
    recording: Recording,
    settings: Settings,
    frames: u32,
    schedule: Schedule,
    network: String,
    link: Transport,
    geometry: Option<Geometry>,
    /// Where each culler listens, and what holds for its links.
    cullers: Vec<PeerEndpoint>,
    /// What holds for the display's.
    display: Options,
}

impl Roles {
    /// The roles, with fresh keys.
    ///
    /// # Errors
    /// When there are no keys to be had, or the settings cannot be.
    pub fn new(scenario: &Scenario) -> Result<Self, SimulateError> {
        let Scenario { network, link, cullers, schedule, batch, frames, workload, geometry, knobs, .. } =
            scenario;
        if *cullers == 0 && geometry.is_some() {
            return Err(SimulateError::NoSupplier);
        }
        let recorded = |trace: &Trace| (trace.size, trace.epsilon_px, trace.few_pixels);
        let ([width, height], epsilon_px, few_pixels) =
            workload.trace().map_or(([1024; 2], 2.0, false), recorded);
        let (_, Machines { cullers: hosts, .. }) = network.topology(*cullers);
        let settings = Settings {
            viewport: Viewport::new(width, height)?,
            lod: LodRule::new(epsilon_px)?.stopping_at_few_pixels(few_pixels),
            batch: *batch,
            coding: knobs.coding,
            occlusion_test: OcclusionTestKind::Hzb,
        };
        let (display, options) = acquainted(knobs, hosts.len())?;
        let peer = |(host, options): (&HostId, Options)| {
            let endpoint = link.endpoint(&format!("{}:7400", host.v4())).parse()?;
            Ok::<_, SimulateError>(PeerEndpoint { endpoint, options })
        };
        Ok(Self {
            recording: Recording::new(workload, *frames, *link == Transport::UdpDeadline),
            settings,
            frames: *frames,
            schedule: *schedule,
            network: network.name.clone(),
            link: *link,
            geometry: geometry.clone(),
            cullers: hosts.iter().zip(options).map(peer).collect::<Result<_, _>>()?,
            display,
        })
    }

    /// Plays a culler until the display leaves; nothing beyond the last one.
    ///
    /// # Errors
    /// When it cannot listen, or the display is lost.
    pub async fn culler(
        &self,
        id: CullerId,
        net: &Arc<dyn Net>,
        clock: &Arc<dyn Net>,
    ) -> Result<(), SessionError> {
        let Some(PeerEndpoint { endpoint, options }) = self.cullers.get(id.index()).cloned() else {
            return Ok(());
        };
        let cullers = self.cullers.iter().map(|culler| culler.endpoint.clone()).collect();
        let at = ServiceEndpoints { listen: Some(endpoint.into()), displays: Vec::new(), cullers, options };
        let scene = self.geometry.as_ref().map(|geometry| &geometry.scene);
        let outline = scene.map_or_else(|| SCENE.into(), |scene| scene.outline());
        let mut service = CullerService::start(net, outline, at).await?;
        let session = service.next().await?;
        self.recording.log(|log| log.stats.push(session.display.stats.clone()));
        let (recording, (_stopper, stop)) = (&self.recording, Stop::new());
        let limits = SessionLimits::none();
        let work = |settings: &Settings| Ok(RecordedCulling::new(recording, clock, settings.batch));
        Ok(session.play(work, &Turns::at_once(), self.drawables(), scene, &limits, &stop).await?)
    }

    /// Plays the display until the last frame, and calls `shown` after each picture. Gives what `count` says
    /// before the first camera and after the last picture.
    ///
    /// # Errors
    /// When a culler does not come, or no frame can be shown any more.
    pub async fn display<C>(
        &self,
        net: &Arc<dyn Net>,
        clock: &Arc<dyn Net>,
        count: impl Fn() -> C,
        shown: impl Fn(),
    ) -> Result<(C, C), SimulateError> {
        let peer = |PeerEndpoint { endpoint, .. }: &PeerEndpoint| PeerEndpoint {
            endpoint: endpoint.clone(),
            options: self.display.clone(),
        };
        let sought = Sought {
            identity: Identity {
                role: Role::Display,
                scene: self.geometry.is_none().then(|| SCENE.into()),
                session: Some((SESSION, self.settings)),
            },
            role: Role::Culler,
            endpoints: self.cullers.iter().map(peer).collect(),
            listener: None,
            most: CullerId::MOST,
        };
        let mut cullers = Peers::seek(net, sought);
        let deadline = net.now().after(JOIN_TIMEOUT);
        let mut arrived = Vec::new();
        while arrived.len() < self.cullers.len() {
            let came = until(&**net, deadline, cullers.next()).await;
            let came = came.ok_or_else(|| self.no_link())?.map_err(|e| self.failed("display", e.into()))?;
            self.recording.log(|log| log.stats.push(came.link.stats.clone()));
            arrived.push(came);
        }
        arrived.into_iter().for_each(|arrival| cullers.put_back(arrival));
        sleep_until(&**net, net.now().after(PAUSE)).await;
        let before = count();
        let recording = &self.recording;
        let mut pictures = Pictures { recording, due: self.frames, shown, count: &count, after: None };
        let work = RecordedPictures { recording: recording.clone(), clock: Arc::clone(clock) };
        let mut cameras = work.clone();
        let role = DisplayRole {
            // What it cannot draw it cannot cull either.
            alone: (self.geometry.is_none())
                .then(|| RecordedCulling::new(recording, clock, self.settings.batch)),
            supplied: self.geometry.as_ref().map(|Geometry { scene, cache }| Supplied {
                scene: Arc::new(Scene::empty(scene.outline())),
                memory: *cache,
                while_loading: WhileLoading::Wait,
            }),
            schedule: self.schedule,
            pace: Pace::Lockstep { frames: Some(self.frames) },
            join_timeout: JOIN_TIMEOUT,
            ..DisplayRole::new(work, cullers, SESSION, self.settings, self.drawables(), net)
        };
        let (_stopper, stop) = Stop::new();
        let played = role.run(&mut cameras, &mut pictures, &stop).await;
        played.map_err(|error| self.failed("display", error.into()))?;
        Ok((before, pictures.after.unwrap_or_else(count)))
    }

    /// How many drawables the scene has.
    fn drawables(&self) -> u32 {
        let Some(Geometry { scene, .. }) = &self.geometry else { return self.recording.drawables() };
        max_frame(scene)
    }

    /// What all ends of all links sent so far, by their own count. What cullers send to each other counts
    /// when the display has learned of it.
    #[must_use]
    pub fn messages(&self) -> SentBytes {
        self.recording.log(|log| {
            let sent = log.stats.iter().map(|stats| sent_bytes(stats.read().sent));
            sent.fold(log.to_others, |all, sent| all + sent)
        })
    }

    /// When what happened to each frame.
    #[must_use]
    pub fn times(&self) -> Vec<FrameTimes> {
        self.recording.log(|log| log.times.clone())
    }

    /// When what happened to each frame, and what was missing in each.
    pub(super) fn take_log(&self) -> (Vec<FrameTimes>, BTreeMap<u32, Vec<DrawableId>>) {
        self.recording.log(|log| (std::mem::take(&mut log.times), std::mem::take(&mut log.remains)))
    }

    /// The failure of a role.
    pub(super) fn failed(&self, role: &'static str, cause: SessionError) -> SimulateError {
        let (network, link) = (self.network.clone(), self.link.name());
        SimulateError::Role { role, network, link, cause: Box::new(cause) }
    }

    fn no_link(&self) -> SimulateError {
        SimulateError::NoLink { network: self.network.clone(), link: self.link.name() }
    }
}

/// Counts pictures.
struct Pictures<'r, F, S, C> {
    recording: &'r Recording,
    /// How many are still to be shown.
    due: u32,
    shown: S,
    count: F,
    /// What was counted after the last one.
    after: Option<C>,
}

impl<F: Fn() -> C, S: Fn(), C> Observer for Pictures<'_, F, S, C> {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.recording.culled_by(frame.camera.frame(), frame.culler);
        (self.shown)();
        self.due -= 1;
        if self.due == 0 {
            self.after = Some((self.count)());
        }
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.recording.log(|log| log.to_others = log.to_others + stats.to_other);
    }
}

/// Options of a display and of so many cullers that know each other.
fn acquainted(knobs: &Knobs, cullers: usize) -> Result<(Options, Vec<Options>), SimulateError> {
    let keys = |name: &str| -> Result<Keys, SimulateError> { Ok(Keys::generate(name.parse()?)?) };
    let display = keys("display")?;
    let cullers: Vec<Keys> =
        (1..=cullers).map(|culler| keys(&format!("culler-{culler}"))).collect::<Result<_, _>>()?;
    let known = |keys: &Keys, role| KnownPeer::in_role(keys.public().clone(), role);
    let all = cullers.iter().map(|keys| known(keys, Role::Culler)).chain([known(&display, Role::Display)]);
    let peers: Vec<_> = all.collect();
    let udp = UdpOptions {
        trust: if knobs.in_the_clear { Trust::Plaintext } else { Trust::Keys },
        deadline: knobs.deadline,
        repair_percent: knobs.repair_percent,
        ..UdpOptions::default()
    };
    let options = |keys| Options {
        security: Some(Security { keys, peers: peers.clone() }),
        udp: udp.clone(),
        ..Options::default()
    };
    Ok((options(display), cullers.into_iter().map(options).collect()))
}
