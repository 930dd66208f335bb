//! Two ends in virtual time, over a network that loses, duplicates, delays and breaks.

mod changes;
mod channels;
mod coded;
mod lossy;
mod moving;
mod network;
mod paused;
mod records;
mod sizes;
mod talk;

use std::time::Duration;

use proptest::prelude::*;
use trimaran_net::Instant;
use trimaran_udp::{Closed, Config, Connection, MIN_DATAGRAM};
use trimaran_wire::BatchSize;

use network::{CLEAN, Network, ONE_WAY, Pair, SEALED};
use talk::{DEADLINE, RELIABLE, Reader, Sender, config, converse, deliver, items, of_sizes, stream, value};

#[test]
fn a_frame_takes_one_trip_and_nothing_is_sent_twice_on_a_clean_path() {
    let pair = deliver(CLEAN, config(), &[2000]);
    assert_eq!(pair.ends[0].stats().lost, 0);
    assert!(pair.sent <= 14, "{} packets for 8 kB", pair.sent);
}

#[test]
fn the_handshake_shows_both_ends_how_long_a_round_trip_takes() {
    let mut pair = Pair::new(SEALED, RELIABLE);
    let round_trips = |pair: &Pair| pair.ends.each_ref().map(|end| end.stats().round_trip);
    assert_eq!(
        round_trips(&pair),
        [2 * ONE_WAY, Duration::from_millis(100)],
        "the listener has heard nothing"
    );
    pair.ends[0].ping();
    pair.step(Instant::from_nanos(0).after(ONE_WAY));
    // The answer took no time here.
    assert_eq!(round_trips(&pair), [2 * ONE_WAY, ONE_WAY]);
}

#[test]
fn frames_of_every_size_arrive() {
    for batch in [1, 10, 256, 16_384] {
        let config = Config { batch: BatchSize::new(batch).unwrap(), ..config() };
        deliver(CLEAN, config, &[0, 1, batch - 1, batch, batch + 1, 4000, 200_000]);
    }
}

#[test]
fn more_than_the_window_passes() {
    let config = Config { window: 64 << 10, send_buffer: 32 << 10, ..config() };
    deliver(Network { loss: 20, ..CLEAN }, config, &[100_000, 0, 50_000]);
}

#[test]
fn more_units_than_may_be_under_way_pass() {
    deliver(Network { loss: 20, ..CLEAN }, config(), &[0; 3000]);
}

#[test]
fn the_last_value_arrives_although_nothing_follows() {
    let mut pair = Pair::new(Network { loss: 500, ..CLEAN }, config());
    pair.ends[0].publish(None, value(7));
    let end = Instant::from_nanos(0).after(Duration::from_secs(19));
    let mut read = None;
    while read.is_none() && pair.step(end) {
        read = pair.ends[1].latest(None);
    }
    assert_eq!(read, Some(value(7)));
}

#[test]
fn a_dead_path_ends_after_the_idle_timeout_and_a_live_one_does_not() {
    let idle_timeout = Duration::from_secs(2);
    let end = Instant::from_nanos(0).after(Duration::from_secs(60));
    let mut pair = Pair::new(CLEAN, config());
    pair.ends.iter_mut().for_each(|end| end.set_idle_timeout(idle_timeout));
    while pair.step(end) {}
    assert_eq!(pair.ends[0].closed(), None);
    pair.network.loss = 1000;
    while pair.step(end.after(idle_timeout * 2)) {}
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Silent(idle_timeout)));
}

#[test]
fn a_close_is_told_and_ends_the_other_side() {
    let mut pair = Pair::new(CLEAN, config());
    pair.ends[0].close();
    while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Here));
    assert_eq!(pair.ends[1].closed(), Some(&Closed::Peer));
    let shown = "Connection { here: ConnectionId(2), there: ConnectionId(1), closed: Some(Peer), .. }";
    assert_eq!(format!("{:?}", pair.ends[1]), shown);
}

#[test]
fn sealed_frames_arrive_although_losses_come_in_bursts() {
    let pair = deliver(Network { bursts: 10, ..SEALED }, config(), &[0, 200_000, 1, 100_000]);
    assert!(pair.burst_losses >= 10, "{} lost", pair.burst_losses);
    assert!(pair.ends[0].stats().lost > 0);
}

