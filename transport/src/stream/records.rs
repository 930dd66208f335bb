//! A lane of records, messages or blocks, over a byte stream of its own.

use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use trimaran_wire::{CloseReason, Message};

use super::inlet::{Inlet, Reader};
use super::source::{Sink, Source};
use super::writer::{Cell, Writer};
use crate::error::Loss;
use crate::lanes::half::{Half, LaneTx, Tx};
use crate::lanes::records::RecordLane;
use crate::stats::Counters;
use trimaran_net::Net;

/// How much is read at once: several records, or one of the longest.
const ROOM: usize = 16 * 1024;

#[derive(Debug)]
pub(crate) struct RecordTx {
    lane: RecordLane,
    writer: Writer,
    /// The inlet for keep-alives while the peer takes nothing.
    inlet: Arc<Inlet>,
}

/// Both halves of the lane.
pub(super) fn records(
    lane: RecordLane,
    net: &Arc<dyn Net>,
    sink: Sink,
    source: Source,
    counters: &Arc<Counters>,
) -> (RecordTx, Reader<Bytes>) {
    let inlet = Inlet::new(source, ROOM, counters);
    let tx = RecordTx { lane, writer: Writer::new(net, sink, counters), inlet: Arc::clone(&inlet) };
    let read: fn(Message) -> _ = match lane {
        RecordLane::Messages => |message| RecordLane::Messages.record(message),
        RecordLane::Bulk => |message| RecordLane::Bulk.record(message),
    };
    (tx, Reader::new(inlet, read))
}

impl RecordTx {
    pub(super) fn cell(&self) -> &Arc<Cell> {
        self.writer.cell()
    }
}

impl Half for RecordTx {
    fn heard(&mut self) -> bool {
        self.inlet.heard()
    }
}

impl LaneTx for RecordTx {
    /// Waits until all earlier records are with the system, so at most one record waits here.
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        Poll::Ready(ready!(self.writer.poll_idle(cx)).map(|()| true))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.writer.close(reason)
    }

    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        self.writer.poll_idle(cx)
    }
}

impl Tx<Bytes> for RecordTx {
    fn stage(&mut self, record: Bytes) -> Result<(), Loss> {
        self.writer.send(self.lane.message(record))
    }
}
