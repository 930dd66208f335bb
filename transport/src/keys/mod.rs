//! Keys of peers: made, kept in files, handed to others.
//!
//! One pair of files serves every transport that encrypts: `NAME.key` is private and stays on its machine,
//! `NAME.pub` goes to the peers.

#[cfg(feature = "quic")]
mod certificate;
mod claim;
mod file;
mod fingerprint;
mod hex;
mod known;
mod noise;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::Name;
#[cfg(feature = "quic")]
pub(crate) use certificate::QuicIdentity;
pub(crate) use claim::KeyFault;
pub use claim::{PeerKey, UnknownPeer, WrongRole};
use file::PrivateFile;
pub use file::{KeyFiles, KeysError};
pub use fingerprint::{Fingerprint, FingerprintError};
pub use known::{KnownPeer, KnownPeers};
pub(crate) use noise::NoiseSecret;
pub use noise::{NoiseKey, NoiseKeyError};

/// The private keys of a peer, and the matching public ones: a static Noise key for UDP, and for QUIC an
/// Ed25519 key with its self-signed certificate.
///
/// A program without the feature `quic` makes keys for UDP alone. It keeps those for QUIC that it reads.
#[derive(Clone)]
pub struct Keys {
    #[cfg(feature = "quic")]
    quic: Option<QuicIdentity>,
    public: PublicKeys,
    file: Arc<PrivateFile>,
}

/// The public keys of a peer: its public file, `NAME.pub`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct PublicKeys {
    /// The name of the peer.
    pub name: Name,
    /// Its certificate's fingerprint: its identity over QUIC. None if it has keys for UDP alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quic: Option<Fingerprint>,
    /// Its public X25519 key: its identity over UDP.
    pub udp: NoiseKey,
}

/// The keys of this peer and of the peers that it knows.
#[derive(Debug, Clone, PartialEq)]
pub struct Security {
    /// This peer's own keys.
    pub keys: Keys,
    /// The known peers.
    pub peers: KnownPeers,
}

impl Security {
    /// All peers have these same keys, and may have any role: for programs of one owner, or a test.
    #[must_use]
    pub fn shared(keys: Keys) -> Self {
        Self { peers: vec![keys.public().clone().into()].into(), keys }
    }
}

impl Keys {
    /// New keys that live as long as this process, unless they are [saved](Self::save).
    ///
    /// # Errors
    /// If the system gives no random bits.
    pub fn generate(name: Name) -> Result<Self, KeysError> {
        #[cfg(feature = "quic")]
        let (quic_certificate, quic_key) = certificate::generate().map(|(of, key)| (Some(of), Some(key)))?;
        #[cfg(not(feature = "quic"))]
        let (quic_certificate, quic_key) = (None, None);
        let udp_key = NoiseSecret::random().map_err(KeysError::Random)?;
        Self::assemble(PrivateFile { name, quic_certificate, quic_key, udp_key })
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

    /// The key and the certificate behind [`PublicKeys::quic`].
    #[cfg(feature = "quic")]
    pub(crate) const fn quic(&self) -> Option<&QuicIdentity> {
        self.quic.as_ref()
    }

    fn assemble(file: PrivateFile) -> Result<Self, KeysError> {
        let quic = file.quic()?;
        let fingerprint = quic.map(|(certificate, _)| Fingerprint::of(certificate.as_ref()));
        let public = PublicKeys { name: file.name.clone(), quic: fingerprint, udp: file.udp_key.public() };
        Ok(Self {
            #[cfg(feature = "quic")]
            quic: quic.map(|(certificate, key)| QuicIdentity::new(certificate, key)).transpose()?,
            public,
            file: Arc::new(file),
        })
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
