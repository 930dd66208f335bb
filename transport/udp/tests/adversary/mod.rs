//! Packets of a peer that knows the key and makes each of their bytes as costly as it can.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test or a benchmark that cannot go on has failed")]

use std::net::SocketAddr;
use std::time::Duration;

use bytes::BytesMut;
use trimaran_net::Instant;
use trimaran_udp::{Connection, ConnectionId, UnitLane};
use trimaran_wire::{FrameEnd, FrameMessage, FrameNumber};

use crate::wire::{Block, acknowledgement, begin, config, give_up, part, repair, sealed, varint};

pub const HERE: ConnectionId = ConnectionId(10);
pub const THERE: ConnectionId = ConnectionId(20);
/// Chunks of a packet of 1,200 bytes.
const ROOM: usize = 1172;
/// The initial flow control limit of a connection, bytes.
const WINDOW: u64 = 4 << 20;

pub fn start() -> Instant {
    Instant::from_nanos(1_000_000_000)
}

/// One way to spend this side's time.
pub struct Attack {
    pub name: &'static str,
    /// Packets that only bring the connection into the attacked state.
    pub before: Vec<Vec<u8>>,
    pub packets: Vec<Vec<u8>>,
}

impl Attack {
    /// The packets with these chunks.
    fn of(name: &'static str, write: impl FnOnce(&mut Packets)) -> Self {
        let mut packets = Packets::default();
        write(&mut packets);
        Self { name, before: Vec::new(), packets: packets.take() }
    }
}

/// A connection under attack: it takes each packet, reads received data, and sends its packets.
pub struct Victim {
    pub connection: Connection,
    pub now: Instant,
    out: Vec<u8>,
}

impl Victim {
    pub fn new() -> Self {
        let mut connection = Connection::plaintext(start(), HERE, THERE, config());
        connection.follow(at(1), [7; 32]);
        Self { connection, now: start(), out: Vec::new() }
    }

    pub fn take(&mut self, packet: &[u8]) {
        self.now = self.now.after(Duration::from_micros(10));
        self.connection.handle_from(self.now, at(1), packet);
        while self.connection.recv(UnitLane::Frames).is_some() {}
        self.answer();
    }

    pub fn answer(&mut self) {
        if self.connection.poll_timeout().is_some_and(|due| due <= self.now) {
            self.connection.handle_timeout(self.now);
        }
        while self.connection.poll_transmit(self.now, &mut self.out) {}
    }
}

fn at(host: u8) -> SocketAddr {
    ([10, 0, 0, host], 1).into()
}

/// Collects chunks into packets as full as they may be.
#[derive(Default)]
struct Packets {
    number: u64,
    open: Vec<u8>,
    done: Vec<Vec<u8>>,
}

impl Packets {
    fn push(&mut self, chunk: &[u8]) {
        if self.open.len() + chunk.len() > ROOM {
            self.flush();
        }
        self.open.extend_from_slice(chunk);
    }

    fn flush(&mut self) {
        if !self.open.is_empty() {
            self.done.push(sealed(HERE.0, self.number, &self.open));
            self.number += 1;
            self.open.clear();
        }
    }

    /// The packets collected since the last call.
    fn take(&mut self) -> Vec<Vec<u8>> {
        self.flush();
        std::mem::take(&mut self.done)
    }
}

/// The beginning of a frame's unit.
fn beginning() -> Vec<u8> {
    let mut bytes = BytesMut::new();
    begin(0).encode(&mut bytes);
    bytes.to_vec()
}

/// Bytes of a unit in parts of a thousand, except those in `missing`.
fn parts(packets: &mut Packets, unit: u64, length: u64, missing: &[u64]) {
    for offset in (0..length).step_by(1000) {
        if !missing.contains(&offset) {
            let size = (length - offset).min(1000) as usize;
            packets.push(&part(unit, offset, 0, &vec![1; size]));
        }
    }
}

/// Shards of a thousand bytes, 64 of them in a block, two of them missing.
const FULL: u64 = 64_000;

/// All attacks. `times` is how often the costliest step is taken.
pub fn attacks(times: u64) -> Vec<Attack> {
    vec![
        repair_for_many_blocks_in_one_place(times),
        repair_for_many_blocks_side_by_side(times),
        small_blocks(times, 2, "small blocks of two repair shards"),
        small_blocks(times, 1, "small blocks of one repair shard"),
        blocks_that_a_byte_completes(times),
        repair_without_an_end(times),
        a_byte_at_the_end_of_the_window(times),
        bytes_backwards(times),
        bytes_with_gaps(times),
        the_last_unit_allowed(times),
        ends_of_units(times),
        acknowledgements(times),
        answers_to_no_question(times),
        endings_of_the_latest_lane(times),
        pings_in_packets_of_their_own(times),
    ]
}

