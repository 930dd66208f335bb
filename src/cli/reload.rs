//! Reading files again while a service runs: a hang-up (SIGHUP) asks for it.

use std::future::pending;

use tokio::{
    runtime::Runtime,
    signal::unix::{Signal, SignalKind, signal},
};

use super::Failure;

/// The hang-ups of this process from now on. Without it, a hang-up ends the process.
#[derive(Debug)]
pub(super) struct HangUps(Signal);

impl HangUps {
    /// # Errors
    /// When signals cannot be received.
    pub(super) fn listen(runtime: &Runtime) -> Result<Self, Failure> {
        let _within = runtime.enter();
        signal(SignalKind::hangup()).map(Self).map_err(Failure::broken)
    }

    /// Waits for the next one. Several at once are one.
    pub(super) async fn next(&mut self) {
        if self.0.recv().await.is_none() {
            pending::<()>().await;
        }
    }
}
