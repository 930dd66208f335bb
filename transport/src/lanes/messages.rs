//! The messages lane: messages beside values and frames, in order and without loss.

use trimaran_net::Instant;
use trimaran_wire::{CloseReason, MAX_MESSAGE, Protocol};

use crate::error::{RecvError, SendError};
use crate::lanes::records::{RecordReceiver, RecordSender};

/// Sends messages: each arrives once, whole, and in the order in which they were sent, or the link ends.
#[derive(Debug)]
pub struct MessageSender<P: Protocol>(pub(crate) RecordSender<P::Message>);

/// Receives messages.
///
/// Receiving is optional: once a bounded buffer is full, unread messages hold up only the peer's sender of
/// messages, and no other lane.
#[derive(Debug)]
pub struct MessageReceiver<P: Protocol>(pub(crate) RecordReceiver<P::Message>);

impl<P: Protocol> MessageSender<P> {
    /// Sends `message`. Waits while the peer takes none and a bounded buffer is full (backpressure), within
    /// the link's timeout. Once this returns the message is sent, unless the process ends.
    ///
    /// Dropping the future while it waits sends nothing: a message is sent whole, or not at all.
    ///
    /// # Errors
    /// If the peer is gone or stalls, or the message has more than [`MAX_MESSAGE`] bytes, encoded by
    /// postcard.
    pub async fn send(&mut self, message: &P::Message) -> Result<(), SendError> {
        // Nothing is encoded within one process, but the limit is the same.
        let local = || {
            let bytes = postcard::experimental::serialized_size(message).ok()?;
            (bytes <= MAX_MESSAGE).then(|| (message.clone(), bytes))
        };
        let wire = || {
            let bytes = postcard::to_stdvec(message).ok()?;
            (bytes.len() <= MAX_MESSAGE).then(|| bytes.into())
        };
        self.0.send(local, wire).await
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

impl<P: Protocol> MessageReceiver<P> {
    /// Waits for the next message, for as long as the peer lives: a peer without messages is not lost.
    /// Dropping the future loses nothing.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol. Messages that came before are returned
    /// first.
    pub async fn recv(&mut self) -> Result<P::Message, RecvError> {
        self.0.recv(None).await
    }

    /// As [`MessageReceiver::recv`], until `deadline` at most. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn recv_by(&mut self, deadline: Instant) -> Result<P::Message, RecvError> {
        self.0.recv(Some(deadline)).await
    }

    /// The next message if it has arrived, without waiting. A peer that hangs is not noticed this way.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub fn try_recv(&mut self) -> Result<Option<P::Message>, RecvError> {
        self.0.try_recv()
    }
}