/// 256 blocks over the same bytes, each with a repair shard and two shards missing; then single bytes.
fn repair_for_many_blocks_in_one_place(times: u64) -> Attack {
    let mut packets = Packets::default();
    parts(&mut packets, 0, FULL, &[1000, 2000]);
    for other in 0..256 {
        let block = Block { unit: 0, offset: 0, length: FULL - other, shard: 1000, count: 32 };
        packets.push(&repair(block, 0));
    }
    let before = packets.take();
    (0..times).for_each(|_| packets.push(&part(0, 70_000, 0, &[1])));
    Attack { name: "repair for many blocks in one place", before, packets: packets.take() }
}

/// As many blocks as the window holds, each with a repair shard and two shards missing; then single bytes in
/// all of them.
fn repair_for_many_blocks_side_by_side(times: u64) -> Attack {
    let mut packets = Packets::default();
    let blocks = WINDOW / FULL - 1;
    for at in 0..blocks {
        let offset = at * FULL;
        for shard in (0..FULL).step_by(1000).filter(|shard| !matches!(shard, 1000 | 2000)) {
            packets.push(&part(0, offset + shard, 0, &[1; 1000]));
        }
        packets.push(&repair(Block { unit: 0, offset, length: FULL, shard: 1000, count: 32 }, 0));
    }
    let before = packets.take();
    (0..times).for_each(|at| packets.push(&part(0, at % blocks * FULL, 0, &[1])));
    Attack { name: "repair for many blocks side by side", before, packets: packets.take() }
}

/// The smallest blocks of two shards, each restored from `count` repair shards.
fn small_blocks(times: u64, count: u8, name: &'static str) -> Attack {
    Attack::of(name, |packets| {
        for at in 0..times {
            let block = Block { unit: 0, offset: at * 4, length: 4, shard: 2, count };
            packets.push(&part(0, block.offset, 0, &[1; 2]));
            packets.push(&repair(block, 0));
        }
    })
}

/// Blocks of two shards of 512 bytes and two of repair: the last piece of each is one byte.
fn blocks_that_a_byte_completes(times: u64) -> Attack {
    Attack::of("blocks that a byte completes", |packets| {
        for at in 0..times.min(4000) {
            let block = Block { unit: 0, offset: at * 1024, length: 1024, shard: 512, count: 2 };
            packets.push(&part(0, block.offset, 0, &[1; 511]));
            packets.push(&repair(block, 0));
            packets.push(&part(0, block.offset + 511, 0, &[1]));
        }
    })
}

/// More repair than there is room for.
fn repair_without_an_end(times: u64) -> Attack {
    Attack::of("more repair than there is place for", |packets| {
        for at in 0..times {
            let block = Block { unit: at % 1000, offset: 0, length: 1024, shard: 512, count: 32 };
            packets.push(&repair(block, (at / 1000 % 32) as u8));
        }
    })
}

/// A frame of which a single byte comes, at the end of the window, and then a notice that no more comes.
fn a_byte_at_the_end_of_the_window(times: u64) -> Attack {
    Attack::of("a byte at the end of the window", |packets| {
        for unit in 0..times.min(200) {
            packets.push(&part(unit, 0, 0, &beginning()));
            packets.push(&part(unit, WINDOW - 1, 0, &[1]));
            packets.push(&give_up(unit, WINDOW));
            // Each frame makes room for the next one once it was read.
            packets.flush();
        }
    })
}

/// Single bytes with gaps between them, the last one first.
fn bytes_backwards(times: u64) -> Attack {
    Attack::of("bytes with gaps, backwards", |packets| {
        let count = times.min(4000);
        (0..count).rev().for_each(|at| packets.push(&part(0, 1 + at * 2, 0, &[1])));
    })
}

/// Items with gaps between them, delivered once the frame is given up.
fn bytes_with_gaps(times: u64) -> Attack {
    Attack::of("items with gaps, given up", |packets| {
        for unit in 0..times.div_ceil(4000) {
            packets.push(&part(unit, 0, 0, &beginning()));
            (0..4000).for_each(|at| packets.push(&part(unit, 88 + at * 8, 0, &[1; 4])));
            packets.push(&give_up(unit, 40_000));
            packets.flush();
        }
    })
}

/// The last unit allowed, in packets of its own; and all units before it end.
fn the_last_unit_allowed(times: u64) -> Attack {
    Attack::of("the last unit allowed", |packets| {
        for round in 0..times.div_ceil(2000) {
            packets.push(&part(round * 1024 + 1023, 0, 0, &[]));
            packets.flush();
            for unit in 0..1024 {
                packets.push(&part(round * 1024 + unit, 0, 2, &[]));
            }
            packets.flush();
        }
    })
}

/// Units that consist only of their end.
fn ends_of_units(times: u64) -> Attack {
    Attack::of("units of nothing", |packets| {
        for unit in 0..times {
            packets.push(&part(unit, 0, 2, &[]));
        }
    })
}

