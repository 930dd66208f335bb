//! Where a culling machine's ids leave: to the display and to the other machine of the pair, in batches,
//! while culling goes on.

use crate::{FrameSender, FrameStart};
use trimaran_proto::DrawableId;
use trimaran_transport::SendError;

use super::{RoleError, stop::Waiting, wait};

/// Sends what is found visible to all receivers. What is found at once leaves at once: the batches that it
/// fills share writes and packets, and none waits for what is not found yet.
///
/// The tree walk that feeds it cannot stop half-way, so a failure is kept and told at the end; nothing is
/// sent after it.
pub(super) struct Outlet<'l, D: std::error::Error + 'static> {
    waiting: Waiting<'l>,
    receivers: [Option<&'l mut FrameSender>; 2],
    failure: Option<RoleError<D>>,
}

impl<'l, D: std::error::Error + 'static> Outlet<'l, D> {
    /// Sends to `display` and, if it is there, to `other`.
    pub(super) fn new(
        waiting: Waiting<'l>,
        display: &'l mut FrameSender,
        other: Option<&'l mut FrameSender>,
    ) -> Self {
        // The other machine first: it draws while the display only gathers.
        Self { waiting, receivers: [other, Some(display)], failure: None }
    }

    pub(super) fn begin(&mut self, start: FrameStart) {
        self.each("beginning a frame", async |sender| sender.begin(start).await);
    }

    pub(super) fn push(&mut self, ids: &[DrawableId]) {
        self.each("sending ids", async |sender| sender.push(ids).await);
    }

    /// Sends what is left and the frame's end; tells whether all went well.
    pub(super) fn finish(mut self) -> Result<(), RoleError<D>> {
        self.each("ending a frame", async |sender| sender.finish().await.map(|_| ()));
        self.failure.map_or(Ok(()), Err)
    }

    fn each(&mut self, doing: &'static str, send: impl AsyncFn(&mut FrameSender) -> Result<(), SendError>) {
        for sender in self.receivers.iter_mut().flatten() {
            if self.failure.is_none() {
                self.failure = wait(self.waiting, doing, send(sender)).err();
            }
        }
    }
}
