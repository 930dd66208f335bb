//! The four-byte header of every message.

use std::fmt;
use std::ops::RangeInclusive;

use crate::{BatchSize, Format, MAX_CHANNELS, MAX_HELLO, Numbered};

/// The bytes of a message's header: the kind, then the payload's length as 24 bits, little-endian.
pub const HEADER_BYTES: usize = 4;

/// The most bytes of a message of the messages lane, encoded by postcard.
pub const MAX_MESSAGE: usize = 16_384;

/// The most bytes of a block of the bulk lane.
pub const MAX_BLOCK: usize = 16_384;

/// The kind of a message: the first byte of its header.
///
/// The upper half of the code is the lane: 0 control, 1 the latest lane, 2 the frames lane, 3 the messages
/// lane, 4 the bulk lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Kind {
    /// A connecting peer's hello, with its session and lane.
    Hello = 0x01,
    /// The hello was accepted in version 4, which this does not name.
    Accept = 0x02,
    /// The hello was refused, and why.
    Refuse = 0x03,
    /// The peer closes, and why.
    Close = 0x04,
    /// The sender is idle, but alive.
    KeepAlive = 0x05,
    /// A hello of a peer whose protocol has channels.
    ChannelsHello = 0x06,
    /// The hello was accepted in the version that this names.
    VersionedAccept = 0x07,
    /// A value of the latest lane.
    Latest = 0x10,
    /// A value and its number, where the latest lane has no order of its own.
    Numbered = 0x11,
    /// A frame begins: its number and its header.
    Begin = 0x20,
    /// A batch of items of the frame that has begun.
    Batch = 0x21,
    /// The frame ends: its number, how many items it had, and their hash.
    End = 0x22,
    /// A batch of items of the frame that has begun, in the application's own shorter form.
    Coded = 0x24,
    /// An application's message on the messages lane.
    Message = 0x30,
    /// A block of the bulk lane.
    Block = 0x40,
}

impl Kind {
    /// Every kind, in the order of the codes.
    pub const ALL: [Self; 15] = [
        Self::Hello,
        Self::Accept,
        Self::Refuse,
        Self::Close,
        Self::KeepAlive,
        Self::ChannelsHello,
        Self::VersionedAccept,
        Self::Latest,
        Self::Numbered,
        Self::Begin,
        Self::Batch,
        Self::End,
        Self::Coded,
        Self::Message,
        Self::Block,
    ];

    /// The kind with this code, if there is one.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }

    /// The byte on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The payload lengths this kind allows, in bytes. Other lengths are refused before anything is stored.
    #[must_use]
    pub const fn lengths(self, format: &Format) -> RangeInclusive<usize> {
        match self {
            Self::Hello => 2..=MAX_HELLO + 58,
            Self::ChannelsHello => 2..=MAX_HELLO + 59 + MAX_CHANNELS * 40,
            Self::Accept => 1..=MAX_HELLO + 5,
            Self::VersionedAccept => 3..=MAX_HELLO + 7,
            Self::Refuse => 2..=512,
            Self::Close => 1..=256,
            Self::KeepAlive => 0..=0,
            Self::Latest => format.latest..=format.latest,
            Self::Numbered => {
                let bytes = Numbered::NUMBER_BYTES + format.latest;
                bytes..=bytes
            }
            Self::Begin => format.begin()..=format.begin(),
            Self::Batch => format.item..=format.batch(BatchSize::MAX),
            Self::End => 16..=16,
            // Shorter than the same items plain.
            Self::Coded => 1..=format.batch(BatchSize::MAX),
            Self::Message => 0..=MAX_MESSAGE,
            Self::Block => 0..=MAX_BLOCK,
        }
    }

    /// The header of a message of this kind. All lengths of [`Kind::lengths`] fit into 24 bits.
    pub(crate) fn header(self, length: usize) -> [u8; HEADER_BYTES] {
        (u32::from(self.code()) | (length as u32) << 8).to_le_bytes()
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Hello => "hello",
            Self::Accept => "accept",
            Self::Refuse => "refuse",
            Self::Close => "close",
            Self::KeepAlive => "keep-alive",
            Self::ChannelsHello => "hello with channels",
            Self::VersionedAccept => "accept with version",
            Self::Latest => "latest value",
            Self::Numbered => "numbered value",
            Self::Begin => "begin",
            Self::Batch => "batch",
            Self::Coded => "coded batch",
            Self::End => "end",
            Self::Message => "message",
            Self::Block => "block",
        })
    }
}

/// Splits a header into the code of its kind and the payload's length.
pub(crate) const fn parse_header(header: [u8; HEADER_BYTES]) -> (u8, usize) {
    let word = u32::from_le_bytes(header);
    (header[0], (word >> 8) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_kinds_are_one_to_one() {
        for code in 0..=255 {
            match Kind::from_code(code) {
                Some(kind) => assert_eq!(kind.code(), code),
                None => assert!(Kind::ALL.iter().all(|kind| kind.code() != code)),
            }
        }
    }

    #[test]
    fn every_length_fits_24_bits_and_survives() {
        let format = Format { latest: 72, header: 1024, item: 256, ..Format::default() };
        for kind in Kind::ALL {
            for length in [*kind.lengths(&format).start(), *kind.lengths(&format).end()] {
                assert_eq!(parse_header(kind.header(length)), (kind.code(), length));
            }
        }
    }
}
