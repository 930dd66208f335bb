//! The cost that a peer with the key can cause on this side: bounded by its packets.

use std::time::Duration;

use trimaran_udp::{STEPS_PER_BYTE, STEPS_PER_PACKET};

use crate::adversary::{Attack, Victim, attacks, frames_behind_one_that_never_arrives, ordinary};

/// The steps for each byte of the packets, less the allowance for packets as such; and whether the connection
/// is still open.
fn steps(victim: &mut Victim, packets: &[Vec<u8>]) -> f64 {
    let counts = |victim: &Victim| {
        let stats = victim.connection.stats();
        (victim.connection.work(), stats.received_bytes, stats.received + stats.sent)
    };
    let before = counts(victim);
    packets.iter().for_each(|packet| victim.take(packet));
    let after = counts(victim);
    let allowed = (after.2 - before.2) * STEPS_PER_PACKET;
    let bytes = (after.1 - before.1).max(1);
    (after.0 - before.0).saturating_sub(allowed) as f64 / bytes as f64
}

#[test]
fn no_byte_of_a_packet_costs_more_than_is_stated() {
    let mut dearest = 0.0_f64;
    for Attack { name, before, packets } in attacks(20_000) {
        let mut victim = Victim::new();
        let all = [before, packets].concat();
        let each = steps(&mut victim, &all);
        println!("{name}: {each:.1} steps a byte, {:?}", victim.connection.closed());
        assert!(each <= STEPS_PER_BYTE as f64, "{name}: {each} steps a byte");
        dearest = dearest.max(each);
    }
    assert!(dearest > STEPS_PER_BYTE as f64 / 4.0, "the bound says nothing: {dearest}");
}

#[test]
fn ordinary_frames_cost_a_step_a_byte() {
    let Attack { packets, .. } = ordinary(100, 4000);
    let each = steps(&mut Victim::new(), &packets);
    assert!((0.1..2.0).contains(&each), "{each} steps a byte");
}

#[test]
fn a_packet_costs_as_much_however_many_frames_wait_for_their_acknowledgement() {
    let cost = |frames| {
        let (mut victim, pings) = frames_behind_one_that_never_arrives(frames, 100);
        // The cost of timers is not a packet's.
        victim.now = victim.now.after(Duration::from_secs(1));
        victim.answer();
        let before = victim.connection.work();
        pings.iter().for_each(|packet| victim.take(packet));
        assert_eq!(victim.connection.closed(), None);
        victim.connection.work() - before
    };
    let (few, many) = (cost(10), cost(10_000));
    assert!(many <= few + 1000, "{many} steps where few frames wait take {few}");
}
