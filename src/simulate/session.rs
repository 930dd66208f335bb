//! Joining the three roles on the simulated network, and counting.

use std::io::Write;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_actors::{JoinError, OrderError, Place, Seat, await_pair, join_session};
use trimaran_netsim::{CaptureError, HostId, Machines, Simulation, Stalled};
use trimaran_proto::{
    EpsilonPx, FrameNumber, Identity, PictureSize, Role, SceneHash, Settings, SettingsError, TesterKind,
};
use trimaran_transport::keys::{Keys, KeysError, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{
    Endpoint, EndpointError, EndpointFault, ListenError, Listener, Net, Options, RecvError, SendError,
    Traffic, sleep_until,
};

use super::bytes::{Account, Sent};
use super::outcome::Ended;
use super::roles::{Stage, display, leave, switch};
use super::{Knobs, Outcome, Scenario, Transport};

/// How long the roles may take to find each other.
const PATIENCE: Duration = Duration::from_secs(60);
/// After the handshakes everything is quiet for so long before the first camera, so that they are not counted.
const PAUSE: Duration = Duration::from_secs(1);
/// All roles hold the same scene; which one does not matter here.
const SCENE: SceneHash = SceneHash(0);

/// Why a session could not be simulated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// No keys for the machines.
    #[error("no keys for the simulated machines")]
    Keys(#[from] KeysError),
    /// A machine's address or name cannot be written.
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    /// A name of a key cannot be used.
    #[error(transparent)]
    Name(#[from] EndpointFault),
    /// The session's settings.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A role ended early.
    #[error("the {role} failed on {network} over {link}")]
    Role {
        /// Which.
        role: &'static str,
        /// Where.
        network: String,
        /// By what.
        link: &'static str,
        /// Why.
        #[source]
        cause: Box<RoleFailure>,
    },
    /// The packets cannot be written down.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The roles wait for each other.
    #[error(transparent)]
    Stalled(#[from] Stalled),
}

/// Why a role ended early.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RoleFailure {
    /// It cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// It did not find the others.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// A link takes nothing more.
    #[error(transparent)]
    Send(#[from] SendError),
    /// A link brings nothing more.
    #[error(transparent)]
    Receive(#[from] RecvError),
    /// A peer broke the order of messages.
    #[error(transparent)]
    Order(#[from] OrderError),
    /// Ids are missing where all were promised.
    #[error("{frame} arrived incomplete")]
    Incomplete {
        /// The frame.
        frame: FrameNumber,
    },
}

/// Runs a session.
///
/// # Errors
/// When a role fails, for instance because a link falls silent for longer than links are patient.
pub fn simulate(scenario: &Scenario) -> Result<Outcome, SimulateError> {
    session(scenario, None)
}

/// Runs a session and writes all its packets into `out`, as pcapng.
///
/// # Errors
/// As [`simulate`], and when `out` does not take them.
pub fn simulate_captured(scenario: &Scenario, out: Box<dyn Write + Send>) -> Result<Outcome, SimulateError> {
    session(scenario, Some(out))
}

fn session(scenario: &Scenario, capture: Option<Box<dyn Write + Send>>) -> Result<Outcome, SimulateError> {
    let Scenario { network, link, batch, frames, seed, workload, knobs } = scenario;
    let (topology, machines) = network.topology();
    let simulation = Simulation::new(&topology, *seed);
    if let Some(out) = capture {
        simulation.capture(out)?;
    }
    let place = |host: &str, options: &Options| -> Result<Place, SimulateError> {
        Ok(Place { endpoint: link.endpoint(host).parse::<Endpoint>()?, options: options.clone() })
    };
    let [first, second, third] = acquainted(knobs)?;
    let settings = Settings {
        size: PictureSize::new(1024, 1024)?,
        epsilon: EpsilonPx::new(2.0)?,
        batch: *batch,
        coding: knobs.coding,
        tester: TesterKind::Hzb,
        lockstep: true,
        few_pixels: false,
        frames: Some(*frames),
    };
    let stage = Stage::new(Arc::new(workload.clone()), *frames, *link == Transport::UdpDeadline);
    let net = |host| -> Arc<dyn Net> { Arc::new(simulation.net(host)) };
    let nets = [net(machines.first), net(machines.second), net(machines.display)];
    let pair = |seat, options: Options| {
        let places =
            place("display:7400", &options).and_then(|show| Ok((show, place("first:7401", &options)?)));
        let (stage, net) = (&stage, if seat == Seat::First { &nets[0] } else { &nets[1] });
        places.map(|(show, meet)| async move { pair_role(net, stage, seat, &show, &meet).await })
    };
    let (first, second) = (pair(Seat::First, first)?, pair(Seat::Second, second)?);
    let listen = place("display:7400", &third)?;
    let show = display_role(&simulation, &nets[2], &stage, &listen, settings, machines);
    let (first, second, counted) = simulation.run(async { tokio::join!(first, second, show) })?;
    simulation.end_capture()?;
    let failed = |role, cause: RoleFailure| SimulateError::Role {
        role,
        network: network.name.clone(),
        link: link.name(),
        cause: Box::new(cause),
    };
    // Whoever fails first takes the others with it: they hear only of a lost link.
    for (role, ended) in [("pair's first machine", first), ("pair's second machine", second)] {
        ended.map_err(|cause| failed(role, cause))?;
    }
    let (sent, before) = counted.map_err(|cause| failed("display", cause))?;
    let (times, remains) =
        stage.log(|log| (std::mem::take(&mut log.times), std::mem::take(&mut log.remains)));
    let account = Account { sessions: 1, frames: *frames, sent, before };
    Ok(Outcome::new(scenario, Ended { times, remains, account, trace_hash: simulation.trace_hash() }))
}

async fn pair_role(
    net: &Arc<dyn Net>,
    stage: &Stage,
    seat: Seat,
    show: &Place,
    meet: &Place,
) -> Result<(), RoleFailure> {
    let deadline = net.now().after(PATIENCE);
    let mut joined = join_session(net, seat, SCENE, show, meet, deadline).await?;
    stage.log(|log| log.stats.extend([joined.display.stats.clone(), joined.other.stats.clone()]));
    switch(net, stage, seat, &mut joined).await?;
    leave([joined.display, joined.other]).await;
    Ok(())
}

async fn display_role(
    simulation: &Simulation,
    net: &Arc<dyn Net>,
    stage: &Stage,
    place: &Place,
    settings: Settings,
    machines: Machines,
) -> Result<(Sent, u64), RoleFailure> {
    let identity = Identity { role: Role::Display, scene: SCENE, settings: Some(settings) };
    let listener = Listener::bind(net, &place.endpoint, identity, &place.options).await?;
    let mut links = await_pair(listener, net.now().after(PATIENCE)).await?;
    let handles: Vec<_> = links.iter().map(|link| link.stats.clone()).collect();
    sleep_until(&**net, net.now().after(PAUSE)).await;
    stage.log(|log| log.stats.extend(handles));
    let before = count(simulation, stage, machines);
    display(net, stage, &mut links).await?;
    let handshakes = before.bytes();
    let sent = count(simulation, stage, machines) - before;
    leave(links).await;
    Ok((sent, handshakes))
}

/// What was sent so far: by the links' own count, and on the wire by what it was for.
fn count(simulation: &Simulation, stage: &Stage, machines: Machines) -> Sent {
    let Machines { first, second, display } = machines;
    let hosts: [HostId; 3] = [first, second, display];
    let mut sent = Sent::default();
    for from in hosts {
        for to in hosts {
            for (class, tally) in simulation.sent_by_class(from, to) {
                sent.add_packets(class, tally);
            }
        }
    }
    sent.messages = stage.log(|log| {
        log.stats.iter().map(|stats| stats.read().sent).fold(Traffic::default(), |all, sent| all + sent)
    });
    sent
}

/// Options of three machines that know each other.
fn acquainted(knobs: &Knobs) -> Result<[Options; 3], SimulateError> {
    let keys = |name: &str| -> Result<Keys, SimulateError> { Ok(Keys::generate(name.parse()?)?) };
    let all = [keys("first")?, keys("second")?, keys("display")?];
    let peers: Vec<_> = all.iter().map(|keys| keys.public().clone()).collect();
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
