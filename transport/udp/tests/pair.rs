//! Two ends in virtual time, over a network that loses, doubles, delays and breaks.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::net::SocketAddr;
use std::time::Duration;

use proptest::prelude::*;
use trimaran_proto::{
    BatchSize, Camera, DrawableId, FrameAssembler, FrameEvent, FrameNumber, FrameOutcome, FrameStart,
    FrameWriter, Goodbye, Instant,
};
use trimaran_udp::{
    Closed, Config, Congestion, Connecting, Connection, ConnectionId, Door, MIN_DATAGRAM, Progress, Received,
    Reception, Repair, Security,
};

/// What happens to packets, in 1/1000.
#[derive(Debug, Clone, Copy)]
struct Network {
    loss: u64,
    twice: u64,
    late: u64,
    broken: u64,
    /// Whether losses come in bursts as well (Gilbert and Elliott): one packet in a hundred begins a burst, one in four ends it, and
    /// within it four of five are lost.
    bursts: bool,
    /// Longer packets are lost.
    mtu: usize,
    /// Whether packets are encrypted.
    sealed: bool,
    seed: u64,
}

const CLEAN: Network = Network {
    loss: 0,
    twice: 0,
    late: 0,
    broken: 0,
    bursts: false,
    mtu: MIN_DATAGRAM,
    sealed: false,
    seed: 1,
};
const ONE_WAY: Duration = Duration::from_millis(5);

/// Arrival, order, whither, what.
type Flight = (Instant, u64, usize, Vec<u8>);

/// Two ends that have met at a door and share a key.
fn introduce(now: Instant, here: ConnectionId, there: ConnectionId, config: Config) -> [Connection; 2] {
    let key = Security::PreShared([9; 32]);
    let door = Door::new(key.clone(), [3; 32]).unwrap();
    let address = SocketAddr::from(([192, 0, 2, 1], 4000));
    let connecting = Connecting::new(&key, here, b"").unwrap();
    let (mut first, mut reply) = (Vec::new(), Vec::new());
    connecting.initial(&mut first);
    let _retry = door.handle(now, address, &first, &mut reply);
    let Progress::Retry(connecting) = connecting.handle(now, &reply, config) else { panic!("no retry") };
    connecting.initial(&mut first);
    let Reception::Knock(knock) = door.handle(now, address, &first, &mut reply) else { panic!("no knock") };
    let listener = knock.take(now, there, b"", config, &mut reply).unwrap();
    let Progress::Taken(ours, _) = connecting.handle(now, &reply, config) else { panic!("not taken") };
    [*ours, listener]
}

struct Pair {
    now: Instant,
    ends: [Connection; 2],
    network: Network,
    flying: BinaryHeap<Reverse<Flight>>,
    count: u64,
    sent: u64,
    bytes: [u64; 2],
    longest: usize,
    /// Whether each direction is in a burst; packets lost to bursts.
    in_burst: [bool; 2],
    burst_losses: u64,
    /// Nothing that the first end sends arrives.
    deaf: bool,
}

impl Pair {
    fn new(network: Network, config: Config) -> Self {
        let now = Instant::from_nanos(0);
        let (a, b) = (ConnectionId(1), ConnectionId(2));
        let ends = if network.sealed {
            introduce(now, a, b, config)
        } else {
            [Connection::plaintext(now, a, b, config), Connection::plaintext(now, b, a, config)]
        };
        let (flying, in_burst) = (BinaryHeap::new(), [false; 2]);
        Self {
            now,
            ends,
            network,
            flying,
            count: 0,
            sent: 0,
            bytes: [0; 2],
            longest: 0,
            in_burst,
            burst_losses: 0,
            deaf: false,
        }
    }

    fn lost_in_burst(&mut self, end: usize) -> bool {
        let turns = self.chance(if self.in_burst[end] { 250 } else { 10 });
        self.in_burst[end] ^= turns && self.network.bursts;
        let lost = self.in_burst[end] && self.chance(800);
        self.burst_losses += u64::from(lost);
        lost
    }

