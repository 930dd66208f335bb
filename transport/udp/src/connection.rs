//! One end of a connection, once both sides have keys.

use std::fmt;
use std::time::Duration;

use thiserror::Error;
use trimaran_proto::{BatchSize, Camera, FrameMessage, Goodbye, Instant};

use crate::acks::Acks;
use crate::chunk::{CLOSE, Chunk};
use crate::congestion::Congestion;
use crate::inbox::{GivenUp, Inbox, LaneViolation, Received};
use crate::keys::{Keys, OVERHEAD};
use crate::latest::{LatestEnd, LatestIn, LatestOut};
use crate::mtu::Mtu;
use crate::outbox::{Outbox, Path};
use crate::pacer::Pacer;
use crate::packet::{ConnectionId, MIN_DATAGRAM, NUMBERS, Packet, data_header};
use crate::recovery::{Content, Recovery, Sent, Verdict};
use crate::repair::{Budget, Repair};
use crate::wire::{Malformed, Reader};

/// What a full packet has beside its part or repair shard at most, bytes: the chunk's own fields, or a short acknowledgement too.
const BESIDE: usize = 36;
/// After so many probes without an answer a path may have become narrower.
const BLACK_HOLE: u32 = 3;

/// What holds for a connection. Both ends must agree on the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// How many ids are passed on at once at most.
    pub batch: BatchSize,
    /// Bytes of the frames lane that the receiver keeps for a reader who does not read. Default 4 MiB.
    pub window: u64,
    /// Bytes that the sender keeps until they are acknowledged. Default 4 MiB.
    pub send_buffer: usize,
    /// How long an acknowledgement may wait for company. Default 1 ms.
    pub ack_delay: Duration,
    /// How long nothing may arrive, or nothing that was sent be acknowledged, before the peer counts as dead. Default 20 s; a
    /// quarter of it without traffic sends a ping.
    pub lease: Duration,
    /// How long after its end a frame sent from here is worth sending: whatever cannot arrive in time is given up, and the peer
    /// gets the frame with gaps. `None`, the default, for always.
    pub patience: Option<Duration>,
    /// When frames sent from here get repair. Default while packets are lost.
    pub repair: Repair,
    /// How many bytes of repair they may have, percent of their own. Default 15; 0 for none.
    pub repair_percent: u8,
    /// How the connection shares its path with others. Default CUBIC.
    pub congestion: Congestion,
    /// The largest datagram that is tried, bytes; 1,200 are always used. Default 1,452: Ethernet's 1,500 less the headers of IPv6
    /// and UDP.
    pub max_datagram: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            batch: BatchSize::default(),
            window: 4 << 20,
            send_buffer: 4 << 20,
            ack_delay: Duration::from_millis(1),
            lease: Duration::from_secs(20),
            patience: None,
            repair: Repair::default(),
            repair_percent: 15,
            congestion: Congestion::default(),
            max_datagram: 1452,
        }
    }
}

