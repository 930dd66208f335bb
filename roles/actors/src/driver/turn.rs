//! Roles of one process that compute one after another, so that no busy time contains another role's work.

use std::{cell::Cell, sync::Arc, time::Duration};

use tokio::sync::{Mutex, OwnedMutexGuard};

use crate::Stopwatch;

/// Whether the roles of a process compute at once, or one after another.
///
/// What a frame shows does not depend on it. Roles that take turns say what each of them takes by itself,
/// which is what a model of three machines needs; roles that compute at once share the machine's cores.
#[derive(Debug, Clone, Default)]
pub struct Turns(Option<Arc<Mutex<()>>>);

impl Turns {
    /// Roles that compute whenever they can: the default.
    #[must_use]
    pub const fn at_once() -> Self {
        Self(None)
    }

    /// Roles that compute one after another, as far as all of them hold a clone of this.
    #[must_use]
    pub fn alone() -> Self {
        Self(Some(Arc::default()))
    }

    /// A role's part in it, by the clock that the role measures its work with.
    pub(super) fn of_a_role(&self, clock: Stopwatch) -> Turn {
        Turn { lock: self.0.clone(), held: Cell::new(None), away: Cell::default(), clock }
    }
}

/// A role's turn to compute. It takes it before it begins, gives it back when it is done, and in between
/// while it waits: whom it waits for may have to compute first.
pub(super) struct Turn {
    /// None where roles compute at once: then taking and giving back do nothing.
    lock: Option<Arc<Mutex<()>>>,
    held: Cell<Option<OwnedMutexGuard<()>>>,
    away: Cell<Duration>,
    clock: Stopwatch,
}

impl Turn {
    /// Whether roles compute one after another.
    pub(super) const fn is_exclusive(&self) -> bool {
        self.lock.is_some()
    }

    /// Waits until no other role computes. Whoever waits longest is next.
    pub(super) fn take(&self) {
        let held = self.held.take();
        let taken = || self.lock.clone().map(Mutex::blocking_lock_owned);
        self.held.set(held.or_else(taken));
    }

    /// Lets another role compute.
    pub(super) fn give_back(&self) {
        self.held.take();
    }

    /// Calls `wait` with what is to be called when it cannot go on by itself: the turn is given back then,
    /// and taken again afterwards.
    pub(super) fn while_waiting<T>(&self, wait: impl FnOnce(&dyn Fn()) -> T) -> T {
        let gave_back = Cell::new(None);
        let value = wait(&|| {
            if let Some(held) = self.held.take() {
                // Before another role can begin: its time and this one's are not to overlap.
                gave_back.set(Some(self.clock.elapsed()));
                drop(held);
            }
        });
        if let Some(since) = gave_back.get() {
            self.take();
            self.away.set(self.away.get() + self.clock.elapsed().saturating_sub(since));
        }
        value
    }

    /// How long others had the turn while this role waited in the midst of its own, since this was last
    /// asked.
    pub(super) fn away(&self) -> Duration {
        self.away.take()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::sync::mpsc;
    use std::thread;

    use super::*;

    #[test]
    fn at_most_one_role_has_the_turn() {
        let turns = Turns::alone();
        let computing = AtomicU32::new(0);
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    let turn = turns.of_a_role(Stopwatch::start());
                    for _ in 0..2000 {
                        turn.take();
                        turn.take();
                        assert_eq!(computing.fetch_add(1, Ordering::SeqCst), 0, "another role computes");
                        thread::yield_now();
                        computing.fetch_sub(1, Ordering::SeqCst);
                        turn.give_back();
                    }
                });
            }
        });
    }

    #[test]
    fn roles_at_once_never_wait_for_each_other() {
        let turns = Turns::at_once();
        let [one, other] = [(), ()].map(|()| turns.of_a_role(Stopwatch::start()));
        one.take();
        other.take();
        assert!(!one.is_exclusive());
        assert_eq!(one.while_waiting(|stuck| stuck()), ());
        assert_eq!(one.away(), Duration::ZERO);
    }

    /// Another role computes between two moments of the clock that this one's waiting time has to contain.
    #[test]
    fn who_waits_gives_the_turn_back_and_what_others_take_is_not_its_own_time() {
        let turns = Turns::alone();
        let clock = Stopwatch::start();
        let turn = turns.of_a_role(clock);
        turn.take();
        assert_eq!(turn.while_waiting(|_| 7), 7);
        assert_eq!(turn.away(), Duration::ZERO, "it did not have to wait");
        thread::scope(|scope| {
            let (done, other_is_done) = mpsc::channel();
            let turns = &turns;
            let other = scope.spawn(move || {
                let turn = turns.of_a_role(clock);
                turn.take();
                let began = clock.elapsed();
                thread::yield_now();
                let took = clock.elapsed().saturating_sub(began);
                turn.give_back();
                done.send(()).unwrap();
                took
            });
            turn.while_waiting(|stuck| {
                stuck();
                other_is_done.recv().unwrap();
            });
            let took = other.join().unwrap();
            assert!(turn.away() >= took);
        });
        assert!(turn.held.take().is_some(), "it has the turn again");
    }

    #[test]
    fn who_waits_without_the_turn_does_not_take_it() {
        let turns = Turns::alone();
        let turn = turns.of_a_role(Stopwatch::start());
        turn.while_waiting(|stuck| stuck());
        assert!(turn.held.take().is_none());
    }
}
