//! Chunks as bytes.

use std::ops::Range;

use smallvec::SmallVec;
use trimaran_wire::{ChannelNumber, ChannelSizes, Format};

use super::{ACK_RANGES, Chunk, GivenUp, Tail, UnitLane, unit_head};
use crate::ranges::RangeSet;
use crate::repair::Block;
use crate::wire::{Malformed, Reader, put_varint};

const PAD: u8 = 0x00;
const PING: u8 = 0x01;
const ACK: u8 = 0x02;
const MAX_DATA: u8 = 0x03;
pub(crate) const CLOSE: u8 = 0x04;
const STOP_SENDING: u8 = 0x05;
const CHALLENGE: u8 = 0x06;
const RESPONSE: u8 = 0x07;
const MESSAGES_MAX_DATA: u8 = 0x08;
const STOP_MESSAGES: u8 = 0x09;
const BULK_MAX_DATA: u8 = 0x0a;
const STOP_BULK: u8 = 0x0b;
/// Before a chunk about a channel, with its number.
const CHANNEL: u8 = 0x0c;
const LATEST: u8 = 0x10;
const LAST_LATEST: u8 = 0x11;
const PART: u8 = 0x20;
const GIVE_UP: u8 = 0x24;
const GIVE_UP_CODED: u8 = 0x25;
const REPAIR: u8 = 0x30;
const LAST_REPAIR: u8 = 0x33;
const MESSAGE_PART: u8 = 0x40;
const BLOCK_PART: u8 = 0x50;
/// Added to the code of a part whose unit ends without being a complete frame, beside that of its lane.
const END: u8 = 2;

impl<'a> Chunk<'a> {
    /// The byte of the chunk [`Chunk::Pad`].
    pub(crate) const FILLING: u8 = PAD;

    pub(crate) fn write(&self, out: &mut Vec<u8>) {
        if let Some(ChannelNumber(number)) = self.channel() {
            out.extend_from_slice(&[CHANNEL, number]);
        }
        match self {
            Self::Pad => out.push(PAD),
            Self::Ping => out.push(PING),
            Self::Ack { delay_us, numbers } => {
                out.push(ACK);
                put_varint(out, *delay_us);
                put_varint(out, numbers.len().min(ACK_RANGES) as u64);
                let mut above = None;
                for range in numbers.iter().rev().take(ACK_RANGES) {
                    // The first is named by its last number, each further one by the gap below the one
                    // before.
                    put_varint(out, above.map_or(range.end - 1, |above: u64| above - range.end));
                    put_varint(out, range.end - range.start);
                    above = Some(range.start);
                }
            }
            Self::MaxData { lane, bytes, units } => {
                out.push(match lane {
                    UnitLane::Frames | UnitLane::Channel(_) => MAX_DATA,
                    UnitLane::Messages => MESSAGES_MAX_DATA,
                    UnitLane::Bulk => BULK_MAX_DATA,
                });
                put_varint(out, *bytes);
                put_varint(out, *units);
            }
            Self::Close => out.push(CLOSE),
            Self::StopSending { lane } => out.push(match lane {
                UnitLane::Frames | UnitLane::Channel(_) => STOP_SENDING,
                UnitLane::Messages => STOP_MESSAGES,
                UnitLane::Bulk => STOP_BULK,
            }),
            Self::Challenge { cookie } => {
                out.push(CHALLENGE);
                out.extend_from_slice(cookie);
            }
            Self::Response { cookie } => {
                out.push(RESPONSE);
                out.extend_from_slice(cookie);
            }
            Self::LastLatest { number, close, .. } => {
                out.push(LAST_LATEST);
                put_varint(out, *number);
                out.extend_from_slice(&(close.len() as u16).to_le_bytes());
                out.extend_from_slice(close);
            }
            Self::Latest { number, value, .. } => {
                out.push(LATEST);
                put_varint(out, *number);
                out.extend_from_slice(value);
            }
            Self::Part { lane, unit, offset, tail, data } => {
                out.push(match (lane, tail) {
                    (UnitLane::Messages, Tail::End) => MESSAGE_PART | END,
                    (UnitLane::Messages, _) => MESSAGE_PART,
                    (UnitLane::Bulk, Tail::End) => BLOCK_PART | END,
                    (UnitLane::Bulk, _) => BLOCK_PART,
                    (_, Tail::More) => PART,
                    (_, Tail::Pause) => PART | 1,
                    (_, Tail::End) => PART | END,
                    (_, Tail::Frame(_)) => PART | 3,
                });
                put_varint(out, *unit);
                put_varint(out, *offset);
                out.extend_from_slice(&(data.len() as u16).to_le_bytes());
                if let Tail::Frame(hash) = tail {
                    out.extend_from_slice(&hash.to_le_bytes());
                }
                out.extend_from_slice(data);
            }
            Self::GiveUp { unit, about: GivenUp { length, sent, hash, coded }, head, .. } => {
                out.push(if coded.is_some() { GIVE_UP_CODED } else { GIVE_UP });
                put_varint(out, *unit);
                put_varint(out, *length);
                put_varint(out, *sent);
                out.extend_from_slice(&hash.to_le_bytes());
                if let Some(items) = coded {
                    put_varint(out, *items);
                }
                put_varint(out, head.len() as u64);
                out.extend_from_slice(head);
            }
            Self::Repair { unit, block, hash, index, data, .. } => {
                out.push(if hash.is_some() { LAST_REPAIR } else { REPAIR });
                put_varint(out, *unit);
                put_varint(out, block.offset);
                put_varint(out, block.length.into());
                out.extend_from_slice(&block.shard.to_le_bytes());
                out.extend_from_slice(&[block.count, *index]);
                if let Some(hash) = hash {
                    out.extend_from_slice(&hash.to_le_bytes());
                }
                out.extend_from_slice(data);
            }
        }
    }

