//! The state that a new path keeps from the old one.

use trimaran_net::CongestionSigns;

use crate::congestion::Window;
use crate::recovery::share::LossShare;
use crate::recovery::{Contents, Recovery};
use crate::rtt::Rtt;

impl Recovery {
    /// The peer has moved, and packets in flight went to its old address: returns their contents. This is no
    /// sign of congestion.
    pub(crate) fn on_moved(&mut self) -> Contents {
        let lost = self.flight.forget_all().flat_map(|sent| sent.contents).collect();
        self.progress = None;
        self.probes = 0;
        self.unanswered = false;
        lost
    }

    /// Starts over on an unknown path (RFC 9000, section 9.4).
    pub(crate) fn on_new_path(&mut self, segment: usize, initial: u16) {
        self.rtt = Rtt::default();
        self.sampled = None;
        self.window = Window::new(segment, initial);
        self.loss = LossShare::new();
        self.signs = CongestionSigns::new();
    }
}
