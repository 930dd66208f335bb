//! Where a culling machine's ids leave: to the display and to the other machine of the pair, in batches, while culling goes on.

use trimaran_proto::{DrawableId, FrameStart};
use trimaran_transport::{FrameSender, SendError};

use super::{RoleError, stop::Waiting, wait};

/// Gathers ids into batches and sends each to all receivers as soon as it is full.
///
/// The tree walk that feeds it cannot stop half-way, so a failure is kept and told at the end; nothing is sent after it.
pub(super) struct Outlet<'l, D: std::error::Error + 'static> {
    waiting: Waiting<'l>,
    receivers: [Option<&'l mut FrameSender>; 2],
    pending: Vec<DrawableId>,
    batch: usize,
    failure: Option<RoleError<D>>,
}

impl<'l, D: std::error::Error + 'static> Outlet<'l, D> {
    /// Sends to `display` and, if it is there, to `other`, in batches of `batch` ids.
    pub(super) fn new(
        waiting: Waiting<'l>,
        display: &'l mut FrameSender,
        other: Option<&'l mut FrameSender>,
        batch: usize,
    ) -> Self {
        // The other machine first: it draws while the display only gathers.
        let receivers = [other, Some(display)];
        Self { waiting, receivers, pending: Vec::with_capacity(batch), batch, failure: None }
    }

    pub(super) fn begin(&mut self, start: FrameStart) {
        self.each("beginning a frame", async |sender, _| {
            sender.begin(start).await?;
            sender.flush().await
        });
    }

    pub(super) fn push(&mut self, id: DrawableId) {
        self.pending.push(id);
        if self.pending.len() >= self.batch {
            self.send_pending();
        }
    }

    /// Sends what is left and the frame's end; tells whether all went well.
    pub(super) fn finish(mut self) -> Result<(), RoleError<D>> {
        self.send_pending();
        self.each("ending a frame", async |sender, _| sender.finish().await.map(|_| ()));
        self.failure.map_or(Ok(()), Err)
    }

    fn send_pending(&mut self) {
        self.each("sending ids", async |sender, ids| {
            sender.push(ids).await?;
            sender.flush().await
        });
        self.pending.clear();
    }

    fn each(
        &mut self,
        doing: &'static str,
        send: impl AsyncFn(&mut FrameSender, &[DrawableId]) -> Result<(), SendError>,
    ) {
        for sender in self.receivers.iter_mut().flatten() {
            if self.failure.is_none() {
                self.failure = wait(self.waiting, doing, send(sender, &self.pending)).err();
            }
        }
    }
}
