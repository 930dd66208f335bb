//! Path migration of the peer (RFC 9000, sections 8.2 and 9).
//!
//! QUIC sends on to a new address at once and sparingly until the peer has answered from there. Here a
//! connection stays at the old address until then: a frame is more than the new one could be sent, and
//! repeated packets from elsewhere do not lead it astray.

use std::net::SocketAddr;
use std::time::Duration;

use trimaran_net::Instant;

use crate::chunk::Chunk;
use crate::cookie::TokenKey;
use crate::keys::OVERHEAD;
use crate::packet::{ConnectionId, CookieBytes, MIN_DATAGRAM};

/// How many bytes may be sent to an unvalidated address for each received from it (RFC 9000, section 8).
const AMPLIFICATION: usize = 3;
/// How often an address is challenged.
const TRIES: u32 = 3;
/// The pause after the first challenge; it doubles.
const PAUSE: Duration = Duration::from_millis(300);
/// The shortest packet with a challenge.
const SHORTEST: usize = OVERHEAD + 1 + size_of::<CookieBytes>();

/// The source of a packet, and its length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Arrival {
    pub(crate) from: SocketAddr,
    pub(crate) bytes: usize,
}

/// A packet for another address than the peer's: a chunk, padded to `size` bytes.
#[derive(Debug, PartialEq)]
pub(crate) struct Migration {
    pub(crate) to: SocketAddr,
    pub(crate) chunk: Chunk<'static>,
    pub(crate) size: usize,
}

/// How far the peer has moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Moved {
    /// To another port of its address: a router changed it, and the path is the same.
    Port,
    /// To another address.
    Path,
}

/// The address of the peer, a possible new one, and the peer's challenge of this side.
pub(crate) struct PeerPath {
    remote: SocketAddr,
    token_key: TokenKey,
    candidate: Option<Candidate>,
    response: Option<Migration>,
}

/// The source of the newest packet.
#[derive(Debug)]
struct Candidate {
    at: SocketAddr,
    received: usize,
    sent: usize,
    tries: u32,
    due: Instant,
}

impl PeerPath {
    /// A peer at `remote`; 32 random bytes that nobody else knows.
    pub(crate) fn new(remote: SocketAddr, secret: [u8; 32]) -> Self {
        Self { remote, token_key: TokenKey::new(secret), candidate: None, response: None }
    }

    pub(crate) const fn remote(&self) -> SocketAddr {
        self.remote
    }

    /// A packet of the peer came; `newest` if no later one has come before.
    pub(crate) fn on_packet(&mut self, now: Instant, Arrival { from, bytes }: Arrival, newest: bool) {
        match &mut self.candidate {
            Some(candidate) if candidate.at == from => candidate.received += bytes,
            _ if newest && from == self.remote => self.candidate = None,
            _ if newest => {
                self.candidate = Some(Candidate { at: from, received: bytes, sent: 0, tries: 0, due: now });
            }
            _ => {}
        }
    }

    /// The peer challenges the packet's source address. The answer goes there, and is as long.
    pub(crate) fn on_challenge(&mut self, Arrival { from, bytes }: Arrival, cookie: CookieBytes) {
        self.response =
            Some(Migration { to: from, chunk: Chunk::Response { cookie }, size: bytes.min(MIN_DATAGRAM) });
    }

    /// The peer returns a cookie. Returns how far it has moved, if it has.
    pub(crate) fn on_response(
        &mut self,
        now: Instant,
        here: ConnectionId,
        from: SocketAddr,
        cookie: &CookieBytes,
    ) -> Option<Moved> {
        let token_key = &self.token_key;
        let found =
            self.candidate.take_if(|at| at.at == from && token_key.accepts(now, from, here, cookie))?;
        let before = std::mem::replace(&mut self.remote, found.at);
        Some(if before.ip() == from.ip() { Moved::Port } else { Moved::Path })
    }

