//! Asking a role to stop.

use std::{
    future::{Future, poll_fn},
    pin::pin,
};

use tokio::{runtime::Handle, sync::watch};

use super::turn::Turn;

/// Asks every role that holds its [`Stop`] to end: on Ctrl-C, or when another role of the process has failed.
#[derive(Debug, Clone)]
pub struct Stopper(watch::Sender<u32>);

/// Tells a role whether it has been asked to end.
#[derive(Debug, Clone)]
pub struct Stop(watch::Receiver<u32>);

impl Stop {
    /// A pair of ends. When the [`Stopper`] is dropped the role goes on.
    #[must_use]
    pub fn new() -> (Stopper, Self) {
        let (sender, receiver) = watch::channel(0);
        (Stopper(sender), Self(receiver))
    }

    /// Whether the role has been asked to end.
    #[must_use]
    pub fn requested(&self) -> bool {
        *self.0.borrow() > 0
    }

    /// Whether it has been asked more than once: whoever asks wants it to leave what it is finishing.
    #[must_use]
    pub fn insisted(&self) -> bool {
        *self.0.borrow() > 1
    }

    /// Waits for `future` on `runtime`; `None` if the role is asked to stop first.
    pub fn unless_requested<T>(&self, runtime: &Handle, future: impl Future<Output = T>) -> Option<T> {
        runtime.block_on(async {
            tokio::select! {
                biased;
                value = future => Some(value),
                () = self.clone().wait() => None,
            }
        })
    }

    async fn wait(mut self) {
        if self.0.wait_for(|requests| *requests > 0).await.is_err() {
            // Nobody is left who could ask.
            std::future::pending::<()>().await;
        }
    }
}

impl Stopper {
    /// Asks, or asks again.
    pub fn stop(&self) {
        self.0.send_modify(|requests| *requests = requests.saturating_add(1));
    }
}

/// How a role waits: on the runtime, not beyond a request to stop, and without its turn to compute.
#[derive(Clone, Copy)]
pub(super) struct Waiting<'r> {
    pub(super) runtime: &'r Handle,
    pub(super) stop: &'r Stop,
    pub(super) turn: &'r Turn,
}

impl Waiting<'_> {
    /// Waits for `future`; `None` if the role was asked to stop first.
    pub(super) fn on<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        let mut future = pin!(future);
        self.turn.while_waiting(|stuck| {
            let future = poll_fn(|context| {
                let polled = future.as_mut().poll(context);
                if polled.is_pending() {
                    stuck();
                }
                polled
            });
            self.stop.unless_requested(self.runtime, future)
        })
    }
}
