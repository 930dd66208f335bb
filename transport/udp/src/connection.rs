//! One end of a connection, once both sides have keys.

use std::fmt;

use trimaran_proto::{BatchSize, Camera, CodedIds, FrameMessage, FrameNumber, Goodbye, IdCoding, Instant};

use crate::acks::Acks;
use crate::inbox::{Inbox, Received};
use crate::keys::{Keys, OVERHEAD};
use crate::latest::{LatestEnd, LatestIn, LatestOut};
use crate::mtu::Mtu;
use crate::outbox::Outbox;
use crate::pacer::Pacer;
use crate::packet::{ConnectionId, MIN_DATAGRAM};
use crate::recovery::{PROBES, Recovery};
use crate::repair::{Budget, Path};
use crate::whereabouts::Whereabouts;

mod closed;
mod config;
mod moving;
mod receive;
mod stats;
mod transmit;

pub use closed::Closed;
pub use config::Config;
pub use stats::PathStats;

/// What a full packet has beside its part or repair shard at most, bytes: the chunk's own fields, or a short acknowledgement too.
const BESIDE: usize = 36;
/// After so many probes without an answer a path may have become narrower.
const BLACK_HOLE: u32 = 3;

/// One end of a connection: no socket, no clock.
///
/// Hand it what arrives ([`Connection::handle`]) and the time when it is due ([`Connection::poll_timeout`],
/// [`Connection::handle_timeout`]); after each call send what [`Connection::poll_transmit`] gives, until it gives nothing.
pub struct Connection {
    config: Config,
    keys: Keys,
    here: ConnectionId,
    there: ConnectionId,
    /// Where the peer is, if it is followed.
    whereabouts: Option<Whereabouts>,
    recovery: Recovery,
    pacer: Pacer,
    paced_until: Option<Instant>,
    mtu: Mtu,
    acks: Acks,
    outbox: Outbox,
    inbox: Inbox,
    cameras_out: LatestOut,
    cameras_in: LatestIn,
    credit_due: bool,
    /// The peer's frames lane is not read here, and it must be told so.
    unread: bool,
    unread_due: bool,
    /// The peer does not read the frames lane.
    unheard: bool,
    /// Something came that only the peer can have sent.
    confirmed: bool,
    /// How many pings are due: probes, or a keepalive. Each may exceed the window by one packet.
    pings: u8,
    last_received: Instant,
    last_sent: Instant,
    /// What was counted: bytes sent, packets and bytes received.
    sent_bytes: u64,
    received: u64,
    received_bytes: u64,
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
    /// A connection in the clear, between two ends that chose these ids: for trusted networks, and for tests.
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
            whereabouts: None,
            recovery: Recovery::new(config.congestion, MIN_DATAGRAM, config.ack_delay),
            pacer: Pacer::new(MIN_DATAGRAM),
            paced_until: None,
            acks: Acks::default(),
            mtu: Mtu::new(now, config.max_datagram),
            outbox: Outbox::new(
                config.window,
                Inbox::initial_units(),
                config.patience,
                Budget::new(config.repair, config.repair_percent),
                config.coding,
            ),
            inbox: Inbox::new(config.batch, config.window),
            cameras_out: LatestOut::default(),
            cameras_in: LatestIn::default(),
            credit_due: false,
            unread: false,
            unread_due: false,
            unheard: false,
            confirmed: false,
            pings: 0,
            last_received: now,
            last_sent: now,
            sent_bytes: 0,
            received: 0,
            received_bytes: 0,
            closed: None,
            close_due: false,
            plain: Vec::with_capacity(MIN_DATAGRAM),
        }
    }

    /// The name that this side gave the connection.
    #[must_use]
    pub const fn id(&self) -> ConnectionId {
        self.here
    }

    /// Whether [`Connection::send`] may be called: what waits for its acknowledgement leaves room.
    #[must_use]
    pub const fn is_writable(&self) -> bool {
        self.outbox.kept() < self.config.send_buffer
    }

    /// Whether everything that was sent has arrived.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.outbox.is_empty() && self.cameras_out.is_drained()
    }

    /// Whether everything that was sent on the frames lane has arrived.
    #[must_use]
    pub fn is_lane_drained(&self) -> bool {
        self.outbox.is_empty()
    }

    /// Whether the newest camera has arrived, and the end of the lane if there was one.
    #[must_use]
    pub fn is_latest_drained(&self) -> bool {
        self.cameras_out.is_drained()
    }

    /// Whether [`Connection::recv`] would give something.
    #[must_use]
    pub fn is_readable(&self) -> bool {
        self.inbox.is_readable()
    }

    /// Whether something has come that only a peer with these keys can have sent, and only now: a listener may have answered a
    /// repeated first packet.
    #[must_use]
    pub const fn is_confirmed(&self) -> bool {
        self.confirmed
    }

    /// Whether the peer reads the frames lane no more: what is sent on it is thrown away.
    #[must_use]
    pub const fn is_unheard(&self) -> bool {
        self.unheard
    }

    /// Passes on ids in batches of at most `batch`, from now on.
    pub const fn set_batch(&mut self, batch: BatchSize) {
        self.inbox.set_batch(batch);
    }

    /// Sends the ids of frames that begin from now on so.
    pub const fn set_coding(&mut self, coding: IdCoding) {
        self.outbox.set_coding(coding);
    }

    /// The newest frame sent from here all of which has arrived: what the peer reads later may refer to it.
    #[must_use]
    pub const fn confirmed_frame(&self) -> Option<FrameNumber> {
        self.outbox.confirmed
    }

    /// Sends something, so that the peer knows this side is there.
    pub fn ping(&mut self) {
        self.pings = self.pings.max(1);
    }

    /// Why the connection is over, if it is.
    #[must_use]
    pub const fn closed(&self) -> Option<&Closed> {
        self.closed.as_ref()
    }

    /// Sends a message of the frames lane; a frame writer has put the messages in order.
    pub fn send(&mut self, message: FrameMessage) {
        self.outbox.put(message, self.path());
    }

    /// Sends a batch of the open frame's ids as changes. Frames take such where [`Connection::set_coding`] or [`Config::coding`] said so
    /// before they began.
    pub fn send_coded(&mut self, batch: CodedIds) {
        self.outbox.put_coded(batch, self.path());
    }

    /// Sends a goodbye behind everything else on the frames lane.
    pub fn goodbye(&mut self, reason: Goodbye) {
        self.outbox.goodbye(reason, self.path());
    }

    /// Says behind everything else on the frames lane that nothing more comes.
    pub fn gone(&mut self) {
        self.outbox.gone(self.path());
    }

    const fn path(&self) -> Path {
        Path { shard: (self.mtu.known() - OVERHEAD - BESIDE) & !15, loss: self.recovery.probable_loss() }
    }

    /// Says that the frames lane is not read any more: the peer need not send what is left of it.
    pub fn stop_reading(&mut self) {
        self.unread_due |= !self.unread;
        self.unread = true;
        self.credit_due |= self.inbox.discard();
    }

    /// Publishes a camera: it replaces the one before. It is sent again until it or a newer one has arrived.
    pub fn publish(&mut self, camera: Camera) {
        self.cameras_out.publish(camera);
    }

    /// Ends the latest lane behind the newest camera, with a goodbye or without. The first call counts.
    pub fn end_latest(&mut self, reason: Option<Goodbye>) {
        self.cameras_out.end(reason);
    }

    /// The newest camera of the peer, if it was not read before.
    pub const fn latest(&mut self) -> Option<Camera> {
        self.cameras_in.take()
    }

    /// How the peer's latest lane ended, once the last camera has come.
    #[must_use]
    pub fn latest_end(&self) -> Option<&LatestEnd> {
        self.cameras_in.end()
    }

    /// Whether there is a camera or an end of the latest lane to read.
    #[must_use]
    pub fn is_latest_readable(&self) -> bool {
        self.cameras_in.is_readable()
    }

    /// The next message of the frames lane. What arrived before an end of the connection is still given,
    /// up to the first unit that breaks the rules of the lane.
    pub fn recv(&mut self) -> Option<Received> {
        match self.inbox.take() {
            Ok(item) => {
                self.credit_due |= self.inbox.credit_due();
                item
            }
            Err(violation) => {
                self.end(violation.into());
                None
            }
        }
    }

    /// Closes at once: what has not arrived is lost. Whoever goes on to send is told again.
    pub fn close(&mut self) {
        self.end(Closed::Here);
    }

    /// When [`Connection::handle_timeout`] is due, if nothing happens before.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        if self.closed.is_some() {
            return None;
        }
        let keepalive = self.last_sent.after(self.config.lease / 4);
        let lease = self.last_received.after(self.config.lease);
        let way = self.recovery.rtt.one_way().as_nanos() as u64;
        let deadline =
            self.outbox.deadline().map(|at| Instant::from_nanos(at.as_nanos().saturating_sub(way)));
        let unheard = self.recovery.unheard_since().map(|since| since.after(self.config.lease));
        let probe = self.mtu.due().filter(|_| self.paced_until.is_none() && self.may_probe());
        let excursion = self.whereabouts.as_ref().and_then(Whereabouts::due);
        let timers =
            [self.recovery.timeout(), self.acks.due(), self.paced_until, deadline, unheard, probe, excursion];
        timers.into_iter().flatten().chain([keepalive, lease]).min()
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.closed.is_some() {
            return;
        }
        if now >= self.last_received.after(self.config.lease) {
            self.end(Closed::Silent(self.config.lease));
            return;
        }
        if self.recovery.unheard_since().is_some_and(|since| now >= since.after(self.config.lease)) {
            self.end(Closed::Deaf(self.config.lease));
            return;
        }
        if now >= self.last_sent.after(self.config.lease / 4) {
            self.ping();
        }
        if self.recovery.timeout().is_some_and(|at| at <= now) {
            let (verdict, probe) = self.recovery.on_timeout(now);
            self.judge(now, verdict);
            if probe {
                self.pings = PROBES;
                self.outbox.stop_waiting();
            }
            if self.recovery.probes() >= BLACK_HOLE && self.mtu.known() > MIN_DATAGRAM {
                self.mtu.on_black_hole(now);
                self.resize();
            }
        }
    }

    /// Takes over the size of datagrams that is known to arrive.
    fn resize(&mut self) {
        self.recovery.window.set_segment(self.mtu.known());
        self.pacer.set_segment(self.mtu.known());
    }

    /// A probe is for a peer that is there, and for a path that is worth it: one that carries frames.
    fn may_probe(&self) -> bool {
        self.confirmed && self.recovery.room() >= self.config.max_datagram
    }

    fn end(&mut self, why: Closed) {
        if self.closed.is_none() {
            self.close_due = why != Closed::Peer;
            self.closed = Some(why);
        }
    }
}
