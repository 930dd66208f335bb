//! What a peer is known by.

use std::fmt;
use std::str::FromStr;

use ring::digest::{SHA256, digest};
use rustls::pki_types::CertificateDer;
use thiserror::Error;

/// SHA-256 of a peer's certificate (DER), as `openssl x509 -fingerprint -sha256` prints it.
///
/// Written as 64 hexadecimal digits; read with or without colons between the bytes.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Fingerprint([u8; 32]);

/// A text that is no fingerprint.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is no fingerprint: give the 64 hexadecimal digits that `trimaran keys new` prints")]
pub struct FingerprintError(String);

impl Fingerprint {
    /// The fingerprint of a certificate.
    pub(crate) fn of(certificate: &CertificateDer<'_>) -> Self {
        let mut bytes = [0; 32];
        bytes.copy_from_slice(digest(&SHA256, certificate).as_ref());
        Self(bytes)
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for Fingerprint {
    type Err = FingerprintError;

    fn from_str(text: &str) -> Result<Self, FingerprintError> {
        let wrong = || FingerprintError(text.to_owned());
        let digits: String = match text.len() {
            64 => text.to_owned(),
            95 => text
                .bytes()
                .enumerate()
                .filter(|(i, byte)| i % 3 != 2 || *byte != b':')
                .map(|(_, byte)| char::from(byte))
                .collect(),
            _ => return Err(wrong()),
        };
        let mut bytes = [0; 32];
        let (pairs, rest) = digits.as_bytes().as_chunks::<2>();
        if pairs.len() != bytes.len() || !rest.is_empty() {
            return Err(wrong());
        }
        for (byte, [high, low]) in bytes.iter_mut().zip(pairs) {
            let digit = |c: u8| char::from(c).to_digit(16).map(|d| d as u8);
            *byte = digit(*high).zip(digit(*low)).map(|(high, low)| high << 4 | low).ok_or_else(wrong)?;
        }
        Ok(Self(bytes))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn it_is_the_sha_256_of_the_certificate() {
        let print = Fingerprint::of(&CertificateDer::from_slice(b"abc"));
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(print.to_string(), known);
        assert_eq!(known.parse(), Ok(print));
        assert_eq!(known.to_uppercase().parse(), Ok(print));
    }

    #[test]
    fn a_text_of_another_shape_is_refused() {
        for text in ["", "ab", &"g".repeat(64), &"0".repeat(63), &"0".repeat(95), &"é".repeat(32)] {
            assert_eq!(text.parse::<Fingerprint>(), Err(FingerprintError(text.to_owned())));
        }
    }

    proptest! {
        #[test]
        fn it_is_read_back_with_and_without_colons(bytes: [u8; 32]) {
            let print = Fingerprint(bytes);
            let pairs: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            prop_assert_eq!(print.to_string().parse(), Ok(print));
            prop_assert_eq!(pairs.join(":").parse(), Ok(print));
        }

        #[test]
        fn no_text_panics(text in any::<String>()) {
            let _ = text.parse::<Fingerprint>();
        }
    }
}
