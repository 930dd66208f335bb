//! Ends that migrate while they talk, and attackers that pretend to be them.

use std::net::SocketAddr;
use std::time::Duration;

use proptest::prelude::*;
use trimaran_net::Instant;
use trimaran_udp::Connection;

use super::network::{Network, ONE_WAY, Pair, SEALED, address};
use super::talk::{RELIABLE, Reader, Sender, items, value};

const FRAME: Duration = Duration::from_micros(16_667);
const MACHINE: usize = 0;
const DISPLAY: usize = 1;

/// A machine that sends sixty frames a second and a display that sends as many values.
struct Travel {
    pair: Pair,
    sender: Sender,
    reader: Reader,
    frame: u32,
    next: Instant,
}

impl Travel {
    fn begin() -> Self {
        let mut pair = Pair::new(Network { mtu: 1500, ..SEALED }, RELIABLE);
        for end in [MACHINE, DISPLAY] {
            pair.ends[end].follow(pair.at[1 - end], [1 + end as u8; 32]);
        }
        let (sender, reader, next) = (Sender::new(RELIABLE), Reader::default(), pair.now);
        Self { pair, sender, reader, frame: 0, next }
    }

    fn remote(&self, end: usize) -> Option<SocketAddr> {
        self.pair.ends[end].remote()
    }

    /// Runs for this time; new frames and values come if they `talk`.
    fn go_on(&mut self, span: Duration, talk: bool) {
        let end = self.pair.now.after(span);
        while self.pair.now < end {
            if talk && self.pair.now >= self.next {
                self.next = self.pair.now.after(FRAME);
                self.pair.ends[DISPLAY].publish(None, value(self.frame));
                self.reader.begun.push(self.pair.now);
                self.sender.send(&mut self.pair.ends[MACHINE], self.frame, &items(4000));
                self.frame += 1;
            }
            self.pair.step_until(if talk { self.next.min(end) } else { end }, end);
            assert_eq!(self.pair.ends.each_ref().map(Connection::closed), [None, None]);
            self.reader.now = self.pair.now;
            self.reader.read(&mut self.pair.ends[DISPLAY]);
        }
    }

    /// They talk for a second.
    fn talk(&mut self) {
        self.go_on(Duration::from_secs(1), true);
    }

    /// Lets packets in flight arrive; all frames must have come completely. Returns the longest time of one.
    fn settle(&mut self) -> Duration {
        while !self.pair.ends.iter().all(Connection::is_drained) {
            assert!(self.pair.now.since(self.next) < Duration::from_secs(60), "{:?}", self.pair.ends);
            self.go_on(Duration::from_millis(10), false);
        }
        assert_eq!(self.reader.frames.len(), self.frame as usize);
        assert!(self.reader.frames.iter().all(|frame| *frame == items(4000)));
        assert_eq!(self.pair.ends[MACHINE].latest(None), Some(value(self.frame - 1)));
        *self.reader.latencies().last().unwrap()
    }
}

#[test]
fn frames_go_on_after_a_moment_when_either_end_gets_another_address() {
    for (who, there) in [
        (DISPLAY, address(2, 6000)),
        (DISPLAY, address(3, 5000)),
        (MACHINE, address(1, 8000)),
        (MACHINE, address(4, 7400)),
    ] {
        let mut travel = Travel::begin();
        travel.talk();
        let before = travel.settle();
        travel.talk();
        travel.pair.at[who] = there;
        travel.talk();
        assert_eq!(travel.remote(1 - who), Some(there));
        let longest = travel.settle();
        // A frame, the challenge, the response, and the frame again, behind others that waited too.
        assert!(longest < before + Duration::from_millis(80), "{longest:?}, before {before:?}");
    }
}

#[test]
fn both_ends_may_move_one_after_the_other_and_back() {
    let mut travel = Travel::begin();
    let home = travel.pair.at;
    for (who, there) in [
        (DISPLAY, address(3, 1)),
        (MACHINE, address(4, 1)),
        (DISPLAY, home[DISPLAY]),
        (MACHINE, home[MACHINE]),
    ] {
        travel.talk();
        travel.pair.at[who] = there;
    }
    travel.talk();
    travel.settle();
    assert_eq!([DISPLAY, MACHINE].map(|end| travel.remote(end)), home.map(Some));
}

