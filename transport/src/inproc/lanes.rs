//! The lanes: values are passed on without encoding.

use std::collections::VecDeque;

use bytes::Bytes;
use tokio::sync::watch;
use trimaran_net::Instant;
use trimaran_wire::{CloseReason, Fixed, FrameEvent, Kind, Protocol};

use super::queue;
use super::records::{RecordRx, RecordTx, records};
use crate::error::{LaneError, LaneSendError, Loss};
use crate::lanes::records::RecordLane;
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;

/// The most messages of the frames lane that may wait for their reader, and that it may have taken at once:
/// for items of 4 bytes 32 MiB in all at the largest batch size.
const QUEUE: usize = 256;

/// One end of the lanes.
#[derive(Debug)]
pub(crate) struct Lanes<P: Protocol> {
    pub(crate) latest: (LatestTx<P>, LatestRx<P>),
    pub(crate) frames: (FrameTx<P>, FrameRx<P>),
    pub(crate) messages: (RecordTx<P::Message>, RecordRx<P::Message>),
    pub(crate) bulk: (RecordTx<Bytes>, RecordRx<Bytes>),
}

impl<P: Protocol> Lanes<P> {
    /// Both ends.
    pub(crate) fn pair() -> [Self; 2] {
        let ((latest_a, latest_rx_b), (latest_b, latest_rx_a)) = (latest(), latest());
        let ((frames_a, frames_rx_b), (frames_b, frames_rx_a)) = (frames(), frames());
        let [(messages_a, messages_rx_b), (messages_b, messages_rx_a)] =
            [RecordLane::Messages; 2].map(records);
        let [(bulk_a, bulk_rx_b), (bulk_b, bulk_rx_a)] = [RecordLane::Bulk; 2].map(records);
        [
            Self {
                latest: (latest_a, latest_rx_a),
                frames: (frames_a, frames_rx_a),
                messages: (messages_a, messages_rx_a),
                bulk: (bulk_a, bulk_rx_a),
            },
            Self {
                latest: (latest_b, latest_rx_b),
                frames: (frames_b, frames_rx_b),
                messages: (messages_b, messages_rx_b),
                bulk: (bulk_b, bulk_rx_b),
            },
        ]
    }
}

/// A latest lane in one direction.
fn latest<P: Protocol>() -> (LatestTx<P>, LatestRx<P>) {
    let (cell, view) = watch::channel(Cell { value: None, number: 0, closed: None });
    (LatestTx { cell }, LatestRx { view, seen: 0 })
}

/// A frames lane in one direction.
fn frames<P: Protocol>() -> (FrameTx<P>, FrameRx<P>) {
    let (queue, messages) = queue::queue(QUEUE);
    (FrameTx { queue, staged: VecDeque::new() }, FrameRx { messages, closed: None })
}

/// The cell of the latest lane.
#[derive(Debug)]
struct Cell<P: Protocol> {
    value: Option<P::Latest>,
    /// The number of published values: it tells the reader whether it has seen this one.
    number: u64,
    closed: Option<CloseReason>,
}

#[derive(Debug)]
pub(crate) struct LatestTx<P: Protocol> {
    cell: watch::Sender<Cell<P>>,
}

impl<P: Protocol> LatestTx<P> {
    pub(crate) fn publish(&mut self, value: P::Latest, shared: &Shared) -> Result<(), LaneSendError> {
        if self.cell.is_closed() {
            return Err(LaneSendError::Lost(Loss::Closed));
        }
        shared.counters.sent.count(Kind::Latest, P::Latest::SIZE);
        self.cell.send_modify(|cell| {
            cell.value = Some(value);
            cell.number += 1;
        });
        Ok(())
    }

    pub(crate) fn close(&mut self, reason: CloseReason, shared: &Shared) -> Result<(), LaneSendError> {
        if self.cell.is_closed() {
            return Err(LaneSendError::Lost(Loss::Closed));
        }
        shared.counters.sent.count(Kind::Close, 0);
        self.cell.send_modify(|cell| cell.closed = Some(reason));
        Ok(())
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx<P: Protocol> {
    view: watch::Receiver<Cell<P>>,
    seen: u64,
}

impl<P: Protocol> LatestRx<P> {
    pub(crate) fn try_latest(&mut self, shared: &Shared) -> Result<Option<P::Latest>, LaneError> {
        // Asked before the look into the cell, so that a value published before the end is not missed.
        let ended = self.view.has_changed().is_err();
        let cell = self.view.borrow_and_update();
        if cell.number != self.seen {
            self.seen = cell.number;
            shared.counters.received.count(Kind::Latest, P::Latest::SIZE);
            return Ok(cell.value.clone());
        }
        match &cell.closed {
            Some(reason) => Err(LaneError::Closed(reason.clone())),
            None if ended => Err(LaneError::Lost(Loss::Closed)),
            None => Ok(None),
        }
    }

    pub(crate) async fn latest(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<P::Latest, LaneError> {
        loop {
            if let Some(value) = self.try_latest(shared)? {
                return Ok(value);
            }
            // The next look finds an end.
            let _changed = timeouts.wait(by, self.view.changed()).await.map_err(LaneError::Expired)?;
        }
    }
}

/// The messages of the frames lane.
#[derive(Debug)]
enum Message<P: Protocol> {
    Event(FrameEvent<P>),
    Close(CloseReason),
}

#[derive(Debug)]
pub(crate) struct FrameTx<P: Protocol> {
    queue: queue::Sender<Message<P>>,
    staged: VecDeque<Message<P>>,
}

impl<P: Protocol> FrameTx<P> {
    pub(crate) fn stage(&mut self, event: FrameEvent<P>, shared: &Shared) {
        let (kind, bytes) = weight(&event, shared);
        shared.counters.sent.count(kind, bytes);
        self.staged.push_back(Message::Event(event));
    }

    pub(crate) fn stage_close(&mut self, reason: CloseReason, shared: &Shared) {
        shared.counters.sent.count(Kind::Close, 0);
        self.staged.push_back(Message::Close(reason));
    }

    pub(crate) async fn send_staged(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        while !self.staged.is_empty() {
            let sent = timeouts.wait(None, self.queue.send(&mut self.staged)).await;
            sent.map_err(|_| LaneSendError::Stalled)?.map_err(|_gone| LaneSendError::Lost(Loss::Closed))?;
        }
        Ok(())
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx<P: Protocol> {
    messages: queue::Receiver<Message<P>>,
    closed: Option<CloseReason>,
}

impl<P: Protocol> FrameRx<P> {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FrameEvent<P>, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        let message = timeouts.wait(by, self.messages.recv()).await.map_err(LaneError::Expired)?;
        match message.ok_or(LaneError::Lost(Loss::Closed))? {
            Message::Close(reason) => {
                shared.counters.received.count(Kind::Close, 0);
                self.closed = Some(reason.clone());
                Err(LaneError::Closed(reason))
            }
            Message::Event(event) => {
                let (kind, bytes) = weight(&event, shared);
                shared.counters.received.count(kind, bytes);
                Ok(event)
            }
        }
    }
}

/// The kind and payload size of an event if it were encoded.
fn weight<P: Protocol>(event: &FrameEvent<P>, shared: &Shared) -> (Kind, usize) {
    match event {
        FrameEvent::Begin(_) => (Kind::Begin, shared.format.begin()),
        FrameEvent::Batch(batch) => (Kind::Batch, batch.as_bytes().len()),
        FrameEvent::End(_) => (Kind::End, 16),
    }
}
