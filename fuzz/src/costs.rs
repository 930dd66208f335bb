//! The work that a peer with the key can cause a connection: no more than is stated for its bytes, whatever
//! it sends. The fuzz target searches for packets that break that; an ordinary test of `trimaran-udp` replays
//! the corpus.

use std::time::Duration;

use trimaran_net::Instant;
use trimaran_udp::{Connection, ConnectionId, STEPS_PER_BYTE, STEPS_PER_PACKET, UnitLane};
use trimaran_wire::{FrameEnd, FrameMessage, FrameNumber};

use crate::wire::{
    BLOCK_PART, Block, MESSAGE_PART, acknowledgement, begin, config, give_up, part, record_part, repair,
    sealed,
};

const HERE: ConnectionId = ConnectionId(10);
const THERE: ConnectionId = ConnectionId(20);
/// Chunks of a packet.
const ROOM: usize = 1172;
/// Places in a unit that something ends at, or nearly.
const PLACES: [u64; 8] = [0, 80, 1024, 2047, 64_000, 96_000, (4 << 20) - 1, 1 << 40];
const SHARDS: [u16; 8] = [2, 8, 100, 256, 512, 1000, 1136, 1500];
const COUNTS: [u8; 4] = [1, 2, 3, 32];

/// Each few bytes are a chunk whose numbers are near those that decide something; packets are as full as they
/// may be, or end where the bytes say so. No steps are done beyond those that are allowed for what came.
pub fn costs(bytes: &[u8]) {
    let mut now = Instant::from_nanos(1_000_000_000);
    let mut connection = Connection::plaintext(now, HERE, THERE, config());
    let (mut reader, mut chunks, mut number, mut frame) = (bytes.iter().copied(), Vec::new(), 0, 0);
    loop {
        let chunk = chunk(&mut reader, connection.stats().sent);
        let full = chunks.len() + chunk.as_ref().map_or(0, Vec::len) > ROOM;
        if full || chunk.as_ref().is_none_or(Vec::is_empty) {
            now = now.after(Duration::from_micros(100));
            connection.handle(now, &sealed(HERE.0, number, &chunks));
            number += 1;
            chunks.clear();
            // A frame of this side gives the peer something to acknowledge.
            if number % 4 == 0 && connection.is_writable(UnitLane::Frames) {
                send_frame(&mut connection, frame);
                frame += 1;
            }
            settle(&mut connection, now);
        }
        match chunk {
            Some(chunk) => chunks.extend_from_slice(&chunk),
            None => return,
        }
    }
}

/// The next chunk, for a peer that was sent so many packets; an empty one ends a packet.
fn chunk(reader: &mut impl Iterator<Item = u8>, sent: u64) -> Option<Vec<u8>> {
    let kind = reader.next()?;
    let mut next = || reader.next().unwrap_or_default();
    Some(match kind % 16 {
        0..=5 => {
            let (unit, offset) = (unit(next()), place(&mut next));
            let data = vec![kind; (usize::from(next()) * 5).min(1100)];
            match kind >> 4 {
                tail @ 0..8 => part(unit, offset, tail, &data),
                tail @ 8..12 => record_part(MESSAGE_PART, unit, offset, tail > 8, &data),
                tail => record_part(BLOCK_PART, unit, offset, tail > 12, &data),
            }
        }
        6..=9 => {
            let (unit, offset, shape) = (unit(next()), place(&mut next), next());
            let shard = SHARDS[usize::from(shape & 7)];
            let count = COUNTS[usize::from(shape >> 3 & 3)];
            let shards = 1 + u64::from(next()) % 64;
            let length = (shards * u64::from(shard)).saturating_sub(u64::from(shape >> 5));
            repair(Block { unit, offset, length, shard, count }, next() % 33)
        }
        10 => give_up(unit(next()), place(&mut next)),
        11 | 12 => {
            let (mut ranges, mut from) = (Vec::new(), u64::from(next()));
            for _ in 0..1 + next() % 32 {
                let to = from + 1 + u64::from(next() % 8);
                ranges.push((from, to));
                from = to + 1 + u64::from(kind >> 4);
            }
            acknowledgement(&ranges)
        }
        13 => vec![1; usize::from(next())],
        14 => vec![next()],
        // In any state, an acknowledgement of all that was sent.
        15 if kind > 128 && sent > 0 => acknowledgement(&[(0, sent)]),
        _ => Vec::new(),
    })
}

/// Few units, and the last one that is allowed.
fn unit(byte: u8) -> u64 {
    if byte == u8::MAX { 1023 } else { u64::from(byte & 7) }
}

fn place(next: &mut impl FnMut() -> u8) -> u64 {
    let (about, off) = (next(), next());
    PLACES[usize::from(about & 7)] + u64::from(about >> 3) * 64 + u64::from(off)
}

fn send_frame(connection: &mut Connection, number: u32) {
    connection.send(&begin(number));
    connection.send(&FrameMessage::End(FrameEnd { frame: FrameNumber(number), items: 0, hash: 0 }));
}

/// Reads and sends what there is, and looks at what that has cost.
fn settle(connection: &mut Connection, now: Instant) {
    let mut out = Vec::new();
    for lane in UnitLane::ALL {
        while connection.recv(lane).is_some() {}
    }
    if connection.poll_timeout().is_some_and(|due| due <= now) {
        connection.handle_timeout(now);
    }
    while connection.poll_transmit(now, &mut out) {}
    let stats = connection.stats();
    let allowed = stats.received_bytes * STEPS_PER_BYTE + (stats.received + stats.sent) * STEPS_PER_PACKET;
    let work = connection.work();
    assert!(work <= allowed, "{work} steps for {} bytes, where {allowed} are allowed", stats.received_bytes);
}
