//! The timers of a connection.

use trimaran_net::Instant;

use super::{Closed, Connection};
use crate::packet::MIN_DATAGRAM;
use crate::peer_path::PeerPath;
use crate::recovery::{PROBES, Probe};

/// After so many unanswered probes a path may have become narrower.
const BLACK_HOLE: u32 = 3;

impl Connection {
    /// When [`Connection::handle_timeout`] is due, if nothing happens earlier.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        if self.closed.is_some() {
            return None;
        }
        let keepalive = self.last_sent.after(self.config.idle_timeout / 4);
        let idle_timeout = self.last_received.after(self.config.idle_timeout);
        let mut next = keepalive.min(idle_timeout);
        // One after the other, because this runs for every packet: a chain of iterators takes twice the
        // instructions.
        let mut or_at = |due: Option<Instant>| {
            if let Some(due) = due {
                next = next.min(due);
            }
        };
        or_at(self.recovery.timeout());
        or_at(self.deaf_at());
        or_at(self.acks.due());
        or_at(self.paced_until);
        or_at(self.question_due());
        let deadline = self.frame_lanes().filter_map(|lane| lane.outbox.deadline()).min();
        or_at(deadline.map(|at| {
            let way = self.recovery.rtt.one_way().as_nanos() as u64;
            Instant::from_nanos(at.as_nanos().saturating_sub(way))
        }));
        or_at(self.mtu.due().filter(|_| self.paced_until.is_none() && self.may_probe()));
        or_at(self.peer_path.as_ref().and_then(PeerPath::due));
        Some(next)
    }

    /// Handles the timers due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.closed.is_some() {
            return;
        }
        if now >= self.last_received.after(self.config.idle_timeout) {
            self.end(Closed::Silent(self.config.idle_timeout));
            return;
        }
        if self.deaf_at().is_some_and(|at| at <= now) {
            self.end(Closed::Deaf(self.config.idle_timeout));
            return;
        }
        if now >= self.last_sent.after(self.config.idle_timeout / 4) {
            self.ping();
        }
        if self.recovery.timeout().is_some_and(|at| at <= now) {
            let (verdict, probe) = self.recovery.on_timeout(now);
            self.judge(now, verdict);
            if probe.is_some() {
                self.pings = PROBES;
            }
            if probe == Some(Probe::Repeat) {
                self.frame_lanes_mut().for_each(|frames| frames.outbox.stop_waiting());
            }
            if self.recovery.probes() >= BLACK_HOLE && self.mtu.known() > MIN_DATAGRAM {
                self.mtu.on_black_hole(now);
                self.resize();
            }
        }
    }

    /// When the peer is given up although it sends. A peer from which nothing came for as long as two
    /// keep-alives take may be silent, and the idle timeout tells.
    fn deaf_at(&self) -> Option<Instant> {
        let idle_timeout = self.config.idle_timeout;
        let since = self.recovery.unheard_since()?;
        (self.last_received >= since.after(idle_timeout / 2)).then(|| since.after(idle_timeout))
    }

    /// Adopts the size of datagrams that is known to arrive.
    pub(super) fn resize(&mut self) {
        self.recovery.window.set_segment(self.mtu.known());
        self.pacer.set_segment(self.mtu.known());
        self.scavenger.set_segment(self.mtu.known());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::connection::tests::{after, connection, now};
    use crate::recovery::{Content, Verdict};

    /// The results of `look` after each of three probes that nobody answers.
    fn probed<T>(connection: &mut Connection, look: impl Fn(&Connection) -> T) -> Vec<T> {
        let mut out = Vec::new();
        connection.ping();
        assert!(connection.poll_transmit(now(), &mut out));
        let mut probe = || {
            let due = connection.recovery.timeout().unwrap();
            connection.handle_timeout(due);
            while connection.poll_transmit(due, &mut out) {}
            look(connection)
        };
        (0..BLACK_HOLE).map(|_| probe()).collect()
    }

    #[test]
    fn a_path_counts_as_narrower_at_the_third_unanswered_probe_and_the_window_keeps_its_packets() {
        let size = |connection: &Connection| (connection.stats().datagram_size, connection.stats().window);
        let mut connection = connection();
        let arrived = vec![Content::Probe { size: 1452 }];
        connection.judge(now(), Verdict { arrived, ..Verdict::default() });
        assert_eq!(size(&connection), (1452, 20 * 1452));
        assert_eq!(probed(&mut connection, size), [(1452, 29_040), (1452, 29_040), (1200, 24_000)]);
    }

    #[test]
    fn a_path_that_is_as_narrow_as_any_is_not_taken_for_narrower() {
        let search = probed(&mut connection(), |connection| connection.mtu.due());
        assert_eq!(search, [Some(after(100)); 3], "the search has not begun anew");
    }
}