    /// Splitmix64: the same network for the same seed.
    fn chance(&mut self, per_mille: u64) -> bool {
        self.network.seed = self.network.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.network.seed;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) % 1000 < per_mille
    }

    fn transmit(&mut self) {
        let mut out = Vec::new();
        for end in 0..2 {
            while self.ends[end].poll_transmit(self.now, &mut out) {
                assert!(out.len() <= Config::default().max_datagram, "{} bytes", out.len());
                self.bytes[end] += out.len() as u64;
                self.sent += 1;
                self.longest = self.longest.max(out.len());
                let copies = 1 + usize::from(self.chance(self.network.twice));
                for _ in 0..copies {
                    let lost = self.lost_in_burst(end) || out.len() > self.network.mtu;
                    if self.chance(self.network.loss) || lost || self.deaf && end == 0 {
                        continue;
                    }
                    let mut packet = out.clone();
                    if self.chance(self.network.broken) {
                        let at = (self.count as usize * 7) % packet.len();
                        packet[at] ^= 0x10;
                    }
                    let late = if self.chance(self.network.late) { ONE_WAY } else { Duration::ZERO };
                    self.count += 1;
                    self.flying.push(Reverse((self.now.after(ONE_WAY + late), self.count, 1 - end, packet)));
                }
            }
        }
    }

    /// Goes to the next thing that happens, but no further than `wake`.
    fn step_until(&mut self, wake: Instant, end: Instant) -> bool {
        if self.step(wake) {
            return true;
        }
        self.now = self.now.max(wake);
        wake < end
    }

    /// Goes to the next thing that happens; false when nothing ever will, or not before `end`.
    fn step(&mut self, end: Instant) -> bool {
        self.transmit();
        let arrival = self.flying.peek().map(|Reverse((at, ..))| *at);
        let timers = self.ends.iter().filter_map(Connection::poll_timeout);
        let Some(next) = timers.chain(arrival).min().filter(|next| *next <= end) else { return false };
        self.now = self.now.max(next);
        while self.flying.peek().is_some_and(|Reverse((at, ..))| *at <= self.now) {
            if let Some(Reverse((_, _, to, packet))) = self.flying.pop() {
                self.ends[to].handle(self.now, &packet);
            }
        }
        for end in &mut self.ends {
            if end.poll_timeout().is_some_and(|at| at <= self.now) {
                end.handle_timeout(self.now);
            }
        }
        true
    }
}

