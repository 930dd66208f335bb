//! One end of a connection, once both sides have keys.

use std::fmt;
use std::time::Duration;

use trimaran_net::Instant;
use trimaran_wire::BatchSize;

use crate::acks::Acks;
use crate::chunk::UnitLane;
use crate::keys::Keys;
use crate::latest::{LatestIn, LatestOut};
use crate::mtu::Mtu;
use crate::pacer::Pacer;
use crate::packet::{ConnectionId, MIN_DATAGRAM, ResetToken};
use crate::peer_path::PeerPath;
use crate::recovery::Recovery;
use crate::scavenger::Scavenger;

mod channel;
mod closed;
mod config;
mod lanes;
mod moving;
mod receive;
mod stats;
mod timers;
mod transmit;
mod units;

use channel::Channel;
use units::Units;
pub(crate) use units::{BULK_WINDOW, MESSAGES_WINDOW};

pub use closed::Closed;
pub use config::Config;
pub use stats::{DeadlineTooShort, PathStats, STEPS_PER_BYTE, STEPS_PER_PACKET};

/// One end of a connection: no socket, no clock.
///
/// Pass it arriving datagrams ([`Connection::handle`]) and the time when it is due
/// ([`Connection::poll_timeout`], [`Connection::handle_timeout`]). After each call send the datagrams of
/// [`Connection::poll_transmit`], until there are none.
pub struct Connection {
    config: Config,
    keys: Keys,
    here: ConnectionId,
    there: ConnectionId,
    /// The peer's address, if it is followed.
    peer_path: Option<PeerPath>,
    recovery: Recovery,
    pacer: Pacer,
    paced_until: Option<Instant>,
    /// The limit of packets in flight up to which the bulk lane may send.
    scavenger: Scavenger,
    mtu: Mtu,
    acks: Acks,
    frames: Units,
    messages: Units,
    bulk: Units,
    latest_out: LatestOut,
    latest_in: LatestIn,
    channels: Vec<Channel>,
    /// When the peer was answered, if its first packet gives a round-trip time.
    answered: Option<Instant>,
    /// A packet came that only the peer can have sent.
    confirmed: bool,
    /// How many pings are due: probes, or a keepalive. Each may exceed the window by one packet.
    pings: u8,
    last_received: Instant,
    last_sent: Instant,
    /// Counters: bytes sent, packets and bytes received.
    sent_bytes: u64,
    received: u64,
    received_bytes: u64,
    /// Packets that failed to open.
    forged: u64,
    /// How the listening peer proves that it has lost the connection.
    reset_token: Option<ResetToken>,
    closed: Option<Closed>,
    close_due: bool,
    plain: Vec<u8>,
}

impl fmt::Debug for Connection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Connection")
            .field("here", &self.here)
            .field("there", &self.there)
            .field("closed", &self.closed)
            .finish_non_exhaustive()
    }
}

impl Connection {
    /// A plaintext connection between two ends that chose these ids: for trusted networks, and for tests.
    #[must_use]
    pub fn plaintext(now: Instant, here: ConnectionId, there: ConnectionId, config: Config) -> Self {
        Self::new(now, here, there, config, Keys::Plaintext)
    }

    pub(crate) fn new(
        now: Instant,
        here: ConnectionId,
        there: ConnectionId,
        config: Config,
        keys: Keys,
    ) -> Self {
        Self {
            config,
            keys,
            here,
            there,
            peer_path: None,
            recovery: Recovery::new(MIN_DATAGRAM, config.initial_window, config.ack_delay, config.window),
            pacer: Pacer::new(MIN_DATAGRAM),
            paced_until: None,
            scavenger: Scavenger::new(MIN_DATAGRAM),
            acks: Acks::default(),
            mtu: Mtu::new(now, config.max_datagram),
            frames: Units::frames(UnitLane::Frames, &config),
            messages: Units::new(UnitLane::Messages, &config, MESSAGES_WINDOW),
            bulk: Units::new(UnitLane::Bulk, &config, BULK_WINDOW),
            latest_out: LatestOut::default(),
            latest_in: LatestIn::new(config.format),
            channels: Channel::all(&config),
            answered: None,
            confirmed: false,
            pings: 0,
            last_received: now,
            last_sent: now,
            sent_bytes: 0,
            received: 0,
            received_bytes: 0,
            forged: 0,
            reset_token: None,
            closed: None,
            close_due: false,
            plain: Vec::with_capacity(MIN_DATAGRAM),
        }
    }