#[test]
fn sealed_packets_fill_the_narrowest_path_and_no_more() {
    let config = Config { max_datagram: MIN_DATAGRAM, ..config() };
    let pair = deliver(SEALED, config, &[20_000]);
    assert!((MIN_DATAGRAM - 36..=MIN_DATAGRAM).contains(&pair.longest), "{} bytes", pair.longest);
    let mut narrow = Pair::new(Network { mtu: pair.longest - 1, ..SEALED }, config);
    let mut reader = Reader::default();
    Sender::new(config).send(&mut narrow.ends[0], 0, &items(20_000));
    let end = Instant::from_nanos(0).after(Duration::from_secs(60));
    while narrow.step(end) {
        reader.read(&mut narrow.ends[1]);
    }
    assert!(reader.frames.is_empty() && !narrow.ends[0].is_drained(), "the path is narrower");
}

#[test]
fn a_lost_close_is_told_again_to_who_goes_on() {
    for network in [CLEAN, SEALED] {
        let mut pair = Pair::new(Network { loss: 1000, ..network }, config());
        pair.ends[0].close();
        pair.ends[0].close();
        pair.transmit();
        assert_eq!(pair.sent, 1, "two calls, one packet");
        pair.network.loss = 0;
        pair.ends[1].publish(None, value(1));
        while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
        assert_eq!(pair.ends[1].closed(), Some(&Closed::Peer));
        assert_eq!(pair.sent, 3, "the value and one more close");
        assert_eq!(pair.ends[0].closed(), Some(&Closed::Here));
    }
}

#[test]
fn closes_that_cross_are_not_answered() {
    let mut pair = Pair::new(SEALED, config());
    pair.ends.iter_mut().for_each(Connection::close);
    while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
    assert_eq!((pair.sent, pair.flying.len()), (2, 0));
}

#[test]
fn a_clean_path_costs_no_repair_and_no_gaps() {
    for config in [RELIABLE, DEADLINE] {
        let (pair, reader) = stream(SEALED, config, 2);
        assert_eq!(reader.gaps, []);
        assert_eq!((pair.ends[0].stats().lost, pair.ends[1].stats().frames_repaired), (0, 0));
        let least = 120 * 16_080;
        assert!(pair.bytes[0] < least * 106 / 100, "{} bytes for {least}", pair.bytes[0]);
    }
}

#[test]
fn both_ends_count_what_became_of_their_packets() {
    let (pair, _) = stream(Network { loss: 10, ..SEALED }, RELIABLE, 10);
    let [sender, receiver] = pair.ends.each_ref().map(Connection::stats);
    assert_eq!(sender.sent_bytes, pair.bytes[0]);
    assert!(sender.sent > receiver.received && sender.sent_bytes > receiver.received_bytes);
    let arrived = receiver.received as f64 / sender.sent as f64;
    assert!((0.98..0.995).contains(&arrived), "{arrived} of the packets, where one in a hundred is lost");
    let gone = sender.sent - receiver.received;
    // The last losses are not detected yet, and packets that only acknowledge are not tracked.
    assert!(sender.lost <= gone && sender.lost * 10 >= gone * 8, "{} of {gone} found lost", sender.lost);
    assert!(sender.repeated > 0 && sender.repeated <= sender.lost + sender.probes, "{sender:?}");
    assert!(sender.repair_sent >= receiver.frames_repaired, "{sender:?}");
    assert!((1200..=pair.longest).contains(&sender.datagram_size), "{sender:?}");
    let round_trip = sender.round_trip.as_millis();
    assert!((10..15).contains(&round_trip), "{round_trip} ms");
    assert!(sender.window >= 10 * 1200, "{sender:?}");
}

