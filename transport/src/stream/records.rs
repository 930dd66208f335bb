//! A lane of records, messages or blocks, over a byte stream of its own.

use std::sync::Arc;

use bytes::Bytes;
use trimaran_wire::CloseReason;

use super::inlet::{Inlet, Reader};
use super::source::{Sink, Source};
use super::writer::{Cell, Writer};
use crate::error::{LaneError, LaneSendError, Loss};
use crate::lanes::records::RecordLane;
use crate::lanes::shared::Shared;
use crate::stats::Counters;
use crate::timeouts::{Expired, Timeouts};
use trimaran_net::{Instant, Net};

/// How much is read at once: several records, or one of the longest.
const ROOM: usize = 16 * 1024;

#[derive(Debug)]
pub(crate) struct RecordTx {
    lane: RecordLane,
    writer: Writer,
    /// The inlet for keep-alives while the peer takes nothing.
    inlet: Arc<Inlet>,
}

#[derive(Debug)]
pub(crate) struct RecordRx {
    lane: RecordLane,
    reader: Reader,
}

/// Both halves of the lane.
pub(super) fn records(
    lane: RecordLane,
    net: &Arc<dyn Net>,
    sink: Sink,
    source: Source,
    counters: &Arc<Counters>,
) -> (RecordTx, RecordRx) {
    let inlet = Arc::new(Inlet::new(source.with_room(ROOM), ROOM));
    let tx = RecordTx { lane, writer: Writer::new(net, sink, counters), inlet: Arc::clone(&inlet) };
    (tx, RecordRx { lane, reader: Reader::new(inlet) })
}

impl RecordTx {
    pub(super) fn cell(&self) -> &Arc<Cell> {
        self.writer.cell()
    }

    /// Waits until all earlier records are with the system, so at most one record waits here.
    pub(crate) async fn send(
        &mut self,
        record: Bytes,
        _: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        let Self { lane, writer, inlet } = self;
        timeouts.wait_while_alive(|| inlet.heard(), writer.idle()).await.map_err(|end| match end {
            Expired::Idle => LaneSendError::Lost(Loss::Silent),
            Expired::Timeout | Expired::Deadline => LaneSendError::Stalled,
        })??;
        writer.send(lane.message(record))
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

impl RecordRx {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Bytes, LaneError> {
        self.lane.record(self.reader.next(by, shared, timeouts).await?)
    }
}
