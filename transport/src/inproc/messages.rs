//! The messages lane: values move through a bounded queue.

use tokio::sync::mpsc;
use trimaran_wire::{CloseReason, Kind, Protocol};

use crate::error::{LaneError, LaneSendError, Loss};
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

/// How many messages may wait for their reader.
const QUEUE: usize = 64;

/// What travels.
#[derive(Debug)]
enum Said<M> {
    /// A message, and how many bytes it would have.
    Message(M, usize),
    Close(CloseReason),
}

#[derive(Debug)]
pub(crate) struct MessageTx<P: Protocol>(mpsc::Sender<Said<P::Message>>);

#[derive(Debug)]
pub(crate) struct MessageRx<P: Protocol> {
    queue: mpsc::Receiver<Said<P::Message>>,
    closed: Option<CloseReason>,
}

/// The lane in one direction.
pub(super) fn messages<P: Protocol>() -> (MessageTx<P>, MessageRx<P>) {
    let (queue, said) = mpsc::channel(QUEUE);
    (MessageTx(queue), MessageRx { queue: said, closed: None })
}

impl<P: Protocol> MessageTx<P> {
    /// Sends a message that would have so many bytes.
    pub(crate) async fn send(
        &mut self,
        message: P::Message,
        bytes: usize,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.say(Said::Message(message, bytes), timeouts).await?;
        shared.counters.sent.count(Kind::Message, bytes);
        Ok(())
    }

    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.say(Said::Close(reason), timeouts).await?;
        shared.counters.sent.count(Kind::Close, 0);
        Ok(())
    }

    async fn say(&self, said: Said<P::Message>, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        let sent = timeouts.wait(None, self.0.send(said)).await.map_err(|_| LaneSendError::Stalled)?;
        sent.map_err(|_gone| LaneSendError::Lost(Loss::Closed))
    }
}

impl<P: Protocol> MessageRx<P> {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<P::Message, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        let said = timeouts.wait(by, self.queue.recv()).await.map_err(LaneError::Expired)?;
        match said.ok_or(LaneError::Lost(Loss::Closed))? {
            Said::Message(message, bytes) => {
                shared.counters.received.count(Kind::Message, bytes);
                Ok(message)
            }
            Said::Close(reason) => {
                shared.counters.received.count(Kind::Close, 0);
                self.closed = Some(reason.clone());
                Err(LaneError::Closed(reason))
            }
        }
    }
}
