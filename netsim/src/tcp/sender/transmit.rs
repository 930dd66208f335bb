//! Chooses the next segment, and holds back others.

use trimaran_net::Instant;

use super::super::rtt::RTO_MIN;
use super::super::segment::Class;
use super::{Outgoing, PROBE_SLACK, Sender, State};

impl Sender {
    /// The next segment that may be sent, if any.
    pub(in crate::tcp) fn transmit(&mut self, now: Instant) -> Option<Outgoing> {
        let alone = self.scoreboard.in_flight() == 0;
        if self.scoreboard.in_flight() < self.cwnd
            && let Some(packet) = self.scoreboard.repeat_lost(now)
        {
            let out = Outgoing::again(packet);
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
            // A byte that the peer has, so that it answers with its window.
            return Some(Outgoing::empty(self.acknowledged - 1, Class::Probe));
        }
        let probing = std::mem::take(&mut self.probe_tail);
        let fresh = self.transmit_new(now, probing);
        if !probing {
            return fresh;
        }
        self.tail_probe = Some((self.next, fresh.is_none()));
        self.timers.retransmit = Some(now.after(self.rtt.timeout()));
        self.timers.tail = None;
        fresh.or_else(|| self.scoreboard.repeat_last(now).map(Outgoing::again))
    }

    /// New data, as far as windows and the host's own queue allow; a probe ignores the congestion window.
    fn transmit_new(&mut self, now: Instant, probing: bool) -> Option<Outgoing> {
        let fin_due = self.closing && !self.fin_sent;
        if self.unsent.is_empty() && !fin_due {
            return None;
        }
        if self.scoreboard.is_empty() && self.state == State::Open {
            self.restart_after_idle(now);
        }
        if !probing && self.scoreboard.in_flight() >= self.cwnd {
            self.usage.limited = true;
            self.usage.most = self.usage.most.max(self.scoreboard.packets());
            return None;
        }
        if self.outgoing >= self.queue_limit() {
            self.held_back = true;
            return None;
        }
        let room = self.window_end.saturating_sub(self.next);
        let wanted = self.unsent.len().min(self.segment as usize);
        let size = wanted.min(usize::try_from(room).unwrap_or(usize::MAX));
        if size < wanted && (size == 0 || !self.scoreboard.is_empty()) {
            if self.scoreboard.is_empty() && self.timers.persist.is_none() {
                self.timers.persist = Some(now.after(self.rtt.timeout()));
                self.progress = now;
            }
            return None;
        }
        // A small segment waits while one before it is still in this host (Linux's autocorking), or,
        // without `nodelay`, while one is not acknowledged (Nagle).
        let small = wanted < self.segment as usize && !fin_due;
        if small && !probing && !self.scoreboard.is_empty() && (self.outgoing > 0 || !self.nodelay) {
            self.held_back = self.outgoing > 0;
            return None;
        }
        if self.scoreboard.in_flight() == 0 {
            self.cubic.skip(now.since(self.last_sent));
        }
        let data = self.unsent.take(size);
        let fin = fin_due && self.unsent.is_empty();
        if self.scoreboard.is_empty() {
            self.progress = now;
        }
        if self.scoreboard.is_empty() || self.timers.tail.is_some() {
            self.timers.retransmit = Some(now.after(self.rtt.timeout()));
        }
        let out = Outgoing { seq: self.next, data: data.clone(), fin, class: Class::Data };
        self.next += data.len() as u64 + u64::from(fin);
        self.fin_sent |= fin;
        self.scoreboard.push(now, out.seq, data, fin);
        self.reduction.sent += 1;
        self.last_sent = now;
        self.note_usage(now);
        self.set_tail_timer(now, false);
        Some(out)
    }

    /// Sets the timer of the tail loss probe, at most the retransmission timeout. That is the oldest
    /// packet's, or a fresh one if an acknowledgement has just come.
    pub(super) fn set_tail_timer(&mut self, now: Instant, heard: bool) {
        self.timers.tail = None;
        if self.state != State::Open || self.scoreboard.is_empty() || self.tail_probe.is_some() {
            return;
        }
        let Some(smoothed) = self.rtt.smoothed() else { return };
        // A single packet's acknowledgement may be delayed.
        let slack = if self.scoreboard.packets() == 1 { RTO_MIN } else { PROBE_SLACK };
        let at = now.after(2 * smoothed + slack);
        let since = if heard { None } else { self.scoreboard.oldest().map(|oldest| oldest.at) };
        let last = since.unwrap_or(now).after(self.rtt.timeout());
        self.timers.tail = Some(if last > now { at.min(last) } else { at });
    }
}
