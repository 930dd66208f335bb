//! A peer that goes elsewhere: a router gives it another address, or it changes networks.

use std::net::SocketAddr;

use trimaran_net::Instant;

use super::{Config, Connection};
use crate::chunk::Chunk;
use crate::keys::OVERHEAD;
use crate::mtu::Mtu;
use crate::pacer::Pacer;
use crate::packet::MIN_DATAGRAM;
use crate::peer_path::{Arrival, Migration, Moved, PeerPath};
use crate::recovery::Verdict;
use crate::scavenger::Scavenger;

impl Connection {
    /// Follows the peer from `remote` on, wherever it goes: `secret` are 32 random bytes, for this connection
    /// alone. They also choose the packet numbers that are left out, so that a peer which acknowledges what
    /// it did not receive is found out. Hand what arrives to
    /// [`Connection::handle_from`], and send what [`Connection::poll_excursion`] gives as well.
    pub fn follow(&mut self, remote: SocketAddr, secret: [u8; 32]) {
        self.recovery.leave_numbers_out(blake3::derive_key("trimaran/udp packet numbers", &secret));
        self.peer_path = Some(PeerPath::new(remote, secret));
    }

    /// Where the peer is, if it is followed: there goes what [`Connection::poll_transmit`] gives.
    #[must_use]
    pub fn remote(&self) -> Option<SocketAddr> {
        self.peer_path.as_ref().map(PeerPath::remote)
    }

    /// As [`Connection::handle`], of a datagram that came from `from`.
    pub fn handle_from(&mut self, now: Instant, from: SocketAddr, datagram: &[u8]) {
        self.receive(now, Some(Arrival { from, bytes: datagram.len() }), datagram);
    }

    /// Writes the next datagram that goes elsewhere than to the peer's address into `out`, which it replaces,
    /// and says where to.
    pub fn poll_excursion(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<SocketAddr> {
        if self.closed.is_some() {
            return None;
        }
        let Migration { to, chunk, size } = self.peer_path.as_mut()?.next(now, self.here)?;
        let mut plain = Vec::with_capacity(size);
        chunk.write(&mut plain);
        plain.resize(plain.len().max(size.saturating_sub(OVERHEAD)), Chunk::FILLING);
        // Who is elsewhere need not hear from this side; the peer must.
        let last_sent = self.last_sent;
        let made = self.seal(now, &plain, None, out);
        self.last_sent = last_sent;
        made.then_some(to)
    }

    /// Takes what a packet says of where the peer is; `newest` when none that was sent later has come before.
    pub(super) fn locate(&mut self, now: Instant, arrival: Option<Arrival>, newest: bool) {
        if let (Some(peer_path), Some(arrival)) = (&mut self.peer_path, arrival) {
            peer_path.on_packet(now, arrival, newest);
        }
    }

    /// Takes a chunk that asks where this side is, or answers where the peer is.
    pub(super) fn take_path_chunk(&mut self, now: Instant, arrival: Option<Arrival>, chunk: &Chunk<'_>) {
        let (Some(peer_path), Some(arrival)) = (&mut self.peer_path, arrival) else { return };
        match chunk {
            Chunk::Challenge { cookie } => peer_path.on_challenge(arrival, *cookie),
            Chunk::Response { cookie } => {
                if let Some(moved) = peer_path.on_response(now, self.here, arrival.from, cookie) {
                    self.go_on_elsewhere(now, moved);
                }
            }
            _ => {}
        }
    }

    /// What was under way is sent again; another path is begun as the first one was.
    fn go_on_elsewhere(&mut self, now: Instant, moved: Moved) {
        let lost = self.recovery.on_moved();
        self.judge(now, Verdict { lost, ..Verdict::default() });
        if moved == Moved::Path {
            let Config { initial_window, .. } = self.config;
            self.recovery.on_new_path(MIN_DATAGRAM, initial_window);
            self.mtu = Mtu::new(now, self.config.max_datagram);
            self.pacer = Pacer::new(MIN_DATAGRAM);
            self.scavenger = Scavenger::new(MIN_DATAGRAM);
        }
    }
}
