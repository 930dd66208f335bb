//! CUBIC that leaves the window alone where losses are random, as `udp` does.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::congestion::{Controller, ControllerFactory, Cubic, CubicConfig};
use quinn_proto::RttEstimator;
use trimaran_net::CongestionSigns;

/// An unused window grows up to so many packets. quinn paces by the window: over one of a few frames they
/// leave at once.
const UNUSED: u64 = 128;

/// Makes [`LossTolerant`] controllers.
#[derive(Debug)]
pub(super) struct LossTolerantConfig(pub(super) Arc<CubicConfig>);

impl ControllerFactory for LossTolerantConfig {
    fn build(self: Arc<Self>, now: Instant, mtu: u16) -> Box<dyn Controller> {
        let cubic = Cubic::new(Arc::clone(&self.0), now, mtu);
        Box::new(LossTolerant { cubic, signs: CongestionSigns::new(), mtu: mtu.into(), round_trip: None })
    }
}

/// quinn's CUBIC, which hears only of losses that are signs of congestion.
#[derive(Debug, Clone)]
pub(super) struct LossTolerant {
    cubic: Cubic,
    signs: CongestionSigns,
    mtu: u64,
    /// The shortest round trip in the present acknowledgement, which is that of its newest packet.
    round_trip: Option<Duration>,
}

impl Controller for LossTolerant {
    fn on_ack(&mut self, now: Instant, sent: Instant, bytes: u64, app_limited: bool, rtt: &RttEstimator) {
        self.signs.on_arrived();
        if app_limited {
            self.signs.on_out_of_data();
        }
        let took = now.saturating_duration_since(sent);
        self.round_trip = Some(self.round_trip.map_or(took, |other| other.min(took)));
        let is_enough = app_limited && self.cubic.window() >= UNUSED * self.mtu;
        self.cubic.on_ack(now, sent, bytes, is_enough, rtt);
    }

    fn on_end_acks(&mut self, now: Instant, in_flight: u64, app_limited: bool, largest: Option<u64>) {
        if let Some(took) = self.round_trip.take() {
            self.signs.on_round_trip(took);
        }
        self.cubic.on_end_acks(now, in_flight, app_limited, largest);
    }

    fn on_congestion_event(&mut self, now: Instant, sent: Instant, is_persistent: bool, lost_bytes: u64) {
        (0..lost_bytes.div_ceil(self.mtu)).for_each(|_| self.signs.on_lost());
        // Without lost bytes a router has marked packets (ECN).
        if is_persistent || lost_bytes == 0 || self.signs.are_there() {
            self.cubic.on_congestion_event(now, sent, is_persistent, lost_bytes);
        }
        if is_persistent {
            self.signs.forget_round_trips();
        }
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.mtu = new_mtu.into();
        self.cubic.on_mtu_update(new_mtu);
    }

    fn window(&self) -> u64 {
        self.cubic.window()
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        self.cubic.initial_window()
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}
