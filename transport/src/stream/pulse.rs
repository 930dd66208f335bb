//! Keep-alives on idle lanes.

use std::sync::{Arc, Weak};
use std::time::Duration;

use trimaran_net::{Net, sleep_until};

/// A lane that can send a keep-alive.
pub(super) trait Pulse: Send + Sync {
    /// Sends one, unless something was sent since the last call or waits to be written. False once the lane
    /// has ended.
    fn beat(&self) -> bool;
}

/// Lets each of `lanes` send a keep-alive every `interval` in which it is idle, until all have ended.
pub(super) fn keep_alive(net: &Arc<dyn Net>, interval: Duration, lanes: Vec<Weak<dyn Pulse>>) {
    let clock = Arc::clone(net);
    net.spawn(Box::pin(async move {
        loop {
            sleep_until(&*clock, clock.now().after(interval)).await;
            let live = lanes.iter().filter(|lane| lane.upgrade().is_some_and(|lane| lane.beat())).count();
            if live == 0 {
                return;
            }
        }
    }));
}
