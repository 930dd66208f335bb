//! The frames lane: begin, ids, end.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use trimaran_proto::{
    Delivery, DrawableId, FrameAssembler, FrameEnd, FrameEvent, FrameMessage, FrameNumber, FrameOrderError,
    FrameOutcome, FrameStart, FrameStats, FrameWriter, Goodbye, IdCoding, IdDecoder, IdEncoder, Kind, Lane,
    Message,
};

use crate::error::{LaneError, LaneSendError, ProtocolError, misplaced};
use crate::link::{Batching, Capabilities, Shared};
use crate::patience::Patience;
use crate::rates::Messages;
use crate::trace::{FrameSpan, Way};
use crate::{RecvError, SendError, inproc, quic, stream, udp};
use trimaran_net::Instant;

/// Sends frames: `begin`, any number of `push`, `finish`.
///
/// Each call waits until the peer's side has room (backpressure), within the link's patience. What a call was
/// given counts as taken even when its future is dropped: the next call sends it.
#[derive(Debug)]
pub struct FrameSender {
    pub(crate) writer: FrameWriter,
    /// Where ids do not travel plain.
    pub(crate) encoder: Option<IdEncoder>,
    pub(crate) lane: FrameTx,
    pub(crate) shared: Shared,
    pub(crate) patience: Patience,
    span: FrameSpan,
}

/// Receives frames.
#[derive(Debug)]
pub struct FrameReceiver {
    pub(crate) assembler: FrameAssembler,
    /// Where ids need not travel plain.
    decoder: Option<IdDecoder>,
    pub(crate) lane: FrameRx,
    pub(crate) shared: Shared,
    pub(crate) patience: Patience,
    rate: Messages,
    span: FrameSpan,
}

#[derive(Debug)]
pub(crate) enum FrameTx {
    Inproc(inproc::FrameTx),
    Stream(stream::FrameTx),
    Quic(quic::FrameTx),
    Udp(udp::FrameTx),
}

#[derive(Debug)]
pub(crate) enum FrameRx {
    Inproc(inproc::FrameRx),
    Stream(stream::FrameRx),
    Quic(quic::FrameRx),
    Udp(udp::FrameRx),
}

impl FrameSender {
    pub(crate) fn new(
        Batching { size, coding }: Batching,
        max_frame: u32,
        capabilities: Capabilities,
        lane: FrameTx,
        shared: Shared,
        patience: Patience,
    ) -> Self {
        let delivery = if capabilities.reliable { Delivery::Ordered } else { Delivery::Lossy };
        // Nothing is coded within one process.
        let codes = !matches!(lane, FrameTx::Inproc(_));
        let encoder = (coding == IdCoding::Changes && codes).then(|| IdEncoder::new(delivery));
        let writer = FrameWriter::new(size).of_at_most(max_frame);
        Self { writer, encoder, lane, shared, patience, span: FrameSpan::none() }
    }

    /// Begins a frame; its camera is on its way when this returns.
    ///
    /// # Errors
    /// When the peer is gone or stalls, a frame is open, or the frame's number is not above the last one's.
    pub async fn begin(&mut self, start: FrameStart) -> Result<(), SendError> {
        let message = self.writer.begin(start).map_err(|e| self.order(e))?;
        self.span = FrameSpan::open(Way::Sent, start.frame, &self.shared);
        if let (Some(encoder), FrameTx::Udp(lane)) = (&mut self.encoder, &self.lane)
            && let Some(confirmed) = lane.confirmed()
        {
            encoder.confirm(confirmed);
        }
        self.lane.stage(coded(&mut self.encoder, message), &self.shared);
        self.send_staged().await
    }

    /// Adds ids to the open frame. All batches that this fills leave together, in one write where there is
    /// room; a remainder waits for more ids, [`FrameSender::flush`] or [`FrameSender::finish`].
    ///
    /// # Errors
    /// When the peer is gone or stalls, no frame is open, or the frame would have more ids than it may.
    pub async fn push(&mut self, ids: &[DrawableId]) -> Result<(), SendError> {
        let Self { writer, encoder, lane, shared, .. } = self;
        writer.push(ids, |message| lane.stage(coded(encoder, message), shared)).map_err(|e| self.order(e))?;
        self.shared.counters.sent.count_ids(ids.len());
        self.send_staged().await
    }

