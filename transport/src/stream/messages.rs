//! The messages lane over a byte stream of its own.

use std::sync::Arc;

use bytes::Bytes;
use trimaran_wire::{CloseReason, Lane, Message};

use super::inlet::{Inlet, Reader};
use super::source::{Sink, Source};
use super::writer::{Cell, Writer};
use crate::error::{LaneError, LaneSendError, Loss, misplaced};
use crate::lanes::shared::Shared;
use crate::stats::Counters;
use crate::timeouts::{Expired, Timeouts};
use trimaran_net::{Instant, Net};

/// How much is read at once: several messages, or one of the longest.
const ROOM: usize = 16 * 1024;

#[derive(Debug)]
pub(crate) struct MessageTx {
    writer: Writer,
    /// Where keep-alives come in while the peer takes nothing.
    inlet: Arc<Inlet>,
}

#[derive(Debug)]
pub(crate) struct MessageRx(Reader);

/// Both halves of the lane.
pub(super) fn messages(
    net: &Arc<dyn Net>,
    sink: Sink,
    source: Source,
    counters: &Arc<Counters>,
) -> (MessageTx, MessageRx) {
    let inlet = Arc::new(Inlet::new(source.with_room(ROOM), ROOM));
    let tx = MessageTx { writer: Writer::new(net, sink, counters), inlet: Arc::clone(&inlet) };
    (tx, MessageRx(Reader::new(inlet)))
}

impl MessageTx {
    pub(super) fn cell(&self) -> &Arc<Cell> {
        self.writer.cell()
    }

    /// Waits until all that was sent before is with the system: so one message waits here at most.
    pub(crate) async fn send(
        &mut self,
        message: Bytes,
        _: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        let Self { writer, inlet } = self;
        timeouts.wait_while_alive(|| inlet.heard(), writer.idle()).await.map_err(|end| match end {
            Expired::Idle => LaneSendError::Lost(Loss::Silent),
            Expired::Timeout | Expired::Deadline => LaneSendError::Stalled,
        })??;
        writer.send(Message::Message(message))
    }

    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        _: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.writer.close(reason, timeouts).await
    }
}

impl MessageRx {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Bytes, LaneError> {
        match self.0.next(by, shared, timeouts).await? {
            Message::Message(bytes) => Ok(bytes),
            other => Err(misplaced(other.kind(), Lane::Messages)),
        }
    }
}
