//! The displays that a culler serves, as its service manager and its log are told.

use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use trimaran::metrics::TurnedAwayReading;
use trimaran_transport::{ListenerStats, Net, TokioNet, sleep_until};

use super::{log::SAID, service_manager::ServiceManager};

/// Tells the service manager how many displays are served.
pub(super) struct Serving<'h> {
    pub(super) manager: ServiceManager,
    scene: &'h Path,
    displays: AtomicUsize,
}

/// A display that is served until this is dropped.
pub(super) struct Served<'s>(&'s Serving<'s>);

impl<'h> Serving<'h> {
    pub(super) fn begin(scene: &'h Path) -> Self {
        let serving =
            Self { manager: ServiceManager::of_this_process(), scene, displays: AtomicUsize::new(0) };
        serving.manager.ready(&serving.status(0));
        serving
    }

    pub(super) fn one_more(&self) -> Served<'_> {
        self.manager.status(&self.status(self.displays.fetch_add(1, Ordering::Relaxed) + 1));
        Served(self)
    }

    /// Whether no display is served.
    pub(super) fn is_idle(&self) -> bool {
        self.displays.load(Ordering::Relaxed) == 0
    }

    fn status(&self, displays: usize) -> String {
        format!("scene {}, displays: {displays}", self.scene.display())
    }
}

impl Drop for Served<'_> {
    fn drop(&mut self) {
        let Serving { manager, displays, .. } = self.0;
        manager.status(&self.0.status(displays.fetch_sub(1, Ordering::Relaxed) - 1));
    }
}

/// Tells when a limit of this listener is reached, at most once a minute.
pub(super) async fn told_of_limits(net: TokioNet, listener: ListenerStats) {
    let mut before = TurnedAwayReading::default();
    loop {
        sleep_until(&net, net.now().after(Duration::from_secs(1))).await;
        let now = TurnedAwayReading::of(std::slice::from_ref(&listener));
        if now != before {
            tracing::warn!(target: SAID, "turned away since the start, by limit: {now}");
            before = now;
            sleep_until(&net, net.now().after(Duration::from_secs(59))).await;
        }
    }
}
