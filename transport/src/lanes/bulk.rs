//! The bulk lane: blocks of bytes, in order and without loss, behind all other traffic.

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_wire::{CloseReason, MAX_BLOCK};

use crate::error::{RecvError, SendError};
use crate::lanes::records::{RecordReceiver, RecordSender};

/// Sends blocks: each arrives once, whole, and in the order in which they were sent, or the link ends.
///
/// Values, frames and messages go first, as far as the transport can decide.
#[derive(Debug)]
pub struct BulkSender(pub(crate) RecordSender<Bytes>);

/// Receives blocks.
///
/// Receiving is optional: once a bounded buffer is full, unread blocks hold up only the peer's sender of
/// blocks, and no other lane.
#[derive(Debug)]
pub struct BulkReceiver(pub(crate) RecordReceiver<Bytes>);

impl BulkSender {
    /// Sends `block`, which may be empty. Waits while a bounded buffer is full (backpressure), within the
    /// link's timeout. Once this returns the block is sent, unless the process ends.
    ///
    /// Dropping the future while it waits sends nothing: a block is sent whole, or not at all.
    ///
    /// # Errors
    /// If the peer is gone or stalls, or the block has more than [`MAX_BLOCK`] bytes.
    pub async fn send(&mut self, block: Bytes) -> Result<(), SendError> {
        let block = Some(block).filter(|block| block.len() <= MAX_BLOCK);
        let local = || block.clone().map(|block| (block.clone(), block.len()));
        self.0.send(local, || block.clone()).await
    }

    /// Closes this lane, behind everything sent.
    ///
    /// If the future is dropped, the close may not be sent.
    ///
    /// # Errors
    /// If the peer is gone already, or takes nothing within the link's timeout.
    pub async fn close(self, reason: CloseReason) -> Result<(), SendError> {
        self.0.close(reason).await
    }
}

impl BulkReceiver {
    /// Waits for the next block, for as long as the peer lives. Dropping the future loses nothing.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol. Blocks that came before are returned
    /// first.
    pub async fn recv(&mut self) -> Result<Bytes, RecvError> {
        self.0.recv(None).await
    }

    /// As [`BulkReceiver::recv`], until `deadline` at most. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn recv_by(&mut self, deadline: Instant) -> Result<Bytes, RecvError> {
        self.0.recv(Some(deadline)).await
    }

    /// The next block if it has arrived, without waiting. A peer that hangs is not noticed this way.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub fn try_recv(&mut self) -> Result<Option<Bytes>, RecvError> {
        self.0.try_recv()
    }
}