fn camera(frame: u32) -> Camera {
    Camera::new([f64::from(frame), 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(frame))
        .unwrap()
}

fn ids(count: u32) -> Vec<DrawableId> {
    (0..count).map(|i| DrawableId(i.wrapping_mul(2_654_435_761))).collect()
}

fn send_frame(writer: &mut FrameWriter, end: &mut Connection, frame: u32, ids: &[DrawableId]) {
    let start = FrameStart { frame: FrameNumber(frame), camera: camera(frame) };
    end.send(writer.begin(start).unwrap());
    writer.push(ids, |message| end.send(message)).unwrap();
    writer.finish(|message| end.send(message)).unwrap();
}

/// Reads what is there; gives the complete frames' ids.
#[derive(Default)]
struct Reader {
    assembler: FrameAssembler,
    ids: Vec<DrawableId>,
    frames: Vec<Vec<DrawableId>>,
    /// Which frames had gaps, and how many ids they should have had.
    gaps: Vec<(usize, u32)>,
    ended: Option<Received>,
}

impl Reader {
    fn read(&mut self, end: &mut Connection) {
        while let Some(item) = end.recv() {
            assert_eq!(self.ended, None, "nothing comes after the end");
            let Received::Frame(message) = item else {
                self.ended = Some(item);
                continue;
            };
            match self.assembler.take(message).unwrap() {
                FrameEvent::Ids(batch) => self.ids.extend(batch.iter()),
                FrameEvent::End(FrameOutcome::Complete(_)) => self.frames.push(std::mem::take(&mut self.ids)),
                FrameEvent::End(FrameOutcome::Incomplete { expected, received, .. }) => {
                    assert_eq!(received as usize, self.ids.len());
                    self.gaps.push((self.frames.len(), expected));
                    self.frames.push(std::mem::take(&mut self.ids));
                }
                FrameEvent::Begin(_) | FrameEvent::Stats(_) => {}
            }
        }
    }
}

/// Sends frames of these sizes and a goodbye over `network`; all must arrive whole.
fn deliver(network: Network, config: Config, sizes: &[u32]) -> Pair {
    let (pair, reader) = converse(network, config, sizes, Duration::ZERO);
    assert_eq!(reader.gaps, []);
    assert_eq!(reader.frames, sizes.iter().map(|size| ids(*size)).collect::<Vec<_>>());
    pair
}

/// Sends frames of these sizes, one after each `pause`, and a goodbye. The end must arrive, and of each frame its ids in order, with
/// gaps where the configuration allows them.
fn converse(network: Network, config: Config, sizes: &[u32], pause: Duration) -> (Pair, Reader) {
    let mut pair = Pair::new(network, config);
    let (mut writer, mut reader) = (FrameWriter::new(config.batch), Reader::default());
    let mut waiting = (0..).zip(sizes);
    let end = Instant::from_nanos(0).after(Duration::from_secs(600));
    let mut newest = None;
    let mut next = Instant::from_nanos(0);
    loop {
        if pair.ends[0].is_writable() && pair.now >= next {
            next = pair.now.after(pause);
            match waiting.next() {
                Some((frame, size)) => {
                    pair.ends[0].publish(camera(frame));
                    send_frame(&mut writer, &mut pair.ends[0], frame, &ids(*size));
                    if frame as usize + 1 == sizes.len() {
                        pair.ends[0].goodbye(Goodbye::Finished);
                    }
                }
                None if reader.ended.is_some() && pair.ends[0].is_drained() => break,
                None => {}
            }
        }
        assert!(
            pair.step_until(if next > pair.now { next } else { end }, end),
            "stuck at {:?}: {:?}, {} frames, {:?}",
            pair.now,
            pair.ends,
            reader.frames.len(),
            reader.ended
        );
        assert_eq!((pair.ends[0].closed(), pair.ends[1].closed()), (None, None));
        reader.read(&mut pair.ends[1]);
        newest = pair.ends[1].latest().map(|camera| camera.frame()).or(newest);
    }
    assert_eq!(reader.ended, Some(Received::Goodbye(Goodbye::Finished)));
    assert_eq!(reader.frames.len(), sizes.len());
    for (got, size) in reader.frames.iter().zip(sizes) {
        let mut all = ids(*size).into_iter();
        assert!(got.iter().all(|id| all.any(|sent| sent == *id)), "ids that were not sent, or out of order");
    }
    for (frame, expected) in &reader.gaps {
        assert!(config.patience.is_some() && *expected == sizes[*frame], "{frame} of {sizes:?}");
        assert!(reader.frames[*frame].len() < *expected as usize);
    }
    assert_eq!(newest, sizes.len().checked_sub(1).map(|last| FrameNumber(last as u32)));
    (pair, reader)
}

#[test]
fn a_frame_takes_one_trip_and_nothing_is_sent_twice_on_a_clean_path() {
    let pair = deliver(CLEAN, Config::default(), &[2000]);
    assert_eq!(pair.ends[0].stats().lost, 0);
    assert!(pair.sent <= 14, "{} packets for 8 kB", pair.sent);
}

#[test]
fn frames_of_every_size_arrive() {
    for batch in [1, 10, 256, 16_384] {
        let config = Config { batch: BatchSize::new(batch).unwrap(), ..Config::default() };
        deliver(CLEAN, config, &[0, 1, batch - 1, batch, batch + 1, 4000, 200_000]);
    }
}

#[test]
fn more_than_the_window_passes() {
    let config = Config { window: 64 << 10, send_buffer: 32 << 10, ..Config::default() };
    deliver(Network { loss: 20, ..CLEAN }, config, &[100_000, 0, 50_000]);
}

#[test]
fn more_units_than_may_be_under_way_pass() {
    deliver(Network { loss: 20, ..CLEAN }, Config::default(), &[0; 3000]);
}

#[test]
fn the_last_camera_arrives_although_nothing_follows() {
    let mut pair = Pair::new(Network { loss: 500, ..CLEAN }, Config::default());
    pair.ends[0].publish(camera(7));
    let end = Instant::from_nanos(0).after(Duration::from_secs(19));
    let mut read = None;
    while read.is_none() && pair.step(end) {
        read = pair.ends[1].latest();
    }
    assert_eq!(read, Some(camera(7)));
}

#[test]
fn a_dead_path_ends_after_the_lease_and_a_live_one_does_not() {
    let lease = Duration::from_secs(2);
    let config = Config { lease, ..Config::default() };
    let end = Instant::from_nanos(0).after(Duration::from_secs(60));
    let mut pair = Pair::new(CLEAN, config);
    while pair.step(end) {}
    assert_eq!(pair.ends[0].closed(), None);
    pair.network.loss = 1000;
    while pair.step(end.after(lease * 2)) {}
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Silent(lease)));
}

