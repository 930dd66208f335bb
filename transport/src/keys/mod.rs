//! Keys of peers: made, kept in files, handed to others.
//!
//! One pair of files serves every transport that encrypts: `NAME.key` is private and stays on its machine,
//! `NAME.pub` goes to the peers.

mod claim;
mod file;
mod fingerprint;
mod hex;
mod noise;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use rcgen::{CertificateParams, KeyPair, PKCS_ED25519};
use rustls::crypto::ring::sign::any_supported_type;
use rustls::pki_types::{CertificateDer, PrivatePkcs8KeyDer};
use rustls::sign::CertifiedKey;
use serde::{Deserialize, Serialize};
use zeroize::Zeroize;

use crate::Name;
pub(crate) use claim::KeyFault;
pub use claim::{PeerKey, UnknownPeer, WrongRole};
use file::PrivateFile;
pub use file::{KeyFiles, KeysError};
pub use fingerprint::{Fingerprint, FingerprintError};
pub(crate) use noise::NoiseSecret;
pub use noise::{NoiseKey, NoiseKeyError};

/// The name in a certificate. It has no meaning: peers know each other by fingerprint.
const COMMON_NAME: &str = "trimaran";

/// The private keys of a peer, and the matching public ones: a self-signed certificate for QUIC, a static
/// Noise key for UDP.
///
/// The certificate is Ed25519: its signatures have one length, so that a simulated handshake has the same
/// packets every time.
#[derive(Clone)]
pub struct Keys {
    #[cfg_attr(not(feature = "quic"), expect(dead_code, reason = "whoever reads it needs TLS"))]
    pub(crate) certified: Arc<CertifiedKey>,
    public: PublicKeys,
    file: Arc<PrivateFile>,
}

/// The public keys of a peer: its public file, `NAME.pub`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublicKeys {
    /// The name of the peer.
    pub name: Name,
    /// Its certificate's fingerprint: its identity over QUIC.
    pub quic: Fingerprint,
    /// Its public X25519 key: its identity over UDP.
    pub udp: NoiseKey,
}

/// The keys of this peer and of the peers that it knows.
#[derive(Debug, Clone, PartialEq)]
pub struct Security {
    /// This peer's own keys.
    pub keys: Keys,
    /// The known peers, each in its role. All others are refused. A key may be there more than once, with a
    /// role each.
    pub peers: Vec<KnownPeer>,
}

/// A peer that this one knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KnownPeer {
    /// Its public keys.
    pub keys: PublicKeys,
    /// The role that it may have; any if not given.
    pub role: Option<String>,
}

impl Keys {
    /// New keys that live as long as this process, unless they are [saved](Self::save).
    ///
    /// # Errors
    /// If the system gives no random bits.
    pub fn generate(name: Name) -> Result<Self, KeysError> {
        let mut key = KeyPair::generate_for(&PKCS_ED25519)?;
        let certificate = CertificateParams::new(vec![COMMON_NAME.to_owned()])?.self_signed(&key)?;
        let quic_key = key.serialize_der().into();
        key.zeroize();
        Self::assemble(PrivateFile {
            name,
            quic_certificate: certificate.der().to_vec().into(),
            quic_key,
            udp_key: NoiseSecret::random().map_err(KeysError::Random)?,
        })
    }

    /// Writes `NAME.key`, readable only by its owner, and `NAME.pub` into `folder`, which is created if
    /// missing.
    ///
    /// # Errors
    /// If one of the two exists already, or cannot be written; then neither is left behind.
    pub fn save(&self, folder: &Path) -> Result<KeyFiles, KeysError> {
        file::save(&self.file, &self.public, folder)
    }

    /// Reads a private file.
    ///
    /// # Errors
    /// If the file is missing, is not a private file, or others may read it.
    pub fn read(path: &Path) -> Result<Self, KeysError> {
        let file = file::read_private(path)?;
        Self::assemble(file).map_err(|e| KeysError::Unusable { path: path.to_owned(), cause: Box::new(e) })
    }

    /// This peer's public keys.
    #[must_use]
    pub const fn public(&self) -> &PublicKeys {
        &self.public
    }

    /// The secret behind [`PublicKeys::udp`].
    #[cfg(any(test, feature = "udp"))]
    pub(crate) fn noise(&self) -> &NoiseSecret {
        &self.file.udp_key
    }

    /// A secret of a QUIC listener at this port that stays the same when it is restarted.
    #[cfg(feature = "quic")]
    pub(crate) fn quic_reset_secret(&self, port: u16) -> [u8; 32] {
        let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, self.file.quic_key.as_ref());
        let mut of = ring::hmac::Context::with_key(&key);
        of.update(b"trimaran quic reset 1");
        of.update(&port.to_le_bytes());
        of.sign().as_ref().first_chunk().copied().unwrap_or_default()
    }

    fn assemble(file: PrivateFile) -> Result<Self, KeysError> {
        let certificate = CertificateDer::from(file.quic_certificate.as_ref().to_vec());
        let quic = Fingerprint::of(&certificate);
        let key = PrivatePkcs8KeyDer::from(file.quic_key.as_ref()).into();
        let certified = CertifiedKey::new(vec![certificate], any_supported_type(&key)?);
        certified.keys_match()?;
        let public = PublicKeys { name: file.name.clone(), quic, udp: file.udp_key.public() };
        Ok(Self { certified: Arc::new(certified), public, file: Arc::new(file) })
    }
}

impl KnownPeer {
    /// The holder of these keys may have this role.
    #[must_use]
    pub fn in_role(keys: PublicKeys, role: impl Into<String>) -> Self {
        Self { keys, role: Some(role.into()) }
    }
}

/// The holder of these keys may have any role.
impl From<PublicKeys> for KnownPeer {
    fn from(keys: PublicKeys) -> Self {
        Self { keys, role: None }
    }
}

impl PublicKeys {
    /// Reads a public file.
    ///
    /// # Errors
    /// If the file is missing or is not a public file.
    pub fn read(path: &Path) -> Result<Self, KeysError> {
        file::read_public(path)
    }
}

impl fmt::Debug for Keys {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Keys").field("public", &self.public).finish_non_exhaustive()
    }
}

impl PartialEq for Keys {
    fn eq(&self, other: &Self) -> bool {
        self.file == other.file
    }
}
