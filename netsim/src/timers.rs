//! The timers of hosts, and when their runtimes wake to notice that they are due.

use std::collections::BTreeMap;
use std::task::{Context, Poll, Waker};

use slab::Slab;
use trimaran_net::Instant;

use crate::host::HostId;

/// All timers of all hosts.
#[derive(Debug, Default)]
pub(crate) struct Timers {
    all: Slab<TimerState>,
    runtimes: BTreeMap<HostId, Runtime>,
}

/// A timer. Only the earliest of its events counts; it adds another one if the timer was set to a later time
/// meanwhile.
#[derive(Debug)]
struct TimerState {
    host: HostId,
    /// Nanoseconds between two ticks of the runtime that it belongs to.
    grain: u64,
    due: Option<Instant>,
    waker: Option<Waker>,
    queued: Option<Instant>,
}

/// The runtime of a host's tasks. With a timer grain it counts time in ticks, and sleeps for whole ticks
/// from when it fell asleep. So it wakes as long after a tick as it fell asleep after one.
#[derive(Debug)]
struct Runtime {
    awake: Instant,
    /// Timers whose tick has come while it sleeps.
    ripe: Vec<usize>,
}

/// The result of a timer's event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rung {
    /// Nothing more.
    Done,
    /// The timer has another event then.
    Again(Instant),
    /// The host's runtime wakes then, if nothing wakes it before.
    Asleep(HostId, Instant),
}

impl Timers {
    /// Adds a timer that is not set.
    pub(crate) fn add(&mut self, host: HostId, grain: u64) -> usize {
        self.all.insert(TimerState { host, grain: grain.max(1), due: None, waker: None, queued: None })
    }

    /// Removes a timer; the caller drops its waker without the lock.
    pub(crate) fn remove(&mut self, key: usize) -> Option<Waker> {
        self.all.try_remove(key).and_then(|timer| timer.waker)
    }

    /// Sets a timer. Returns the time of a new event, unless there is an earlier one.
    pub(crate) fn set(&mut self, key: usize, at: Instant) -> Option<Instant> {
        let timer = self.all.get_mut(key)?;
        let tick =
            Instant::from_nanos(at.as_nanos().checked_next_multiple_of(timer.grain).unwrap_or(u64::MAX));
        timer.due = Some(tick);
        timer.queued.is_none_or(|queued| queued > tick).then(|| {
            timer.queued = Some(tick);
            tick
        })
    }

    /// Whether a timer is due. The caller's runtime is awake.
    pub(crate) fn poll(&mut self, now: Instant, key: usize, cx: &Context<'_>) -> Poll<()> {
        let Some(timer) = self.all.get_mut(key) else { return Poll::Pending };
        if timer.due.is_some_and(|due| due <= now) {
            return Poll::Ready(());
        }
        if !timer.waker.as_ref().is_some_and(|waker| waker.will_wake(cx.waker())) {
            timer.waker = Some(cx.waker().clone());
        }
        Poll::Pending
    }

    /// A timer's event has come.
    pub(crate) fn ring(&mut self, now: Instant, key: usize) -> Rung {
        let Some(timer) = self.all.get_mut(key) else { return Rung::Done };
        if timer.queued.is_none_or(|queued| queued > now) {
            return Rung::Done; // an earlier setting's, or that of a timer that had this key before
        }
        timer.queued = None;
        match timer.due {
            Some(due) if due > now => {
                timer.queued = Some(due);
                Rung::Again(due)
            }
            Some(_) => {
                let (host, grain) = (timer.host, timer.grain);
                let runtime = self.runtime(host, now);
                runtime.ripe.push(key);
                let late = runtime.awake.as_nanos() % grain;
                if late > 0 {
                    return Rung::Asleep(host, Instant::from_nanos(now.as_nanos().saturating_add(late)));
                }
                self.rouse(now, host);
                Rung::Done
            }
            None => Rung::Done,
        }
    }

    /// Something wakes a host's runtime, which looks at its timers too.
    pub(crate) fn rouse(&mut self, now: Instant, host: HostId) {
        let runtime = self.runtime(host, now);
        runtime.awake = now;
        for key in std::mem::take(&mut runtime.ripe) {
            // The timer may have been set again, or its key reused.
            let timer = self.all.get_mut(key).filter(|timer| timer.due.is_some_and(|due| due <= now));
            if let Some(waker) = timer.and_then(|timer| timer.waker.take()) {
                waker.wake();
            }
        }
    }

    /// Whether timers wait for the host's runtime to wake.
    pub(crate) fn sleeps_late(&self, host: HostId) -> bool {
        self.runtimes.get(&host).is_some_and(|runtime| !runtime.ripe.is_empty())
    }

    fn runtime(&mut self, host: HostId, now: Instant) -> &mut Runtime {
        self.runtimes.entry(host).or_insert_with(|| Runtime { awake: now, ripe: Vec::new() })
    }
}
