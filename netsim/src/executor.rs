//! Tasks on one thread, in an order that depends only on the program.

use parking_lot::{Condvar, Mutex};
use std::collections::VecDeque;
use std::fmt;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

use slab::Slab;
use trimaran_net::BoxFuture;

use crate::host::HostId;

/// The key of the future given to [`Executor::run_until_stalled`]; no task has it.
const MAIN: usize = usize::MAX;

/// Runs tasks in the order in which they were woken. In virtual time that order is deterministic: there are
/// no threads and no clock.
#[derive(Default)]
pub(crate) struct Executor {
    tasks: Mutex<Slab<Task>>,
    ready: Arc<Ready>,
}

impl fmt::Debug for Executor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Executor").field("tasks", &self.tasks.lock().len()).finish_non_exhaustive()
    }
}

struct Task {
    host: HostId,
    /// `None` while it runs.
    future: Option<BoxFuture<'static, ()>>,
    rouser: Arc<Rouser>,
}

#[derive(Debug, Default)]
struct Ready {
    queue: Mutex<VecDeque<Arc<Rouser>>>,
    /// Notified of each queued task.
    added: Condvar,
}

/// Queues one task, at most once until it has run.
#[derive(Debug)]
struct Rouser {
    key: usize,
    /// Other threads wake tasks where a simulation runs in step with a clock. If a waker finds this set, the
    /// task has yet to run, and will see the waker's changes.
    queued: AtomicBool,
    ready: Arc<Ready>,
}

impl Rouser {
    fn new(key: usize, ready: &Arc<Ready>) -> Arc<Self> {
        Arc::new(Self { key, queued: AtomicBool::new(false), ready: Arc::clone(ready) })
    }
}

impl Wake for Rouser {
    fn wake(self: Arc<Self>) {
        if !self.queued.swap(true, Ordering::AcqRel) {
            self.ready.queue.lock().push_back(Arc::clone(&self));
            self.ready.added.notify_one();
        }
    }

    fn wake_by_ref(self: &Arc<Self>) {
        Arc::clone(self).wake();
    }
}

impl Executor {
    /// Adds a task of a host; it runs for the first time when its turn comes.
    pub(crate) fn spawn(&self, host: HostId, future: BoxFuture<'static, ()>) {
        let mut tasks = self.tasks.lock();
        let entry = tasks.vacant_entry();
        let rouser = Rouser::new(entry.key(), &self.ready);
        Arc::clone(&rouser).wake();
        entry.insert(Task { host, future: Some(future), rouser });
    }

    /// A waker of the main future.
    pub(crate) fn main(&self) -> Waker {
        Rouser::new(MAIN, &self.ready).into()
    }

    /// Whether something has been woken.
    pub(crate) fn is_ready(&self) -> bool {
        !self.ready.queue.lock().is_empty()
    }

    /// Waits until something has been woken by another thread, for so long at most.
    pub(crate) fn wait(&self, longest: Duration) {
        let mut queue = self.ready.queue.lock();
        if queue.is_empty() {
            self.ready.added.wait_for(&mut queue, longest);
        }
    }

    /// Runs ready tasks and `main` until `main` is done or nothing is ready.
    pub(crate) fn run_until_stalled<F: Future>(
        &self,
        main: &mut Pin<&mut F>,
        waker: &Waker,
    ) -> Poll<F::Output> {
        loop {
            let Some(next) = self.ready.queue.lock().pop_front() else { return Poll::Pending };
            next.queued.swap(false, Ordering::AcqRel);
            if next.key == MAIN {
                if let Poll::Ready(output) = main.as_mut().poll(&mut Context::from_waker(waker)) {
                    return Poll::Ready(output);
                }
            } else {
                self.run(&next);
            }
        }
    }

    fn run(&self, rouser: &Arc<Rouser>) {
        // The key of an ended task may have been reused.
        let future = match self.tasks.lock().get_mut(rouser.key) {
            Some(task) if Arc::ptr_eq(&task.rouser, rouser) => task.future.take(),
            _ => None,
        };
        let Some(mut future) = future else { return };
        let done =
            future.as_mut().poll(&mut Context::from_waker(&Waker::from(Arc::clone(rouser)))).is_ready();
        let mut tasks = self.tasks.lock();
        // It may have ended its own host, and then it is not among the tasks any more.
        match tasks.get_mut(rouser.key).filter(|task| Arc::ptr_eq(&task.rouser, rouser)) {
            Some(task) if !done => {
                task.future = Some(future);
                return;
            }
            Some(_) => _ = tasks.remove(rouser.key),
            None => {}
        }
        drop(tasks);
        drop(future); // without the lock: what it held may wake or end others
    }

