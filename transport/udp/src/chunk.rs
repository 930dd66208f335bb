//! The contents of a packet: a sequence of chunks.

use trimaran_wire::{ChannelNumber, Format, HEADER_BYTES, Kind};

use crate::packet::CookieBytes;
use crate::ranges::RangeSet;
use crate::repair::Block;
use crate::wire::varint_len;

mod codec;

pub(crate) use codec::CLOSE;

/// The most ranges of packet numbers in an acknowledgement; older ones have been named often enough.
pub(crate) const ACK_RANGES: usize = 32;

/// A lane that is a sequence of units: each is assembled independently, and they are delivered in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnitLane {
    /// A unit is a frame.
    #[default]
    Frames,
    /// A unit is a message.
    Messages,
    /// A unit is a block. Its bytes are sent only when no other lane has anything to send.
    Bulk,
    /// A unit is a frame of a channel.
    Channel(ChannelNumber),
}

impl UnitLane {
    /// Every lane beside channels, in the order of its priority; frames, those of channels and messages take
    /// turns.
    pub const ALL: [Self; 3] = [Self::Frames, Self::Messages, Self::Bulk];
}

/// The relation of a part to the rest of its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tail {
    /// More of the unit follows.
    More,
    /// Nothing follows for now: the receiver delivers what it has.
    Pause,
    /// The unit ends here, and is not a complete frame.
    End,
    /// The frame ends here; the hash of its items.
    Frame(u64),
}

/// Whether a packet must be acknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Asks {
    Nothing,
    Ack,
    /// Immediately, by an acknowledgement of its own.
    AckNow,
}

/// One chunk.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Chunk<'a> {
    /// A padding byte.
    Pad,
    /// Asks for an immediate acknowledgement.
    Ping,
    /// Packets that arrived; the newest one so many microseconds ago.
    Ack { delay_us: u64, numbers: RangeSet },
    /// The total of bytes and units that the sender may send on a lane.
    MaxData { lane: UnitLane, bytes: u64, units: u64 },
    /// The sender has closed the connection.
    Close,
    /// Value `number` of the latest lane or of a channel, counted as published.
    Latest { channel: Option<ChannelNumber>, number: u64, value: &'a [u8] },
    /// The latest lane ends behind value `number`, 0 if there was none, with the encoded close, or with
    /// none.
    LastLatest { channel: Option<ChannelNumber>, number: u64, close: &'a [u8] },
    /// The sender reads no more of a lane.
    StopSending { lane: UnitLane },
    /// Asks for the cookie back from the address to which this is sent.
    Challenge { cookie: CookieBytes },
    /// The cookie of a challenge.
    Response { cookie: CookieBytes },
    /// Bytes of a unit. Those of messages and of blocks have no tails other than more and end.
    Part { lane: UnitLane, unit: u64, offset: u64, tail: Tail, data: &'a [u8] },
    /// The missing bytes of a frame will not come.
    GiveUp { lane: UnitLane, unit: u64, about: GivenUp, head: &'a [u8] },
    /// A repair shard of a block of a unit; with the frame's hash where the block ends the frame.
    Repair { lane: UnitLane, unit: u64, block: Block, hash: Option<u64>, index: u8, data: &'a [u8] },
}

/// The description of a frame that is given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GivenUp {
    /// The bytes of its unit.
    pub(crate) length: u64,
    /// How many of them were sent, from the start.
    pub(crate) sent: u64,
    pub(crate) hash: u64,
    /// The number of items, if it does not follow from the length: the batches are messages.
    pub(crate) coded: Option<u64>,
}

/// The first byte of a frame's unit whose batches are messages, and may be coded. Any other unit of a frame
/// begins with the message begin.
pub(crate) const CODED_UNIT: u8 = Kind::Coded.code();

/// The start of a frame's unit: the header and payload of begin, and a byte before them if its batches are
/// messages.
pub(crate) const fn unit_head(format: &Format, coded: bool) -> usize {
    HEADER_BYTES + format.begin() + coded as usize
}

/// The most bytes that a part has beside its data.
pub(crate) fn part_overhead(lane: UnitLane, unit: u64, offset: u64) -> usize {
    let channel = if matches!(lane, UnitLane::Channel(_)) { 2 } else { 0 };
    channel + 1 + varint_len(unit) + varint_len(offset) + 2 + 8
}

impl Chunk<'_> {
    /// The channel that it is about.
    pub(crate) const fn channel(&self) -> Option<ChannelNumber> {
        match self {
            Self::Latest { channel, .. } | Self::LastLatest { channel, .. } => *channel,
            Self::MaxData { lane, .. }
            | Self::StopSending { lane }
            | Self::Part { lane, .. }
            | Self::GiveUp { lane, .. }
            | Self::Repair { lane, .. } => match lane {
                UnitLane::Channel(number) => Some(*number),
                _ => None,
            },
            _ => None,
        }
    }

    /// The acknowledgement that it asks for.
    pub(crate) const fn asks(&self) -> Asks {
        match self {
            Self::Ack { .. } | Self::Close | Self::Pad | Self::Challenge { .. } | Self::Response { .. } => {
                Asks::Nothing
            }
            Self::Ping => Asks::AckNow,
            _ => Asks::Ack,
        }
    }
}
