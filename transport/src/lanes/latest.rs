//! The latest lane: a cell of size one.

use trimaran_net::Instant;
use trimaran_wire::{CloseReason, Fixed, FixedBytes, Protocol, to_bytes};

use super::ends::{AnyTx, Came, Receiver, Sender, lost};
use crate::error::{LaneError, ProtocolError, RecvError, SendError};

/// Publishes values: each replaces the one before, whether that has been read or not.
#[derive(Debug)]
pub struct LatestSender<P: Protocol>(pub(crate) Sender<P::Latest, FixedBytes>);

/// Reads the newest value.
#[derive(Debug)]
pub struct LatestReceiver<P: Protocol>(pub(crate) Receiver<P::Latest, FixedBytes>);

impl<P: Protocol> LatestSender<P> {
    /// Publishes `value`. Never waits: if the peer is slow, only the newest value waits for it.
    ///
    /// # Errors
    /// If the peer is gone.
    pub fn publish(&mut self, value: P::Latest) -> Result<(), SendError> {
        match &mut self.0.lane {
            AnyTx::Local(lane) => lane.stage(value),
            AnyTx::Wire(lane) => lane.stage(to_bytes(&value)),
        }
        .map_err(|loss| lost(loss, &self.0.shared))
    }

    /// Closes this lane, after the last published value.
    ///
    /// If the future is dropped, the close may not be sent.
    ///
    /// # Errors
    /// If the peer is gone already, or takes nothing within the link's timeout.
    pub async fn close(self, reason: CloseReason) -> Result<(), SendError> {
        self.0.close(reason).await
    }
}

impl<P: Protocol> LatestReceiver<P> {
    /// Waits for an unread value, for as long as the peer lives, and returns the newest. Dropping the future
    /// loses no value.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol. A value that came before such an end is
    /// returned first.
    pub async fn latest(&mut self) -> Result<P::Latest, RecvError> {
        self.latest_until(None).await
    }

    /// As [`LatestReceiver::latest`], until `deadline` at most. Dropping the future loses no value.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn latest_by(&mut self, deadline: Instant) -> Result<P::Latest, RecvError> {
        self.latest_until(Some(deadline)).await
    }

    /// The newest unread value, or `None` if there is none now. Never waits.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub fn try_latest(&mut self) -> Result<Option<P::Latest>, RecvError> {
        self.0.try_next()?.map(|came| self.value(came)).transpose()
    }

    /// Discards everything until the lane ends, and returns how it ended.
    pub(crate) async fn drain(&mut self) -> RecvError {
        loop {
            if let Err(end) = self.latest().await {
                return end;
            }
        }
    }

    async fn latest_until(&mut self, by: Option<Instant>) -> Result<P::Latest, RecvError> {
        let came = self.0.next(by).await?;
        self.value(came)
    }

    fn value(&self, came: Came<P::Latest, FixedBytes>) -> Result<P::Latest, RecvError> {
        match came {
            Came::Local(value) => Ok(value),
            Came::Wire(bytes) => read::<P>(&bytes).map_err(|e| e.receiving(&self.0.shared.peer)),
        }
    }
}

/// The value in `bytes`, which have the length of a value.
fn read<P: Protocol>(bytes: &[u8]) -> Result<P::Latest, LaneError> {
    P::Latest::read(bytes).map_err(|e| LaneError::Protocol(ProtocolError::Value(Box::new(e))))
}
