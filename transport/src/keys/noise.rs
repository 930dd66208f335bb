//! Static keys of the Noise handshake, X25519 (RFC 7748), by which UDP peers know each other.

use std::fmt;
use std::str::FromStr;

use curve25519_dalek::MontgomeryPoint;
use serde::{Deserialize, Serialize, Serializer};
use thiserror::Error;
use zeroize::Zeroizing;

use super::hex;

/// The public key of a peer over UDP. Written as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct NoiseKey([u8; 32]);

/// A text that is not a public key.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is no public key: give the 64 hexadecimal digits of `PublicKeys::udp`")]
pub struct NoiseKeyError(String);

/// A private key. It is never printed, and it is wiped from memory when dropped.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub(crate) struct NoiseSecret(Zeroizing<[u8; 32]>);

/// A text that is not a private key; it is not repeated here.
#[derive(Debug, Error)]
#[error("a private key has 64 hexadecimal digits")]
pub(crate) struct NoiseSecretError;

impl NoiseKey {
    /// The key's bytes, as the Noise handshake takes them.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 32] {
        self.0
    }

    /// The key of these bytes, as the Noise handshake gives them.
    #[cfg(feature = "udp")]
    pub(crate) const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }
}

impl NoiseSecret {
    /// A new random secret from the system.
    pub(super) fn random() -> std::io::Result<Self> {
        let mut bytes = Zeroizing::new([0; 32]);
        getrandom::fill(&mut *bytes)?;
        Ok(Self(bytes))
    }

    /// The secret's bytes, as the Noise handshake takes them.
    #[cfg(feature = "udp")]
    pub(crate) fn to_bytes(&self) -> Zeroizing<[u8; 32]> {
        self.0.clone()
    }

    /// The matching public key.
    pub(super) fn public(&self) -> NoiseKey {
        NoiseKey(MontgomeryPoint::mul_base_clamped(*self.0).to_bytes())
    }

    /// Its 64 hexadecimal digits.
    pub(super) fn to_text(&self) -> Zeroizing<String> {
        let mut text = Zeroizing::new(String::with_capacity(64));
        for byte in *self.0 {
            text.extend(
                [byte >> 4, byte & 15].map(|digit| char::from_digit(digit.into(), 16).unwrap_or_default()),
            );
        }
        text
    }
}

impl fmt::Display for NoiseKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        hex::write(&self.0, f)
    }
}

impl fmt::Debug for NoiseKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for NoiseKey {
    type Err = NoiseKeyError;

    fn from_str(text: &str) -> Result<Self, NoiseKeyError> {
        hex::read(text).map(Self).ok_or_else(|| NoiseKeyError(text.to_owned()))
    }
}

impl TryFrom<String> for NoiseKey {
    type Error = NoiseKeyError;

    fn try_from(text: String) -> Result<Self, NoiseKeyError> {
        text.parse()
    }
}

impl From<NoiseKey> for String {
    fn from(key: NoiseKey) -> Self {
        key.to_string()
    }
}

impl fmt::Debug for NoiseSecret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("NoiseSecret")
    }
}

impl TryFrom<String> for NoiseSecret {
    type Error = NoiseSecretError;

    fn try_from(text: String) -> Result<Self, NoiseSecretError> {
        let text = Zeroizing::new(text);
        hex::read(&text).map(|bytes| Self(bytes.into())).ok_or(NoiseSecretError)
    }
}

impl Serialize for NoiseSecret {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.to_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_public_key_is_that_of_rfc_7748() {
        // Section 6.1: Bob's keys.
        let secret = "5dab087e624a8a4b79e17f8b83800ee66f3bb1292618b6fd1c2f8b27ff88e0eb".to_owned();
        let public = "de9edb7d7b7dc1b4d35b61c2ece435373f8343c85b78674dadfc7e146f882b4f";
        let secret = NoiseSecret::try_from(secret).unwrap();
        assert_eq!(secret.public().to_string(), public);
        assert_eq!(public.parse(), Ok(secret.public()));
        assert_eq!(secret.public().to_bytes()[0], 0xde);
    }

    #[test]
    fn a_secret_is_random_and_nothing_prints_it() {
        let (one, other) = (NoiseSecret::random().unwrap(), NoiseSecret::random().unwrap());
        assert_ne!(one, other);
        assert_eq!(format!("{one:?}"), "NoiseSecret");
        let error = NoiseSecret::try_from("5ec2e7".to_owned()).unwrap_err();
        assert!(!error.to_string().contains("5ec2e7"), "{error}");
    }
}