    /// Sends what waits, without waiting for a full batch.
    ///
    /// # Errors
    /// As [`FrameSender::push`].
    pub async fn flush(&mut self) -> Result<(), SendError> {
        let Self { writer, encoder, lane, shared, .. } = self;
        writer.flush(|message| lane.stage(coded(encoder, message), shared)).map_err(|e| self.order(e))?;
        self.send_staged().await
    }

    /// Ends the open frame: sends what waits and the end (EOF). Says what the frame had.
    ///
    /// # Errors
    /// As [`FrameSender::push`].
    pub async fn finish(&mut self) -> Result<FrameEnd, SendError> {
        let Self { writer, encoder, lane, shared, .. } = self;
        let end = writer
            .finish(|message| lane.stage(coded(encoder, message), shared))
            .map_err(|e| self.order(e))?;
        self.send_staged().await?;
        self.span.close(Way::Sent, end.ids, true, &self.shared);
        Ok(end)
    }

    /// Sends what this side did for a frame that is over.
    ///
    /// # Errors
    /// When the peer is gone or stalls, or a frame is open.
    pub async fn stats(&mut self, stats: &FrameStats) -> Result<(), SendError> {
        let message = self.writer.stats(*stats).map_err(|e| self.order(e))?;
        self.lane.stage(coded(&mut self.encoder, message), &self.shared);
        self.send_staged().await
    }

    /// Says goodbye on this lane. A frame that is open stays unfinished.
    ///
    /// # Errors
    /// When the peer is gone already, or takes nothing within the link's patience.
    pub async fn goodbye(mut self, reason: Goodbye) -> Result<(), SendError> {
        self.lane.stage(Message::Goodbye(reason), &self.shared);
        self.send_staged().await?;
        match &mut self.lane {
            FrameTx::Inproc(_) => Ok(()),
            FrameTx::Stream(lane) => lane.close(&mut self.patience).await,
            FrameTx::Quic(lane) => lane.close(&mut self.patience).await,
            FrameTx::Udp(lane) => lane.close(&mut self.patience).await,
        }
        .map_err(|e| self.error(e))
    }

    async fn send_staged(&mut self) -> Result<(), SendError> {
        match &mut self.lane {
            FrameTx::Inproc(lane) => lane.send_staged(&mut self.patience).await,
            FrameTx::Stream(lane) => lane.send_staged(&mut self.patience).await,
            FrameTx::Quic(lane) => lane.send_staged(&mut self.patience).await,
            FrameTx::Udp(lane) => lane.send_staged(&mut self.patience).await,
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneSendError) -> SendError {
        error.sending(self.shared.peer, self.patience.limit())
    }

    const fn order(&self, cause: FrameOrderError) -> SendError {
        SendError::Order { peer: self.shared.peer, cause }
    }
}

impl FrameTx {
    /// Puts a message in the queue of this side.
    fn stage(&mut self, message: Message, shared: &Shared) {
        match self {
            Self::Inproc(lane) => lane.stage(message, shared),
            Self::Stream(lane) => lane.stage(&message, shared),
            Self::Quic(lane) => lane.stage(&message, shared),
            Self::Udp(lane) => lane.stage(message, shared),
        }
    }
}

/// What travels for a message of a frame.
fn coded(encoder: &mut Option<IdEncoder>, message: FrameMessage) -> Message {
    match encoder {
        Some(encoder) => encoder.encode(message),
        None => Message::Frame(message),
    }
}

impl FrameReceiver {
    pub(crate) fn new(
        max_frame: u32,
        lane: FrameRx,
        shared: Shared,
        patience: Patience,
        rate: Messages,
    ) -> Self {
        let decoder = (!matches!(lane, FrameRx::Inproc(_))).then(|| IdDecoder::new(max_frame));
        let assembler = FrameAssembler::new(max_frame);
        Self { assembler, decoder, lane, shared, patience, rate, span: FrameSpan::none() }
    }

    /// Waits for what comes next. Dropping the future loses nothing.
    ///
    /// # Errors
    /// When the peer said goodbye, is lost, broke the protocol, or sent nothing within the link's patience.
    pub async fn recv(&mut self) -> Result<FrameEvent, RecvError> {
        self.recv_until(None).await
    }