    /// Reads the next chunk.
    pub(crate) fn read(reader: &mut Reader<'a>, format: &Format) -> Result<Self, Malformed> {
        match reader.u8("chunk")? {
            CHANNEL => {
                let number = ChannelNumber(reader.u8("channel")?);
                let channel = format.channels.get(number.index());
                let channel = channel.ok_or(Malformed::Range { what: "channel" })?;
                let code = reader.u8("chunk")?;
                let belongs = match channel.sizes() {
                    ChannelSizes::Latest { .. } => matches!(code, LATEST | LAST_LATEST),
                    ChannelSizes::Frames { .. } => {
                        matches!(code, MAX_DATA | STOP_SENDING | 0x20..=0x25 | REPAIR | LAST_REPAIR)
                    }
                };
                if !belongs {
                    return Err(Malformed::UnknownChunk { code });
                }
                Self::read_of(reader, code, &Format::of_channel(channel), Some(number))
            }
            code => Self::read_of(reader, code, format, None),
        }
    }

    /// Reads the rest of a chunk with this code, of a lane with values of these sizes.
    fn read_of(
        reader: &mut Reader<'a>,
        code: u8,
        format: &Format,
        channel: Option<ChannelNumber>,
    ) -> Result<Self, Malformed> {
        let lane = channel.map_or_else(|| lane_of(code), UnitLane::Channel);
        match code {
            PAD => Ok(Self::Pad),
            PING => Ok(Self::Ping),
            ACK => read_ack(reader),
            MAX_DATA | MESSAGES_MAX_DATA | BULK_MAX_DATA => {
                let (bytes, units) = (reader.varint("max data")?, reader.varint("max data")?);
                Ok(Self::MaxData { lane, bytes, units })
            }
            CLOSE => Ok(Self::Close),
            STOP_SENDING | STOP_MESSAGES | STOP_BULK => Ok(Self::StopSending { lane }),
            CHALLENGE => Ok(Self::Challenge { cookie: *reader.array("cookie")? }),
            RESPONSE => Ok(Self::Response { cookie: *reader.array("cookie")? }),
            LATEST => {
                let number = reader.varint("value number")?;
                Ok(Self::Latest { channel, number, value: reader.take(format.latest, "value")? })
            }
            LAST_LATEST => {
                let number = reader.varint("value number")?;
                let length = usize::from(reader.u16("close length")?);
                Ok(Self::LastLatest { channel, number, close: reader.take(length, "close")? })
            }
            0x20..=0x23 | MESSAGE_PART | 0x42 | BLOCK_PART | 0x52 => {
                let unit = reader.varint("unit")?;
                let offset = reader.varint("offset")?;
                let length = usize::from(reader.u16("part length")?);
                let tail = match code & 3 {
                    0 => Tail::More,
                    1 => Tail::Pause,
                    2 => Tail::End,
                    _ => Tail::Frame(reader.u64("hash")?),
                };
                Ok(Self::Part { lane, unit, offset, tail, data: reader.take(length, "part")? })
            }
            GIVE_UP | GIVE_UP_CODED => {
                let unit = reader.varint("unit")?;
                let length = reader.varint("unit length")?;
                let sent = reader.varint("sent length")?;
                let hash = reader.u64("hash")?;
                let coded = if code == GIVE_UP_CODED { Some(reader.varint("items")?) } else { None };
                let count = reader.varint("beginning length")?;
                if sent > length || count > unit_head(format, coded.is_some()) as u64 {
                    return Err(Malformed::Range { what: "unit length" });
                }
                let about = GivenUp { length, sent, hash, coded };
                Ok(Self::GiveUp { lane, unit, about, head: reader.take(count as usize, "beginning")? })
            }
            REPAIR | LAST_REPAIR => {
                let unit = reader.varint("unit")?;
                let offset = reader.varint("offset")?;
                let length = reader.varint("block length")?;
                let length = u32::try_from(length).map_err(|_| Malformed::Range { what: "block length" })?;
                let shard = reader.u16("shard length")?;
                let [count, index] = *reader.array("repair shards")?;
                let hash = if code == LAST_REPAIR { Some(reader.u64("hash")?) } else { None };
                let block = Block { offset, length, shard, count };
                if !block.is_sound() || index >= count {
                    return Err(Malformed::Range { what: "block" });
                }
                Ok(Self::Repair {
                    lane,
                    unit,
                    block,
                    hash,
                    index,
                    data: reader.take(shard.into(), "repair shard")?,
                })
            }
            _ => Err(Malformed::UnknownChunk { code }),
        }
    }
}