/// Acknowledgements of the same packets, with as many ranges as allowed.
fn acknowledgements(times: u64) -> Attack {
    let mut packets = Packets::default();
    (0..100).for_each(|_| {
        packets.push(&[0x01]);
        packets.flush();
    });
    let before = packets.take();
    let ranges: Vec<_> = (0..32).map(|at| (at * 2, at * 2 + 1)).collect();
    (0..times).for_each(|_| packets.push(&acknowledgement(&ranges)));
    Attack { name: "acknowledgements again", before, packets: packets.take() }
}

fn answers_to_no_question(times: u64) -> Attack {
    Attack::of("challenges and responses", |packets| {
        for code in [6, 7] {
            (0..times).for_each(|_| packets.push(&[&[code][..], &[9; 24]].concat()));
        }
    })
}

fn endings_of_the_latest_lane(times: u64) -> Attack {
    Attack::of("last values", |packets| {
        (0..times).for_each(|_| packets.push(&[0x11, 9, 6, 0, 4, 2, 0, 0, 0, 0]));
    })
}

fn pings_in_packets_of_their_own(times: u64) -> Attack {
    Attack::of("pings", |packets| {
        (0..times.min(20_000)).for_each(|_| {
            packets.push(&[0x01]);
            packets.flush();
        });
    })
}

/// Frames of an honest peer.
pub fn ordinary(frames: u32, items: u32) -> Attack {
    let mut sender = Connection::plaintext(start(), THERE, HERE, config());
    let mut receiver = Connection::plaintext(start(), HERE, THERE, config());
    let (mut now, mut out, mut packets) = (start(), Vec::new(), Vec::new());
    for frame in 0..frames {
        send_frame(&mut sender, frame, items);
        while !sender.is_drained() {
            now = now.after(Duration::from_millis(1));
            while sender.poll_transmit(now, &mut out) {
                receiver.handle(now, &out);
                packets.push(out.clone());
            }
            while receiver.recv(UnitLane::Frames).is_some() {}
            now = now.after(Duration::from_millis(1));
            while receiver.poll_transmit(now, &mut out) {
                sender.handle(now, &out);
            }
            sender.handle_timeout(now);
        }
    }
    Attack { name: "ordinary frames", before: Vec::new(), packets }
}

pub fn send_frame(sender: &mut Connection, frame: u32, items: u32) {
    sender.send(&begin(frame));
    for first in (0..items).step_by(256) {
        let bytes: Vec<u8> = (first..items.min(first + 256)).flat_map(u32::to_le_bytes).collect();
        sender.send(&FrameMessage::Batch(bytes.into()));
    }
    sender.send(&FrameMessage::End(FrameEnd { frame: FrameNumber(frame), items, hash: 0 }));
}

/// A sender of small frames, of which its peer acknowledges all but the first: the rest is kept behind it,
/// and then pings.
pub fn frames_behind_one_that_never_arrives(frames: u32, pings: u64) -> (Victim, Vec<Vec<u8>>) {
    let mut victim = Victim::new();
    let (mut out, mut number) = (Vec::new(), 0);
    let mut max_data = vec![0x03];
    varint(&mut max_data, u64::MAX);
    varint(&mut max_data, u64::MAX);
    victim.take(&sealed(HERE.0, number, &max_data));
    for frame in 0..frames {
        if !victim.connection.is_writable(UnitLane::Frames) {
            break;
        }
        send_frame(&mut victim.connection, frame, 0);
        victim.now = victim.now.after(Duration::from_millis(1));
        let mut arrived = Vec::new();
        while victim.connection.poll_transmit(victim.now, &mut out) {
            let word = u64::from_le_bytes(out[..8].try_into().unwrap());
            // The oldest unit is written first: a part of unit 0, from its beginning.
            if !out.windows(3).take(60).any(|bytes| bytes == [0x23, 0, 0]) {
                arrived.push((word >> 2, (word >> 2) + 1));
            }
        }
        if !arrived.is_empty() {
            number += 1;
            let start = arrived.len().saturating_sub(32);
            victim.now = victim.now.after(Duration::from_millis(1));
            victim.connection.handle_from(
                victim.now,
                at(1),
                &sealed(HERE.0, number, &acknowledgement(&merged(&arrived[start..]))),
            );
            victim.connection.handle_timeout(victim.now);
        }
    }
    let packets = (0..pings).map(|at| sealed(HERE.0, number + 1 + at, &[0x01])).collect();
    (victim, packets)
}

/// Merges ranges that touch.
fn merged(ranges: &[(u64, u64)]) -> Vec<(u64, u64)> {
    let mut merged: Vec<(u64, u64)> = Vec::new();
    for (from, to) in ranges {
        match merged.last_mut() {
            Some(last) if last.1 == *from => last.1 = *to,
            _ => merged.push((*from, *to)),
        }
    }
    merged
}
