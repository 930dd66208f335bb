//! Sealing and opening packets.

use snow::StatelessTransportState;
use xxhash_rust::xxh3::xxh3_128_with_seed;

use crate::packet::{ConnectionId, HEADER, PacketNumber, TAG};

/// The keys of a connection's packets.
///
/// The number of a packet is the nonce, and the connection id chooses the key. So a packet with a changed
/// header does not open, although the header is not among the authenticated data of the Noise transport.
pub(crate) enum Keys {
    /// Encrypted and authenticated.
    Noise(Box<StatelessTransportState>),
    /// In plaintext, with a hash against random errors, not against attackers.
    Plaintext,
}

impl Keys {
    /// Seals `plain` behind the header in `out`.
    pub(crate) fn seal(
        &self,
        to: ConnectionId,
        number: PacketNumber,
        plain: &[u8],
        out: &mut Vec<u8>,
    ) -> bool {
        let start = out.len();
        match self {
            Self::Noise(noise) => {
                out.resize(start + plain.len() + TAG, 0);
                out.get_mut(start..).is_some_and(|sealed| noise.write_message(number, plain, sealed).is_ok())
            }
            Self::Plaintext => {
                out.extend_from_slice(plain);
                out.extend_from_slice(&checksum(to, number, plain));
                true
            }
        }
    }

    /// Opens a sealed packet into `plain`, which it replaces; false if the peer did not seal it.
    pub(crate) fn open(
        &self,
        to: ConnectionId,
        number: PacketNumber,
        sealed: &[u8],
        plain: &mut Vec<u8>,
    ) -> bool {
        let Some((body, tag)) = sealed.split_last_chunk::<TAG>() else { return false };
        match self {
            Self::Noise(noise) => {
                // With room for the tag it is opened in place; otherwise it would be opened elsewhere, and
                // moved.
                plain.resize(sealed.len(), 0);
                let opened = noise.read_message(number, sealed, plain);
                plain.truncate(body.len());
                opened.is_ok()
            }
            Self::Plaintext => {
                plain.clear();
                plain.extend_from_slice(body);
                *tag == checksum(to, number, body)
            }
        }
    }
}

fn checksum(to: ConnectionId, number: PacketNumber, plain: &[u8]) -> [u8; TAG] {
    xxh3_128_with_seed(plain, number ^ u64::from(to.0).rotate_left(32)).to_le_bytes()
}

/// The bytes of a sealed packet beside its chunks.
pub(crate) const OVERHEAD: usize = HEADER + TAG;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_in_the_clear_opens_as_what_it_was_sealed_as() {
        let (id, number) = (ConnectionId(1), 1 << 32 | 5);
        let (mut sealed, mut plain) = (Vec::new(), Vec::new());
        assert!(Keys::Plaintext.seal(id, number, b"chunks", &mut sealed));
        let mut opens = |id, number| Keys::Plaintext.open(id, number, &sealed, &mut plain);
        assert!(opens(id, number));
        assert!(!opens(ConnectionId(3), number) && !opens(id, 5), "of another connection, another number");
        assert_eq!(plain, b"chunks");
    }
}