    /// As [`FrameReceiver::recv`], until `deadline` at most.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn recv_by(&mut self, deadline: Instant) -> Result<FrameEvent, RecvError> {
        self.recv_until(Some(deadline)).await
    }

    /// What has arrived, if anything has, without waiting: for whoever polls rather than pay for being woken.
    /// A peer that hangs is not noticed this way.
    ///
    /// # Errors
    /// When the peer said goodbye, is lost, or broke the protocol.
    pub fn try_recv(&mut self) -> Result<Option<FrameEvent>, RecvError> {
        // Not bound by the runtime's budget of a task, which would show a full queue as an empty one to a
        // loop that never yields.
        let next = pin!(tokio::task::unconstrained(self.recv_until(None)));
        match next.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(event) => event.map(Some),
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

    /// The frame that has begun and not ended.
    #[must_use]
    pub fn open_frame(&self) -> Option<FrameNumber> {
        self.assembler.open_frame()
    }

    async fn recv_until(&mut self, by: Option<Instant>) -> Result<FrameEvent, RecvError> {
        let message = match &mut self.lane {
            FrameRx::Inproc(lane) => lane.next(by, &self.shared, &mut self.patience).await,
            FrameRx::Stream(lane) => lane.next(by, &self.shared, &mut self.patience).await,
            FrameRx::Quic(lane) => lane.next(by, &self.shared, &mut self.patience).await,
            FrameRx::Udp(lane) => lane.next(by, &self.shared, &mut self.patience).await,
        };
        let event = message
            .and_then(|message| {
                self.rate.count(|| self.patience.now()).map_err(|e| {
                    self.shared.counters.flooded();
                    LaneError::Protocol(ProtocolError::TooMany(e))
                })?;
                let message = decoded(&mut self.decoder, message)?;
                self.assembler.take(message).map_err(|e| LaneError::Protocol(ProtocolError::Frame(e)))
            })
            .map_err(|e| e.receiving(self.shared.peer, self.patience.limit()))?;
        match &event {
            FrameEvent::Begin(start) => {
                self.span = FrameSpan::open(Way::Received, start.frame, &self.shared);
            }
            FrameEvent::Ids(batch) => self.shared.counters.received.count_ids(batch.count()),
            FrameEvent::End(FrameOutcome::Complete(end)) => {
                self.span.close(Way::Received, end.ids, true, &self.shared);
            }
            FrameEvent::End(FrameOutcome::Incomplete { received, .. }) => {
                self.span.close(Way::Received, *received, false, &self.shared);
            }
            FrameEvent::Stats(_) => {}
        }
        Ok(event)
    }
}

/// The message of a frame that travelled as `message`.
fn decoded(decoder: &mut Option<IdDecoder>, message: Message) -> Result<FrameMessage, LaneError> {
    match (decoder, message) {
        (None, Message::Frame(message)) => Ok(message),
        (Some(decoder), Message::Frame(message)) => Ok(decoder.plain(message)),
        (Some(decoder), Message::Coded(coded)) => {
            decoder.coded(&coded).map_err(|e| LaneError::Protocol(e.into()))
        }
        (_, other) => Err(misplaced(other.kind(), Lane::Frames)),
    }
}

/// The kind and payload size of a message of the frames lane where messages have no headers of their own.
pub(crate) fn weight(message: &Message) -> (Kind, usize) {
    match message {
        Message::Frame(message) => frame_weight(message),
        Message::Coded(batch) => (Kind::Coded, batch.as_bytes().len()),
        _ => (message.kind(), 0),
    }
}

/// The same of a message that is of a frame.
pub(crate) fn frame_weight(message: &FrameMessage) -> (Kind, usize) {
    match message {
        FrameMessage::Begin(_) => (Kind::Begin, *Kind::Begin.lengths().end()),
        FrameMessage::Ids(batch) => (Kind::Ids, batch.as_bytes().len()),
        FrameMessage::End(_) => (Kind::End, *Kind::End.lengths().end()),
        FrameMessage::Stats(_) => (Kind::Stats, 0),
    }
}
