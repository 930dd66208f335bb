//! The sending half: what may be sent, when it is sent again, and how fast.

use std::time::Duration;

use bytes::Bytes;
use trimaran_transport::Instant;

use super::board::{Board, News};
use super::cubic::Cubic;
use super::rtt::{RTO_MIN, Rtt};
use super::segment::{Class, earlier};
use super::unsent::Unsent;

mod recovery;
mod window;

use recovery::{Reduction, Undo};
use window::Usage;

/// Packets at first (RFC 6928).
const FIRST_WINDOW: u32 = 10;
/// A probe for a lost tail waits two round trips and so much more: two of Linux's clock ticks.
const PROBE_SLACK: Duration = Duration::from_millis(2);
/// What Linux charges a socket for a full packet, and at most for all (`tcp_wmem`).
const PACKET_COST: u64 = 4352;
const BUFFER_MAX: u64 = 4_194_304;

#[derive(Debug)]
pub(super) struct Sender {
    /// The first byte that is not acknowledged; the next one to be sent; how far the peer takes them.
    pub(super) acknowledged: u64,
    pub(super) next: u64,
    window_end: u64,
    segment: u32,
    unsent: Unsent,
    buffer: Option<u64>,
    /// The program has written all that it will.
    closing: bool,
    fin_sent: bool,
    board: Board,
    pub(super) rtt: Rtt,
    cubic: Cubic,
    cwnd: u32,
    threshold: u32,
    state: State,
    /// A recovery is over when this is acknowledged.
    recovery_end: u64,
    reduction: Reduction,
    undo: Option<Undo>,
    /// When the first of the repetitions under way left, milliseconds.
    repeating_since: Option<u64>,
    usage: Usage,
    timers: Timers,
    /// A probe for a lost tail is out: what was next then, and whether it was data sent again.
    tail_probe: Option<(u64, bool)>,
    /// Send that probe now, whatever the window.
    probe_tail: bool,
    /// Ask for room now.
    probe_window: bool,
    last_sent: Instant,
    /// When something was acknowledged last, or began to wait for that.
    progress: Instant,
    /// Bytes of this connection in the machine's own queue.
    outgoing: u64,
    /// Something waits for those to leave.
    held_back: bool,
    nodelay: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    /// Something is lost, and what arrives makes room to repeat it.
    Recovery,
    /// Nothing came for a timeout: starts anew.
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

impl Sender {
    pub(super) fn new(next: u64, segment: u32, buffer: Option<usize>, nodelay: bool) -> Self {
        let start = Instant::from_nanos(0);
        Self {
            acknowledged: next,
            next,
            window_end: next,
            segment,
            unsent: Unsent::default(),
            buffer: buffer.map(|bytes| bytes as u64),
            closing: false,
            fin_sent: false,
            board: Board::new(),
            rtt: Rtt::new(),
            cubic: Cubic::new(),
            cwnd: FIRST_WINDOW,
            threshold: u32::MAX,
            state: State::Open,
            recovery_end: 0,
            reduction: Reduction::default(),
            undo: None,
            repeating_since: None,
            usage: Usage { limited: false, most: 0, round_end: 0, unlimited_most: 0, since: start },
            timers: Timers::default(),
            tail_probe: None,
            probe_tail: false,
            probe_window: false,
            last_sent: start,
            progress: start,
            outgoing: 0,
            held_back: false,
            nodelay,
        }
    }

    /// How many bytes the program may write now.
    pub(super) fn room(&self) -> usize {
        // Linux's buffer grows with the window: twice what a window of packets costs.
        let grown = 2 * PACKET_COST * u64::from(self.cwnd.max(FIRST_WINDOW));
        let limit = self.buffer.unwrap_or_else(|| grown.min(BUFFER_MAX));
        usize::try_from(limit.saturating_sub(self.held())).unwrap_or(usize::MAX)
    }

    /// Whether a program that waits for room should be told: when a third is free, as Linux has it.
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
        self.fin_sent && self.board.is_empty()
    }

    /// Since when what is to be sent makes no progress: it is not acknowledged, or the peer has no room.
    pub(super) fn waiting_since(&self) -> Option<Instant> {
        (!self.board.is_empty() || self.timers.persist.is_some()).then_some(self.progress)
    }

    pub(super) fn set_window(&mut self, ack: u64, window: u32) {
        self.window_end = self.window_end.max(ack + u64::from(window));
        if self.window_end > self.next {
            self.timers.persist = None;
        }
    }

    /// So many bytes of this connection have left the machine. Says whether something waited for that.
    pub(super) const fn left(&mut self, bytes: u64) -> bool {
        self.outgoing = self.outgoing.saturating_sub(bytes);
        std::mem::replace(&mut self.held_back, false)
    }

    pub(super) const fn entered(&mut self, bytes: u64) {
        self.outgoing += bytes;
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        let Timers { retransmit, tail, reorder, persist } = self.timers;
        earlier(earlier(retransmit, tail), earlier(reorder, persist))
    }

