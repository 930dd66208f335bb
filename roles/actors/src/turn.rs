//! Roles of one process that compute one after another, so that no busy time contains another role's work.

use std::{
    cell::Cell,
    collections::HashMap,
    fmt,
    future::{Future, pending, poll_fn},
    pin::{Pin, pin},
    sync::Arc,
    task::{Context, Poll, Wake, Waker, ready},
    thread::{self, Thread},
    time::Duration,
};

use parking_lot::Mutex;
use tokio::{sync::oneshot, task::unconstrained};

use crate::{
    clock::Stopwatch,
    shares::{Number, Shares},
};

/// The clock of a process's roles, and whether they compute at once or one after another.
///
/// It does not change the content of frames. Roles in turn report the time of each by itself, which a model
/// of three machines needs; roles at once share the machine's cores. Clones are the same object: their roles'
/// times are comparable.
#[derive(Debug, Clone)]
pub struct Turns {
    clock: Stopwatch,
    lock: Option<Arc<Lock>>,
    /// Whether a device is idle while its role waits.
    idle_devices: bool,
}

impl Turns {
    /// Roles that compute whenever they can. The clock starts now.
    #[must_use]
    pub fn at_once() -> Self {
        Self { clock: Stopwatch::start(), lock: None, idle_devices: false }
    }

    /// Roles that compute one after another, as far as all of them hold a clone of this.
    #[must_use]
    pub fn alone() -> Self {
        Self { idle_devices: true, ..Self::some_at_a_time(false, 1) }
    }

    /// Roles that share a device fairly, as far as all of them hold a clone of this: `most` have it at a
    /// time, at least one, and each gets the same time of it, however long its frames take. With more than
    /// one, some compute on the host while the device works for others.
    #[must_use]
    pub fn fair(most: usize) -> Self {
        Self::some_at_a_time(true, most.max(1))
    }

    fn some_at_a_time(by_time: bool, most: usize) -> Self {
        let turns = Self::at_once();
        let waiting = Mutex::new(Waiting { shares: Shares::new(by_time, most), told: HashMap::new() });
        Self { lock: Some(Arc::new(Lock { clock: turns.clock, waiting })), ..turns }
    }

    /// Whether a role's device is idle while the role waits for something, so that no other role's time
    /// contains its work.
    #[must_use]
    pub const fn idle_devices(&self) -> bool {
        self.idle_devices
    }

    /// The roles' clock.
    #[must_use]
    pub const fn clock(&self) -> Stopwatch {
        self.clock
    }

    /// A role's handle.
    pub(crate) fn of_a_role(&self) -> Turn {
        let role = self.lock.as_ref().map_or(0, |lock| lock.waiting.lock().shares.join());
        Turn { turns: self.clone(), role, held: Cell::new(None), away: Cell::default() }
    }
}

/// A role that shares a device by time lets others have it after this long.
const SLICE: Duration = Duration::from_millis(20);

/// State of a lock that some roles hold at a time.
#[derive(Debug)]
struct Lock {
    clock: Stopwatch,
    waiting: Mutex<Waiting>,
}

#[derive(Debug)]
struct Waiting {
    shares: Shares,
    /// How waiting roles are told of their turn.
    told: HashMap<Number, oneshot::Sender<Held>>,
}

impl Lock {
    /// Waits for the role's turn. Dropping the future gives it up.
    async fn take(self: Arc<Self>, role: Number) -> Held {
        let (tell, told) = oneshot::channel();
        {
            let mut waiting = self.waiting.lock();
            waiting.shares.ask(role);
            waiting.told.insert(role, tell);
        }
        let _gives_up = Request { lock: &self, role };
        self.tell_next();
        match told.await {
            Ok(held) => held,
            // The role has left.
            Err(_) => pending().await,
        }
    }

    fn tell_next(self: &Arc<Self>) {
        let (role, tell) = {
            let mut waiting = self.waiting.lock();
            let Some(role) = waiting.shares.next() else { return };
            (role, waiting.told.remove(&role))
        };
        let held = Held { lock: Arc::clone(self), role, since: self.clock.elapsed() };
        // If the role no longer waits, the turn is dropped here, and passes to the next one.
        let _unheard = tell.map(|tell| tell.send(held));
    }
}

/// A request for the turn, withdrawn on drop if the role still waits.
struct Request<'l> {
    lock: &'l Lock,
    role: Number,
}

impl Drop for Request<'_> {
    fn drop(&mut self) {
        let mut waiting = self.lock.waiting.lock();
        let told = waiting.told.remove(&self.role);
        if told.is_some() {
            waiting.shares.withdraw(self.role);
        }
        // The waiter that this wakes may take the lock.
        drop((waiting, told));
    }
}

