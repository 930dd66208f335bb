//! Keep-alives on lanes that have nothing to say.

use std::sync::{Arc, Weak};
use std::time::Duration;

use trimaran_net::{Net, sleep_until};

/// A lane that can show a keep-alive.
pub(super) trait Pulse: Send + Sync {
    /// Shows one, unless something was said since the last call or waits to be written. False once the lane
    /// is over.
    fn beat(&self) -> bool;
}

/// Has each of `lanes` show a keep-alive every `interval` in which it says nothing, until all are over.
pub(super) fn keep_alive(net: &Arc<dyn Net>, interval: Duration, lanes: [Weak<dyn Pulse>; 4]) {
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
