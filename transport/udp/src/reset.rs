//! Resets: a listener that has lost its connections tells their peers so, without any state.

use zeroize::Zeroizing;

use crate::packet::{ConnectionId, ResetToken};

/// A listener's secret for tokens. It is made of its keys, so that it is the same after a restart.
#[derive(Clone)]
pub(crate) struct ResetKey(Zeroizing<[u8; 32]>);

impl ResetKey {
    /// The key of a listener at `port` with the private or shared key `secret`. Another listener with the
    /// same secret has another one, so nobody can learn a connection's token from that.
    ///
    /// In the clear there is no secret: tokens are then as easy to forge as closes.
    pub(crate) fn new(secret: &[u8], port: u16) -> Self {
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
        let token = |byte, port, id| ResetKey::new(&[byte; 32], port).token(ConnectionId(id));
        let first = token(1, 7400, 5);
        assert!(same(&first, &token(1, 7400, 5)), "the same after a restart");
        for other in [token(2, 7400, 5), token(1, 7401, 5), token(1, 7400, 6)] {
            assert!(!same(&first, &other));
        }
        for at in 0..first.len() {
            let mut forged = first;
            forged[at] ^= 1;
            assert!(!same(&first, &forged), "byte {at}");
            forged[(at + 1) % first.len()] ^= 1;
            assert!(!same(&first, &forged), "byte {at} and the next");
        }
    }
}