/// The lane of a chunk with this code, of a kind that each lane has.
const fn lane_of(code: u8) -> UnitLane {
    match code {
        MESSAGES_MAX_DATA | STOP_MESSAGES | MESSAGE_PART | 0x42 => UnitLane::Messages,
        BULK_MAX_DATA | STOP_BULK | BLOCK_PART | 0x52 => UnitLane::Bulk,
        _ => UnitLane::Frames,
    }
}

fn read_ack<'a>(reader: &mut Reader<'a>) -> Result<Chunk<'a>, Malformed> {
    const WHAT: &str = "acknowledged range";
    let out_of_range = Malformed::Range { what: WHAT };
    let delay_us = reader.varint("acknowledgement delay")?;
    let count = reader.varint(WHAT)?;
    if !(1..=ACK_RANGES as u64).contains(&count) {
        return Err(out_of_range);
    }
    let mut ranges: SmallVec<[Range<u64>; 2]> = SmallVec::new();
    let mut above: Option<u64> = None;
    for _ in 0..count {
        let step = reader.varint(WHAT)?;
        let length = reader.varint(WHAT)?;
        let end = match above {
            None => step.checked_add(1),
            Some(_) if step == 0 => None,
            Some(above) => above.checked_sub(step),
        };
        let end = end.ok_or(out_of_range)?;
        let start = end.checked_sub(length).filter(|_| length > 0).ok_or(out_of_range)?;
        ranges.push(start..end);
        above = Some(start);
    }
    ranges.reverse();
    Ok(Chunk::Ack { delay_us, numbers: RangeSet::from_rising(ranges) })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::chunk::part_overhead;
    use crate::samples::FORMAT_WITH_CHANNELS as FORMAT;

    fn back(chunk: &Chunk<'_>) {
        let mut out = Vec::new();
        chunk.write(&mut out);
        let mut reader = Reader::new(&out);
        assert_eq!(Chunk::read(&mut reader, &FORMAT).as_ref(), Ok(chunk));
        assert!(reader.is_empty());
        for cut in 0..out.len() {
            assert!(Chunk::read(&mut Reader::new(&out[..cut]), &FORMAT).is_err(), "{cut} of {}", out.len());
        }
    }

    /// The other chunks have examples in WIRE.md.
    #[test]
    fn chunks_without_an_example_come_back_and_their_parts_do_not() {
        let block = Block { offset: 1136, length: 5, shard: 6, count: 2 };
        back(&Chunk::Repair {
            lane: UnitLane::Frames,
            unit: 7,
            block,
            hash: None,
            index: 1,
            data: b"repair",
        });
        for lane in [UnitLane::Messages, UnitLane::Bulk] {
            back(&Chunk::Part { lane, unit: 1 << 30, offset: 80, tail: Tail::More, data: b"stop" });
        }
    }

    #[test]
    fn a_part_with_a_hash_has_as_many_bytes_beside_its_data_as_foretold() {
        for lane in [UnitLane::Frames, UnitLane::Channel(ChannelNumber(1))] {
            for (unit, offset) in [(0, 0), (7, 1 << 20), (1 << 30, 100), (u64::MAX, u64::MAX)] {
                let mut out = Vec::new();
                Chunk::Part { lane, unit, offset, tail: Tail::Frame(1), data: &[] }.write(&mut out);
                assert_eq!(part_overhead(lane, unit, offset), out.len(), "{unit}, {offset} of {lane:?}");
            }
        }
    }

    #[test]
    fn a_frame_is_not_given_up_with_more_bytes_than_it_or_its_beginning_has() {
        for coded in [None, Some(3)] {
            let most = unit_head(&FORMAT, coded.is_some());
            for (sent, head, is_sound) in [(90, most, true), (91, 0, false), (0, most + 1, false)] {
                let (about, head) = (GivenUp { length: 90, sent, hash: 1, coded }, vec![0; head]);
                let chunk = Chunk::GiveUp { lane: UnitLane::Frames, unit: 7, about, head: &head };
                let mut out = Vec::new();
                chunk.write(&mut out);
                let read = Chunk::read(&mut Reader::new(&out), &FORMAT);
                let refused = Malformed::Range { what: "unit length" };
                assert_eq!(read, if is_sound { Ok(chunk) } else { Err(refused) });
            }
        }
    }

    #[test]
    fn ranges_below_zero_empty_or_touching_are_refused() {
        for ack in [[5, 7, 0, 0], [5, 0, 1, 1], [5, 2, 0, 1], [5, 2, 4, 1], [5, 2, 2, 3]] {
            let bytes = [&[ACK, 0, 2][..], &ack].concat();
            let read = Chunk::read(&mut Reader::new(&bytes), &FORMAT);
            assert!(matches!(read, Err(Malformed::Range { .. })), "{ack:?}: {read:?}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_judged_and_what_is_read_is_written_back(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
            let mut reader = Reader::new(&bytes);
            while let Ok(chunk) = Chunk::read(&mut reader, &FORMAT) {
                back(&chunk);
            }
        }

        #[test]
        fn any_bytes_about_a_channel_are_judged(
            number in 0u8..3, code in 0u8..0x40, rest in prop::collection::vec(any::<u8>(), 0..60),
        ) {
            let bytes = [&[CHANNEL, number, code][..], &rest].concat();
            match Chunk::read(&mut Reader::new(&bytes), &FORMAT) {
                Ok(chunk) => {
                    prop_assert_eq!(chunk.channel(), Some(ChannelNumber(number)));
                    let is_value = matches!(chunk, Chunk::Latest { .. } | Chunk::LastLatest { .. });
                    prop_assert_eq!(is_value, number == 0);
                    back(&chunk);
                }
                Err(_) if number == 2 => {}
                Err(Malformed::UnknownChunk { code: named }) => prop_assert_eq!(named, code),
                Err(_) => {}
            }
        }
    }
}
