//! The roles of a session, to be played on any network.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use trimaran_actors::{
    BoxedError, CullerId, CullerService, DisplayRole, Observer, Pace, PeerEndpoint, Peers, PeersConfig,
    Schedule, ServiceEndpoints, SessionError, SessionLimits, ShownFrame, Stop, Supplied, Turns, WhileLoading,
    max_frame, sent_bytes,
};
use trimaran_netsim::HostId;
use trimaran_proto::{
    DrawableId, FrameStats, Identity, LodRule, OcclusionTestKind, Role, SceneHash, SentBytes, SessionKey,
    Settings, Viewport,
};
use trimaran_scene::Scene;
use trimaran_transport::keys::{Keys, KnownPeer, KnownPeers, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Net, Options, sleep_until, until};

use super::error::SimulateError;
use super::outcome::FrameTimes;
use super::recorded::{RecordedCulling, RecordedPictures, Recording};
use super::scenario::{Geometry, Knobs, Scenario, Transport};
use crate::session_hosts::SessionHosts;
use crate::trace::Trace;

/// How long the roles may take to find each other.
const JOIN_TIMEOUT: Duration = Duration::from_secs(60);
/// Everything is quiet for this long between the handshakes and the first camera, so that handshakes are not
/// counted.
const PAUSE: Duration = Duration::from_secs(1);
/// The roles' scene when none of its geometry is sent: its identity does not matter then.
const SCENE: SceneHash = SceneHash(0);
const SESSION: SessionKey = SessionKey(0);

/// The roles of a scenario. Each is played on the network of its own machine, with the address that
/// [`SessionHosts`] gives it; that network may be simulated or real.
///
/// Each role takes two networks: `net` for its links, and `clock` for computing and for the times of events.
/// All clocks must begin at the same time.
#[derive(Debug)]
pub struct Roles {
    recording: Recording,
    settings: Settings,
    frames: u32,
    schedule: Schedule,
    network: String,
    link: Transport,
    geometry: Option<Geometry>,
    /// Where each culler listens, with the options of its links.
    cullers: Vec<PeerEndpoint>,
    /// The options of the display's links.
    display: Options,
}

impl Roles {
    /// The roles, with fresh keys.
    ///
    /// # Errors
    /// When keys cannot be made, or the settings are invalid.
    pub fn new(scenario: &Scenario) -> Result<Self, SimulateError> {
        let Scenario { network, link, cullers, schedule, batch, frames, workload, geometry, knobs, .. } =
            scenario;
        if *cullers == 0 && geometry.is_some() {
            return Err(SimulateError::NoSupplier);
        }
        let recorded = |trace: &Trace| (trace.size, trace.epsilon_px, trace.few_pixels);
        let ([width, height], epsilon_px, few_pixels) =
            workload.trace().map_or(([1024; 2], 2.0, false), recorded);
        let (_, SessionHosts { cullers: hosts, .. }) = SessionHosts::on(network, *cullers);
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

    /// Plays a culler until the display leaves; does nothing if there is no such culler.
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

    /// Plays the display until the last frame, and calls `shown` after each picture. Returns the results of
    /// `count` before the first camera and after the last picture.
    ///
    /// # Errors
    /// When a culler does not come, or frames can no longer be shown.
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
        let sought = PeersConfig {
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
            // A display that cannot draw the geometry cannot cull it either.
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

    /// The messages that all ends of all links have sent so far, by their own count. Messages between cullers
    /// count once the display has learned of them.
    #[must_use]
    pub fn messages(&self) -> SentBytes {
        self.recording.log(|log| {
            let sent = log.stats.iter().map(|stats| sent_bytes(stats.read().sent));
            sent.fold(log.to_others, |all, sent| all + sent)
        })
    }

    /// The times of each frame's events.
    #[must_use]
    pub fn times(&self) -> Vec<FrameTimes> {
        self.recording.log(|log| log.times.clone())
    }

    /// The times of each frame's events, and the received ids of those with gaps.
    pub(super) fn take_log(&self) -> (Vec<FrameTimes>, BTreeMap<u32, Vec<DrawableId>>) {
        self.recording.log(|log| (std::mem::take(&mut log.times), std::mem::take(&mut log.remains)))
    }

    /// Names the role, network and link in a failure.
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
    /// The count after the last one.
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

/// Options of a display and this many cullers, with the keys of each other.
fn acquainted(knobs: &Knobs, cullers: usize) -> Result<(Options, Vec<Options>), SimulateError> {
    let keys = |name: &str| -> Result<Keys, SimulateError> { Ok(Keys::generate(name.parse()?)?) };
    let display = keys("display")?;
    let cullers: Vec<Keys> =
        (1..=cullers).map(|culler| keys(&format!("culler-{culler}"))).collect::<Result<_, _>>()?;
    let known = |keys: &Keys, role| KnownPeer::in_role(keys.public().clone(), role);
    let all = cullers.iter().map(|keys| known(keys, Role::Culler)).chain([known(&display, Role::Display)]);
    let peers: KnownPeers = all.collect();
    let udp = UdpOptions::default()
        .with_trust(if knobs.in_the_clear { Trust::Plaintext } else { Trust::Keys })
        .with_deadline(knobs.deadline)
        .with_repair_percent(knobs.repair_percent);
    let options = |keys| {
        Options::default().with_security(Security { keys, peers: peers.clone() }).with_udp(udp.clone())
    };
    Ok((options(display), cullers.into_iter().map(options).collect()))
}