/// Why a connection is over.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Closed {
    /// This side closed it.
    #[error("this side closed the connection")]
    Here,
    /// The peer closed it.
    #[error("the peer closed the connection")]
    Peer,
    /// Nothing came for the lease.
    #[error("nothing came from the peer for {0:?}")]
    Silent(Duration),
    /// The peer sends, but acknowledges nothing.
    #[error("the peer acknowledged nothing for {0:?}")]
    Deaf(Duration),
    /// The peer sent what is no packet, under its own key.
    #[error("the peer sent a packet that is none")]
    Malformed(#[from] Malformed),
    /// The peer broke the rules of the frames lane.
    #[error("the peer broke the rules of the frames lane")]
    Lane(#[from] LaneViolation),
    /// The peer acknowledged a packet that was never sent.
    #[error("the peer acknowledged a packet that was never sent")]
    NeverSent,
    /// The peer sent a camera that is none.
    #[error("the peer sent a camera that is none")]
    Camera,
    /// All packet numbers are used, or a packet could not be sealed.
    #[error("no further packet can be sealed")]
    Exhausted,
}

/// One end of a connection: no socket, no clock.
///
/// Hand it what arrives ([`Connection::handle`]) and the time when it is due ([`Connection::poll_timeout`],
/// [`Connection::handle_timeout`]); after each call send what [`Connection::poll_transmit`] gives, until it gives nothing.
pub struct Connection {
    config: Config,
    keys: Keys,
    here: ConnectionId,
    there: ConnectionId,
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
    /// A ping is due: a probe or a keepalive. It may exceed the window by one packet.
    probe: bool,
    last_received: Instant,
    last_sent: Instant,
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
            ),
            inbox: Inbox::new(config.batch, config.window),
            cameras_out: LatestOut::default(),
            cameras_in: LatestIn::default(),
            credit_due: false,
            unread: false,
            unread_due: false,
            unheard: false,
            confirmed: false,
            probe: false,
            last_received: now,
            last_sent: now,
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

    /// Sends something, so that the peer knows this side is there.
    pub const fn ping(&mut self) {
        self.probe = true;
    }

    /// Why the connection is over, if it is.
    #[must_use]
    pub const fn closed(&self) -> Option<&Closed> {
        self.closed.as_ref()
    }

    /// Packets that were found lost so far.
    #[must_use]
    pub const fn lost_packets(&self) -> u64 {
        self.recovery.lost_packets
    }

    /// The largest datagram that is known to arrive, bytes.
    #[must_use]
    pub const fn datagram_size(&self) -> usize {
        self.mtu.known()
    }

    /// Frames sent from here that were given up, for they could not arrive in time.
    #[must_use]
    pub const fn frames_given_up(&self) -> u64 {
        self.outbox.frames_given_up
    }

    /// Frames of the peer that are whole only because of their repair.
    #[must_use]
    pub const fn frames_repaired(&self) -> u64 {
        self.inbox.frames_repaired
    }

    /// The smoothed round-trip time.
    #[must_use]
    pub fn round_trip(&self) -> Duration {
        self.recovery.rtt.smoothed()
    }

    /// Sends a message of the frames lane; a frame writer has put the messages in order.
    pub fn send(&mut self, message: FrameMessage) {
        self.outbox.put(message, self.path());
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
        Path { shard: (self.mtu.known() - OVERHEAD - BESIDE) & !15, loss: self.recovery.loss() }
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

    /// Takes a datagram for this connection. What does not open, came before, or belongs elsewhere is ignored.
    pub fn handle(&mut self, now: Instant, datagram: &[u8]) {
        let Ok(Packet::Data { to, number, sealed }) = Packet::parse(datagram) else { return };
        if to != self.here || self.closed == Some(Closed::Peer) || !self.acks.is_new(number) {
            return;
        }
        let mut plain = std::mem::take(&mut self.plain);
        if self.keys.open(to, number, sealed, &mut plain) {
            self.last_received = now;
            self.confirmed = true;
            if self.closed.is_some() {
                // The close was lost, unless this one crossed it: two ends that answer each other's would never stop.
                self.close_due = plain != [CLOSE];
                self.acks.on_received(now, number, false, self.config.ack_delay);
                self.plain = plain;
                return;
            }
            match self.take_chunks(now, &plain) {
                Ok(eliciting) => self.acks.on_received(now, number, eliciting, self.config.ack_delay),
                Err(why) => self.end(why),
            }
        }
        self.plain = plain;
    }

    /// Writes the next datagram into `out`, which it replaces; false when there is none now.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> bool {
        let mut plain = std::mem::take(&mut self.plain);
        plain.clear();
        self.outbox.expire(now, now.after(self.recovery.rtt.one_way()));
        let sent = self.write_chunks(now, &mut plain);
        let made = !plain.is_empty() && self.seal(now, &plain, sent, out);
        self.plain = plain;
        made
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
        let timers = [self.recovery.timeout(), self.acks.due(), self.paced_until, deadline, unheard, probe];
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
        self.probe |= now >= self.last_sent.after(self.config.lease / 4);
        if self.recovery.timeout().is_some_and(|at| at <= now) {
            let (verdict, probe) = self.recovery.on_timeout(now);
            self.probe |= probe;
            self.judge(now, verdict);
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

    fn take_chunks(&mut self, now: Instant, plain: &[u8]) -> Result<bool, Closed> {
        let mut reader = Reader::new(plain);
        let mut eliciting = false;
        while !reader.is_empty() {
            let chunk = Chunk::read(&mut reader)?;
            eliciting |= chunk.is_eliciting();
            match chunk {
                Chunk::Pad | Chunk::Ping => {}
                Chunk::Ack { delay_us, numbers } => {
                    let delay = Duration::from_micros(delay_us);
                    let verdict =
                        self.recovery.on_ack(now, &numbers, delay).map_err(|_| Closed::NeverSent)?;
                    self.judge(now, verdict);
                }
                Chunk::Credit { bytes, units } => self.outbox.allow(bytes, units),
                Chunk::Close => return Err(Closed::Peer),
                Chunk::Camera { number, camera } => {
                    let camera = Camera::from_bytes(&camera).map_err(|_| Closed::Camera)?;
                    self.cameras_in.put(number, camera);
                }
                Chunk::LastCamera { number, goodbye } => {
                    self.cameras_in.put_end(number, goodbye).map_err(|_| Closed::Camera)?;
                }
                Chunk::Unread => {
                    self.unheard = true;
                    self.outbox.drop_all();
                }
                Chunk::Part { unit, offset, tail, data } => self.inbox.put(unit, offset, tail, data)?,
                Chunk::GiveUp { unit, length, sent, hash, head } => {
                    self.inbox.give_up(unit, GivenUp { length, sent, hash }, head)?;
                }
                Chunk::Repair { unit, block, hash, index, data } => {
                    self.inbox.put_repair(unit, block, hash, index, data)?;
                }
            }
        }
        if self.unread {
            self.credit_due |= self.inbox.discard();
        }
        Ok(eliciting)
    }

    fn judge(&mut self, now: Instant, verdict: Verdict) {
        for content in verdict.lost {
            match content {
                Content::Part { unit, range, ended } => self.outbox.on_loss(unit, range, ended),
                Content::Camera { number } => self.cameras_out.on_camera_lost(number),
                Content::LastCamera => self.cameras_out.on_end_lost(),
                Content::Credit => self.credit_due = true,
                Content::Unread => self.unread_due = true,
                Content::GiveUp { unit } => self.outbox.on_give_up_loss(unit),
                Content::Repair => {}
                Content::Probe { size } => self.mtu.on_lost(now, size),
            }
        }
        for content in verdict.arrived {
            match content {
                Content::Part { unit, range, ended } => self.outbox.on_ack(unit, range, ended),
                Content::Camera { number } => self.cameras_out.on_camera_arrived(number),
                Content::LastCamera => self.cameras_out.on_end_arrived(),
                Content::GiveUp { unit } => self.outbox.on_give_up_ack(unit),
                Content::Probe { size } => {
                    self.mtu.on_arrived(now, size);
                    self.resize();
                }
                Content::Credit | Content::Unread | Content::Repair => {}
            }
        }
    }

    /// Fills a packet; gives what it carried if it asks for an acknowledgement.
    fn write_chunks(&mut self, now: Instant, plain: &mut Vec<u8>) -> Option<Vec<Content>> {
        let all = self.mtu.known() - OVERHEAD;
        if self.closed.is_some() {
            if std::mem::take(&mut self.close_due) {
                Chunk::Close.write(plain);
            }
            return None;
        }
        let mut contents = Vec::new();
        let allowed = self.may_send(now);
        let ack_due = self.acks.due().is_some_and(|due| due <= now);
        let has_data = allowed && self.has_data();
        if (ack_due || has_data || self.probe)
            && let Some(ack) = self.acks.take(now)
        {
            ack.write(plain);
            // A packet that leaves anyway.
            self.cameras_out.write_copy(all.saturating_sub(plain.len()), plain, &mut contents);
            if !contents.is_empty() {
                return Some(contents);
            }
        }
        if !allowed {
            return (!contents.is_empty()).then_some(contents);
        }
        let probe = std::mem::take(&mut self.probe);
        if std::mem::take(&mut self.credit_due) {
            let (bytes, units) = self.inbox.tell_credit();
            Chunk::Credit { bytes, units }.write(plain);
            contents.push(Content::Credit);
        }
        if std::mem::take(&mut self.unread_due) {
            Chunk::Unread.write(plain);
            contents.push(Content::Unread);
        }
        self.cameras_out.write(all.saturating_sub(plain.len()), plain, &mut contents);
        while let Some(content) = self.outbox.write_next(all.saturating_sub(plain.len()), all, plain) {
            contents.push(content);
        }
        if contents.is_empty() && probe {
            Chunk::Ping.write(plain);
            return Some(contents);
        }
        if plain.is_empty() && self.may_probe() {
            self.write_probe(now, plain, &mut contents);
        }
        (!contents.is_empty()).then_some(contents)
    }

    /// Fills a packet up to the size that is to be tried.
    fn write_probe(&mut self, now: Instant, plain: &mut Vec<u8>, contents: &mut Vec<Content>) {
        if let Some(size) = self.mtu.probe(now) {
            Chunk::Ping.write(plain);
            plain.resize(size - OVERHEAD, Chunk::FILLING);
            contents.push(Content::Probe { size });
        }
    }

    /// Whether window and pacer allow a full packet now. A probe always may leave.
    fn may_send(&mut self, now: Instant) -> bool {
        self.paced_until = None;
        if self.probe {
            return true;
        }
        let probe = self.mtu.due().is_some_and(|due| due <= now) && self.may_probe();
        if !self.has_data() && !probe || self.recovery.room() < self.mtu.known() {
            return false;
        }
        let ready = self.pacer.ready(now, self.recovery.window.window(), self.recovery.rtt.smoothed());
        if ready > now {
            self.paced_until = Some(ready);
        }
        ready <= now
    }

    fn has_data(&self) -> bool {
        self.credit_due || self.unread_due || self.cameras_out.is_due() || self.outbox.has_due()
    }

    fn seal(&mut self, now: Instant, plain: &[u8], sent: Option<Vec<Content>>, out: &mut Vec<u8>) -> bool {
        let number = self.recovery.next_number();
        out.clear();
        out.extend_from_slice(&data_header(self.there, number));
        if number >= NUMBERS || !self.keys.seal(self.there, number, plain, out) {
            self.closed.get_or_insert(Closed::Exhausted);
            return false;
        }
        self.last_sent = now;
        let bytes = out.len();
        if sent.is_some() {
            self.pacer.on_sent(bytes);
        }
        let lost = self.recovery.on_sent(sent.map(|contents| Sent { at: now, bytes, contents }));
        self.judge(now, Verdict { lost, ..Verdict::default() });
        true
    }
}
