//! The three roles on the simulated network, and counting what they send.

use std::io::Write;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_actors::{JoinError, OrderError, Seat};
use trimaran_netsim::{CaptureError, HostId, Machines, Simulation, Stalled};
use trimaran_proto::{FrameNumber, SettingsError};
use trimaran_transport::keys::KeysError;
use trimaran_transport::{EndpointError, EndpointFault, ListenError, Net, RecvError, SendError};

use super::bytes::{Account, Sent};
use super::outcome::Ended;
use super::{Cast, Outcome, Scenario};

/// Links run on tokio, which counts time in milliseconds; what roles compute ends at any time.
const TIMER_GRAIN: Duration = Duration::from_millis(1);

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
    /// The machines never got a link over this network.
    #[error(
        "nothing gets through {network} over {link}: look at its keys rate, loss, queue and mtu (quic and udp begin with packets of 1228 bytes)"
    )]
    NoLink {
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
    simulate_watched(scenario, None, || ())
}

/// Runs a session, writes all its packets into `capture`, as pcapng, and calls `shown` after each picture.
///
/// # Errors
/// As [`simulate`], and when `capture` does not take them.
pub fn simulate_watched(
    scenario: &Scenario,
    capture: Option<Box<dyn Write + Send>>,
    shown: impl Fn(),
) -> Result<Outcome, SimulateError> {
    let (topology, machines) = scenario.network.topology();
    let simulation = Simulation::new(&topology, scenario.seed);
    if let Some(out) = capture {
        simulation.capture(out)?;
    }
    let cast = Cast::new(scenario)?;
    let hosts = [machines.first, machines.second, machines.display];
    let clocks = hosts.map(|host| -> Arc<dyn Net> { Arc::new(simulation.net(host)) });
    let nets =
        hosts.map(|host| -> Arc<dyn Net> { Arc::new(simulation.net(host).with_timer_grain(TIMER_GRAIN)) });
    let count = || sent(&simulation, &cast, machines);
    let (first, second, counted) = simulation.run(async {
        tokio::join!(
            cast.switch(Seat::First, &nets[0], &clocks[0]),
            cast.switch(Seat::Second, &nets[1], &clocks[1]),
            cast.display(&nets[2], &clocks[2], count, shown),
        )
    })?;
    simulation.end_capture()?;
    // Whoever fails first takes the others with it: they hear only of a lost link.
    for (role, ended) in [("pair's first machine", first), ("pair's second machine", second)] {
        ended.map_err(|cause| cast.failed(role, cause))?;
    }
    let (before, after) = counted.map_err(|cause| cast.failed("display", cause))?;
    let handshakes = before.bytes();
    let account = Account { sessions: 1, frames: scenario.frames, sent: after - before, before: handshakes };
    let (times, remains) = cast.take_log();
    Ok(Outcome::new(scenario, Ended { times, remains, account, trace_hash: simulation.trace_hash() }))
}

/// What was sent so far: by the links' own count, and on the wire by what it was for.
fn sent(simulation: &Simulation, cast: &Cast, machines: Machines) -> Sent {
    let Machines { first, second, display } = machines;
    let hosts: [HostId; 3] = [first, second, display];
    let mut sent = Sent { messages: cast.messages(), ..Sent::default() };
    for from in hosts {
        for to in hosts {
            for (class, tally) in simulation.sent_by_class(from, to) {
                sent.add_packets(class, tally);
            }
        }
    }
    sent
}
