//! A bounded queue for one sender and one receiver. Items move in bundles, so a waiting task is woken once
//! per bundle: waking is the main cost.

use parking_lot::{Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

/// Makes a queue that holds at most `capacity` items, at least one; the receiver may hold as many again.
pub(crate) fn queue<T>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    let state = State { waiting: VecDeque::new(), ended: false, sender: None, receiver: None };
    let shared = Arc::new(Shared { state: Mutex::new(state), capacity: capacity.max(1) });
    (Sender(Arc::clone(&shared)), Receiver { shared, bundle: VecDeque::new() })
}

#[derive(Debug)]
struct Shared<T> {
    state: Mutex<State<T>>,
    capacity: usize,
}

#[derive(Debug)]
struct State<T> {
    waiting: VecDeque<T>,
    /// One of the ends is gone.
    ended: bool,
    /// Waits for room.
    sender: Option<Waker>,
    /// Waits for items.
    receiver: Option<Waker>,
}

#[derive(Debug)]
pub(crate) struct Sender<T>(Arc<Shared<T>>);

/// The other end is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Gone;

impl<T> Sender<T> {
    /// Ready once there is room.
    pub(crate) fn poll_room(&self, cx: &Context<'_>) -> Poll<Result<(), Gone>> {
        self.poll_locked(cx).map_ok(|_| ())
    }

    /// Sends as many `items` as there is room for, and waits if there is none.
    pub(crate) fn poll_send(&self, items: &mut VecDeque<T>, cx: &Context<'_>) -> Poll<Result<(), Gone>> {
        self.poll_locked(cx).map_ok(|mut state| {
            let room = (self.0.capacity - state.waiting.len()).min(items.len());
            state.waiting.extend(items.drain(..room));
            let receiver = state.receiver.take();
            drop(state);
            wake(receiver);
        })
    }

    /// Sends an item, whether there is room or not.
    pub(crate) fn push(&self, item: T) -> Result<(), Gone> {
        let mut state = self.0.state.lock();
        if state.ended {
            return Err(Gone);
        }
        state.waiting.push_back(item);
        let receiver = state.receiver.take();
        drop(state);
        wake(receiver);
        Ok(())
    }

    /// The state once there is room.
    fn poll_locked(&self, cx: &Context<'_>) -> Poll<Result<MutexGuard<'_, State<T>>, Gone>> {
        let mut state = self.0.state.lock();
        if state.ended {
            return Poll::Ready(Err(Gone));
        }
        if state.waiting.len() >= self.0.capacity {
            state.sender = Some(cx.waker().clone());
            return Poll::Pending;
        }
        Poll::Ready(Ok(state))
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        let mut state = self.0.state.lock();
        state.ended = true;
        let receiver = state.receiver.take();
        drop(state);
        wake(receiver);
    }
}

#[derive(Debug)]
pub(crate) struct Receiver<T> {
    shared: Arc<Shared<T>>,
    /// Taken from the queue at once, returned one by one.
    bundle: VecDeque<T>,
}

impl<T> Receiver<T> {
    /// The next item; `None` after the last one, if the sender is gone.
    pub(crate) fn poll_recv(&mut self, cx: &Context<'_>) -> Poll<Option<T>> {
        if self.bundle.is_empty() {
            let mut state = self.shared.state.lock();
            std::mem::swap(&mut state.waiting, &mut self.bundle);
            if self.bundle.is_empty() && !state.ended {
                state.receiver = Some(cx.waker().clone());
                return Poll::Pending;
            }
            let sender = state.sender.take();
            drop(state);
            wake(sender);
        }
        Poll::Ready(self.bundle.pop_front())
    }
}

impl<T> Drop for Receiver<T> {
    fn drop(&mut self) {
        let mut state = self.shared.state.lock();
        state.ended = true;
        let sender = state.sender.take();
        drop(state);
        wake(sender);
    }
}

fn wake(waker: Option<Waker>) {
    if let Some(waker) = waker {
        waker.wake();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::future::poll_fn;

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
                            poll_fn(|cx| sender.poll_send(&mut items, cx)).await.unwrap();
                        }
                    }
                }
            });
            let got: Vec<u32> = runtime.block_on(async {
                let mut got = Vec::new();
                while let Some(item) = poll_fn(|cx| receiver.poll_recv(cx)).await {
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
            assert_eq!(poll_fn(|cx| sender.poll_send(&mut items, cx)).await, Ok(()));
            assert_eq!(items, [3, 4]);
            tokio::select! {
                biased;
                sent = poll_fn(|cx| sender.poll_send(&mut items, cx)) => panic!("{sent:?} without room"),
                () = tokio::task::yield_now() => {}
            }
            assert_eq!(items, [3, 4]);
            assert_eq!(poll_fn(|cx| receiver.poll_recv(cx)).await, Some(0));
            assert_eq!(poll_fn(|cx| sender.poll_send(&mut items, cx)).await, Ok(()));
            assert!(items.is_empty());
            drop(sender);
            for expected in [Some(1), Some(2), Some(3), Some(4), None, None] {
                assert_eq!(poll_fn(|cx| receiver.poll_recv(cx)).await, expected);
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
        assert_eq!(runtime.block_on(poll_fn(|cx| sender.poll_send(&mut items, cx))), Ok(()));
        assert_eq!(runtime.block_on(poll_fn(|cx| sender.poll_send(&mut items, cx))), Err(Gone));
        runtime.block_on(gone).unwrap();
    }
}