    /// Takes an upper bound of a round trip, used until one is measured.
    pub(crate) fn guess_round_trip(&mut self, most: Duration) {
        self.recovery.rtt.guess(most);
    }

    /// The peer is told to prove by this token that it has lost the connection.
    pub(crate) const fn resets_with(&mut self, token: ResetToken) {
        self.reset_token = Some(token);
    }

    /// The peer is answered now, and sends nothing under these keys before it has read that.
    pub(crate) const fn on_answer(&mut self, now: Instant) {
        self.answered = Some(now);
    }

    /// This side's id of the connection.
    #[must_use]
    pub const fn id(&self) -> ConnectionId {
        self.here
    }

    /// Whether a packet has come that only a peer with these keys can have sent, and only now: a listener may
    /// have answered a repeated first packet.
    #[must_use]
    pub const fn is_confirmed(&self) -> bool {
        self.confirmed
    }

    /// Delivers items in batches of at most `batch`, from now on.
    pub fn set_batch(&mut self, batch: BatchSize) {
        self.frames.inbox.set_batch(batch);
        self.channels.iter_mut().for_each(|channel| channel.units.inbox.set_batch(batch));
    }

    /// Whether batches of frames that begin from now on may be coded.
    pub fn set_coded(&mut self, coded: bool) {
        self.frames.outbox.set_coded(coded);
        for channel in &mut self.channels {
            channel.units.outbox.set_coded(coded && channel.may_be_coded);
        }
    }

    /// Agrees with the peer on another idle timeout.
    pub const fn set_idle_timeout(&mut self, idle_timeout: Duration) {
        self.config.idle_timeout = idle_timeout;
    }

    /// Sends a packet, so that the peer knows this side is there.
    pub fn ping(&mut self) {
        self.pings = self.pings.max(1);
    }

    /// Why the connection has ended, if it has.
    #[must_use]
    pub const fn closed(&self) -> Option<&Closed> {
        self.closed.as_ref()
    }

    /// Closes at once: data that has not arrived is lost. A peer that keeps sending gets another close.
    pub fn close(&mut self) {
        self.end(Closed::Here);
    }

    /// Whether to probe the MTU: the peer is there, and the path carries frames.
    fn may_probe(&self) -> bool {
        self.confirmed && self.recovery.room() >= self.config.max_datagram
    }

    fn end(&mut self, why: Closed) {
        if self.closed.is_none() {
            self.close_due = !matches!(why, Closed::Peer | Closed::Reset);
            self.closed = Some(why);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;
    use crate::chunk::Chunk;
    use crate::packet::data_header;
    use crate::ranges::RangeSet;
    use crate::samples::FORMAT;

    pub(super) const HERE: ConnectionId = ConnectionId(10);

    pub(super) fn now() -> Instant {
        Instant::from_nanos(1_000_000_000)
    }

    pub(super) fn after(ms: u64) -> Instant {
        now().after(Duration::from_millis(ms))
    }

    pub(super) fn connection() -> Connection {
        Connection::plaintext(now(), HERE, ConnectionId(20), Config::new(FORMAT))
    }

    /// A packet of the peer.
    pub(super) fn sealed(number: u64, chunk: &Chunk<'_>) -> Vec<u8> {
        let (mut plain, mut packet) = (Vec::new(), Vec::from(data_header(HERE, number)));
        chunk.write(&mut plain);
        assert!(Keys::Plaintext.seal(HERE, number, &plain, &mut packet));
        packet
    }

    /// An acknowledgement of these packets.
    pub(super) fn acknowledged(packets: Range<u64>) -> Chunk<'static> {
        let mut numbers = RangeSet::default();
        numbers.insert(packets);
        Chunk::Ack { delay_us: 0, numbers }
    }
}
