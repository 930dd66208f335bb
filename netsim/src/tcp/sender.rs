//! The sending half: transmission, retransmission and congestion control.

use std::time::Duration;

use bytes::Bytes;
use trimaran_net::Instant;

use super::cubic::Cubic;
use super::rtt::Rtt;
use super::scoreboard::{News, Scoreboard, Sent};
use super::segment::Class;
use super::unsent::Unsent;

mod recovery;
mod transmit;
mod window;

use recovery::{Reduction, Undo};
use window::Usage;

/// The initial window in packets (RFC 6928).
const FIRST_WINDOW: u32 = 10;
/// A tail loss probe waits two round trips and this: two of Linux's clock ticks.
const PROBE_SLACK: Duration = Duration::from_millis(2);
/// Linux's charge for a full packet, and the limit of a socket (`tcp_wmem`).
const PACKET_COST: u64 = 4352;
const BUFFER_MAX: u64 = 4_194_304;

#[derive(Debug, Default)]
pub(super) struct Sender {
    /// The first unacknowledged byte; the next one to be sent; the end of the peer's window.
    pub(super) acknowledged: u64,
    pub(super) next: u64,
    window_end: u64,
    segment: u32,
    unsent: Unsent,
    buffer: Option<u64>,
    /// The program has written all that it will.
    closing: bool,
    fin_sent: bool,
    scoreboard: Scoreboard,
    pub(super) rtt: Rtt,
    cubic: Cubic,
    cwnd: u32,
    threshold: u32,
    state: State,
    /// A recovery is over when this is acknowledged.
    recovery_end: u64,
    reduction: Reduction,
    undo: Option<Undo>,
    /// When the first retransmission in flight was sent, milliseconds.
    repeating_since: Option<u64>,
    usage: Usage,
    timers: Timers,
    /// A tail loss probe is in flight: the next byte at that time, and whether it was a retransmission.
    tail_probe: Option<(u64, bool)>,
    /// Send that probe now, regardless of the window.
    probe_tail: bool,
    /// Send a window probe now.
    probe_window: bool,
    last_sent: Instant,
    /// When data was last acknowledged, or began to wait for that.
    progress: Instant,
    /// Bytes of this connection in the host's own queue.
    outgoing: u64,
    /// Data waits for those to leave.
    held_back: bool,
    pub(super) nodelay: bool,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum State {
    #[default]
    Open,
    /// Data is lost, and arrivals make room to retransmit it.
    Recovery,
    /// The timeout expired: starts over.
    Loss,
}

#[derive(Debug, Default)]
struct Timers {
    retransmit: Option<Instant>,
    tail: Option<Instant>,
    reorder: Option<Instant>,
    persist: Option<Instant>,
}

/// A segment's place in the stream.
pub(super) struct Outgoing {
    pub(super) seq: u64,
    pub(super) data: Bytes,
    pub(super) fin: bool,
    pub(super) class: Class,
}

impl Outgoing {
    /// A segment without data.
    pub(super) const fn empty(seq: u64, class: Class) -> Self {
        Self { seq, data: Bytes::new(), fin: false, class }
    }

    fn again(packet: &Sent) -> Self {
        let Sent { seq, data, fin, .. } = packet;
        Self { seq: *seq, data: data.clone(), fin: *fin, class: Class::Retransmission }
    }
}

impl Sender {
    pub(super) fn new(next: u64, segment: u32, buffer: Option<usize>, nodelay: bool) -> Self {
        Self {
            acknowledged: next,
            next,
            window_end: next,
            segment,
            buffer: buffer.map(|bytes| bytes as u64),
            cwnd: FIRST_WINDOW,
            threshold: u32::MAX,
            nodelay,
            ..Self::default()
        }
    }

    /// How many bytes the program may write now.
    pub(super) fn room(&self) -> usize {
        // Linux's buffer grows with the window: twice the cost of a window of packets.
        let grown = 2 * PACKET_COST * u64::from(self.cwnd.max(FIRST_WINDOW));
        let limit = self.buffer.unwrap_or_else(|| grown.min(BUFFER_MAX));
        usize::try_from(limit.saturating_sub(self.held())).unwrap_or(usize::MAX)
    }

    /// Whether to wake a program that waits for room: when a third is free, as in Linux.
    pub(super) fn has_much_room(&self) -> bool {
        self.room() as u64 >= self.held() / 2
    }

    fn held(&self) -> u64 {
        self.unsent.len() as u64 + (self.next - self.acknowledged)
    }

    pub(super) fn write(&mut self, data: &[u8]) {
        self.unsent.write(data);
    }

    pub(super) const fn close(&mut self) {
        self.closing = true;
    }

    /// Whether all has been acknowledged, the end of the stream included.
    pub(super) fn has_ended(&self) -> bool {
        self.fin_sent && self.scoreboard.is_empty()
    }

    /// Since when sending makes no progress: no acknowledgement comes, or the peer has no room.
    pub(super) fn waiting_since(&self) -> Option<Instant> {
        (!self.scoreboard.is_empty() || self.timers.persist.is_some()).then_some(self.progress)
    }

    pub(super) fn set_window(&mut self, ack: u64, window: u32) {
        self.window_end = self.window_end.max(ack + u64::from(window));
        if self.window_end > self.next {
            self.timers.persist = None;
        }
    }

    /// So many bytes of this connection have left the host. Returns whether data waited for that.
    pub(super) const fn left(&mut self, bytes: u64) -> bool {
        self.outgoing = self.outgoing.saturating_sub(bytes);
        std::mem::replace(&mut self.held_back, false)
    }

    pub(super) const fn entered(&mut self, bytes: u64) {
        self.outgoing += bytes;
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        let Timers { retransmit, tail, reorder, persist } = self.timers;
        [retransmit, tail, reorder, persist].into_iter().flatten().min()
    }

    /// The time of [`Sender::next_timeout`] has come.
    pub(super) fn expire(&mut self, now: Instant) {
        let due = |timer: &mut Option<Instant>| timer.take_if(|at| *at <= now).is_some();
        if due(&mut self.timers.reorder) {
            self.look_for_losses(now);
            if self.state == State::Open && self.scoreboard.has_lost() {
                self.enter_recovery();
                self.reduce(&News::default(), false);
                self.timers.tail = None;
            }
        }
        if due(&mut self.timers.tail) && !self.scoreboard.is_empty() {
            self.probe_tail = true;
            self.timers.retransmit = None;
            return;
        }
        if due(&mut self.timers.persist) {
            self.probe_window = true;
            self.rtt.back_off();
            self.timers.persist = Some(now.after(self.rtt.timeout()));
        }
        if due(&mut self.timers.retransmit) && !self.scoreboard.is_empty() {
            self.time_out(now);
        }
    }
}
