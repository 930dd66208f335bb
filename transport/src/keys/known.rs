//! The peers that a role knows.

use std::{fmt, sync::Arc};

use parking_lot::RwLock;

use super::PublicKeys;

/// A peer that this one knows.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct KnownPeer {
    /// Its public keys.
    pub keys: PublicKeys,
    /// The role that it may have; any if not given.
    pub role: Option<String>,
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

/// The known peers, each in its role. All others are refused. A key may be there more than once, with a role
/// each.
///
/// Clones share the list, and it may change while links go on: listeners and connecting sides use the list of
/// the moment for each handshake. Links that are there stay.
#[derive(Clone)]
pub struct KnownPeers(Arc<RwLock<Arc<[KnownPeer]>>>);

impl KnownPeers {
    /// Those of this moment.
    #[must_use]
    pub fn now(&self) -> Arc<[KnownPeer]> {
        Arc::clone(&self.0.read())
    }

    /// Knows these from now on, and no others.
    pub fn replace(&self, peers: &Self) {
        let peers = peers.now();
        *self.0.write() = peers;
    }
}

impl fmt::Debug for KnownPeers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.now().fmt(f)
    }
}

impl PartialEq for KnownPeers {
    fn eq(&self, other: &Self) -> bool {
        self.now() == other.now()
    }
}

impl From<Vec<KnownPeer>> for KnownPeers {
    fn from(peers: Vec<KnownPeer>) -> Self {
        Self(Arc::new(RwLock::new(peers.into())))
    }
}

impl FromIterator<KnownPeer> for KnownPeers {
    fn from_iter<I: IntoIterator<Item = KnownPeer>>(peers: I) -> Self {
        Vec::from_iter(peers).into()
    }
}
