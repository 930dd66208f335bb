//! The timers of a connection.

use std::io;
use std::time::Duration;

use trimaran_net::Instant;

use super::{Config, FIRST_WAIT, Socket, State};

/// Linux's `tcp_syn_retries`.
const FIRST_TRIES: u32 = 6;
/// Linux's `tcp_keepalive_probes`.
const PROBES: u32 = 9;

/// Linux's `tcp_fin_timeout`.
const FIN_TIMEOUT: Duration = Duration::from_secs(60);

impl Socket {
    /// When [`Socket::expire`] is to be called.
    pub(crate) fn next_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Closed => None,
            State::Opening { due, .. } => Some(due),
            State::Open => {
                let Config { options, .. } = self.config;
                let stale =
                    options.user_timeout.and_then(|limit| Some(self.sender.waiting_since()?.after(limit)));
                let halves = [self.sender.next_timeout(), self.receiver.acks.due()];
                let own = [self.next_probe(), self.deserted(), stale];
                halves.into_iter().chain(own).flatten().min()
            }
        }
    }

    /// Handles the timers that are due.
    pub(crate) fn expire(&mut self, now: Instant) {
        match &mut self.state {
            State::Closed => {}
            State::Opening { due, tries, send, .. } => {
                if now < *due {
                    return;
                }
                if *tries > FIRST_TRIES {
                    self.fail(io::ErrorKind::TimedOut);
                    return;
                }
                *send = true;
                *due = now.after(FIRST_WAIT * 2_u32.saturating_pow(*tries));
            }
            State::Open => self.expire_open(now),
        }
    }

    fn expire_open(&mut self, now: Instant) {
        let Config { options, .. } = self.config;
        let waiting = self.sender.waiting_since();
        if options.user_timeout.zip(waiting).is_some_and(|(limit, since)| since.after(limit) <= now) {
            self.fail(io::ErrorKind::TimedOut);
            return;
        }
        self.sender.expire(now);
        if self.receiver.acks.due().is_some_and(|due| due <= now) {
            self.receiver.acks.expired();
            self.receiver.ack_now = true;
        }
        if self.deserted().is_some_and(|at| at <= now) {
            self.state = State::Closed;
        } else if self.next_probe().is_some_and(|at| at <= now) {
            if self.probes >= PROBES {
                self.fail(io::ErrorKind::TimedOut);
                return;
            }
            self.probes += 1;
            self.probe = true;
        }
    }

    /// When an idle peer is probed.
    fn next_probe(&self) -> Option<Instant> {
        let options = &self.config.options;
        let after = options.keepalive?;
        let idle = !self.orphan && self.sender.waiting_since().is_none();
        idle.then(|| self.last_heard.after(after + options.keepalive_interval * self.probes))
    }

    /// When a connection ends that the program has left and the peer keeps open (Linux's `tcp_fin_timeout`).
    fn deserted(&self) -> Option<Instant> {
        (self.orphan && self.sender.has_ended()).then(|| self.last_heard.after(FIN_TIMEOUT))
    }
}
