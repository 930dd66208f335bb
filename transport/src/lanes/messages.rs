//! The messages lane: what is said beside values and frames, in order and without loss.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use trimaran_wire::{CloseReason, MAX_MESSAGE, Protocol};

use crate::application::whole;
use crate::error::{LaneError, LaneSendError, ProtocolError, RecvError, SendError};
use crate::inproc::messages as inproc;
use crate::lanes::shared::Shared;
#[cfg(feature = "quic")]
use crate::quic::messages as quic;
use crate::rates::Messages;
use crate::stream::messages as stream;
use crate::timeouts::Timeouts;
#[cfg(feature = "udp")]
use crate::udp::messages as udp;
use trimaran_net::Instant;

/// Sends messages: each arrives once, whole, and in the order in which they were sent, or the link ends.
#[derive(Debug)]
pub struct MessageSender<P: Protocol> {
    pub(crate) lane: MessageTx<P>,
    pub(crate) shared: Shared,
    pub(crate) timeouts: Timeouts,
}

/// Receives messages.
///
/// Nobody has to: what is not received holds up the peer's sender of messages, once a bounded buffer is full,
/// and no other lane.
#[derive(Debug)]
pub struct MessageReceiver<P: Protocol> {
    pub(crate) lane: MessageRx<P>,
    pub(crate) shared: Shared,
    /// Without a limit: a peer may have nothing to say for ever.
    pub(crate) timeouts: Timeouts,
    pub(crate) rate: Messages,
}

#[derive(Debug)]
pub(crate) enum MessageTx<P: Protocol> {
    Local(inproc::MessageTx<P>),
    Wire(WireMessageTx),
}

#[derive(Debug)]
pub(crate) enum MessageRx<P: Protocol> {
    Local(inproc::MessageRx<P>),
    Wire(WireMessageRx),
}

over_bytes!(WireMessageTx: MessageTx);
over_bytes!(WireMessageRx: MessageRx);

impl<P: Protocol> MessageSender<P> {
    /// Sends `message`. Waits while the peer takes none and a bounded buffer is full (backpressure), within
    /// the link's timeout. When this returns the message is on its way: whatever the caller does then, but
    /// for ending the process, it is sent.
    ///
    /// Dropping the future while it waits sends nothing: a message is sent whole, or not at all.
    ///
    /// # Errors
    /// When the peer is gone or stalls, or the message has more than [`MAX_MESSAGE`] bytes as postcard
    /// writes it.
    pub async fn send(&mut self, message: &P::Message) -> Result<(), SendError> {
        let Self { lane, shared, timeouts } = self;
        let fits = |bytes: usize| bytes <= MAX_MESSAGE;
        let too_long = || SendError::TooLong { peer: shared.peer.clone() };
        let sent = match lane {
            // Nothing is encoded within one process, and what it allows is the same.
            MessageTx::Local(lane) => {
                let bytes =
                    postcard::experimental::serialized_size(message).ok().filter(|bytes| fits(*bytes));
                let bytes = bytes.ok_or_else(too_long)?;
                lane.send(message.clone(), bytes, shared, timeouts).await
            }
            MessageTx::Wire(lane) => {
                let bytes = postcard::to_stdvec(message).ok().filter(|bytes| fits(bytes.len()));
                let bytes = bytes.ok_or_else(too_long)?.into();
                whichever!(WireMessageTx: lane, lane => lane.send(bytes, shared, timeouts).await)
            }
        };
        sent.map_err(|e| self.error(e))
    }

    /// Closes this lane, behind all that was sent.
    ///
    /// Dropping the future may leave the close unsaid.
    ///
    /// # Errors
    /// When the peer is gone already, or takes nothing within the link's timeout.
    pub async fn close(mut self, reason: CloseReason) -> Result<(), SendError> {
        let (shared, timeouts) = (&self.shared, &mut self.timeouts);
        match &mut self.lane {
            MessageTx::Local(lane) => lane.close(reason, shared, timeouts).await,
            MessageTx::Wire(lane) => {
                whichever!(WireMessageTx: lane, lane => lane.close(reason, shared, timeouts).await)
            }
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneSendError) -> SendError {
        error.sending(&self.shared.peer, self.timeouts.limit())
    }
}

impl<P: Protocol> MessageReceiver<P> {
    /// Waits for the next message, for as long as the peer lives: one with nothing to say is none that is
    /// lost. Dropping the future loses nothing.
    ///
    /// # Errors
    /// When the peer closed the link, is lost, or broke the protocol. Messages that came before are given
    /// first.
    pub async fn recv(&mut self) -> Result<P::Message, RecvError> {
        self.recv_until(None).await
    }

    /// As [`MessageReceiver::recv`], until `deadline` at most. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn recv_by(&mut self, deadline: Instant) -> Result<P::Message, RecvError> {
        self.recv_until(Some(deadline)).await
    }

    /// The next message if it has arrived, without waiting. A peer that hangs is not noticed this way.
    ///
    /// # Errors
    /// When the peer closed the link, is lost, or broke the protocol.
    pub fn try_recv(&mut self) -> Result<Option<P::Message>, RecvError> {
        // Not bound by the runtime's budget of a task, as in polling for frames.
        let next = pin!(tokio::task::unconstrained(self.recv_until(None)));
        match next.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(message) => message.map(Some),
            Poll::Pending => Ok(None),
        }
    }

    /// Throws away what comes until the lane ends, and says how it ended.
    pub(crate) async fn drain(&mut self) -> RecvError {
        loop {
            if let Err(end) = self.recv().await {
                return end;
            }
        }
    }

    async fn recv_until(&mut self, by: Option<Instant>) -> Result<P::Message, RecvError> {
        let Self { lane, shared, timeouts, rate } = self;
        let message = match lane {
            MessageRx::Local(lane) => lane.next(by, shared, timeouts).await,
            MessageRx::Wire(lane) => {
                { whichever!(WireMessageRx: lane, lane => lane.next(by, shared, timeouts).await) }.and_then(
                    |bytes| {
                        rate.count(|| timeouts.now()).map_err(|e| {
                            shared.counters.flooded();
                            LaneError::Protocol(ProtocolError::TooMany(e))
                        })?;
                        whole(&bytes).map_err(|e| LaneError::Protocol(ProtocolError::Message(e)))
                    },
                )
            }
        };
        message.map_err(|e| e.receiving(&self.shared.peer, self.timeouts.limit()))
    }
}
