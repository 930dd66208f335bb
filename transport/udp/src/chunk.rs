//! The inside of a packet: a sequence of chunks.

use trimaran_wire::{Format, HEADER_BYTES, Kind};

use crate::packet::CookieBytes;
use crate::ranges::RangeSet;
use crate::repair::Block;
use crate::wire::varint_len;

mod codec;

pub(crate) use codec::CLOSE;

/// The ranges of packet numbers that an acknowledgement names at most; older ones have been named often
/// enough.
pub(crate) const ACK_RANGES: usize = 32;

/// A lane that is a sequence of units: each is put together by itself, and they are passed on in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UnitLane {
    /// A unit is a frame.
    Frames,
    /// A unit is a message.
    Messages,
    /// A unit is a block. Its bytes leave when no other lane has anything to send.
    Bulk,
}

impl UnitLane {
    /// Every lane, in the order of its precedence; of frames and messages neither waits for the other.
    pub const ALL: [Self; 3] = [Self::Frames, Self::Messages, Self::Bulk];
}

/// How a part of a unit relates to what follows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tail {
    /// More of the unit follows.
    More,
    /// Nothing follows for now: the receiver shall pass on what it has.
    Pause,
    /// The unit ends here, and is no whole frame.
    End,
    /// The frame ends here; the hash of its items.
    Frame(u64),
}

/// Whether a packet is to be acknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Asks {
    Nothing,
    Ack,
    /// By an acknowledgement of its own, at once.
    AckNow,
}

/// One chunk.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Chunk<'a> {
    /// Nothing: a byte that fills a packet up.
    Pad,
    /// Only to be acknowledged, at once.
    Ping,
    /// Packets that arrived; the newest one so many microseconds ago.
    Ack { delay_us: u64, numbers: RangeSet },
    /// How many bytes and units the sender may send on a lane in all.
    MaxData { lane: UnitLane, bytes: u64, units: u64 },
    /// The sender is gone.
    Close,
    /// A value of the latest lane, the `number`th that was published.
    Latest { number: u64, value: &'a [u8] },
    /// The latest lane ends behind value `number`, 0 if there was none, with the encoded close, or with
    /// none.
    LastLatest { number: u64, close: &'a [u8] },
    /// The sender reads no more of a lane.
    StopSending { lane: UnitLane },
    /// Who receives at the address that this is sent to shall bring the cookie back from there.
    Challenge { cookie: CookieBytes },
    /// The cookie of a challenge.
    Response { cookie: CookieBytes },
    /// Bytes of a unit. Those of messages and of blocks have no other tail than more and end.
    Part { lane: UnitLane, unit: u64, offset: u64, tail: Tail, data: &'a [u8] },
    /// What has not arrived of a frame will not come any more.
    GiveUp { unit: u64, about: GivenUp, head: &'a [u8] },
    /// A repair shard of a block of a unit; with the frame's hash where the block ends the frame.
    Repair { unit: u64, block: Block, hash: Option<u64>, index: u8, data: &'a [u8] },
}

/// What is said of a frame when it is given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct GivenUp {
    /// The bytes of its unit.
    pub(crate) length: u64,
    /// How many of them were sent, from the first on.
    pub(crate) sent: u64,
    pub(crate) hash: u64,
    /// How many items it has, where that does not follow from its length: its batches are messages.
    pub(crate) coded: Option<u64>,
}

/// The first byte of a frame's unit whose batches are messages, so that they can be changes. Any other begins
/// with the message begin.
pub(crate) const CODED_UNIT: u8 = Kind::Coded.code();

/// What a frame's unit starts with: the header and payload of begin, and a byte before them where its batches
/// are messages.
pub(crate) const fn unit_head(format: &Format, coded: bool) -> usize {
    HEADER_BYTES + format.begin() + coded as usize
}

/// The most bytes that a part has beside its data.
pub(crate) fn part_overhead(unit: u64, offset: u64) -> usize {
    1 + varint_len(unit) + varint_len(offset) + 2 + 8
}

impl Chunk<'_> {
    /// What it asks of who receives it.
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
