//! Sealing and opening packets.

use snow::StatelessTransportState;
use xxhash_rust::xxh3::xxh3_128_with_seed;

use crate::packet::{ConnectionId, HEADER, PacketNumber, TAG};

/// What protects the packets of a connection.
///
/// The number of a packet is the nonce, and the key is chosen by the connection id: a packet whose header was
/// changed does not open, although the header is not among the authenticated data of the Noise transport.
pub(crate) enum Keys {
    /// Encrypted and authenticated.
    Noise(Box<StatelessTransportState>),
    /// In the clear, with a hash against accidents, none against attackers.
    Plaintext,
}

impl Keys {
    /// Seals `plain` behind the header that is in `out`.
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

    /// Opens what was sealed into `plain`, which it replaces; false when it is not what the peer sealed.
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
                // With room for the tag it is opened there; with less it would be opened elsewhere, and
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

/// What a sealed packet has beside its chunks, bytes.
pub(crate) const OVERHEAD: usize = HEADER + TAG;