#[test]
fn another_address_is_another_path_and_another_port_is_not() {
    for (there, known) in [(address(2, 6000), true), (address(3, 5000), false)] {
        let mut travel = Travel::begin();
        travel.talk();
        let before = travel.pair.ends[MACHINE].stats();
        assert!(before.window > 12_000 && before.datagram_size == 1452, "{before:?}");
        travel.pair.at[DISPLAY] = there;
        while travel.remote(MACHINE) != Some(there) {
            travel.go_on(Duration::from_millis(1), false);
            travel.pair.ends[DISPLAY].ping();
        }
        let after = travel.pair.ends[MACHINE].stats();
        assert_eq!(after.lost, before.lost, "a move is no loss of the path's");
        if known {
            assert_eq!((after.window, after.datagram_size), (before.window, 1452));
        } else {
            assert_eq!((after.window, after.datagram_size), (24_000, 1200));
            assert_eq!(after.round_trip, Duration::from_millis(100), "not measured");
        }
    }
}

#[test]
fn who_repeats_packets_from_elsewhere_gets_few_and_leads_nobody_astray() {
    let mut travel = Travel::begin();
    travel.talk();
    let before = travel.settle();
    let (victim, home) = (address(66, 6), travel.pair.at[DISPLAY]);
    // The copies come first, so the genuine packets count as repeated.
    travel.pair.echo = Some(victim);
    let received = travel.pair.ends[MACHINE].stats().received_bytes;
    travel.talk();
    let copied = travel.pair.ends[MACHINE].stats().received_bytes - received;
    travel.pair.echo = None;
    let longest = travel.settle();
    assert_eq!(travel.remote(MACHINE), Some(home));
    assert!(longest <= before + Duration::from_millis(1), "{longest:?}, before {before:?}");
    let got = travel.pair.astray[&victim] as u64;
    assert!(got > 0 && got <= 3 * copied && got <= 6 * 1200, "{got} bytes for {copied}");
}

#[test]
fn an_old_packet_from_elsewhere_leads_nowhere() {
    let mut travel = Travel::begin();
    let (elsewhere, machine) = (address(66, 6), travel.pair.at[MACHINE]);
    travel.talk();
    // A copy of a received packet, and a new packet that is not the newest.
    let mut late = Vec::new();
    travel.pair.ends[DISPLAY].publish(None, value(1000));
    assert!(travel.pair.ends[DISPLAY].poll_transmit(travel.pair.now, &mut late));
    travel.pair.ends[DISPLAY].ping();
    travel.go_on(Duration::from_millis(20), false);
    travel.pair.launch(elsewhere, machine, ONE_WAY, late.clone());
    travel.go_on(Duration::from_millis(20), false);
    assert_eq!(travel.pair.ends[MACHINE].latest(None), Some(value(1000)), "it counts, wherever it came from");
    travel.pair.launch(elsewhere, machine, ONE_WAY, late.clone());
    travel.go_on(Duration::from_secs(3), false);
    assert_eq!(travel.remote(MACHINE), Some(travel.pair.at[DISPLAY]));
    assert_eq!(travel.pair.astray.get(&elsewhere), None);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn every_frame_arrives_whoever_goes_wherever(
        moves in prop::collection::vec((0usize..2, 3u8..6, 1u16..3, 50u64..400), 1..4), loss in prop::sample::select(vec![0u64, 12, 25, 50]),
    ) {
        let mut travel = Travel::begin();
        travel.pair.network.loss = loss;
        for (who, host, port, ms) in moves {
            // Both at once would lose each other: neither is at the address that the other sends to.
            travel.go_on(Duration::from_millis(ms + 2500), true);
            travel.pair.at[who] = address(host + 4 * who as u8, port);
        }
        travel.talk();
        travel.settle();
        prop_assert_eq!(travel.remote(MACHINE), Some(travel.pair.at[DISPLAY]));
        prop_assert_eq!(travel.remote(DISPLAY), Some(travel.pair.at[MACHINE]));
    }
}
