//! A lane of records, messages or blocks, over QUIC: a stream of its own in both directions. A task writes
//! it, so that a sender may stop waiting at any time without leaving half a record.

use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use quinn::{RecvStream, SendStream};
use tokio::sync::oneshot;
use trimaran_wire::{CloseReason, Decoder, Format, HEADER_BYTES, Kind, Message};

use super::carrier::{Carrier, loss};
use super::frames::{buffered, poll_fill};
use crate::error::{LaneError, Loss};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::lanes::queue::{Gone, Receiver, Sender, queue};
use crate::lanes::records::RecordLane;
use crate::stats::Counters;
use trimaran_net::sleep_until;

/// How many records may wait for room on the stream, and be taken at once by the task that writes it.
const QUEUE: usize = 4;
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
    counters: Arc<Counters>,
    queue: Sender<Said>,
    /// Dropped with this half.
    _open: oneshot::Sender<()>,
    /// Resolves when everything has arrived, or never will.
    ended: oneshot::Receiver<()>,
}

/// An encoded record or close, and whether it is the last.
type Said = (Bytes, bool);

impl RecordTx {
    pub(super) fn new(
        carrier: &Arc<Carrier>,
        lane: RecordLane,
        stream: SendStream,
        counters: &Arc<Counters>,
    ) -> Self {
        // Fails only for a stream that is closed.
        let _ = stream.set_priority(lane.priority());
        let ((sender, waiting), (_open, left), (end, ended)) =
            (queue(QUEUE), oneshot::channel(), oneshot::channel());
        let task = write(Arc::clone(carrier), stream, waiting, left, end);
        carrier.net.spawn(Box::pin(task));
        let (carrier, counters) = (Arc::clone(carrier), Arc::clone(counters));
        Self { lane, carrier, counters, queue: sender, _open, ended }
    }

    fn say(&self, message: &Message) -> Result<(), Loss> {
        let mut bytes = BytesMut::new();
        message.encode(&mut bytes);
        let (payload, last) = (bytes.len() - HEADER_BYTES, message.kind() == Kind::Close);
        self.queue.push((bytes.freeze(), last)).map_err(|Gone| self.loss())?;
        self.counters.sent.count(message.kind(), payload);
        Ok(())
    }

    /// Why nobody writes any more.
    fn loss(&self) -> Loss {
        self.carrier.connection.close_reason().map_or(Loss::Closed, loss)
    }
}

impl Half for RecordTx {}

impl LaneTx for RecordTx {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        Poll::Ready(ready!(self.queue.poll_room(cx)).map(|()| true).map_err(|Gone| self.loss()))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.say(&Message::Close(reason))
    }

    /// Waits until all of the lane has arrived.
    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        Pin::new(&mut self.ended).poll(cx).map(|_| Ok(()))
    }
}

impl Tx<Bytes> for RecordTx {
    fn stage(&mut self, record: Bytes) -> Result<(), Loss> {
        self.say(&self.lane.message(record))
    }
}

/// Writes the queue until its last entry, and ends the stream.
async fn write(
    carrier: Arc<Carrier>,
    mut stream: SendStream,
    mut waiting: Receiver<Said>,
    left: oneshot::Receiver<()>,
    end: oneshot::Sender<()>,
) {
    let net = Arc::clone(&carrier.net);
    let connection = carrier.connection.clone();
    let all = async {
        while let Some((bytes, last)) = poll_fn(|cx| waiting.poll_recv(cx)).await {
            if stream.write_chunk(bytes).await.is_err() {
                return;
            }
            if last {
                break;
            }
        }
        // Fails only for a stream that is closed.
        let _ = stream.finish();
        let _gone = stream.stopped().await;
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
    counters: Arc<Counters>,
    stream: RecvStream,
    decoder: Decoder,
    closed: Option<CloseReason>,
}

impl RecordRx {
    pub(super) fn new(
        carrier: &Arc<Carrier>,
        lane: RecordLane,
        stream: RecvStream,
        format: Format,
        counters: &Arc<Counters>,
    ) -> Self {
        let (carrier, counters) = (Arc::clone(carrier), Arc::clone(counters));
        Self { lane, _carrier: carrier, counters, stream, decoder: Decoder::new(format), closed: None }
    }
}

impl Half for RecordRx {}

impl Rx<Bytes> for RecordRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<Bytes>, LaneError>> {
        if let Some(reason) = &self.closed {
            return Poll::Ready(Err(LaneError::Closed(reason.clone())));
        }
        Poll::Ready(match buffered(&mut self.decoder, &self.counters.received)? {
            Some(Message::KeepAlive) => Ok(None),
            Some(Message::Close(reason)) => {
                self.closed = Some(reason.clone());
                Err(LaneError::Closed(reason))
            }
            Some(record) => self.lane.record(record).map(Some),
            None => match ready!(poll_fill(&mut self.stream, &mut self.decoder, cx))? {
                0 => Err(LaneError::Lost(match self.decoder.pending() {
                    0 => Loss::Closed,
                    bytes => Loss::Cut { bytes },
                })),
                _ => Ok(None),
            },
        })
    }
}
