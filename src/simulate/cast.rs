//! The three roles of a session, to be played on any network.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use trimaran_actors::{JoinError, Listener, Place, Seat, await_pair, join_session};
use trimaran_netsim::Machines;
use trimaran_proto::{
    DrawableId, EpsilonPx, FrameNumber, Identity, PictureSize, Role, SceneHash, Settings, TesterKind,
};
use trimaran_transport::keys::{Keys, KnownPeer, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Endpoint, Net, Options, Traffic, sleep_until};

use super::roles::{Stage, display, leave, switch};
use super::{FrameTimes, Knobs, RoleFailure, Scenario, SimulateError, Transport};

/// How long the roles may take to find each other.
const TIMEOUT: Duration = Duration::from_secs(60);
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
pub struct Cast {
    stage: Stage,
    settings: Settings,
    network: String,
    link: Transport,
    /// Where the display waits for the pair, and the first machine for the second.
    doors: [Endpoint; 2],
    /// Of the first, the second and the display; each knows the others' keys.
    options: [Options; 3],
}

impl Cast {
    /// The roles, with fresh keys.
    ///
    /// # Errors
    /// When there are no keys to be had, or the settings cannot be.
    pub fn new(scenario: &Scenario) -> Result<Self, SimulateError> {
        let Scenario { network, link, batch, frames, workload, knobs, .. } = scenario;
        let (_, Machines { first, display, .. }) = network.topology();
        let settings = Settings {
            size: PictureSize::new(1024, 1024)?,
            epsilon: EpsilonPx::new(2.0)?,
            batch: *batch,
            coding: knobs.coding,
            tester: TesterKind::Hzb,
            lockstep: true,
            few_pixels: false,
            first: FrameNumber(0),
            frames: Some(*frames),
        };
        Ok(Self {
            stage: Stage::new(Arc::new(workload.clone()), *frames, *link == Transport::UdpDeadline),
            settings,
            network: network.name.clone(),
            link: *link,
            doors: [
                link.endpoint(&format!("{}:7400", display.v4())).parse()?,
                link.endpoint(&format!("{}:7401", first.v4())).parse()?,
            ],
            options: acquainted(knobs)?,
        })
    }

    /// Plays a machine of the pair until the last frame.
    ///
    /// # Errors
    /// When a link fails, or a peer breaks the order of messages.
    pub async fn switch(
        &self,
        seat: Seat,
        net: &Arc<dyn Net>,
        clock: &Arc<dyn Net>,
    ) -> Result<(), RoleFailure> {
        let [first, second, _] = &self.options;
        let options = if seat == Seat::First { first } else { second };
        let [show, meet] = self.doors.clone().map(|endpoint| Place { endpoint, options: options.clone() });
        let deadline = net.now().after(TIMEOUT);
        let mut joined = join_session(net, seat, SCENE, &show, &meet, deadline).await?;
        let stats = [joined.display.stats.clone(), joined.other.stats.clone()];
        self.stage.log(|log| log.stats.extend(stats));
        switch(clock, &self.stage, seat, &mut joined).await?;
        leave([joined.display, joined.other]).await;
        Ok(())
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
    ) -> Result<(C, C), RoleFailure> {
        let [_, _, options] = &self.options;
        let [listener, _] = &self.doors;
        let identity = Identity { role: Role::Display, scene: SCENE, settings: Some(self.settings) };
        let listener = Listener::bind(net, listener, identity, options).await?;
        let mut links = await_pair(listener, net.now().after(TIMEOUT)).await?;
        let handles: Vec<_> = links.iter().map(|link| link.stats.clone()).collect();
        sleep_until(&**net, net.now().after(PAUSE)).await;
        self.stage.log(|log| log.stats.extend(handles));
        let before = count();
        display(clock, &self.stage, &mut links, shown).await?;
        let after = count();
        leave(links).await;
        Ok((before, after))
    }

    /// What all ends of all links sent so far, by their own count.
    #[must_use]
    pub fn messages(&self) -> Traffic {
        self.stage.log(|log| {
            log.stats.iter().map(|stats| stats.read().sent).fold(Traffic::default(), |all, sent| all + sent)
        })
    }

    /// When what happened to each frame.
    #[must_use]
    pub fn times(&self) -> Vec<FrameTimes> {
        self.stage.log(|log| log.times.clone())
    }

    /// When what happened to each frame, and what was missing in each.
    pub(super) fn take_log(&self) -> (Vec<FrameTimes>, BTreeMap<u32, Vec<DrawableId>>) {
        self.stage.log(|log| (std::mem::take(&mut log.times), std::mem::take(&mut log.remains)))
    }

    /// The failure of a role.
    pub(super) fn failed(&self, role: &'static str, cause: RoleFailure) -> SimulateError {
        let (network, link) = (self.network.clone(), self.link.name());
        // The other role is there, in a simulation.
        let no_link =
            matches!(cause, RoleFailure::Join(JoinError::Accept { .. } | JoinError::Connect { .. }));
        let cause = Box::new(cause);
        if no_link {
            SimulateError::NoLink { network, link, cause }
        } else {
            SimulateError::Role { role, network, link, cause }
        }
    }
}

/// Options of three machines that know each other.
fn acquainted(knobs: &Knobs) -> Result<[Options; 3], SimulateError> {
    let keys = |name: &str| -> Result<Keys, SimulateError> { Ok(Keys::generate(name.parse()?)?) };
    let all = [keys("first")?, keys("second")?, keys("display")?];
    let roles = [Role::SwitchA, Role::SwitchB, Role::Display];
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
