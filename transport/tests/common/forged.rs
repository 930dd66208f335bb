//! Forgeries by an observer of a client's first QUIC packet: it knows the connection ids, and with them the
//! keys of first packets (RFC 9001, section 5.2).

use ring::aead::{AES_128_GCM, Aad, LessSafeKey, Nonce, UnboundKey};
use rustls::Side;
use rustls::crypto::ring::cipher_suite::TLS13_AES_128_GCM_SHA256;
use rustls::quic::{Keys, Version};

/// A forged answer.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Forgery {
    /// A claim that the listener speaks only another version of QUIC.
    VersionNegotiation,
    /// A request for address validation.
    Retry,
    /// A close of the connection for this reason (RFC 9000, section 20.1).
    Close(u16),
    /// A claim that the connection is unknown.
    StatelessReset,
}

impl Forgery {
    /// Refused; the certificate is not known; no common application protocol; and the others.
    pub(crate) const ALL: [Self; 6] = [
        Self::Close(0x0002),
        Self::Close(0x0100 + 46),
        Self::Close(0x0100 + 120),
        Self::VersionNegotiation,
        Self::Retry,
        Self::StatelessReset,
    ];
}

/// A client's first packet.
pub(crate) struct Initial {
    pub(crate) source: Vec<u8>,
    destination: Vec<u8>,
}

/// QUIC's version 1.
const VERSION: [u8; 4] = [0, 0, 0, 1];
/// The connection id of a listener that does not exist.
const ELSEWHERE: [u8; 8] = *b"somebody";

impl Initial {
    pub(crate) fn parse(datagram: &[u8]) -> Option<Self> {
        let rest = datagram.strip_prefix(&[*datagram.first().filter(|first| **first & 0xf0 == 0xc0)?])?;
        let (&length, rest) = rest.strip_prefix(&VERSION)?.split_first()?;
        let (destination, rest) = rest.split_at_checked(length.into())?;
        let (&length, rest) = rest.split_first()?;
        let (source, _) = rest.split_at_checked(length.into())?;
        Some(Self { source: source.to_vec(), destination: destination.to_vec() })
    }

    /// A long header as from the listener, answering a packet from `from`.
    fn header(&self, first: u8, version: [u8; 4], from: &[u8]) -> Vec<u8> {
        let length = |id: &[u8]| [u8::try_from(id.len()).unwrap()];
        let (to, from_length) = (length(&self.source), length(from));
        [&[first][..], &version, &to, &self.source, &from_length, from].concat()
    }

    pub(crate) fn forge(&self, forgery: Forgery) -> Vec<u8> {
        match forgery {
            Forgery::VersionNegotiation => {
                [self.header(0xc0, [0; 4], &self.destination), vec![0x0a, 0x0a, 0x0a, 0x0a]].concat()
            }
            Forgery::Retry => self.retry(),
            Forgery::Close(code) => self.close(code),
            Forgery::StatelessReset => [&[0x40][..], &self.source, &[7; 40]].concat(),
        }
    }

    /// The tag of a Retry is a checksum with a public key (RFC 9001, section 5.8).
    fn retry(&self) -> Vec<u8> {
        const KEY: [u8; 16] = 0xbe0c690b9f66575a1d766b54e368c84e_u128.to_be_bytes();
        const NONCE: [u8; 12] = [0x46, 0x15, 0x99, 0xd3, 0x5d, 0x63, 0x2b, 0xf2, 0x23, 0x98, 0x25, 0xbb];
        let packet =
            [self.header(0xf0, VERSION, &ELSEWHERE), b"no token of the listener's".to_vec()].concat();
        let length = u8::try_from(self.destination.len()).unwrap();
        let pseudo = [&[length][..], &self.destination, &packet].concat();
        let key = LessSafeKey::new(UnboundKey::new(&AES_128_GCM, &KEY).unwrap());
        let nonce = Nonce::assume_unique_for_key(NONCE);
        let tag = key.seal_in_place_separate_tag(nonce, Aad::from(pseudo), &mut []).unwrap();
        [&packet, tag.as_ref()].concat()
    }

    fn close(&self, code: u16) -> Vec<u8> {
        let suite = TLS13_AES_128_GCM_SHA256.tls13().unwrap();
        let keys =
            Keys::initial(Version::V1, suite, suite.quic.unwrap(), &self.destination, Side::Server).local;
        // CONNECTION_CLOSE with a code of two bytes, for a frame of no type and without words; then padding.
        let [high, low] = (0x4000 | code).to_be_bytes();
        let mut payload = vec![0x1c, high, low, 0x00, 0x00];
        payload.resize(40, 0);
        let number = [0, 0, 0, 0];
        let length = u16::try_from(number.len() + payload.len() + keys.packet.tag_len()).unwrap() | 0x4000;
        let mut header = self.header(0xc3, VERSION, &ELSEWHERE);
        header.push(0);
        header.extend(length.to_be_bytes());
        let number_at = header.len();
        header.extend(number);
        let tag = keys.packet.encrypt_in_place(0, &header, &mut payload).unwrap();
        let mut packet = [&header, &payload[..], tag.as_ref()].concat();
        let sample_at = number_at + 4;
        let sample = packet[sample_at..sample_at + keys.header.sample_len()].to_vec();
        let (first, rest) = packet.split_first_mut().unwrap();
        let number = &mut rest[number_at - 1..number_at + 3];
        keys.header.encrypt_in_place(&sample, first, number).unwrap();
        packet
    }
}
