//! Loss recovery from acknowledgements: how the window shrinks and comes back.

use trimaran_net::Instant;

use super::super::scoreboard::News;
use super::super::segment::{Range, Segment};
use super::{PROBE_SLACK, Sender, State};

/// How the window shrinks in a recovery (RFC 6937).
#[derive(Debug, Default)]
pub(super) struct Reduction {
    pub(super) before: u32,
    pub(super) delivered: u32,
    pub(super) sent: u32,
}

/// The state before a recovery that may prove spurious.
#[derive(Debug)]
pub(super) struct Undo {
    pub(super) cwnd: u32,
    pub(super) threshold: u32,
    /// Retransmissions that were not reported as duplicates.
    pub(super) repetitions: u32,
}

impl Sender {
    /// An acknowledgement came.
    pub(in crate::tcp) fn acknowledge(&mut self, now: Instant, segment: &Segment, ack: u64) {
        if ack > self.next || ack < self.acknowledged {
            return;
        }
        let duplicate = duplicate(&segment.sacks, ack);
        let advanced = ack > self.acknowledged;
        self.acknowledged = ack;
        let min_rtt = self.rtt.min();
        let news = self.scoreboard.acknowledge(now, ack, &segment.sacks, min_rtt);
        if let Some(sample) = news.rtt.or(news.latest_rtt) {
            self.rtt.measure(now, sample, ack, self.next);
        }
        if advanced {
            self.progress = now;
            self.rtt.forgive();
            self.timers.retransmit = (!self.scoreboard.is_empty()).then(|| now.after(self.rtt.timeout()));
        }
        self.judge_tail_probe(ack, &news, advanced, duplicate);
        if duplicate && self.tail_probe.is_none() {
            self.scoreboard.be_more_patient();
        }
        self.undo_if_spurious(segment, advanced, duplicate);
        self.look_for_losses(now);
        if self.state != State::Open && ack >= self.recovery_end {
            if self.state == State::Recovery {
                self.cwnd = self.threshold;
            }
            self.state = State::Open;
        }
        if self.state == State::Open && self.scoreboard.has_lost() {
            self.enter_recovery();
        }
        match self.state {
            State::Recovery => self.reduce(&news, advanced),
            State::Open | State::Loss => self.grow(now, &news),
        }
        self.set_tail_timer(now, true);
    }

    pub(super) fn look_for_losses(&mut self, now: Instant) {
        let recovering = self.state != State::Open;
        let wait = self.scoreboard.find_lost(now, recovering, self.rtt.min(), self.rtt.smoothed());
        self.timers.reorder = wait.map(|wait| now.after(wait + PROBE_SLACK));
    }

    /// A tail loss probe that retransmitted data repaired a loss, unless it is reported as a duplicate.
    fn judge_tail_probe(&mut self, ack: u64, news: &News, advanced: bool, duplicate: bool) {
        let Some((end, again)) = self.tail_probe.filter(|(end, _)| ack >= *end) else { return };
        let repaired = again && !duplicate && ack > end;
        if repaired && self.state == State::Open {
            // Congestion: reduces the window, though nothing is left to retransmit.
            self.threshold = self.cubic.after_loss(self.cwnd);
            self.cwnd = self.threshold;
        }
        // An acknowledgement without news: the probe was a duplicate, too.
        if repaired || !again || duplicate || (!advanced && !news.sacked) {
            self.tail_probe = None;
        }
    }

    pub(super) fn enter_recovery(&mut self) {
        self.remember_for_undo();
        self.reduction = Reduction { before: self.cwnd, ..Reduction::default() };
        self.threshold = self.cubic.after_loss(self.cwnd);
        self.recovery_end = self.next;
        self.state = State::Recovery;
        self.tail_probe = None;
    }

    fn remember_for_undo(&mut self) {
        if self.scoreboard.repeated() == 0 {
            self.repeating_since = None;
        }
        let repetitions = self.scoreboard.repeated();
        self.undo = Some(Undo { cwnd: self.cwnd, threshold: self.threshold, repetitions });
    }

    /// Restores the window if all retransmitted data had arrived: the peer reports duplicates, or
    /// acknowledges the originals.
    fn undo_if_spurious(&mut self, segment: &Segment, advanced: bool, duplicate: bool) {
        let recovering = self.state != State::Open;
        let Some(undo) = &mut self.undo else { return };
        if duplicate {
            undo.repetitions = undo.repetitions.saturating_sub(1);
        }
        let since = self.repeating_since;
        let all_twice = duplicate && since.is_some() && undo.repetitions == 0;
        let older = recovering && advanced && since.is_some_and(|since| segment.echo < since);
        if !all_twice && !older {
            return;
        }
        self.cwnd = self.cwnd.max(undo.cwnd);
        self.threshold = self.threshold.max(undo.threshold);
        self.undo = None;
        if recovering {
            self.scoreboard.nothing_is_lost();
            self.state = State::Open;
        }
    }

    /// Proportional rate reduction: sends in proportion to what arrives, so that the window ends at the
    /// threshold.
    pub(super) fn reduce(&mut self, news: &News, advanced: bool) {
        let flight = self.scoreboard.in_flight();
        let reduction = &mut self.reduction;
        reduction.delivered += news.delivered;
        let allowed = if flight > self.threshold {
            let share = u64::from(self.threshold) * u64::from(reduction.delivered);
            let due = share.div_ceil(u64::from(reduction.before.max(1)));
            u32::try_from(due).unwrap_or(u32::MAX).saturating_sub(reduction.sent)
        } else {
            let more = reduction.delivered.saturating_sub(reduction.sent).max(news.delivered);
            (more + u32::from(advanced)).min(self.threshold - flight)
        };
        let least = u32::from(reduction.sent == 0);
        self.cwnd = flight + allowed.max(least);
    }

    pub(super) fn time_out(&mut self, now: Instant) {
        if self.state != State::Loss {
            self.remember_for_undo();
            self.threshold = self.cubic.after_loss(self.cwnd);
            self.cubic.reset();
        }
        self.state = State::Loss;
        self.recovery_end = self.next;
        self.tail_probe = None;
        self.timers.tail = None;
        self.scoreboard.give_up(now);
        self.cwnd = self.scoreboard.in_flight() + 1;
        self.rtt.back_off();
        self.timers.retransmit = Some(now.after(self.rtt.timeout()));
    }
}

/// Whether the first range reports a duplicate (RFC 2883, section 4).
fn duplicate(sacks: &[Range], ack: u64) -> bool {
    let Some(first) = sacks.first() else { return false };
    let within = sacks.get(1).is_some_and(|second| second.from <= first.from && first.to <= second.to);
    first.to <= ack || within
}
