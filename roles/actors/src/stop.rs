//! Stop requests to roles.

use std::{
    future::{Future, pending},
    sync::Arc,
};

use tokio::sync::watch;
use trimaran_cull::Cancel;

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

    /// Whether it has been requested more than once: the role is to leave even unfinished work.
    #[must_use]
    pub fn insisted(&self) -> bool {
        *self.0.borrow() > 1
    }

    /// The same for a device, which ends its waits then.
    #[must_use]
    pub fn cancel(&self) -> Cancel {
        let stop = self.clone();
        Arc::new(move || stop.requested())
    }

    /// The result of `future`; `None` if the role is asked to stop first.
    ///
    /// Dropping this drops `future`.
    pub async fn unless_requested<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        self.unless_asked(1, future).await
    }

    /// The result of `future`; `None` if the stop is enforced first.
    pub(crate) async fn unless_insisted<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        self.unless_asked(2, future).await
    }

    async fn unless_asked<T>(&self, times: u32, future: impl Future<Output = T>) -> Option<T> {
        let mut requests = self.0.clone();
        let asked = async {
            if requests.wait_for(|requests| *requests >= times).await.is_err() {
                // The stopper is gone.
                pending::<()>().await;
            }
        };
        tokio::select! {
            biased;
            value = future => Some(value),
            () = asked => None,
        }
    }
}

impl Stopper {
    /// Requests a stop, or repeats the request.
    pub fn stop(&self) {
        self.0.send_modify(|requests| *requests = requests.saturating_add(1));
    }

    /// Requests and enforces a stop: the role does not wait for its peers to receive its close.
    pub fn insist(&self) {
        self.stop();
        self.stop();
    }
}