#[test]
fn what_cannot_arrive_in_time_is_given_up_and_the_rest_is_passed_on() {
    let config = Config { repair_percent: 0, frame_deadline: Some(Duration::from_millis(9)), ..RELIABLE };
    let (pair, reader) = stream(Network { loss: 10, ..SEALED }, config, 5);
    // A round trip takes 10 ms, so retransmissions are too late.
    assert!(reader.gaps.len() > 10, "{} frames with gaps", reader.gaps.len());
    assert!(pair.ends[0].stats().frames_given_up >= reader.gaps.len() as u64);
    let missing: usize =
        reader.gaps.iter().map(|(at, expected)| *expected as usize - reader.frames[*at].len()).sum();
    assert!(
        missing < reader.gaps.len() * 900,
        "{missing} items in {} frames: packets of them",
        reader.gaps.len()
    );

    let (_, patient) = stream(Network { loss: 10, ..SEALED }, DEADLINE, 5);
    assert_eq!(patient.gaps, [], "two round trips are enough");
}

#[test]
fn a_deadline_before_anything_can_have_come_is_known_once_the_way_was_measured() {
    let hopeless = |frame_deadline| {
        let config = Config { frame_deadline, ..RELIABLE };
        assert_eq!(Pair::new(SEALED, config).ends[0].deadline_too_short(), None, "nothing was measured");
        let end = &stream(SEALED, config, 2).0.ends[0];
        assert_eq!(end.stats().deadline_too_short, end.deadline_too_short().is_some());
        end.deadline_too_short()
    };
    let found = hopeless(Some(Duration::from_millis(4))).unwrap();
    assert_eq!(found.deadline, Duration::from_millis(4));
    assert!((ONE_WAY..ONE_WAY + Duration::from_millis(1)).contains(&found.way), "{found:?}");
    assert!(hopeless(Some(found.way)).is_some(), "nothing leaves before it is to be there");
    assert_eq!((hopeless(Some(Duration::from_millis(6))), hopeless(None)), (None, None));
}

/// Nothing is acknowledged, so the window stays at its initial size.
#[test]
fn no_more_is_under_way_than_the_congestion_window_allows() {
    let mut pair = Pair::new(CLEAN, config());
    pair.deaf = true;
    Sender::new(config()).send(&mut pair.ends[0], 0, &items(100_000));
    let end = pair.now.after(Duration::from_secs(10));
    while pair.ends[0].stats().probes == 0 {
        assert!(pair.step(end), "nothing is found missing");
        let stats = pair.ends[0].stats();
        assert!(stats.in_flight <= stats.window, "{stats:?}");
    }
    assert!(pair.ends[0].stats().in_flight > 10_000, "{:?}", pair.ends[0].stats());
}

/// The congestion window is wide, and nothing is acknowledged.
#[test]
fn values_that_newer_ones_replace_wait_in_their_place_and_fill_no_memory() {
    let config = Config { window: 1 << 20, initial_window: u16::MAX, ..RELIABLE };
    let mut pair = Pair::new(CLEAN, config);
    pair.deaf = true;
    for number in 0..10_000 {
        pair.ends[0].publish(None, value(number));
        pair.now = pair.now.after(Duration::from_micros(100));
        pair.transmit();
    }
    let sent = pair.ends[0].stats().sent;
    assert!((1024..=1747).contains(&sent), "{sent} packets: two windows of full ones are 1,747");
    pair.deaf = false;
    while !pair.ends[0].is_drained() {
        assert!(pair.step(Instant::from_nanos(0).after(Duration::from_secs(19))));
    }
    assert_eq!(pair.ends[1].latest(None), Some(value(9_999)));
}

#[test]
fn a_wider_path_is_found_and_a_narrower_one_too() {
    let (pair, _) = stream(Network { mtu: 1500, ..SEALED }, RELIABLE, 2);
    assert_eq!((pair.ends[0].stats().datagram_size, pair.longest), (1452, 1452));
    let (mut pair, _) = stream(Network { mtu: 1300, ..SEALED }, RELIABLE, 2);
    assert!(
        (1285..=1300).contains(&pair.ends[0].stats().datagram_size),
        "{}",
        pair.ends[0].stats().datagram_size
    );
    assert_eq!(pair.ends[0].stats().lost, 0, "lost probes are no losses");
    pair.network.mtu = 1200;
    Sender::new(RELIABLE).send(&mut pair.ends[0], 10_000, &items(4000));
    let end = pair.now.after(Duration::from_secs(19));
    while !pair.ends[0].is_drained() {
        assert!(pair.step(end), "{:?}", pair.ends);
    }
    assert_eq!(pair.ends[0].stats().datagram_size, 1200);
}

