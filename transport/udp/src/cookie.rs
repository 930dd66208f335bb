//! Address validation of strangers, without keeping state for them.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use trimaran_net::Instant;
use zeroize::Zeroizing;

use crate::packet::{ConnectionId, CookieBytes};

/// The lifetime of a cookie: several round trips with losses, and no longer.
const LIFE: Duration = Duration::from_secs(10);

/// A listener's secret for making cookies: 32 random bytes, drawn when it starts.
pub(crate) struct TokenKey(Zeroizing<[u8; 32]>);

impl TokenKey {
    pub(crate) fn new(secret: [u8; 32]) -> Self {
        Self(Zeroizing::new(secret))
    }

    pub(crate) fn issue(&self, now: Instant, address: SocketAddr, id: ConnectionId) -> CookieBytes {
        let mut cookie = [0; 24];
        let (time, hash) = cookie.split_at_mut(8);
        time.copy_from_slice(&now.as_nanos().to_le_bytes());
        hash.copy_from_slice(&self.hash(now, address, id).as_bytes()[..16]);
        cookie
    }

    pub(crate) fn accepts(
        &self,
        now: Instant,
        address: SocketAddr,
        id: ConnectionId,
        cookie: &CookieBytes,
    ) -> bool {
        let Some((time, hash)) = cookie.split_first_chunk() else { return false };
        let issued = Instant::from_nanos(u64::from_le_bytes(*time));
        // Compared as keyed hashes, in constant time.
        let theirs = blake3::keyed_hash(&self.0, hash);
        let ours = blake3::keyed_hash(&self.0, &self.hash(issued, address, id).as_bytes()[..16]);
        issued <= now && now.since(issued) <= LIFE && theirs == ours
    }

    fn hash(&self, at: Instant, address: SocketAddr, id: ConnectionId) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        match address.ip() {
            IpAddr::V4(ip) => hasher.update(&ip.octets()),
            IpAddr::V6(ip) => hasher.update(&ip.octets()),
        };
        hasher.update(&address.port().to_le_bytes());
        hasher.update(&at.as_nanos().to_le_bytes());
        hasher.update(&id.0.to_le_bytes());
        hasher.finalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cookie_is_good_for_one_address_one_id_and_ten_seconds() {
        let token_key = TokenKey::new([7; 32]);
        let (here, there) = (SocketAddr::from(([127, 0, 0, 1], 5)), SocketAddr::from(([127, 0, 0, 1], 6)));
        let (id, other) = (ConnectionId(1), ConnectionId(2));
        let now = Instant::from_nanos(1_000_000);
        let cookie = token_key.issue(now, here, id);
        assert!(token_key.accepts(now, here, id, &cookie));
        assert!(token_key.accepts(now.after(LIFE), here, id, &cookie));
        assert!(!token_key.accepts(now.after(LIFE + Duration::from_nanos(1)), here, id, &cookie));
        assert!(!token_key.accepts(Instant::from_nanos(0), here, id, &cookie), "from the future");
        assert!(!token_key.accepts(now, there, id, &cookie));
        assert!(!token_key.accepts(now, here, other, &cookie));
        assert!(!TokenKey::new([8; 32]).accepts(now, here, id, &cookie));
        for at in 0..cookie.len() {
            let mut forged = cookie;
            forged[at] ^= 1;
            assert!(!token_key.accepts(now.after(LIFE / 2), here, id, &forged), "byte {at}");
        }
    }
}