/// The turn. Another role gets it on drop.
#[derive(Debug)]
struct Held {
    lock: Arc<Lock>,
    role: Number,
    since: Duration,
}

impl Drop for Held {
    fn drop(&mut self) {
        let took = self.lock.clock.elapsed().saturating_sub(self.since);
        self.lock.waiting.lock().shares.give_back(self.role, took);
        self.lock.tell_next();
    }
}

/// A role's turn to compute. The role takes it before it begins, and returns it when done and while it waits:
/// another role may have to compute first.
pub(crate) struct Turn {
    /// Without a lock, taking and returning do nothing.
    turns: Turns,
    role: Number,
    held: Cell<Option<Held>>,
    away: Cell<Duration>,
}

impl fmt::Debug for Turn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Turn").field("role", &self.role).finish_non_exhaustive()
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.give_back();
        if let Some(lock) = &self.turns.lock {
            let mut waiting = lock.waiting.lock();
            waiting.shares.leave(self.role);
            let told = waiting.told.remove(&self.role);
            // It may hold the turn, which takes the lock on drop.
            drop((waiting, told));
        }
    }
}

type Taking = Pin<Box<dyn Future<Output = Held>>>;

impl Turn {
    /// Waits until it is this role's turn.
    pub(crate) async fn take(&self) {
        let held = self.held.take();
        let taken = match &self.turns.lock {
            Some(lock) if held.is_none() => Some(Arc::clone(lock).take(self.role).await),
            _ => held,
        };
        self.held.set(taken);
    }

    /// Lets another role compute.
    pub(crate) fn give_back(&self) {
        self.held.take();
    }

    /// Whether others get the device in the midst of this role's work.
    pub(crate) fn is_shared(&self) -> bool {
        self.turns.lock.as_ref().is_some_and(|lock| lock.waiting.lock().shares.is_by_time())
    }

    /// If this role has had a time-shared device for long, lets others have it, and waits to get it back. It
    /// blocks its thread, and may be called in the midst of a frame.
    pub(crate) fn rest(&self) {
        let (Some(lock), Some(held)) = (&self.turns.lock, self.held.take()) else { return };
        let since = self.turns.clock.elapsed();
        if since.saturating_sub(held.since) < SLICE || !lock.waiting.lock().shares.is_awaited() {
            self.held.set(Some(held));
            return;
        }
        drop(held);
        // The blocked task may have used up its tokio budget, and cannot yield.
        self.held.set(Some(block_on(unconstrained(Arc::clone(lock).take(self.role)))));
        self.away.set(self.away.get() + self.turns.clock.elapsed().saturating_sub(since));
    }

    /// The result of `work`. While `work` waits for something, other roles have the turn.
    pub(crate) async fn given_back_while_waiting<T>(&self, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        // Since when others have had the turn in the midst of this role's, and the request to get it back.
        let mut gave_back: Option<(Duration, Taking)> = None;
        poll_fn(|context| {
            if let Some((since, again)) = &mut gave_back {
                self.held.set(Some(ready!(again.as_mut().poll(context))));
                self.away.set(self.away.get() + self.turns.clock.elapsed().saturating_sub(*since));
                gave_back = None;
            }
            let polled = work.as_mut().poll(context);
            if polled.is_pending()
                && let (Some(held), Some(lock)) = (self.held.take(), &self.turns.lock)
            {
                // Before another role can begin, so that their times do not overlap.
                let since = self.turns.clock.elapsed();
                drop(held);
                gave_back = Some((since, Box::pin(Arc::clone(lock).take(self.role))));
            }
            polled
        })
        .await
    }

    /// How long others had the turn while this role waited in the midst of its own, since the last call.
    pub(crate) fn away(&self) -> Duration {
        self.away.take()
    }
}

