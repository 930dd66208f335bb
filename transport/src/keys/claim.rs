//! The roles of a peer, by its key.

use std::fmt;

use thiserror::Error;
use trimaran_wire::{CloseReason, Explanation, Refusal};

use super::{Fingerprint, KnownPeer, NoiseKey, Security};
use crate::Name;

/// The key that a peer has proved to hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PeerKey {
    /// The key of its certificate, over QUIC.
    Quic(Fingerprint),
    /// Its static key, over datagrams.
    Udp(NoiseKey),
}

/// A peer that claims a role for which its key is not known.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "key '{name}' ({key}) claims to be {claimed}; this configuration knows it as {known}: give each role the keys that its peers know \
     it by"
)]
pub struct WrongRole {
    /// The name of the key.
    pub name: Name,
    /// The key.
    pub key: PeerKey,
    /// The role that its holder claims.
    pub claimed: String,
    /// The role for which this side knows the key.
    pub known: String,
}

/// This side does not know the peer's certificate.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "the peer's certificate is {presented}, but {} expected: if it is the right peer, add its fingerprint to the peers",
    expectation(.expected)
)]
pub struct UnknownPeer {
    /// The certificates that this side knows.
    pub expected: Vec<Fingerprint>,
    /// The certificate that was shown.
    pub presented: Fingerprint,
}

fn expectation(expected: &[Fingerprint]) -> String {
    match expected {
        [] => "none is".to_owned(),
        [one] => format!("{one} is"),
        many => format!("one of {many:?} is"),
    }
}

/// Why the holder of a key is refused.
#[derive(Debug, PartialEq)]
pub(crate) enum KeyFault {
    /// No peer has this key.
    Stranger,
    /// It is known for another role.
    WrongRole(Box<WrongRole>),
}

impl Security {
    /// Whether the holder of `key` may be `claimed`.
    pub(crate) fn judge(&self, key: PeerKey, claimed: Option<&str>) -> Result<(), KeyFault> {
        let claimed = claimed.unwrap_or("a peer without a role");
        let mut wrong = Err(KeyFault::Stranger);
        let peers = self.peers.now();
        for KnownPeer { keys, role } in peers.iter().filter(|peer| peer.has(key)) {
            match role {
                Some(known) if known != claimed => {
                    let (name, claimed, known) = (keys.name.clone(), claimed.to_owned(), known.clone());
                    wrong = Err(KeyFault::WrongRole(Box::new(WrongRole { name, key, claimed, known })));
                }
                _ => return Ok(()),
            }
        }
        wrong
    }
}

impl KnownPeer {
    fn has(&self, key: PeerKey) -> bool {
        match key {
            PeerKey::Quic(fingerprint) => self.keys.quic == Some(fingerprint),
            PeerKey::Udp(key) => self.keys.udp == key,
        }
    }
}

impl WrongRole {
    /// The refusal that a listener sends to the peer.
    pub(crate) fn refusal(&self) -> Refusal {
        Refusal::Key { claimed: Explanation::new(&self.claimed), known: Explanation::new(&self.known) }
    }

    /// The close that a connecting peer sends to the listener.
    pub(crate) fn close(&self) -> CloseReason {
        let Self { claimed, known, .. } = self;
        let why = format!("its peer claims to be {claimed}, with a key that is known as that of {known}");
        CloseReason::new(CloseReason::REFUSED, &why)
    }
}

impl fmt::Display for PeerKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Quic(fingerprint) => fingerprint.fmt(f),
            Self::Udp(key) => key.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::Keys;

    #[test]
    fn a_key_may_have_the_roles_that_it_is_known_for_and_no_other() {
        let [own, one, two, any, nobody] = ["own", "one", "two", "any", "nobody"]
            .map(|name| Keys::generate(name.parse().unwrap()).unwrap().public().clone());
        let security = Security {
            keys: Keys::generate("own".parse().unwrap()).unwrap(),
            peers: vec![
                KnownPeer::in_role(one.clone(), "arm"),
                KnownPeer::in_role(two.clone(), "arm"),
                KnownPeer::in_role(two.clone(), "gripper"),
                any.clone().into(),
            ]
            .into(),
        };
        let roles = ["arm", "gripper", "panel"];
        for (peer, expected) in [
            (&one, [true, false, false]),
            (&two, [true, true, false]),
            (&any, [true; 3]),
            (&nobody, [false; 3]),
        ] {
            for key in [peer.quic.map(PeerKey::Quic), Some(PeerKey::Udp(peer.udp))].into_iter().flatten() {
                assert_eq!(
                    roles.map(|role| security.judge(key, Some(role)).is_ok()),
                    expected,
                    "{}",
                    peer.name
                );
            }
        }
        let key = PeerKey::Udp(one.udp);
        let Err(KeyFault::WrongRole(error)) = security.judge(key, Some("gripper")) else { panic!() };
        let error = error.to_string();
        let begins =
            format!("key 'one' ({}) claims to be gripper; this configuration knows it as arm", one.udp);
        assert!(error.starts_with(&begins), "{error}");
        assert_eq!(security.judge(PeerKey::Udp(own.udp), Some("arm")), Err(KeyFault::Stranger));
    }
}
