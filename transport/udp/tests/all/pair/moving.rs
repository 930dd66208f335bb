//! Ends that migrate while they talk, and attackers that pretend to be them.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::net::SocketAddr;
use std::time::Duration;

use proptest::prelude::*;
use trimaran_net::Instant;
use trimaran_udp::{Connection, ConnectionId};

use super::network::{ONE_WAY, introduce};
use super::talk::{RELIABLE, Reader, Sender, items, value};

const FRAME: Duration = Duration::from_micros(16_667);
const MACHINE: usize = 0;
const DISPLAY: usize = 1;

fn address(host: u8, port: u16) -> SocketAddr {
    ([10, 0, 0, host], port).into()
}

/// A packet in flight: its arrival, its order among equal arrivals, source, destination, bytes.
type Flight = (Instant, u64, SocketAddr, SocketAddr, Vec<u8>);

/// A machine that sends sixty frames a second and a display that sends as many values, 5 ms from each other.
struct Travel {
    now: Instant,
    ends: [Connection; 2],
    /// The address of each.
    at: [SocketAddr; 2],
    flying: BinaryHeap<Reverse<Flight>>,
    count: u64,
    /// One packet in so many is lost; none if it is 0.
    loss: u64,
    /// Bytes that arrived at addresses without an end.
    astray: BTreeMap<SocketAddr, usize>,
    /// The address of an attacker that repeats all packets of the display, faster than the network.
    echo: Option<SocketAddr>,
    sender: Sender,
    reader: Reader,
    frame: u32,
    next: Instant,
}

impl Travel {
    fn begin() -> Self {
        let now = Instant::from_nanos(0);
        let mut ends = introduce(now, ConnectionId(1), ConnectionId(2), RELIABLE);
        let at = [address(1, 7400), address(2, 5000)];
        ends[MACHINE].follow(at[DISPLAY], [1; 32]);
        ends[DISPLAY].follow(at[MACHINE], [2; 32]);
        let (flying, astray) = (BinaryHeap::new(), BTreeMap::new());
        let (sender, reader) = (Sender::new(RELIABLE), Reader::default());
        Self {
            now,
            ends,
            at,
            flying,
            count: 0,
            loss: 0,
            astray,
            echo: None,
            sender,
            reader,
            frame: 0,
            next: now,
        }
    }

    fn launch(&mut self, from: SocketAddr, to: SocketAddr, after: Duration, packet: &[u8]) {
        self.count += 1;
        self.flying.push(Reverse((self.now.after(after), self.count, from, to, packet.to_vec())));
    }

    fn send(&mut self, end: usize, to: SocketAddr, packet: &[u8]) {
        if let Some(echo) = self.echo.filter(|_| end == DISPLAY) {
            self.launch(echo, to, ONE_WAY / 2, packet);
        }
        // A fixed pattern without a period.
        let lost =
            self.loss > 0 && (self.count.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33).is_multiple_of(self.loss);
        if lost {
            self.count += 1;
        } else {
            self.launch(self.at[end], to, ONE_WAY, packet);
        }
    }

    fn transmit(&mut self) {
        let mut out = Vec::new();
        for end in [MACHINE, DISPLAY] {
            while self.ends[end].poll_transmit(self.now, &mut out) {
                let to = self.ends[end].remote().unwrap();
                self.send(end, to, &out);
            }
            while let Some(to) = self.ends[end].poll_excursion(self.now, &mut out) {
                assert!(out.len() <= 1200, "{} bytes", out.len());
                self.send(end, to, &out);
            }
        }
    }

    fn arrive(&mut self) {
        while self.flying.peek().is_some_and(|Reverse((at, ..))| *at <= self.now) {
            let Some(Reverse((_, _, from, to, packet))) = self.flying.pop() else { return };
            match self.at.iter().position(|at| *at == to) {
                Some(end) => self.ends[end].handle_from(self.now, from, &packet),
                None => *self.astray.entry(to).or_default() += packet.len(),
            }
        }
    }

    /// Runs for this time; new frames and values come if they `talk`.
    fn go_on(&mut self, span: Duration, talk: bool) {
        let end = self.now.after(span);
        while self.now < end {
            if talk && self.now >= self.next {
                self.next = self.now.after(FRAME);
                self.ends[DISPLAY].publish(value(self.frame));
                self.reader.begun.push(self.now);
                self.sender.send(&mut self.ends[MACHINE], self.frame, &items(4000));
                self.frame += 1;
            }
            self.transmit();
            let arrival = self.flying.peek().map(|Reverse((at, ..))| *at);
            let timers = self.ends.iter().filter_map(Connection::poll_timeout).chain(arrival);
            let next = timers.chain(talk.then_some(self.next)).min().map_or(end, |next| next.min(end));
            self.now = self.now.max(next);
            self.arrive();
            for connection in &mut self.ends {
                if connection.poll_timeout().is_some_and(|at| at <= self.now) {
                    connection.handle_timeout(self.now);
                }
                assert_eq!(connection.closed(), None);
            }
            self.reader.now = self.now;
            self.reader.read(&mut self.ends[DISPLAY]);
        }
    }