/// Blocks this thread on a future, also within a runtime, where the runtime's own `block_on` is forbidden.
fn block_on<T>(future: impl Future<Output = T>) -> T {
    struct Unpark(Thread);
    impl Wake for Unpark {
        fn wake(self: Arc<Self>) {
            self.0.unpark();
        }
    }
    let mut future = pin!(future);
    let waker = Waker::from(Arc::new(Unpark(thread::current())));
    loop {
        if let Poll::Ready(done) = future.as_mut().poll(&mut Context::from_waker(&waker)) {
            return done;
        }
        thread::park();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use tokio::sync::oneshot;

    use super::*;

    #[test]
    fn at_most_one_role_has_the_turn() {
        let turns = Turns::alone();
        let computing = AtomicU32::new(0);
        let role = async || {
            let turn = turns.of_a_role();
            for _ in 0..2000 {
                turn.take().await;
                turn.take().await;
                assert_eq!(computing.fetch_add(1, Ordering::SeqCst), 0, "another role computes");
                thread::yield_now();
                computing.fetch_sub(1, Ordering::SeqCst);
                turn.give_back();
            }
        };
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| block_on(role()));
            }
        });
    }

    /// Within a runtime, like a session's thread.
    #[test]
    fn a_role_that_has_had_the_device_for_long_rests_while_another_one_waits() {
        let turns = Turns::fair(1);
        let turn = turns.of_a_role();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(async {
            turn.take().await;
            thread::sleep(SLICE);
            turn.rest();
            assert_eq!(turn.away(), Duration::ZERO, "nobody waits");
            let (asks, has_asked) = oneshot::channel();
            let turns = turns.clone();
            let other = thread::spawn(move || {
                let turn = turns.of_a_role();
                let taking = Arc::clone(turn.turns.lock.as_ref().unwrap()).take(turn.role);
                let mut taking = pin!(taking);
                let first =
                    block_on(poll_fn(|context| Poll::Ready(taking.as_mut().poll(context).is_ready())));
                asks.send(first).unwrap();
                let held = block_on(taking);
                thread::sleep(Duration::from_millis(1));
                drop(held);
            });
            assert!(!has_asked.await.unwrap(), "it must wait");
            // The task's tokio budget is used up.
            poll_fn(|context| {
                for _ in 0..1000 {
                    let (send, mut sent) = oneshot::channel();
                    let _ = send.send(());
                    let _ = Pin::new(&mut sent).poll(context);
                }
                Poll::Ready(())
            })
            .await;
            turn.rest();
            assert!(turn.held.take().is_some(), "it has the turn again");
            assert!(turn.away() >= Duration::from_millis(1));
            other.join().unwrap();
        });
    }

    #[test]
    fn roles_at_once_never_wait_for_each_other() {
        let [one, other] = [(), ()].map(|()| Turns::at_once().of_a_role());
        block_on(async {
            one.take().await;
            other.take().await;
            one.given_back_while_waiting(tokio::task::yield_now()).await;
        });
        assert_eq!(one.away(), Duration::ZERO);
    }

    /// Another role computes between two readings of the clock that bracket this one's waiting time.
    #[test]
    fn who_waits_gives_the_turn_back_and_what_others_take_is_not_its_own_time() {
        let turns = Turns::alone();
        let clock = turns.clock();
        let turn = turns.of_a_role();
        thread::scope(|scope| {
            let (done, other_is_done) = oneshot::channel();
            let turns = &turns;
            let role = async {
                turn.take().await;
                assert_eq!(turn.away(), Duration::ZERO, "it did not have to wait");
                let other = scope.spawn(move || {
                    let turn = turns.of_a_role();
                    block_on(turn.take());
                    let began = clock.elapsed();
                    thread::yield_now();
                    let took = clock.elapsed().saturating_sub(began);
                    turn.give_back();
                    done.send(()).unwrap();
                    took
                });
                other_is_done.await.unwrap();
                let took = other.join().unwrap();
                assert!(turn.away() >= took);
                assert!(turn.held.take().is_some(), "it has the turn again");
            };
            block_on(turn.given_back_while_waiting(role));
        });
    }

    /// Between the two another role has the turn all the time.
    #[test]
    fn a_request_that_is_given_up_is_withdrawn() {
        let turns = Turns::fair(1);
        let [holds, waits] = [(), ()].map(|()| turns.of_a_role());
        let lock = turns.lock.as_ref().unwrap();
        block_on(async {
            holds.take().await;
            let mut context = Context::from_waker(Waker::noop());
            let mut taking = Box::pin(waits.take());
            assert!(taking.as_mut().poll(&mut context).is_pending());
            assert!(lock.waiting.lock().shares.is_awaited());
            drop(taking);
            assert!(!lock.waiting.lock().shares.is_awaited());
            assert!(lock.waiting.lock().told.is_empty());
            holds.give_back();
            waits.take().await;
            assert!(waits.held.take().is_some(), "it may ask again");
        });
    }

    #[test]
    fn who_waits_without_the_turn_does_not_take_it() {
        let turn = Turns::alone().of_a_role();
        block_on(turn.given_back_while_waiting(tokio::task::yield_now()));
        assert!(turn.held.take().is_none());
    }
}
