//! A lane of records, messages or blocks, over QUIC: a stream of its own in both directions. A task writes
//! it, so that a sender may stop waiting at any time without leaving half a record.

use std::future::poll_fn;
use std::sync::Arc;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use quinn::{RecvStream, SendStream};
use tokio::sync::{mpsc, oneshot};
use trimaran_wire::{CloseReason, Decoder, Format, HEADER_BYTES, Kind, Message};

use super::carrier::{Carrier, all_arrived, loss};
use super::frames::poll_fill;
use crate::error::{LaneError, LaneSendError, Loss, ProtocolError};
use crate::lanes::records::RecordLane;
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::{Instant, sleep_until};

/// How many records may wait for room on the stream.
const QUEUE: usize = 8;
/// How long sent records may wait for room after the sending half was dropped.
const LINGER: Duration = Duration::from_secs(2);

impl RecordLane {
    /// The priority of its stream. Those of frames are negative.
    const fn priority(self) -> i32 {
        match self {
            Self::Messages => 1,
            Self::Bulk => i32::MIN,
        }
    }
}

#[derive(Debug)]
pub(crate) struct RecordTx {
    lane: RecordLane,
    carrier: Arc<Carrier>,
    queue: mpsc::Sender<Said>,
    /// Dropped with this half.
    _open: oneshot::Sender<()>,
    /// Resolves when everything has arrived, or never will.
    ended: oneshot::Receiver<()>,
}

/// An encoded record or close, and whether it is the last.
type Said = (Bytes, bool);

impl RecordTx {
    pub(super) fn new(carrier: &Arc<Carrier>, lane: RecordLane, stream: SendStream) -> Self {
        // Fails only for a stream that is closed.
        let _ = stream.set_priority(lane.priority());
        let ((queue, waiting), (_open, left), (end, ended)) =
            (mpsc::channel(QUEUE), oneshot::channel(), oneshot::channel());
        let task = write(Arc::clone(carrier), stream, waiting, left, end);
        carrier.net.spawn(Box::pin(task));
        Self { lane, carrier: Arc::clone(carrier), queue, _open, ended }
    }

    pub(crate) async fn send(
        &mut self,
        record: Bytes,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.say(&self.lane.message(record), shared, timeouts).await
    }

    /// Closes the lane, and waits until all of it has arrived.
    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.say(&Message::Close(reason), shared, timeouts).await?;
        let _ended = timeouts.wait(None, &mut self.ended).await.map_err(|_| LaneSendError::Stalled)?;
        Ok(())
    }

    async fn say(
        &self,
        message: &Message,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        let mut bytes = BytesMut::new();
        message.encode(&mut bytes);
        let (payload, last) = (bytes.len() - HEADER_BYTES, message.kind() == Kind::Close);
        let queued = timeouts.wait(None, self.queue.send((bytes.freeze(), last))).await;
        queued.map_err(|_| LaneSendError::Stalled)?.map_err(|_gone| {
            LaneSendError::Lost(self.carrier.connection.close_reason().map_or(Loss::Closed, loss))
        })?;
        shared.counters.sent.count(message.kind(), payload);
        Ok(())
    }
}

/// Writes the queue until its last entry, and ends the stream.
async fn write(
    carrier: Arc<Carrier>,
    mut stream: SendStream,
    mut waiting: mpsc::Receiver<Said>,
    left: oneshot::Receiver<()>,
    end: oneshot::Sender<()>,
) {
    let net = Arc::clone(&carrier.net);
    let connection = carrier.connection.clone();
    let all = async {
        while let Some((bytes, last)) = waiting.recv().await {
            if stream.write_chunk(bytes).await.is_err() {
                return;
            }
            if last {
                break;
            }
        }
        // Fails only for a stream that is closed.
        let _ = stream.finish();
        all_arrived([&stream]).await;
    };
    let late = async {
        let _left = left.await;
        sleep_until(&*net, net.now().after(LINGER)).await;
    };
    tokio::select! {
        biased;
        () = all => {}
        _ = connection.closed() => {}
        () = late => {}
    }
    drop(waiting);
    let _unheard = end.send(());
}

#[derive(Debug)]
pub(crate) struct RecordRx {
    lane: RecordLane,
    /// Kept as long as the lane is read.
    _carrier: Arc<Carrier>,
    stream: RecvStream,
    decoder: Decoder,
    closed: Option<CloseReason>,
}

impl RecordRx {
    pub(super) fn new(carrier: &Arc<Carrier>, lane: RecordLane, stream: RecvStream, format: Format) -> Self {
        Self { lane, _carrier: Arc::clone(carrier), stream, decoder: Decoder::new(format), closed: None }
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Bytes, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        let Self { stream, decoder, .. } = self;
        loop {
            let before = decoder.position();
            let message =
                decoder.next_message().map_err(|e| LaneError::Protocol(ProtocolError::Decode(e)))?;
            let Some(message) = message else {
                let read = timeouts.wait(by, poll_fn(|cx| poll_fill(stream, decoder, cx))).await;
                if read.map_err(LaneError::Expired)?? == 0 {
                    return Err(LaneError::Lost(match decoder.pending() {
                        0 => Loss::Closed,
                        bytes => Loss::Cut { bytes },
                    }));
                }
                continue;
            };
            let bytes = decoder.position().saturating_sub(before) as usize;
            shared.counters.received.count(message.kind(), bytes.saturating_sub(HEADER_BYTES));
            match message {
                Message::KeepAlive => {}
                Message::Close(reason) => {
                    self.closed = Some(reason.clone());
                    return Err(LaneError::Closed(reason));
                }
                record => return self.lane.record(record),
            }
        }
    }
}
