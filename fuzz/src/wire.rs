//! Packets of a peer that knows the key of a connection in the clear, written by the page
//! `transport/udp/WIRE.md`.

use trimaran_udp::Config;
use trimaran_wire::{Channel, FixedBytes, Format, FrameMessage, FrameNumber};
use xxhash_rust::xxh3::xxh3_128_with_seed;

/// A channel of values and one of frames.
const CHANNELS: &[Channel] = &[Channel::latest::<()>("alive"), Channel::frames::<(), u32>("front")];

/// A connection whose values and headers have 72 bytes, and its items 4. A coded batch says first how many
/// items it has.
pub fn config() -> Config {
    let count_coded = |bytes: &[u8]| bytes.first().map(|count| usize::from(*count));
    Config::new(Format { latest: 72, header: 72, item: 4, count_coded, channels: CHANNELS })
}

/// A value of such a connection.
pub fn value() -> FixedBytes {
    FixedBytes::from_elem(1, 72)
}

/// The beginning of a frame of such a connection.
pub fn begin(number: u32) -> FrameMessage {
    FrameMessage::Begin { frame: FrameNumber(number), header: value() }
}

/// A packet with these chunks, sealed for the connection with that id.
pub fn sealed(id: u32, number: u64, chunks: &[u8]) -> Vec<u8> {
    let seed = number ^ u64::from(id) << 32;
    let tag = xxh3_128_with_seed(chunks, seed).to_le_bytes();
    [&(number << 2).to_le_bytes()[..], &id.to_le_bytes(), chunks, &tag].concat()
}

pub fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// A part: `tail` 0 has more behind it, 1 is all for now, 2 ends a unit that is no frame.
pub fn part(unit: u64, offset: u64, tail: u8, data: &[u8]) -> Vec<u8> {
    let mut out = vec![0x20 | tail & 3];
    varint(&mut out, unit);
    varint(&mut out, offset);
    out.extend_from_slice(&(data.len() as u16).to_le_bytes());
    if tail & 3 == 3 {
        out.extend_from_slice(&[0; 8]);
    }
    out.extend_from_slice(data);
    out
}

/// The first byte of a part of a message, and of a block, behind which more follows.
pub const MESSAGE_PART: u8 = 0x40;
pub const BLOCK_PART: u8 = 0x50;

/// A part of a message or of a block, as `code` says.
pub fn record_part(code: u8, unit: u64, offset: u64, ends: bool, data: &[u8]) -> Vec<u8> {
    let mut out = part(unit, offset, 0, data);
    out[0] = code | u8::from(ends) << 1;
    out
}

/// Where a block lies, and what repair it has.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    pub unit: u64,
    pub offset: u64,
    pub length: u64,
    pub shard: u16,
    pub count: u8,
}

pub fn repair(Block { unit, offset, length, shard, count }: Block, index: u8) -> Vec<u8> {
    let mut out = vec![0x30];
    varint(&mut out, unit);
    varint(&mut out, offset);
    varint(&mut out, length);
    out.extend_from_slice(&shard.to_le_bytes());
    out.extend_from_slice(&[count, index]);
    out.resize(out.len() + usize::from(shard), 7);
    out
}

/// Word that nothing more comes of a frame of `sent` bytes, whose beginning has arrived.
pub fn give_up(unit: u64, sent: u64) -> Vec<u8> {
    let mut out = vec![0x24];
    varint(&mut out, unit);
    varint(&mut out, sent);
    varint(&mut out, sent);
    out.extend_from_slice(&[0; 9]);
    out
}

/// An acknowledgement of ranges in rising order, each with its end.
pub fn acknowledgement(ranges: &[(u64, u64)]) -> Vec<u8> {
    let mut out = vec![0x02, 0];
    varint(&mut out, ranges.len() as u64);
    let mut above = None;
    for (from, to) in ranges.iter().rev() {
        varint(&mut out, above.map_or(*to - 1, |above: u64| above - to));
        varint(&mut out, to - from);
        above = Some(*from);
    }
    out
}