#[test]
fn a_close_is_told_and_ends_the_other_side() {
    let mut pair = Pair::new(CLEAN, Config::default());
    pair.ends[0].close();
    while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Here));
    assert_eq!(pair.ends[1].closed(), Some(&Closed::Peer));
}

const SEALED: Network = Network { sealed: true, ..CLEAN };

#[test]
fn sealed_frames_arrive_although_losses_come_in_bursts() {
    let pair = deliver(Network { bursts: true, ..SEALED }, Config::default(), &[0, 200_000, 1, 100_000]);
    assert!(pair.burst_losses >= 20, "{} lost", pair.burst_losses);
    assert!(pair.ends[0].stats().lost > 0);
}

#[test]
fn sealed_packets_fill_the_narrowest_path_and_no_more() {
    let config = Config { max_datagram: MIN_DATAGRAM, ..Config::default() };
    let pair = deliver(SEALED, config, &[20_000]);
    assert!((MIN_DATAGRAM - 36..=MIN_DATAGRAM).contains(&pair.longest), "{} bytes", pair.longest);
    let mut narrow = Pair::new(Network { mtu: pair.longest - 1, ..SEALED }, config);
    let mut reader = Reader::default();
    send_frame(&mut FrameWriter::new(BatchSize::default()), &mut narrow.ends[0], 0, &ids(20_000));
    let end = Instant::from_nanos(0).after(Duration::from_secs(60));
    while narrow.step(end) {
        reader.read(&mut narrow.ends[1]);
    }
    assert!(reader.frames.is_empty() && !narrow.ends[0].is_drained(), "the path is narrower");
}

#[test]
fn a_lost_close_is_told_again_to_who_goes_on() {
    for network in [CLEAN, SEALED] {
        let mut pair = Pair::new(Network { loss: 1000, ..network }, Config::default());
        pair.ends[0].close();
        pair.ends[0].close();
        pair.transmit();
        assert_eq!(pair.sent, 1, "two calls, one packet");
        pair.network.loss = 0;
        pair.ends[1].publish(camera(1));
        while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
        assert_eq!(pair.ends[1].closed(), Some(&Closed::Peer));
        assert_eq!(pair.sent, 3, "the camera and one more close");
        assert_eq!(pair.ends[0].closed(), Some(&Closed::Here));
    }
}

#[test]
fn closes_that_cross_are_not_answered() {
    let mut pair = Pair::new(SEALED, Config::default());
    pair.ends.iter_mut().for_each(Connection::close);
    while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
    assert_eq!((pair.sent, pair.flying.len()), (2, 0));
}

/// Frames of 4,000 ids, sixty a second, for `seconds`.
fn stream(network: Network, config: Config, seconds: usize) -> (Pair, Reader) {
    converse(network, config, &vec![4000; 60 * seconds], Duration::from_micros(16_667))
}

