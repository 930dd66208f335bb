//! The sessions that a process serves.

use prometheus_client::{
    encoding::EncodeLabelSet,
    metrics::{counter::Counter, family::Family, gauge::Gauge},
    registry::Registry,
};
use trimaran_actors::RoleError;

/// A process's sessions. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct SessionMetrics {
    running: Gauge,
    begun: Counter,
    errors: Family<Kind, Counter>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Kind {
    kind: &'static str,
}

/// A session that goes on until this is dropped.
#[derive(Debug)]
pub struct RunningSession(SessionMetrics);

impl Drop for RunningSession {
    fn drop(&mut self) {
        self.0.running.dec();
    }
}

impl SessionMetrics {
    pub(super) fn register(&self, registry: &mut Registry) {
        let Self { running, begun, errors } = self;
        registry.register("sessions", "Sessions that go on: a display or a page each", running.clone());
        registry.register("sessions", "Sessions that have begun", begun.clone());
        registry.register(
            "errors",
            "Sessions and links that ended with an error, by its kind",
            errors.clone(),
        );
    }

    /// A session begins.
    #[must_use]
    pub fn begin(&self) -> RunningSession {
        self.begun.inc();
        self.running.inc();
        RunningSession(self.clone())
    }

    /// A session or a link has ended with this error.
    pub fn failed(&self, error: &RoleError) {
        self.errors.get_or_create(&Kind { kind: error.kind() }).inc();
    }

    /// How many go on.
    #[must_use]
    pub fn running(&self) -> u64 {
        self.running.get().try_into().unwrap_or(0)
    }

    /// How many have begun.
    #[must_use]
    pub fn begun(&self) -> u64 {
        self.begun.get()
    }
}