    /// When [`PeerPath::next`] has a packet.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.candidate.as_ref().map(|candidate| candidate.due)
    }

    /// The next packet for another address than the peer's.
    pub(crate) fn next(&mut self, now: Instant, here: ConnectionId) -> Option<Migration> {
        if let Some(response) = self.response.take() {
            if let Some(candidate) = self.candidate.as_mut().filter(|candidate| candidate.at == response.to) {
                candidate.sent += response.size;
            }
            return Some(response);
        }
        let candidate = self.candidate.as_mut().filter(|candidate| candidate.due <= now)?;
        let size = (candidate.received * AMPLIFICATION).saturating_sub(candidate.sent).min(MIN_DATAGRAM);
        if candidate.tries == TRIES {
            self.candidate = None;
            return None;
        }
        candidate.due = now.after(PAUSE * 2u32.pow(candidate.tries));
        candidate.tries += 1;
        if size < SHORTEST {
            return None;
        }
        candidate.sent += size;
        let cookie = self.token_key.issue(now, candidate.at, here);
        Some(Migration { to: candidate.at, chunk: Chunk::Challenge { cookie }, size })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: ConnectionId = ConnectionId(1);

    fn at(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    fn address(host: u8, port: u16) -> SocketAddr {
        ([10, 0, 0, host], port).into()
    }

    fn peer_path() -> PeerPath {
        PeerPath::new(address(1, 1), [7; 32])
    }

    fn from(from: SocketAddr, bytes: usize) -> Arrival {
        Arrival { from, bytes }
    }

    fn challenge(peer_path: &mut PeerPath, ms: u64) -> (SocketAddr, CookieBytes, usize) {
        match peer_path.next(at(ms), HERE) {
            Some(Migration { to, chunk: Chunk::Challenge { cookie }, size }) => (to, cookie, size),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_peer_is_believed_to_have_moved_once_it_answers_from_there() {
        for (there, moved) in [(address(1, 2), Moved::Port), (address(2, 1), Moved::Path)] {
            let mut it = peer_path();
            it.on_packet(at(0), from(there, 500), true);
            assert_eq!(it.remote(), address(1, 1));
            let (to, cookie, size) = challenge(&mut it, 0);
            assert_eq!((to, size), (there, MIN_DATAGRAM));
            assert_eq!(it.next(at(0), HERE), None, "once");
            assert_eq!(it.on_response(at(10), HERE, address(3, 3), &cookie), None, "from elsewhere");
            assert_eq!(it.on_response(at(10), HERE, there, &[0; 24]), None, "another cookie");
            assert_eq!(it.on_response(at(10), HERE, there, &cookie), Some(moved));
            assert_eq!((it.remote(), it.due()), (there, None));
            assert_eq!(it.on_response(at(11), HERE, there, &cookie), None, "it is there already");
        }
    }

    #[test]
    fn an_address_that_does_not_answer_is_asked_three_times_and_gets_no_more_than_thrice_what_came() {
        let mut it = peer_path();
        it.on_packet(at(0), from(address(2, 1), 40), true);
        assert_eq!(challenge(&mut it, 0).2, 120);
        assert_eq!((it.due(), it.next(at(299), HERE)), (Some(at(300)), None));
        assert_eq!(it.next(at(300), HERE), None, "it has had enough");
        assert_eq!(it.due(), Some(at(900)), "the pause doubles");
        it.on_packet(at(400), from(address(2, 1), 100), false);
        assert_eq!(challenge(&mut it, 900).2, 300, "100 bytes more have come");
        assert_eq!((it.next(at(2100), HERE), it.due()), (None, None));
        it.on_packet(at(3000), from(address(2, 1), 500), true);
        assert_eq!(challenge(&mut it, 3000).2, MIN_DATAGRAM, "it is heard again");
    }

    #[test]
    fn only_the_newest_packet_leads_and_one_from_where_the_peer_is_leads_back() {
        let mut it = peer_path();
        it.on_packet(at(0), from(address(2, 1), 500), false);
        assert_eq!(it.due(), None);
        it.on_packet(at(0), from(address(2, 1), 500), true);
        it.on_packet(at(1), from(address(1, 1), 500), false);
        let (_, cookie, _) = challenge(&mut it, 1);
        it.on_packet(at(2), from(address(3, 1), 500), true);
        assert_eq!(it.on_response(at(3), HERE, address(2, 1), &cookie), None, "it has gone on");
        assert_eq!(challenge(&mut it, 3).0, address(3, 1));
        it.on_packet(at(4), from(address(1, 1), 500), true);
        assert_eq!((it.due(), it.remote()), (None, address(1, 1)));
    }

    #[test]
    fn an_answer_goes_where_the_question_came_from_and_is_as_long() {
        let mut it = peer_path();
        it.on_challenge(from(address(5, 5), 120), [9; 24]);
        let expected = Migration { to: address(5, 5), chunk: Chunk::Response { cookie: [9; 24] }, size: 120 };
        assert_eq!(it.next(at(0), HERE), Some(expected));
        assert_eq!(it.next(at(0), HERE), None);
        it.on_challenge(from(address(5, 5), 9000), [9; 24]);
        assert_eq!(it.next(at(0), HERE).map(|it| it.size), Some(MIN_DATAGRAM));
    }

    #[test]
    fn an_answer_and_a_question_together_are_no_more_than_thrice_what_came() {
        // The shortest question has 53 bytes.
        for (came, asked, rest) in [(100, 100, Some(200)), (21, 10, Some(53)), (21, 11, None)] {
            let mut it = peer_path();
            it.on_packet(at(0), from(address(2, 1), came), true);
            it.on_challenge(from(address(2, 1), asked), [9; 24]);
            let mut size = || it.next(at(0), HERE).map(|it| it.size);
            assert_eq!((size(), size()), (Some(asked), rest));
        }
    }
}