const DEADLINE: Config = Config { patience: Some(Duration::from_millis(40)), ..RELIABLE };
const RELIABLE: Config = Config {
    window: 4 << 20,
    send_buffer: 4 << 20,
    ack_delay: Duration::from_millis(1),
    lease: Duration::from_secs(20),
    patience: None,
    repair: Repair::Auto,
    repair_percent: 15,
    congestion: Congestion::Cubic,
    max_datagram: 1452,
    batch: BatchSize::MAX,
};

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
fn repair_spares_most_frames_a_wait_and_costs_what_was_set() {
    let lossy = Network { loss: 10, ..SEALED };
    let (plain, _) = stream(lossy, Config { repair_percent: 0, ..RELIABLE }, 10);
    let (repaired, _) = stream(lossy, RELIABLE, 10);
    let count = repaired.ends[1].stats().frames_repaired;
    assert!(count > 60, "{count} of 600 frames, of which one in seven loses a packet");
    assert_eq!(plain.ends[1].stats().frames_repaired, 0);
    assert!(repaired.bytes[0] * 100 <= plain.bytes[0] * 115, "{} and {}", repaired.bytes[0], plain.bytes[0]);
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
    // The last losses are not found yet, and what only acknowledges is not missed.
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
    let config = Config { repair_percent: 0, patience: Some(Duration::from_millis(9)), ..RELIABLE };
    let (pair, reader) = stream(Network { loss: 10, ..SEALED }, config, 5);
    // A round trip takes 10 ms: what is lost is not sent again in time.
    assert!(reader.gaps.len() > 10, "{} frames with gaps", reader.gaps.len());
    assert!(pair.ends[0].stats().frames_given_up >= reader.gaps.len() as u64);
    let missing: usize =
        reader.gaps.iter().map(|(at, expected)| *expected as usize - reader.frames[*at].len()).sum();
    assert!(
        missing < reader.gaps.len() * 900,
        "{missing} ids in {} frames: packets of them",
        reader.gaps.len()
    );

    let (_, patient) = stream(Network { loss: 10, ..SEALED }, DEADLINE, 5);
    assert_eq!(patient.gaps, [], "two round trips are enough");
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
    let mut writer = FrameWriter::new(BatchSize::default());
    send_frame(&mut writer, &mut pair.ends[0], 10_000, &ids(4000));
    let end = pair.now.after(Duration::from_secs(19));
    while !pair.ends[0].is_drained() {
        assert!(pair.step(end), "{:?}", pair.ends);
    }
    assert_eq!(pair.ends[0].stats().datagram_size, 1200);
}

#[test]
fn a_peer_that_acknowledges_nothing_is_given_up_and_costs_no_more() {
    let lease = Duration::from_secs(5);
    let config = Config { lease, ..Config::default() };
    let mut pair = Pair::new(CLEAN, config);
    pair.deaf = true;
    pair.ends[0].publish(camera(0));
    // It goes on to send, so it is not silent.
    let mut frame = 0;
    while pair.ends[0].closed().is_none()
        && pair.step_until(pair.now.after(Duration::from_millis(100)), Instant::from_nanos(u64::MAX))
    {
        frame += 1;
        pair.ends[1].publish(camera(frame));
        assert!(pair.now < Instant::from_nanos(0).after(lease * 2));
    }
    assert_eq!(pair.ends[0].closed(), Some(&Closed::Deaf(lease)));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn every_frame_arrives_once_in_order_whatever_the_network_does(
        loss in 0u64..200, twice in 0u64..200, late in 0u64..300, broken in 0u64..100,
        bursts: bool, sealed: bool, seed: u64,
        sizes in prop::collection::vec(0u32..6000, 1..12),
    ) {
        deliver(Network { loss, twice, late, broken, bursts, sealed, seed, ..CLEAN }, Config::default(), &sizes);
    }

    #[test]
    fn with_deadlines_every_frame_ends_whole_or_with_known_gaps(
        loss in 0u64..300, twice in 0u64..200, late in 0u64..300, broken in 0u64..100,
        bursts: bool, sealed: bool, seed: u64, patience in 1u64..80, repair_percent in 0u8..60,
        mtu in 1200usize..1460, pause in 0u64..20,
        sizes in prop::collection::vec(0u32..6000, 1..12),
    ) {
        let network = Network { loss, twice, late, broken, bursts, sealed, seed, mtu };
        let config = Config { patience: Some(Duration::from_millis(patience)), repair_percent, ..RELIABLE };
        let (pair, reader) = converse(network, config, &sizes, Duration::from_millis(pause));
        if loss + broken == 0 && !bursts && late == 0 && patience > 70 {
            prop_assert_eq!(reader.gaps, []);
        }
        prop_assert!(pair.ends[0].is_drained());
    }

    #[test]
    fn a_strangers_bytes_change_nothing(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let mut pair = Pair::new(CLEAN, Config::default());
        pair.ends[0].handle(pair.now, &bytes);
        let mut out = Vec::new();
        prop_assert!(!pair.ends[0].poll_transmit(pair.now, &mut out));
        prop_assert_eq!(pair.ends[0].closed(), None);
    }
}
