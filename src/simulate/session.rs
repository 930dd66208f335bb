//! Plays the roles on the simulated network, and counts their traffic.

use std::io::Write;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::join_all;
use trimaran_actors::{CullerId, Schedule};
use trimaran_netsim::{HostId, Simulation};
use trimaran_transport::Net;

use super::bytes::{Account, Sent};
use super::error::SimulateError;
use super::outcome::{Ended, Outcome};
use super::roles::Roles;
use super::scenario::Scenario;
use crate::session_hosts::SessionHosts;

/// Tokio counts time in milliseconds; the roles' computing may end at any time.
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
/// As [`simulate`], and when writing to `capture` fails.
pub fn simulate_watched(
    scenario: &Scenario,
    capture: Option<Box<dyn Write + Send>>,
    shown: impl Fn(),
) -> Result<Outcome, SimulateError> {
    let (topology, hosts) = SessionHosts::on(&scenario.network, scenario.cullers);
    if scenario.schedule == Schedule::Switch && scenario.cullers != 2 {
        return Err(SimulateError::Schedule(scenario.cullers));
    }
    let simulation = Simulation::new(&topology, scenario.seed);
    if let Some(out) = capture {
        simulation.capture(out)?;
    }
    let roles = Roles::new(scenario)?;
    let place = |host: &HostId| -> (Arc<dyn Net>, Arc<dyn Net>) {
        let net = simulation.net(*host).with_timer_grain(TIMER_GRAIN);
        (Arc::new(net), Arc::new(simulation.net(*host)))
    };
    let count = || sent(&simulation, &roles, &hosts);
    let places: Vec<_> = hosts.cullers.iter().map(place).collect();
    let (display_net, display_clock) = place(&hosts.display);
    let each = CullerId::first(places.len()).zip(&places);
    let (cullers, counted) = simulation.run(async {
        let mut cullers = pin!(join_all(each.map(|(id, (net, clock))| roles.culler(id, net, clock))));
        let mut display = pin!(roles.display(&display_net, &display_clock, count, shown));
        let mut ended = None;
        let counted = loop {
            tokio::select! {
                biased;
                counted = &mut display => break counted,
                all = &mut cullers, if ended.is_none() => ended = Some(all),
            }
        };
        // Cullers that no display ever found wait forever.
        match ended {
            None if counted.is_ok() => (cullers.await, counted),
            ended => (ended.unwrap_or_default(), counted),
        }
    })?;
    simulation.end_capture()?;
    let (before, after) = counted?;
    for ended in cullers {
        ended.map_err(|cause| roles.failed("culler", cause))?;
    }
    let handshakes = before.bytes();
    let account = Account { sessions: 1, frames: scenario.frames, sent: after - before, before: handshakes };
    let (times, remains) = roles.take_log();
    Ok(Outcome::new(scenario, Ended { times, remains, account, trace_hash: simulation.trace_hash() }))
}

/// The traffic so far: by the links' own count, and on the wire by kind.
fn sent(simulation: &Simulation, roles: &Roles, hosts: &SessionHosts) -> Sent {
    let hosts: Vec<HostId> = hosts.cullers.iter().copied().chain([hosts.display]).collect();
    let mut sent = Sent { messages: roles.messages(), ..Sent::default() };
    for from in &hosts {
        for to in &hosts {
            for (class, tally) in simulation.sent_by_class(*from, *to) {
                sent.add_packets(class, tally);
            }
        }
    }
    sent
}
