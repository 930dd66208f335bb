//! Asking a role to stop.

use std::future::{Future, pending};

use tokio::sync::watch;

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

    /// What `future` gives; `None` if the role is asked to stop first.
    ///
    /// Dropping the future drops `future`.
    pub async fn unless_requested<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        self.unless_asked(1, future).await
    }

    /// What `future` gives; `None` if whoever stops the role insists first.
    pub(crate) async fn unless_insisted<T>(&self, future: impl Future<Output = T>) -> Option<T> {
        self.unless_asked(2, future).await
    }

    async fn unless_asked<T>(&self, times: u32, future: impl Future<Output = T>) -> Option<T> {
        let mut requests = self.0.clone();
        let asked = async {
            if requests.wait_for(|requests| *requests >= times).await.is_err() {
                // Nobody is left who could ask.
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
    /// Asks, or asks again.
    pub fn stop(&self) {
        self.0.send_modify(|requests| *requests = requests.saturating_add(1));
    }

    /// Asks, and insists: the role does not wait until its peers have heard that it leaves.
    pub fn insist(&self) {
        self.stop();
        self.stop();
    }
}
