//! Timers in virtual time.

use std::sync::Arc;
use std::task::{Context, Poll};

use trimaran_transport::{Instant, Timer};

use crate::world::{TimerState, World};

pub(super) struct SimTimer {
    world: Arc<World>,
    key: usize,
    /// It rings at multiples of so many nanoseconds.
    grain: u64,
}

impl SimTimer {
    pub(super) fn new(world: &Arc<World>, grain: u64) -> Self {
        let key = world.core().timers.insert(TimerState::default());
        Self { world: Arc::clone(world), key, grain }
    }
}

impl Timer for SimTimer {
    fn reset(&mut self, at: Instant) {
        let at = Instant::from_nanos(at.as_nanos().checked_next_multiple_of(self.grain).unwrap_or(u64::MAX));
        self.world.core().set_timer(self.key, at);
    }

    fn poll(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let mut core = self.world.core();
        let now = core.now;
        let Some(timer) = core.timers.get_mut(self.key) else { return Poll::Pending };
        if timer.due.is_some_and(|due| due <= now) {
            return Poll::Ready(());
        }
        if !timer.waker.as_ref().is_some_and(|waker| waker.will_wake(cx.waker())) {
            timer.waker = Some(cx.waker().clone());
        }
        Poll::Pending
    }
}

impl Drop for SimTimer {
    fn drop(&mut self) {
        let gone = self.world.core().timers.try_remove(self.key);
        drop(gone);
    }
}
