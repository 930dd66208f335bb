//! A congestion controller for quinn that leaves the window alone where losses are random.
//!
//! As in `trimaran-udp`, a loss counts as congestion where packets queue, which shows in the round trip, or
//! where more than a tenth is lost. It is simpler than the product's: what is measured here has no queues but
//! those of its own frames.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::congestion::{Controller, ControllerFactory};
use quinn_proto::RttEstimator;

use super::FIRST_WINDOW;

/// The largest window.
const LARGEST: u64 = 4 << 20;
/// The largest window that is not used.
const UNUSED: u64 = 128 * 1452;
/// Packets queue where a round trip takes so much longer than the shortest one.
const QUEUE: Duration = Duration::from_millis(10);
/// How many bytes tell the share of lost ones.
const SAMPLE: f64 = 512.0 * 1024.0;

#[derive(Debug)]
pub(super) struct SteadyConfig;

impl ControllerFactory for SteadyConfig {
    fn build(self: Arc<Self>, _now: Instant, mtu: u16) -> Box<dyn Controller> {
        let mtu = mtu.into();
        Box::new(Steady { window: FIRST_WINDOW, mtu, queues: false, acked: 0.0, lost: 0.0, cut: None })
    }
}

/// The state of a path.
#[derive(Debug, Clone)]
struct Steady {
    window: u64,
    mtu: u64,
    /// Whether packets queued lately.
    queues: bool,
    /// Acknowledged and lost bytes, of which older ones count less.
    acked: f64,
    lost: f64,
    /// When the window was last cut: once a round trip is enough.
    cut: Option<Instant>,
}

impl Controller for Steady {
    fn on_ack(&mut self, _now: Instant, _sent: Instant, bytes: u64, app_limited: bool, rtt: &RttEstimator) {
        self.queues = rtt.get() > rtt.min() * 2 + QUEUE;
        self.acked += bytes as f64;
        if self.acked + self.lost > SAMPLE {
            self.acked /= 2.0;
            self.lost /= 2.0;
        }
        // quinn paces by the window: at an unused one of a few frames it leaves their bursts alone.
        let most = if app_limited { UNUSED } else { LARGEST };
        if !self.queues && self.window < most {
            self.window += bytes;
        }
    }

    fn on_congestion_event(&mut self, now: Instant, sent: Instant, persistent: bool, lost: u64) {
        self.lost += lost as f64;
        let too_much = self.lost * 9.0 > self.acked && self.acked + self.lost > SAMPLE / 4.0;
        let is_new = self.cut.is_none_or(|cut| sent > cut);
        if is_new && (persistent || self.queues || too_much) {
            self.cut = Some(now);
            self.window = (self.window * 7 / 10).max(FIRST_WINDOW / 2);
        }
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.mtu = new_mtu.into();
        self.window = self.window.max(2 * self.mtu);
    }

    fn window(&self) -> u64 {
        self.window
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        FIRST_WINDOW
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}
