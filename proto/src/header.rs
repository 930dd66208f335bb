//! The four bytes before every message.

use std::fmt;
use std::ops::RangeInclusive;

use crate::{BatchSize, Camera, NumberedCamera};

/// The bytes of a frame header: the kind, then the payload's length as 24 bits, little-endian.
pub const HEADER_BYTES: usize = 4;

/// What a message is: the first byte of its header.
///
/// The upper half of the code says where it belongs: 0 control, 1 the latest lane, 2 the frames lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Kind {
    /// Who connects, for which lane of which session.
    Hello = 0x01,
    /// The hello was taken.
    Accept = 0x02,
    /// The hello was not taken, and why.
    Refuse = 0x03,
    /// The peer leaves, and why.
    Goodbye = 0x04,
    /// The sender has nothing to say, and lives.
    Alive = 0x05,
    /// A camera on the latest lane.
    Camera = 0x10,
    /// A camera and its number, where the latest lane has no order of its own.
    Numbered = 0x11,
    /// A frame begins: its number and the camera it was culled for.
    Begin = 0x20,
    /// A batch of ids of the frame that has begun.
    Ids = 0x21,
    /// The frame ends: its number, how many ids it had, and their hash.
    End = 0x22,
    /// What the sender did for a frame that has ended.
    Stats = 0x23,
    /// A batch of ids of the frame that has begun, as changes against an earlier frame.
    Coded = 0x24,
}

impl Kind {
    /// Every kind, in the order of the codes.
    pub const ALL: [Self; 12] = [
        Self::Hello,
        Self::Accept,
        Self::Refuse,
        Self::Goodbye,
        Self::Alive,
        Self::Camera,
        Self::Numbered,
        Self::Begin,
        Self::Ids,
        Self::End,
        Self::Stats,
        Self::Coded,
    ];

    /// The kind with this code, if there is one.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }

    /// The byte that travels.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The payload lengths this kind allows, in bytes. Whatever a peer claims beyond them is refused before
    /// anything is stored.
    #[must_use]
    pub const fn lengths(self) -> RangeInclusive<usize> {
        match self {
            Self::Hello | Self::Accept => 2..=256,
            Self::Refuse => 2..=512,
            Self::Goodbye => 1..=256,
            Self::Alive => 0..=0,
            Self::Camera => Camera::SIZE..=Camera::SIZE,
            Self::Numbered => NumberedCamera::SIZE..=NumberedCamera::SIZE,
            Self::Begin => 4 + Camera::SIZE..=4 + Camera::SIZE,
            Self::Ids => 4..=BatchSize::MAX.bytes(),
            Self::End => 16..=16,
            Self::Stats => 1..=256,
            // Shorter than the same ids plain.
            Self::Coded => 3..=BatchSize::MAX.bytes(),
        }
    }

    /// The header of a message of this kind. `length` is within [`Kind::lengths`], so that 24 bits hold it.
    pub(crate) fn header(self, length: usize) -> [u8; HEADER_BYTES] {
        debug_assert!(self.lengths().contains(&length), "{self} of {length} bytes");
        (u32::from(self.code()) | (length as u32) << 8).to_le_bytes()
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Hello => "hello",
            Self::Accept => "accept",
            Self::Refuse => "refuse",
            Self::Goodbye => "goodbye",
            Self::Alive => "sign of life",
            Self::Camera => "camera",
            Self::Numbered => "numbered camera",
            Self::Begin => "begin",
            Self::Ids => "ids",
            Self::Coded => "coded ids",
            Self::End => "end",
            Self::Stats => "stats",
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
        for kind in Kind::ALL {
            for length in [*kind.lengths().start(), *kind.lengths().end()] {
                assert_eq!(parse_header(kind.header(length)), (kind.code(), length));
            }
        }
    }
}