    /// The next segment to be sent, if there is one that may.
    pub(super) fn transmit(&mut self, now: Instant) -> Option<Outgoing> {
        let alone = self.board.in_flight() == 0;
        if self.board.in_flight() < self.cwnd
            && let Some(packet) = self.board.repeat_lost(now)
        {
            let out = Outgoing {
                seq: packet.seq,
                data: packet.data.clone(),
                fin: packet.fin,
                class: Class::Retransmission,
            };
            self.reduction.sent += 1;
            if alone {
                self.cubic.skip(now.since(self.last_sent));
            }
            self.repeating_since.get_or_insert(now.as_nanos() / 1_000_000);
            if let Some(undo) = &mut self.undo {
                undo.repetitions += 1;
            }
            if self.timers.retransmit.is_none() {
                self.timers.retransmit = Some(now.after(self.rtt.timeout()));
            }
            self.last_sent = now;
            return Some(out);
        }
        if std::mem::take(&mut self.probe_window) {
            // A byte that the peer has: it can but answer with its window.
            return Some(Outgoing {
                seq: self.acknowledged - 1,
                data: Bytes::new(),
                fin: false,
                class: Class::Probe,
            });
        }
        let probing = std::mem::take(&mut self.probe_tail);
        let fresh = self.transmit_new(now, probing);
        if !probing {
            return fresh;
        }
        self.tail_probe = Some((self.next, fresh.is_none()));
        self.timers.retransmit = Some(now.after(self.rtt.timeout()));
        self.timers.tail = None;
        fresh.or_else(|| {
            let packet = self.board.repeat_last(now)?;
            let class = Class::Retransmission;
            Some(Outgoing { seq: packet.seq, data: packet.data.clone(), fin: packet.fin, class })
        })
    }

    /// New data, as far as windows and the machine's own queue allow; a probe need not heed the congestion window.
    fn transmit_new(&mut self, now: Instant, probing: bool) -> Option<Outgoing> {
        let fin_due = self.closing && !self.fin_sent;
        if self.unsent.is_empty() && !fin_due {
            return None;
        }
        if self.board.is_empty() && self.state == State::Open {
            self.restart_after_idle(now);
        }
        if !probing && self.board.in_flight() >= self.cwnd {
            self.usage.limited = true;
            self.usage.most = self.usage.most.max(self.board.packets());
            return None;
        }
        if self.outgoing >= self.queue_limit() {
            self.held_back = true;
            return None;
        }
        let room = self.window_end.saturating_sub(self.next);
        let wanted = self.unsent.len().min(self.segment as usize);
        let size = wanted.min(usize::try_from(room).unwrap_or(usize::MAX));
        if size < wanted && (size == 0 || !self.board.is_empty()) {
            if self.board.is_empty() && self.timers.persist.is_none() {
                self.timers.persist = Some(now.after(self.rtt.timeout()));
                self.progress = now;
            }
            return None;
        }
        // A small segment waits while one before it is still in this machine (Linux's autocorking), or, without `nodelay`, while
        // one is not acknowledged (Nagle).
        let small = wanted < self.segment as usize && !fin_due;
        if small && !probing && !self.board.is_empty() && (self.outgoing > 0 || !self.nodelay) {
            self.held_back = self.outgoing > 0;
            return None;
        }
        if self.board.in_flight() == 0 {
            self.cubic.skip(now.since(self.last_sent));
        }
        let data = self.unsent.take(size);
        let fin = fin_due && self.unsent.is_empty();
        if self.board.is_empty() {
            self.progress = now;
        }
        if self.board.is_empty() || self.timers.tail.is_some() {
            self.timers.retransmit = Some(now.after(self.rtt.timeout()));
        }
        let out = Outgoing { seq: self.next, data: data.clone(), fin, class: Class::Data };
        self.next += data.len() as u64 + u64::from(fin);
        self.fin_sent |= fin;
        self.board.push(now, out.seq, data, fin);
        self.reduction.sent += 1;
        self.last_sent = now;
        self.note_usage(now);
        self.set_tail_timer(now, false);
        Some(out)
    }

    /// Sets the timer after which a lost tail is probed for, at the retransmission timeout at most: that of the oldest packet,
    /// or a fresh one where an acknowledgement has just come.
    fn set_tail_timer(&mut self, now: Instant, heard: bool) {
        self.timers.tail = None;
        if self.state != State::Open || self.board.is_empty() || self.tail_probe.is_some() {
            return;
        }
        let Some(smoothed) = self.rtt.smoothed() else { return };
        // A single packet's acknowledgement may be delayed.
        let slack = if self.board.packets() == 1 { RTO_MIN } else { PROBE_SLACK };
        let at = now.after(2 * smoothed + slack);
        let since = if heard { None } else { self.board.oldest().map(|oldest| oldest.at) };
        let last = since.unwrap_or(now).after(self.rtt.timeout());
        self.timers.tail = Some(if last > now { at.min(last) } else { at });
    }

    /// The time has come that [`Sender::next_timeout`] named.
    pub(super) fn expire(&mut self, now: Instant) {
        let due = |timer: &mut Option<Instant>| timer.take_if(|at| *at <= now).is_some();
        if due(&mut self.timers.reorder) {
            self.look_for_losses(now);
            if self.state == State::Open && self.board.has_lost() {
                self.enter_recovery();
                self.reduce(&News::default(), false);
                self.timers.tail = None;
            }
        }
        if due(&mut self.timers.tail) && !self.board.is_empty() {
            self.probe_tail = true;
            self.timers.retransmit = None;
            return;
        }
        if due(&mut self.timers.persist) {
            self.probe_window = true;
            self.rtt.back_off();
            self.timers.persist = Some(now.after(self.rtt.timeout()));
        }
        if due(&mut self.timers.retransmit) && !self.board.is_empty() {
            self.time_out(now);
        }
    }
}
