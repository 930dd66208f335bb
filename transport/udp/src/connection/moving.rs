//! Path migration: a router gives the peer another address, or the peer changes networks.

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
    /// Follows the peer from `remote` on, wherever it goes; `secret` are 32 random bytes, for this connection
    /// alone. They also choose packet numbers to skip, so that a peer that acknowledges packets it did not
    /// receive is detected. Pass arriving datagrams to [`Connection::handle_from`], and send those of
    /// [`Connection::poll_excursion`] as well.
    pub fn follow(&mut self, remote: SocketAddr, secret: [u8; 32]) {
        self.recovery.leave_numbers_out(blake3::derive_key("trimaran/udp packet numbers", &secret));
        self.peer_path = Some(PeerPath::new(remote, secret));
    }

    /// The peer's address, if it is followed: the destination of [`Connection::poll_transmit`]'s datagrams.
    #[must_use]
    pub fn remote(&self) -> Option<SocketAddr> {
        self.peer_path.as_ref().map(PeerPath::remote)
    }

    /// As [`Connection::handle`], for a datagram from `from`.
    pub fn handle_from(&mut self, now: Instant, from: SocketAddr, datagram: &[u8]) {
        self.receive(now, Some(Arrival { from, bytes: datagram.len() }), datagram);
    }

    /// Writes the next datagram for another address than the peer's into `out`, which it replaces, and
    /// returns that address.
    pub fn poll_excursion(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<SocketAddr> {
        if self.closed.is_some() {
            return None;
        }
        let Migration { to, chunk, size } = self.peer_path.as_mut()?.next(now, self.here)?;
        let mut plain = Vec::with_capacity(size);
        chunk.write(&mut plain);
        plain.resize(plain.len().max(size.saturating_sub(OVERHEAD)), Chunk::FILLING);
        // Other addresses need no keep-alive; the peer does.
        let last_sent = self.last_sent;
        let made = self.seal(now, &plain, None, out);
        self.last_sent = last_sent;
        made.then_some(to)
    }

    /// Takes the peer's address from a packet; `newest` if no later packet has come before.
    pub(super) fn locate(&mut self, now: Instant, arrival: Option<Arrival>, newest: bool) {
        if let (Some(peer_path), Some(arrival)) = (&mut self.peer_path, arrival) {
            peer_path.on_packet(now, arrival, newest);
        }
    }

    /// Takes a path challenge, or the response to one.
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

    /// Data in flight is sent again; a new path is begun like the first one.
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