    /// They talk for a second.
    fn talk(&mut self) {
        self.go_on(Duration::from_secs(1), true);
    }

    /// Lets packets in flight arrive; all frames must have come completely. Returns the longest time of one.
    fn settle(&mut self) -> Duration {
        while !self.ends.iter().all(Connection::is_drained) {
            assert!(self.now.since(self.next) < Duration::from_secs(60), "{:?}", self.ends);
            self.go_on(Duration::from_millis(10), false);
        }
        assert_eq!(self.reader.frames.len(), self.frame as usize);
        assert!(self.reader.frames.iter().all(|frame| *frame == items(4000)));
        assert_eq!(self.ends[MACHINE].latest(), Some(value(self.frame - 1)));
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
        travel.at[who] = there;
        travel.talk();
        assert_eq!(travel.ends[1 - who].remote(), Some(there));
        let longest = travel.settle();
        // A frame, the challenge, the response, and the frame again, behind others that waited too.
        assert!(longest < before + Duration::from_millis(80), "{longest:?}, before {before:?}");
    }
}

#[test]
fn both_ends_may_move_one_after_the_other_and_back() {
    let mut travel = Travel::begin();
    let home = travel.at;
    for (who, there) in [
        (DISPLAY, address(3, 1)),
        (MACHINE, address(4, 1)),
        (DISPLAY, home[DISPLAY]),
        (MACHINE, home[MACHINE]),
    ] {
        travel.talk();
        travel.at[who] = there;
    }
    travel.talk();
    travel.settle();
    assert_eq!([DISPLAY, MACHINE].map(|end| travel.ends[end].remote()), home.map(Some));
}

#[test]
fn another_address_is_another_path_and_another_port_is_not() {
    for (there, known) in [(address(2, 6000), true), (address(3, 5000), false)] {
        let mut travel = Travel::begin();
        travel.talk();
        let before = travel.ends[MACHINE].stats();
        assert!(before.window > 12_000 && before.datagram_size == 1452, "{before:?}");
        travel.at[DISPLAY] = there;
        while travel.ends[MACHINE].remote() != Some(there) {
            travel.go_on(Duration::from_millis(1), false);
            travel.ends[DISPLAY].ping();
        }
        let after = travel.ends[MACHINE].stats();
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
    let (victim, home) = (address(66, 6), travel.at[DISPLAY]);
    // The copies come first, so the genuine packets count as repeated.
    travel.echo = Some(victim);
    let received = travel.ends[MACHINE].stats().received_bytes;
    travel.talk();
    let copied = travel.ends[MACHINE].stats().received_bytes - received;
    travel.echo = None;
    let longest = travel.settle();
    assert_eq!(travel.ends[MACHINE].remote(), Some(home));
    assert!(longest <= before + Duration::from_millis(1), "{longest:?}, before {before:?}");
    let got = travel.astray[&victim] as u64;
    assert!(got > 0 && got <= 3 * copied && got <= 6 * 1200, "{got} bytes for {copied}");
}

#[test]
fn an_old_packet_from_elsewhere_leads_nowhere() {
    let mut travel = Travel::begin();
    let elsewhere = address(66, 6);
    travel.talk();
    // A copy of a received packet, and a new packet that is not the newest.
    let mut late = Vec::new();
    travel.ends[DISPLAY].publish(value(1000));
    assert!(travel.ends[DISPLAY].poll_transmit(travel.now, &mut late));
    travel.ends[DISPLAY].ping();
    travel.go_on(Duration::from_millis(20), false);
    travel.launch(elsewhere, travel.at[MACHINE], ONE_WAY, &late);
    travel.go_on(Duration::from_millis(20), false);
    assert_eq!(travel.ends[MACHINE].latest(), Some(value(1000)), "it counts, wherever it came from");
    travel.launch(elsewhere, travel.at[MACHINE], ONE_WAY, &late);
    travel.go_on(Duration::from_secs(3), false);
    assert_eq!(travel.ends[MACHINE].remote(), Some(travel.at[DISPLAY]));
    assert_eq!(travel.astray.get(&elsewhere), None);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn every_frame_arrives_whoever_goes_wherever(
        moves in prop::collection::vec((0usize..2, 3u8..6, 1u16..3, 50u64..400), 1..4), loss in 0u64..80,
    ) {
        let mut travel = Travel::begin();
        travel.loss = if loss < 20 { 0 } else { loss };
        for (who, host, port, ms) in moves {
            // Both at once would lose each other: neither is at the address that the other sends to.
            travel.go_on(Duration::from_millis(ms + 2500), true);
            travel.at[who] = address(host + 4 * who as u8, port);
        }
        travel.talk();
        travel.settle();
        prop_assert_eq!(travel.ends[MACHINE].remote(), Some(travel.at[DISPLAY]));
        prop_assert_eq!(travel.ends[DISPLAY].remote(), Some(travel.at[MACHINE]));
    }
}
