//! The outer layer of a datagram: its kind, and its connection.

use crate::wire::{Malformed, Reader};

/// The version of the datagrams' layout.
pub const VERSION: u64 = 4;

/// The smallest path supported: every path of IPv6 carries that much. The first packet of a connection is as
/// long, so that a path that does not carry it is detected at once (RFC 9000, section 14).
pub const MIN_DATAGRAM: usize = 1200;

/// Bytes that authenticate a packet.
pub(crate) const TAG: usize = 16;

/// Bytes before the protected part of a data packet.
pub(crate) const HEADER: usize = 12;

/// The number of a data packet: 0 to 2^62 - 2, rising, never used twice under one key, for any contents.
///
/// It is sent in full. Truncated as in QUIC it would save four of 1,200 bytes, and reading a header would
/// need state (the largest number so far). In full, the number is the nonce and the header can be read by
/// itself.
pub(crate) type PacketNumber = u64;

/// One past the last number. A connection that sends a million packets a second reaches it after 146,000
/// years. In the place of a number it says that the packet is a reset.
pub(crate) const NUMBERS: PacketNumber = (1 << 62) - 1;

/// The receiver's name for a connection, chosen by it at random.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ConnectionId(pub u32);

/// The cookie that a listener sends a stranger: the time and a keyed hash of it and of the stranger's
/// address.
pub(crate) type CookieBytes = [u8; 24];

/// The bytes of a reset's token.
pub(crate) const TOKEN: usize = 16;

/// The proof that a reset comes from the listener: the peer got it in the answer (as in RFC 9000, section
/// 10.3).
pub(crate) type ResetToken = [u8; TOKEN];

/// A datagram, with its contents unopened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packet<'a> {
    /// The sender of `token` knows no connection of this name of its own.
    Reset { unknown: ConnectionId, token: &'a ResetToken },
    /// Protected chunks.
    Data { to: ConnectionId, number: PacketNumber, sealed: &'a [u8] },
    /// A stranger asks for a connection.
    Initial { version: u64, from: ConnectionId, cookie: Option<&'a CookieBytes>, noise: &'a [u8] },
    /// The stranger must validate its address.
    Retry { version: u64, to: ConnectionId, cookie: &'a CookieBytes },
    /// The listener's half of the handshake.
    Answer { version: u64, to: ConnectionId, noise: &'a [u8] },
}

const DATA: u64 = 0;
const INITIAL: u64 = 1;
const RETRY: u64 = 2;
const ANSWER: u64 = 3;

impl<'a> Packet<'a> {
    pub(crate) fn parse(datagram: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(datagram);
        let word = reader.u64("packet header")?;
        let id = ConnectionId(reader.u32("connection id")?);
        let number = word >> 2;
        match word & 3 {
            DATA if number == NUMBERS => Ok(Self::Reset { unknown: id, token: reader.array("reset token")? }),
            DATA => Ok(Self::Data { to: id, number, sealed: reader.rest() }),
            // In another version nothing further can be read.
            INITIAL if number != VERSION => {
                Ok(Self::Initial { version: number, from: id, cookie: None, noise: &[] })
            }
            INITIAL => {
                let cookie = match reader.u8("cookie flag")? {
                    0 => None,
                    1 => Some(reader.array("cookie")?),
                    _ => return Err(Malformed::Range { what: "cookie flag" }),
                };
                let length = usize::from(reader.u16("handshake length")?);
                let noise = reader.take(length, "handshake")?;
                Ok(Self::Initial { version: number, from: id, cookie, noise })
            }
            RETRY => Ok(Self::Retry { version: number, to: id, cookie: reader.array("cookie")? }),
            _ => Ok(Self::Answer { version: number, to: id, noise: reader.rest() }),
        }
    }

    /// Writes the datagram into `out`, which it replaces.
    pub(crate) fn write(&self, out: &mut Vec<u8>) {
        out.clear();
        let mut head = |form: u64, number: u64, id: ConnectionId| {
            out.extend_from_slice(&(number << 2 | form).to_le_bytes());
            out.extend_from_slice(&id.0.to_le_bytes());
        };
        match *self {
            Self::Reset { unknown, token } => {
                head(DATA, NUMBERS, unknown);
                out.extend_from_slice(token);
            }
            Self::Data { to, number, sealed } => {
                head(DATA, number, to);
                out.extend_from_slice(sealed);
            }
            Self::Initial { version, from, cookie, noise } => {
                head(INITIAL, version, from);
                out.push(u8::from(cookie.is_some()));
                out.extend_from_slice(cookie.map_or(&[][..], |bytes| bytes));
                out.extend_from_slice(&(noise.len() as u16).to_le_bytes());
                out.extend_from_slice(noise);
                out.resize(MIN_DATAGRAM, 0);
            }
            Self::Retry { version, to, cookie } => {
                head(RETRY, version, to);
                out.extend_from_slice(cookie);
            }
            Self::Answer { version, to, noise } => {
                head(ANSWER, version, to);
                out.extend_from_slice(noise);
            }
        }
    }
}

/// The connection of a datagram, if it is a packet of one.
#[must_use]
pub fn destination(datagram: &[u8]) -> Option<ConnectionId> {
    match Packet::parse(datagram) {
        Ok(Packet::Data { to, .. }) => Some(to),
        _ => None,
    }
}

/// The header of a data packet.
pub(crate) fn data_header(to: ConnectionId, number: PacketNumber) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    let (word, id) = header.split_at_mut(8);
    word.copy_from_slice(&(number << 2 | DATA).to_le_bytes());
    id.copy_from_slice(&to.0.to_le_bytes());
    header
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn back(packet: Packet<'_>) {
        let mut out = vec![1, 2, 3];
        packet.write(&mut out);
        assert_eq!(Packet::parse(&out), Ok(packet));
    }

    #[test]
    fn packets_come_back() {
        let id = ConnectionId(0xdead_beef);
        let cookie = &[7; 24];
        back(Packet::Data { to: id, number: NUMBERS - 1, sealed: b"sealed" });
        back(Packet::Reset { unknown: id, token: &[8; 16] });
        back(Packet::Initial { version: VERSION, from: id, cookie: None, noise: b"hello" });
        back(Packet::Initial { version: VERSION, from: id, cookie: Some(cookie), noise: &[9; 400] });
        back(Packet::Initial { version: 2, from: id, cookie: None, noise: &[] });
        back(Packet::Retry { version: VERSION, to: id, cookie });
        back(Packet::Answer { version: VERSION, to: id, noise: b"answer" });
    }

    #[test]
    fn a_length_beyond_the_datagram_is_refused() {
        let mut out = Vec::new();
        Packet::Initial { version: VERSION, from: ConnectionId(1), cookie: None, noise: b"hello" }
            .write(&mut out);
        out[13..15].copy_from_slice(&u16::MAX.to_le_bytes());
        assert_eq!(Packet::parse(&out), Err(Malformed::Short { what: "handshake" }));
    }

    #[test]
    fn an_initial_of_another_version_is_read_only_up_to_the_id() {
        let initial = Packet::Initial { version: 2, from: ConnectionId(1), cookie: None, noise: &[] };
        let mut out = Vec::new();
        initial.write(&mut out);
        out[HEADER..].fill(0xff);
        assert_eq!(Packet::parse(&out), Ok(initial));
    }

    proptest! {
        #[test]
        fn any_bytes_are_judged(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            let _judged = Packet::parse(&bytes);
        }
    }
}
