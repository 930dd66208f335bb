//! What a new path leaves of what was known of the old one.

use crate::congestion::Window;
use crate::recovery::share::LossShare;
use crate::recovery::{Contents, Recovery};
use crate::rtt::Rtt;

impl Recovery {
    /// The peer is elsewhere, and what was in flight went where it was: gives what that carried. It says
    /// nothing of congestion.
    pub(crate) fn on_moved(&mut self) -> Contents {
        let lost = self.flight.forget_all().flat_map(|sent| sent.contents).collect();
        self.progress = None;
        self.probes = 0;
        self.unanswered = false;
        lost
    }

    /// Begins anew on a path of which nothing is known (RFC 9000, section 9.4).
    pub(crate) fn on_new_path(&mut self, segment: usize, initial: u16) {
        self.rtt = Rtt::default();
        self.sampled = None;
        self.window = Window::new(segment, initial);
        self.loss = LossShare::new();
    }
}
