//! The service manager that has started this process: systemd, by sd_notify(3). It is told when the service
//! is ready, what it does and when it stops, and restarts a service that has hung.

use std::{env, future::pending, time::Duration};

use sd_notify::NotifyState;
use tokio::{runtime::Runtime, task::JoinSet};
use trimaran_transport::{Net, TokioNet, sleep_until};

/// The service manager of this process. Without one, nothing is told.
#[derive(Debug, Clone, Copy)]
pub(super) struct ServiceManager {
    /// It restarts a service that has not been heard for this long.
    watchdog: Option<Duration>,
}

impl ServiceManager {
    pub(super) fn of_this_process() -> Self {
        Self { watchdog: sd_notify::watchdog_enabled() }
    }

    /// Whether there is one.
    pub(super) fn is_there() -> bool {
        env::var_os("NOTIFY_SOCKET").is_some()
    }

    /// The service works from now on.
    pub(super) fn ready(self, status: &str) {
        tell(&[NotifyState::Ready, NotifyState::Status(status)]);
    }

    /// Tells the service's present work.
    pub(super) fn status(self, status: &str) {
        tell(&[NotifyState::Status(status)]);
    }

    /// The service ends soon.
    pub(super) fn stopping() {
        tell(&[NotifyState::Stopping]);
    }

    /// The service has not hung as long as the result is kept, though its main loop has ended: a report of a
    /// walk takes as long as its checks do.
    #[must_use]
    pub(super) fn meanwhile(self, runtime: &Runtime) -> JoinSet<()> {
        let net = TokioNet::new(runtime.handle().clone());
        let mut heard = JoinSet::new();
        heard.spawn_on(async move { self.watching(&net, pending()).await }, runtime.handle());
        heard
    }

    /// The result of `work`, a service's main loop. As long as that is polled, or waits, the service has not
    /// hung.
    pub(super) async fn watching<T>(self, net: &dyn Net, work: impl Future<Output = T>) -> T {
        let Some(longest) = self.watchdog else { return work.await };
        let heard = async {
            loop {
                tell(&[NotifyState::Watchdog]);
                sleep_until(net, net.now().after(longest / 3)).await;
            }
        };
        tokio::select! {
            biased;
            done = work => done,
            never = heard => never,
        }
    }
}

fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::debug!(%error, "the service manager was not told");
    }
}
