//! The frames lane's queue. Messages move in bundles, so a waiting task is woken once per bundle: waking is
//! the main cost.

use parking_lot::Mutex;
use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::Notify;

/// Makes a queue that holds at most `capacity` items, at least one; the receiver may hold as many again.
pub(super) fn queue<T>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    let shared = Arc::new(Shared {
        state: Mutex::new(State { waiting: VecDeque::new(), ended: false }),
        arrived: Notify::new(),
        taken: Notify::new(),
        capacity: capacity.max(1),
    });
    (Sender(Arc::clone(&shared)), Receiver { shared, bundle: VecDeque::new() })
}

#[derive(Debug)]
struct Shared<T> {
    state: Mutex<State<T>>,
    /// Wakes the receiver for items, and for the sender's end.
    arrived: Notify,
    /// Wakes the sender for room, and for the receiver's end.
    taken: Notify,
    capacity: usize,
}

#[derive(Debug)]
struct State<T> {
    waiting: VecDeque<T>,
    /// One of the ends is gone.
    ended: bool,
}

#[derive(Debug)]
pub(super) struct Sender<T>(Arc<Shared<T>>);

/// The receiver is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Gone;

impl<T> Sender<T> {
    /// Sends as many `items` as there is room for, and waits if there is none. Dropping the future leaves
    /// unsent items in `items`.
    pub(super) async fn send(&self, items: &mut VecDeque<T>) -> Result<(), Gone> {
        while !items.is_empty() && !self.send_some(items)? {
            self.0.taken.notified().await;
        }
        Ok(())
    }

    /// Whether there was any room.
    fn send_some(&self, items: &mut VecDeque<T>) -> Result<bool, Gone> {
        let Shared { state, arrived, capacity, .. } = &*self.0;
        let mut state = state.lock();
        if state.ended {
            return Err(Gone);
        }
        let room = capacity.saturating_sub(state.waiting.len()).min(items.len());
        state.waiting.extend(items.drain(..room));
        drop(state);
        if room > 0 {
            arrived.notify_one();
        }
        Ok(room > 0)
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        self.0.state.lock().ended = true;
        self.0.arrived.notify_one();
    }
}

#[derive(Debug)]
pub(super) struct Receiver<T> {
    shared: Arc<Shared<T>>,
    /// Taken from the queue at once, returned one by one.
    bundle: VecDeque<T>,
}

impl<T> Receiver<T> {
    /// The next item; `None` after the last one, if the sender is gone. Dropping the future loses nothing.
    pub(super) async fn recv(&mut self) -> Option<T> {
        loop {
            if let Some(item) = self.bundle.pop_front() {
                return Some(item);
            }
            if self.take() {
                continue;
            }
            if self.shared.state.lock().ended {
                // Items that came between the look and this one are still taken.
                self.take();
                return self.bundle.pop_front();
            }
            self.shared.arrived.notified().await;
        }
    }

    /// Takes all waiting items; returns whether there were any.
    fn take(&mut self) -> bool {
        std::mem::swap(&mut self.shared.state.lock().waiting, &mut self.bundle);
        if self.bundle.is_empty() {
            return false;
        }
        self.shared.taken.notify_one();
        true
    }
}

impl<T> Drop for Receiver<T> {
    fn drop(&mut self) {
        self.shared.state.lock().ended = true;
        self.shared.taken.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn runtime() -> tokio::runtime::Runtime {
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).build().unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn all_arrive_in_order_across_threads(capacity in 0_usize..6, bundles in prop::collection::vec(0_u32..9, 0..200)) {
            let runtime = runtime();
            let (sender, mut receiver) = queue(capacity);
            let sent = runtime.spawn({
                let bundles = bundles.clone();
                async move {
                    let mut next = 0..;
                    for size in bundles {
                        let mut items: VecDeque<u32> = next.by_ref().take(size as usize).collect();
                        while !items.is_empty() {
                            sender.send(&mut items).await.unwrap();
                        }
                    }
                }
            });
            let got: Vec<u32> = runtime.block_on(async {
                let mut got = Vec::new();
                while let Some(item) = receiver.recv().await {
                    got.push(item);
                }
                got
            });
            runtime.block_on(sent).unwrap();
            prop_assert_eq!(got, (0..bundles.iter().sum()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_sender_waits_for_room_and_keeps_what_was_not_sent() {
        let (sender, mut receiver) = queue(3);
        let mut items: VecDeque<u32> = (0..5).collect();
        runtime().block_on(async {
            assert_eq!(sender.send(&mut items).await, Ok(()));
            assert_eq!(items, [3, 4]);
            tokio::select! {
                biased;
                sent = sender.send(&mut items) => panic!("{sent:?} without room"),
                () = tokio::task::yield_now() => {}
            }
            assert_eq!(items, [3, 4]);
            assert_eq!(receiver.recv().await, Some(0));
            assert_eq!(sender.send(&mut items).await, Ok(()));
            assert!(items.is_empty());
            drop(sender);
            for expected in [Some(1), Some(2), Some(3), Some(4), None, None] {
                assert_eq!(receiver.recv().await, expected);
            }
        });
    }

    #[test]
    fn a_sender_learns_that_the_receiver_is_gone_while_it_waits() {
        let (sender, receiver) = queue(1);
        let mut items: VecDeque<u32> = (0..3).collect();
        let runtime = runtime();
        let gone = runtime.spawn(async move {
            tokio::task::yield_now().await;
            drop(receiver);
        });
        assert_eq!(runtime.block_on(sender.send(&mut items)), Ok(()));
        assert_eq!(runtime.block_on(sender.send(&mut items)), Err(Gone));
        runtime.block_on(gone).unwrap();
    }
}