#[test]
fn a_peer_that_acknowledges_nothing_is_given_up_and_costs_no_more() {
    let idle_timeout = Duration::from_secs(5);
    let config = Config { idle_timeout, ..config() };
    let mut pair = Pair::new(CLEAN, config);
    pair.deaf = true;
    pair.ends[0].publish(None, value(0));
    // It goes on to send, so it is not silent.
    let mut frame = 0;
    while pair.ends[0].closed().is_none()
        && pair.step_until(pair.now.after(Duration::from_millis(100)), Instant::from_nanos(u64::MAX))
    {
        frame += 1;
        pair.ends[1].publish(None, value(frame));
        assert!(pair.now < Instant::from_nanos(0).after(idle_timeout * 2));
    }
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Deaf(idle_timeout)));
    assert_eq!(pair.now, Instant::from_nanos(0).after(idle_timeout), "not before");
}

/// The last of it may come a moment after the first packet that it has not acknowledged.
#[test]
fn a_peer_that_falls_silent_counts_as_silent_although_it_acknowledged_nothing() {
    let idle_timeout = Duration::from_secs(5);
    let config = Config { idle_timeout, ..config() };
    let mut pair = Pair::new(CLEAN, config);
    pair.deaf = true;
    pair.ends[0].publish(None, value(0));
    pair.step_until(pair.now.after(Duration::from_millis(100)), Instant::from_nanos(u64::MAX));
    pair.ends[1].publish(None, value(1));
    pair.step_until(pair.now.after(Duration::from_millis(100)), Instant::from_nanos(u64::MAX));
    assert_eq!(pair.ends[0].latest(None), Some(value(1)));
    pair.network.loss = 1000;
    let end = pair.now.after(idle_timeout * 2);
    while pair.ends[0].closed().is_none() && pair.step(end) {}
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Silent(idle_timeout)));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn every_frame_arrives_once_in_order_whatever_the_network_does(
        loss in 0u64..200, twice in 0u64..200, late in 0u64..300, broken in 0u64..100,
        bursts in prop::sample::select(vec![0u64, 10]), sealed: bool, seed: u64, repair_percent in 0u8..60,
        sizes in prop::collection::vec(0u32..6000, 1..12),
    ) {
        let config = Config { repair_percent, ..config() };
        deliver(Network { loss, twice, late, broken, bursts, sealed, seed, ..CLEAN }, config, &sizes);
    }

    #[test]
    fn with_deadlines_every_frame_ends_whole_or_with_known_gaps(
        loss in 0u64..300, twice in 0u64..200, late in 0u64..300, broken in 0u64..100,
        bursts in prop::sample::select(vec![0u64, 10]), sealed: bool, seed: u64, frame_deadline in 1u64..80, repair_percent in 0u8..60,
        mtu in 1200usize..1460, pause in 0u64..20,
        sizes in prop::collection::vec(0u32..6000, 1..12),
    ) {
        let network = Network { loss, twice, late, broken, bursts, sealed, seed, mtu };
        let config = Config { frame_deadline: Some(Duration::from_millis(frame_deadline)), repair_percent, ..RELIABLE };
        let (pair, reader) = converse(network, config, &of_sizes(&sizes), Duration::from_millis(pause));
        if loss + broken + bursts == 0 && late == 0 && frame_deadline > 70 {
            prop_assert_eq!(reader.gaps, []);
        }
        prop_assert!(pair.ends[0].is_drained());
    }

    #[test]
    fn a_strangers_bytes_change_nothing(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let mut pair = Pair::new(CLEAN, config());
        pair.ends[0].handle(pair.now, &bytes);
        let mut out = Vec::new();
        prop_assert!(!pair.ends[0].poll_transmit(pair.now, &mut out));
        prop_assert_eq!(pair.ends[0].closed(), None);
    }
}
