//! Timers in virtual time.

use std::sync::Arc;
use std::task::{Context, Poll};

use trimaran_net::{Instant, Timer};

use super::SimNet;
use crate::world::World;

pub(super) struct SimTimer {
    world: Arc<World>,
    key: usize,
}

impl SimTimer {
    pub(super) fn new(net: &SimNet) -> Self {
        let key = net.world.core().timers.add(net.host, net.timer_grain);
        Self { world: Arc::clone(&net.world), key }
    }
}

impl Timer for SimTimer {
    fn reset(&mut self, at: Instant) {
        self.world.core().set_timer(self.key, at);
    }

    fn poll(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let mut core = self.world.core();
        let now = core.now;
        core.timers.poll(now, self.key, cx)
    }
}

impl Drop for SimTimer {
    fn drop(&mut self) {
        let gone = self.world.core().timers.remove(self.key);
        drop(gone);
    }
}