    /// Ends all tasks of a host. One that is running ends when it next waits.
    pub(crate) fn end(&self, host: HostId) {
        let mut tasks = self.tasks.lock();
        let keys: Vec<_> = tasks.iter().filter(|(_, task)| task.host == host).map(|(key, _)| key).collect();
        let ended: Vec<_> = keys.into_iter().filter_map(|key| tasks.try_remove(key)).collect();
        drop(tasks);
        drop(ended); // without the lock, as above
    }

    /// Drops all tasks, which breaks a reference cycle.
    pub(crate) fn clear(&self) {
        loop {
            let tasks = std::mem::take(&mut *self.tasks.lock());
            self.ready.queue.lock().clear();
            if tasks.is_empty() {
                return;
            }
            drop(tasks);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::pin::pin;

    use super::*;

    /// Runs `main` until it is done or nothing is ready.
    fn run<F: Future>(executor: &Executor, main: F) -> Poll<F::Output> {
        let waker = executor.main();
        waker.wake_by_ref();
        executor.run_until_stalled(&mut pin!(main), &waker)
    }

    async fn yield_once() {
        let mut yielded = false;
        std::future::poll_fn(|cx| {
            if yielded {
                return Poll::Ready(());
            }
            yielded = true;
            cx.waker().wake_by_ref();
            Poll::Pending
        })
        .await;
    }

    #[test]
    fn tasks_take_turns_in_the_order_of_their_wake_ups() {
        let executor = Executor::default();
        let log = Arc::new(Mutex::new(Vec::new()));
        for name in ["a", "b", "c"] {
            let log = Arc::clone(&log);
            executor.spawn(
                HostId(0),
                Box::pin(async move {
                    for round in 0..2 {
                        log.lock().push((name, round));
                        yield_once().await;
                    }
                }),
            );
        }
        assert_eq!(run(&executor, std::future::pending::<()>()), Poll::Pending);
        assert_eq!(*log.lock(), [("a", 0), ("b", 0), ("c", 0), ("a", 1), ("b", 1), ("c", 1)]);
    }

    #[test]
    fn a_waker_that_outlives_its_task_wakes_nobody_else() {
        let executor = Executor::default();
        let stale = Arc::new(Mutex::new(None));
        let keep = Arc::clone(&stale);
        executor.spawn(
            HostId(0),
            Box::pin(async move {
                std::future::poll_fn(|cx| {
                    *keep.lock() = Some(cx.waker().clone());
                    Poll::Ready(())
                })
                .await;
            }),
        );
        assert!(run(&executor, std::future::pending::<()>()).is_pending());
        let polls = Arc::new(Mutex::new(0));
        let count = Arc::clone(&polls);
        executor.spawn(
            HostId(0),
            Box::pin(std::future::poll_fn(move |_| {
                *count.lock() += 1;
                Poll::Pending
            })),
        );
        assert!(run(&executor, std::future::pending::<()>()).is_pending());
        stale.lock().take().unwrap().wake();
        assert!(run(&executor, std::future::pending::<()>()).is_pending());
        assert_eq!(*polls.lock(), 1);
    }

    #[test]
    fn the_tasks_of_a_host_end_with_it_and_the_one_that_ends_it_at_its_next_wait() {
        let executor = Arc::new(Executor::default());
        let log = Arc::new(Mutex::new(Vec::new()));
        let rounds = async |log: &Mutex<Vec<_>>, name| {
            for round in 0..2 {
                log.lock().push((name, round));
                yield_once().await;
            }
        };
        for (host, name) in [(1, "a"), (2, "b"), (1, "c")] {
            let (log, ending) = (Arc::clone(&log), Arc::clone(&executor));
            let task = async move {
                if name == "c" {
                    ending.end(HostId(1));
                    let log = Arc::clone(&log);
                    // It gets the key of the one that runs.
                    ending.spawn(HostId(2), Box::pin(async move { rounds(&log, "d").await }));
                }
                rounds(&log, name).await;
            };
            executor.spawn(HostId(host), Box::pin(task));
        }
        assert_eq!(run(&executor, std::future::pending::<()>()), Poll::Pending);
        assert_eq!(*log.lock(), [("a", 0), ("b", 0), ("c", 0), ("b", 1), ("d", 0), ("d", 1)]);
        assert_eq!(executor.tasks.lock().len(), 0);
    }

    #[test]
    fn being_woken_twice_runs_a_task_once() {
        let executor = Executor::default();
        let mut polls = 0;
        let main = std::future::poll_fn(|cx| {
            polls += 1;
            if polls == 1 {
                cx.waker().wake_by_ref();
                cx.waker().wake_by_ref();
            }
            Poll::<()>::Pending
        });
        assert_eq!(run(&executor, main), Poll::Pending);
        assert_eq!(polls, 2);
    }
}
