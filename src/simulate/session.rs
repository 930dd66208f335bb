//! The three roles on the simulated network, and counting what they send.

use std::io::Write;
use std::sync::Arc;
use std::time::Duration;

use trimaran_actors::CullerIndex;
use trimaran_netsim::{HostId, Machines, Simulation};
use trimaran_transport::Net;

use super::bytes::{Account, Sent};
use super::error::SimulateError;
use super::outcome::{Ended, Outcome};
use super::roles::Roles;
use super::scenario::Scenario;

/// Links run on tokio, which counts time in milliseconds; what roles compute ends at any time.
const TIMER_GRAIN: Duration = Duration::from_millis(1);

/// Runs a session.
///
/// # Errors
/// When a role fails, for instance because a link is silent for longer than its timeout.
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
    let roles = Roles::new(scenario)?;
    let hosts = [machines.first, machines.second, machines.display];
    let clocks = hosts.map(|host| -> Arc<dyn Net> { Arc::new(simulation.net(host)) });
    let nets =
        hosts.map(|host| -> Arc<dyn Net> { Arc::new(simulation.net(host).with_timer_grain(TIMER_GRAIN)) });
    let count = || sent(&simulation, &roles, machines);
    let (first, second, counted) = simulation.run(async {
        tokio::join!(
            roles.culler(CullerIndex::First, &nets[0], &clocks[0]),
            roles.culler(CullerIndex::Second, &nets[1], &clocks[1]),
            roles.display(&nets[2], &clocks[2], count, shown),
        )
    })?;
    simulation.end_capture()?;
    // Whoever fails first takes the others with it: they hear only of a lost link.
    for (role, ended) in [("first culler", first), ("second culler", second)] {
        ended.map_err(|cause| roles.failed(role, cause))?;
    }
    let (before, after) = counted.map_err(|cause| roles.failed("display", cause))?;
    let handshakes = before.bytes();
    let account = Account { sessions: 1, frames: scenario.frames, sent: after - before, before: handshakes };
    let (times, remains) = roles.take_log();
    Ok(Outcome::new(scenario, Ended { times, remains, account, trace_hash: simulation.trace_hash() }))
}

/// What was sent so far: by the links' own count, and on the wire by what it was for.
fn sent(simulation: &Simulation, roles: &Roles, machines: Machines) -> Sent {
    let Machines { first, second, display } = machines;
    let hosts: [HostId; 3] = [first, second, display];
    let mut sent = Sent { messages: roles.messages(), ..Sent::default() };
    for from in hosts {
        for to in hosts {
            for (class, tally) in simulation.sent_by_class(from, to) {
                sent.add_packets(class, tally);
            }
        }
    }
    sent
}
