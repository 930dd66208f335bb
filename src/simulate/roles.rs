//! The three roles of a session, to be played on any network.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use trimaran_actors::{
    BoxedError, CullerIndex, CullerSession, DisplayRole, JoinError, JoinTimeouts, Listener, Observer,
    PeerEndpoint, SessionError, SessionEvent, ShownFrame, Stop, Turns, await_cullers,
};
use trimaran_netsim::Machines;
use trimaran_proto::{
    DrawableId, FrameNumber, Identity, LodRule, OcclusionTestKind, Role, SceneHash, Settings, Viewport,
};
use trimaran_transport::keys::{Keys, KnownPeer, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Endpoint, Instant, Net, Options, Traffic, sleep_until};

use super::error::SimulateError;
use super::outcome::FrameTimes;
use super::recorded::{RecordedCulling, RecordedPictures, Recording};
use super::scenario::{Knobs, Scenario, Transport};

/// How long the roles may take to find each other.
const TIMEOUTS: JoinTimeouts = JoinTimeouts { join: Duration::from_secs(60), rejoin: Duration::ZERO };
/// After the handshakes everything is quiet for so long before the first camera, so that they are not
/// counted.
const PAUSE: Duration = Duration::from_secs(1);
/// All roles hold the same scene; which one does not matter here.
const SCENE: SceneHash = SceneHash(0);

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
    network: String,
    link: Transport,
    /// Where the display waits for the cullers, and the first culler for the second.
    listen: [Endpoint; 2],
    /// Of the first, the second and the display; each knows the others' keys.
    options: [Options; 3],
}

impl Roles {
    /// The roles, with fresh keys.
    ///
    /// # Errors
    /// When there are no keys to be had, or the settings cannot be.
    pub fn new(scenario: &Scenario) -> Result<Self, SimulateError> {
        let Scenario { network, link, batch, frames, workload, knobs, .. } = scenario;
        let (_, Machines { first, display, .. }) = network.topology();
        let settings = Settings {
            viewport: Viewport::new(1024, 1024)?,
            lod: LodRule::new(2.0)?,
            batch: *batch,
            coding: knobs.coding,
            occlusion_test: OcclusionTestKind::Hzb,
            lockstep: true,
            first: FrameNumber(0),
            frames: Some(*frames),
        };
        Ok(Self {
            recording: Recording::new(workload, *frames, *link == Transport::UdpDeadline),
            settings,
            network: network.name.clone(),
            link: *link,
            listen: [
                link.endpoint(&format!("{}:7400", display.v4())).parse()?,
                link.endpoint(&format!("{}:7401", first.v4())).parse()?,
            ],
            options: acquainted(knobs)?,
        })
    }

    /// Plays a culler until the last frame.
    ///
    /// # Errors
    /// When a link fails, or a peer breaks the order of messages.
    pub async fn culler(
        &self,
        index: CullerIndex,
        net: &Arc<dyn Net>,
        clock: &Arc<dyn Net>,
    ) -> Result<(), SessionError> {
        let options = &self.options[index.index()];
        let [display, other] =
            self.listen.clone().map(|endpoint| PeerEndpoint { endpoint, options: options.clone() });
        let (recording, asked) = (&self.recording, Instant::from_nanos(0));
        let culler = CullerSession {
            index,
            scene: SCENE,
            net: Arc::clone(net),
            display,
            other,
            timeouts: TIMEOUTS,
            turns: Turns::at_once(),
            work: |settings: &Settings| {
                let (recording, clock, batch) = (recording.clone(), Arc::clone(clock), settings.batch);
                Ok(RecordedCulling { recording, clock, batch, asked, frame: settings.first })
            },
            watch: |event: SessionEvent<'_>| {
                if let SessionEvent::Joined(joined) = event {
                    let stats = [joined.display.stats.clone(), joined.other.stats.clone()];
                    recording.log(|log| log.stats.extend(stats));
                }
            },
        };
        let (_stopper, stop) = Stop::new();
        culler.run(&stop).await
    }

    /// Plays the display until the last frame, and calls `shown` after each picture. Gives what `count` says
    /// before the first camera and after the last picture.
    ///
    /// # Errors
    /// When a link fails, or a peer breaks the order of messages.
    pub async fn display<C>(
        &self,
        net: &Arc<dyn Net>,
        clock: &Arc<dyn Net>,
        count: impl Fn() -> C,
        shown: impl Fn(),
    ) -> Result<(C, C), SessionError> {
        let ([listen, _], [_, _, options], settings) = (&self.listen, &self.options, self.settings);
        let identity = Identity { role: Role::Display, scene: SCENE, settings: Some(settings) };
        let listener = Listener::bind(net, listen, identity, options).await?;
        let [first, second] = await_cullers(listener, net.now().after(TIMEOUTS.join)).await?;
        let stats = [first.stats.clone(), second.stats.clone()];
        sleep_until(&**net, net.now().after(PAUSE)).await;
        self.recording.log(|log| log.stats.extend(stats));
        let before = count();
        let mut pictures = Pictures { due: settings.frames.unwrap_or(0), shown, count: &count, after: None };
        let (recording, clock) = (self.recording.clone(), Arc::clone(clock));
        let work = RecordedPictures { recording, clock, came: Vec::new() };
        let mut cameras = work.clone();
        let role =
            DisplayRole { work, first, second, settings, net: Arc::clone(net), turns: Turns::at_once() };
        let (_stopper, stop) = Stop::new();
        role.run(&mut cameras, &mut pictures, &stop).await?;
        Ok((before, pictures.after.unwrap_or_else(count)))
    }

    /// What all ends of all links sent so far, by their own count.
    #[must_use]
    pub fn messages(&self) -> Traffic {
        self.recording.log(|log| {
            log.stats.iter().map(|stats| stats.read().sent).fold(Traffic::default(), |all, sent| all + sent)
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
        // The other role is there, in a simulation.
        let no_link =
            matches!(cause, SessionError::Join(JoinError::Accept { .. } | JoinError::Connect { .. }));
        let cause = Box::new(cause);
        if no_link {
            SimulateError::NoLink { network, link, cause }
        } else {
            SimulateError::Role { role, network, link, cause }
        }
    }
}

/// Counts pictures.
struct Pictures<F, S, C> {
    /// How many are still to be shown.
    due: u32,
    shown: S,
    count: F,
    /// What was counted after the last one.
    after: Option<C>,
}

impl<F: Fn() -> C, S: Fn(), C> Observer for Pictures<F, S, C> {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        (self.shown)();
        self.due -= 1;
        if self.due == 0 {
            self.after = Some((self.count)());
        }
        Ok(())
    }
}

/// Options of three machines that know each other.
fn acquainted(knobs: &Knobs) -> Result<[Options; 3], SimulateError> {
    let keys = |name: &str| -> Result<Keys, SimulateError> { Ok(Keys::generate(name.parse()?)?) };
    let all = [keys("first")?, keys("second")?, keys("display")?];
    let roles = [Role::FirstCuller, Role::SecondCuller, Role::Display];
    let known = |(keys, role): (&Keys, Role)| KnownPeer::in_role(keys.public().clone(), role);
    let peers: Vec<_> = all.iter().zip(roles).map(known).collect();
    let udp = UdpOptions {
        trust: if knobs.in_the_clear { Trust::Plaintext } else { Trust::Keys },
        deadline: knobs.deadline,
        repair_percent: knobs.repair_percent,
        ..UdpOptions::default()
    };
    Ok(all.map(|keys| Options {
        security: Some(Security { keys, peers: peers.clone() }),
        udp: udp.clone(),
        ..Options::default()
    }))
}
