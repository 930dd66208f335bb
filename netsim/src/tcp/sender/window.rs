//! The window while nothing is lost: it grows while it is used, and shrinks while it is not.

use trimaran_net::Instant;

use super::super::cubic::Ack;
use super::super::scoreboard::News;
use super::{FIRST_WINDOW, Sender, State};

/// How much of the window is used.
#[derive(Debug, Default)]
pub(super) struct Usage {
    pub(super) limited: bool,
    /// The most packets in flight in this round trip, and where that ends.
    pub(super) most: u32,
    pub(super) round_end: u64,
    /// The most used while the window is not the limit, and since when that is so.
    pub(super) unlimited_most: u32,
    pub(super) since: Instant,
}

impl Sender {
    /// About a millisecond of data, and two packets at least, may wait in the host's own queue (Linux's
    /// small queues).
    pub(super) fn queue_limit(&self) -> u64 {
        let two = 2 * u64::from(self.segment + 52);
        let Some(rtt) = self.rtt.smoothed().filter(|rtt| !rtt.is_zero()) else { return two };
        let factor = if self.cwnd < self.threshold / 2 { 2.0 } else { 1.2 };
        let rate = factor * f64::from(self.cwnd) * f64::from(self.segment) / rtt.as_secs_f64();
        two.max((rate / 1024.0) as u64)
    }

    pub(super) fn note_usage(&mut self, now: Instant) {
        let (packets, remembered, timeout) =
            (self.scoreboard.packets(), self.remembered_threshold(), self.rtt.timeout());
        let usage = &mut self.usage;
        if self.acknowledged > usage.round_end {
            (usage.most, usage.round_end, usage.limited) = (0, self.next, false);
        }
        usage.most = usage.most.max(packets);
        if packets >= self.cwnd {
            usage.limited = true;
            (usage.unlimited_most, usage.since) = (0, now);
            return;
        }
        usage.unlimited_most = usage.unlimited_most.max(packets);
        if now.since(usage.since) >= timeout {
            // An unused window shrinks after so long, half at a time.
            let used = usage.unlimited_most.max(FIRST_WINDOW);
            if self.state == State::Open && used < self.cwnd {
                self.threshold = remembered;
                self.cwnd = u32::midpoint(self.cwnd, used);
            }
            (usage.unlimited_most, usage.since) = (0, now);
        }
    }

    /// After a pause of a timeout the window is halved, once for each.
    pub(super) fn restart_after_idle(&mut self, now: Instant) {
        let timeout = self.rtt.timeout();
        let mut idle = now.since(self.last_sent);
        if self.last_sent.as_nanos() == 0 || idle <= timeout {
            return;
        }
        self.threshold = self.remembered_threshold();
        let least = self.cwnd.min(FIRST_WINDOW);
        while idle > timeout && self.cwnd > least {
            idle -= timeout;
            self.cwnd = (self.cwnd / 2).max(least);
        }
        self.last_sent = now;
    }

    /// The threshold after an unused window shrank: three quarters of it are known to work.
    const fn remembered_threshold(&self) -> u32 {
        let most = self.cwnd - self.cwnd / 4;
        if self.threshold > most { self.threshold } else { most }
    }

    pub(super) fn grow(&mut self, now: Instant, news: &News) {
        if news.acknowledged == 0 {
            return;
        }
        let Some(min_rtt) = self.rtt.min() else { return };
        let slow_start = self.cwnd < self.threshold;
        if slow_start
            && let Some(rtt) = news.latest_rtt
            && self.cubic.leaves_slow_start(
                now,
                Ack { acknowledged: self.acknowledged, next: self.next, rtt, min_rtt },
                self.cwnd,
            )
        {
            self.threshold = self.cwnd;
        }
        let used = if slow_start { self.cwnd < 2 * self.usage.most } else { self.usage.limited };
        if !used {
            return;
        }
        let mut acked = news.acknowledged;
        if self.cwnd < self.threshold {
            let step = acked.min(self.threshold - self.cwnd);
            self.cwnd += step;
            acked -= step;
        }
        if acked > 0 {
            self.cwnd = self.cubic.grow(now, self.cwnd, acked, min_rtt);
        }
    }
}
