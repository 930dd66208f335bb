//! QUIC as real links use it, in virtual time: the conformance suite, exact times, and reproducible runs.

use std::time::Duration;

use trimaran_netsim::Simulation;
use trimaran_netsim::link::{Conditions, LinkModel, Loss, Phase, Probability};
use trimaran_transport::conformance::{Overhead, Pairs, finished};
use trimaran_transport::{Instant, LinkConfig, sleep_until};

use crate::hosts::{Link, Machines, acquainted};

fn machines(link: &LinkModel, seed: u64) -> (Simulation, Machines) {
    machines_between(link, link, seed)
}

fn machines_between(way: &LinkModel, back: &LinkModel, seed: u64) -> (Simulation, Machines) {
    let overhead = Overhead { header_bytes: 4, handshake: 1, coded: true };
    Machines::joined([way, back], seed, "quic", overhead, acquainted())
}

connection_in_virtual_time!(machines);

#[test]
fn a_handshake_takes_whole_round_trips() {
    // Without a rate all time is delay.
    for delay in [Duration::from_micros(5), Duration::from_micros(50), Duration::from_millis(20)] {
        let (simulation, machines) = machines(&LinkModel::clean(None, delay), 1);
        simulation.run(machines.pair(LinkConfig::default())).unwrap();
        // Three round trips: address validation; keys; the hello and its answer.
        assert_eq!(simulation.now().as_nanos(), 6 * delay.as_nanos() as u64);
    }
}

#[test]
fn who_leaves_waits_half_a_second_for_a_peer_that_has_left_and_cannot_tell_what_has_arrived() {
    let clean = LinkModel::clean(None, Duration::from_millis(5));
    let nothing = Loss::Independent(Probability::new(1.0).unwrap());
    let conditions = Conditions { loss: nothing, ..clean.conditions };
    let cut = LinkModel { phases: vec![Phase { at: Duration::from_secs(1), conditions }], ..clean.clone() };
    let (simulation, machines) = machines_between(&cut, &clean, 1);
    let took = simulation.run(async {
        let (arm, panel) = machines.pair(LinkConfig::default()).await;
        sleep_until(&*machines.net(), Instant::from_nanos(2_000_000_000)).await;
        // It hears nothing, and nothing tells it that its own close has arrived.
        let Link { frames_tx, latest_tx, messages_tx, bulk, .. } = panel;
        let trimaran_transport::Bulk { tx: bulk_tx, rx: _bulk_rx } = bulk.unwrap();
        let left = async {
            tokio::join!(
                frames_tx.close(finished()),
                latest_tx.close(finished()),
                messages_tx.close(finished()),
                bulk_tx.close(finished())
            )
        };
        tokio::select! {
            said = arm.close(finished()) => said.unwrap(),
            left = left => panic!("nobody can have answered it: {left:?}"),
        }
        machines.net().now().since(Instant::from_nanos(2_000_000_000))
    });
    // Its close takes 5 ms; quinn's last packet leaves at once.
    let (least, most) = (Duration::from_millis(505), Duration::from_millis(510));
    let took = took.unwrap();
    assert!((least..most).contains(&took), "{took:?}");
}
