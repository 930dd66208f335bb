//! Resets: a listener that has lost its connections tells their peers so, without any state.

use zeroize::Zeroizing;

use crate::handshake::Security;
use crate::packet::ConnectionId;

/// The bytes of a token.
pub(crate) const TOKEN: usize = 16;

/// The proof that a reset comes from the listener: the peer got it in the answer (as in RFC 9000, section
/// 10.3).
pub(crate) type ResetToken = [u8; TOKEN];

/// A listener's secret for tokens. It is made of its keys, so that it is the same after a restart.
#[derive(Clone)]
pub(crate) struct ResetKey(Zeroizing<[u8; 32]>);

impl ResetKey {
    /// The key of a listener at `port`. Another listener with the same keys has another one, so nobody can
    /// learn a connection's token from that.
    ///
    /// In the clear there is no secret: tokens are then as easy to forge as closes.
    pub(crate) fn new(security: &Security, port: u16) -> Self {
        let secret: &[u8] = match security {
            Security::PreShared(key) => &**key,
            Security::Pinned { own, .. } => &**own,
            Security::Plaintext => &[],
        };
        let mut hasher = blake3::Hasher::new_derive_key("trimaran udp reset 1");
        hasher.update(&port.to_le_bytes()).update(secret);
        Self(Zeroizing::new(hasher.finalize().into()))
    }

    /// The token of the connection with this id on the listener's side.
    pub(crate) fn token(&self, id: ConnectionId) -> ResetToken {
        let hash = blake3::keyed_hash(&self.0, &id.0.to_le_bytes());
        hash.as_bytes().first_chunk().copied().unwrap_or_default()
    }
}

/// Whether the tokens are equal, in a time that does not tell where they differ.
pub(crate) fn same(a: &ResetToken, b: &ResetToken) -> bool {
    a.iter().zip(b).fold(0, |differing, (a, b)| differing | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_of_one_connection_one_port_and_one_key() {
        let shared = |byte| Security::PreShared([byte; 32].into());
        let token = |security: &Security, port, id| ResetKey::new(security, port).token(ConnectionId(id));
        let first = token(&shared(1), 7400, 5);
        assert!(same(&first, &token(&shared(1), 7400, 5)), "the same after a restart");
        let pinned = Security::Pinned { own: [1; 32].into(), peers: vec![[2; 32]] };
        assert_eq!(first, token(&pinned, 7400, 5), "the keys are the same bytes");
        for other in [token(&shared(2), 7400, 5), token(&shared(1), 7401, 5), token(&shared(1), 7400, 6)] {
            assert!(!same(&first, &other));
        }
        for at in 0..TOKEN {
            let mut forged = first;
            forged[at] ^= 1;
            assert!(!same(&first, &forged), "byte {at}");
        }
    }
}
