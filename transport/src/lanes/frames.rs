//! The frames lane: begin, batches, end.

use bytes::Bytes;
use trimaran_wire::{
    Batch, BatchDecoder, BatchEncoder, Batching, CloseReason, Delivery, Fixed, FrameAssembler, FrameEnd,
    FrameEvent, FrameMessage, FrameNumber, FrameOrderError, FrameOutcome, FrameStart, FrameStep, FrameWriter,
    Item, Protocol, to_bytes,
};

use crate::error::{LaneError, LaneSendError, ProtocolError, RecvError, SendError};
use crate::inproc::lanes as inproc;
use crate::lanes::shared::{Shared, at_once};
#[cfg(feature = "quic")]
use crate::quic::frames as quic;
use crate::rates::Messages;
use crate::stream::frames as stream;
use crate::timeouts::Timeouts;
use crate::trace::{FrameSpan, Way};
use crate::transport::Capabilities;
#[cfg(feature = "udp")]
use crate::udp::frames as udp;
use trimaran_net::Instant;

/// Sends frames: `begin`, any number of `push`, `finish`.
///
/// Each call waits until the peer has room (backpressure), within the link's timeout. A call's data counts as
/// taken even if its future is dropped: the next call sends it.
#[derive(Debug)]
pub struct FrameSender<P: Protocol> {
    writer: FrameWriter<P::Item>,
    /// Set if items may travel coded.
    encoder: Option<Box<dyn BatchEncoder<P::Item>>>,
    lane: FrameTx<P>,
    shared: Shared,
    timeouts: Timeouts,
    span: FrameSpan,
}

/// Receives frames.
#[derive(Debug)]
pub struct FrameReceiver<P: Protocol> {
    assembler: FrameAssembler,
    /// Set if items may come coded.
    decoder: Option<Box<dyn BatchDecoder<P::Item>>>,
    lane: FrameRx<P>,
    shared: Shared,
    timeouts: Timeouts,
    rate: Messages,
    span: FrameSpan,
}

#[derive(Debug)]
pub(crate) enum FrameTx<P: Protocol> {
    Local(inproc::FrameTx<P>),
    Wire(WireFrameTx),
}

#[derive(Debug)]
pub(crate) enum FrameRx<P: Protocol> {
    Local(inproc::FrameRx<P>),
    Wire(WireFrameRx),
}

over_bytes!(WireFrameTx: FrameTx);
over_bytes!(WireFrameRx: FrameRx);

impl<P: Protocol> FrameSender<P> {
    pub(crate) fn new(
        Batching { size, coded }: Batching,
        max_frame: u32,
        capabilities: Capabilities,
        lane: FrameTx<P>,
        shared: Shared,
        timeouts: Timeouts,
    ) -> Self {
        let delivery = if capabilities.reliable { Delivery::Ordered } else { Delivery::Lossy };
        // Nothing is coded within one process.
        let encoder = match lane {
            FrameTx::Wire(_) if coded => P::encoder(delivery),
            _ => None,
        };
        let writer = FrameWriter::new(size).of_at_most(max_frame);
        Self { writer, encoder, lane, shared, timeouts, span: FrameSpan::none() }
    }

    /// Begins a frame; its header has been sent when this returns.
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// If the peer is gone or stalls, a frame is open, or the frame's number is not above the last one's.
    pub async fn begin(&mut self, start: FrameStart<P::Header>) -> Result<(), SendError> {
        let frame = start.frame;
        self.writer.begin(frame).map_err(|e| self.order(e))?;
        self.span = FrameSpan::open(Way::Sent, frame, &self.shared);
        if let Some(encoder) = &mut self.encoder {
            #[cfg(feature = "udp")]
            if let FrameTx::Wire(WireFrameTx::Udp(lane)) = &self.lane
                && let Some(confirmed) = lane.confirmed()
            {
                encoder.confirmed(confirmed);
            }
            encoder.begin(frame);
        }
        match &mut self.lane {
            FrameTx::Local(lane) => lane.stage(FrameEvent::Begin(start), &self.shared),
            FrameTx::Wire(lane) => {
                let begin = FrameMessage::Begin { frame, header: to_bytes(&start.header) };
                whichever!(WireFrameTx: lane, lane => lane.stage(begin, &self.shared));
            }
        }
        self.send_staged().await
    }

    /// Adds items to the open frame. All batches that this fills are sent together, in one write if there is
    /// room. A remainder waits for more items, [`FrameSender::flush`] or [`FrameSender::finish`].
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// If the peer is gone or stalls, no frame is open, or the frame would exceed its limit of items.
    pub async fn push(&mut self, items: &[P::Item]) -> Result<(), SendError> {
        let Self { writer, encoder, lane, shared, .. } = self;
        writer
            .push(items, |message| stage(encoder.as_deref_mut(), lane, message, shared))
            .map_err(|e| self.order(e))?;
        self.shared.counters.sent.count_items(items.len());
        self.send_staged().await
    }

    /// Sends waiting items without waiting for a full batch.
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// As [`FrameSender::push`].
    pub async fn flush(&mut self) -> Result<(), SendError> {
        let Self { writer, encoder, lane, shared, .. } = self;
        writer
            .flush(|message| stage(encoder.as_deref_mut(), lane, message, shared))
            .map_err(|e| self.order(e))?;
        self.send_staged().await
    }

    /// Ends the open frame: sends waiting items and the end (EOF). Returns the frame's totals.
    ///
    /// Dropping the future undoes nothing: the frame has ended, and the next call sends the rest.
    ///
    /// # Errors
    /// As [`FrameSender::push`].
    pub async fn finish(&mut self) -> Result<FrameEnd, SendError> {
        let Self { writer, encoder, lane, shared, .. } = self;
        let end = writer
            .finish(|message| stage(encoder.as_deref_mut(), lane, message, shared))
            .map_err(|e| self.order(e))?;
        self.send_staged().await?;
        self.span.close(Way::Sent, end.items, true, &self.shared);
        Ok(end)
    }

    /// Closes this lane. A frame that is open stays unfinished.
    ///
    /// If the future is dropped, the close may not be sent.
    ///
    /// # Errors
    /// If the peer is gone already, or takes nothing within the link's timeout.
    pub async fn close(mut self, reason: CloseReason) -> Result<(), SendError> {
        match &mut self.lane {
            FrameTx::Local(lane) => lane.stage_close(reason, &self.shared),
            FrameTx::Wire(lane) => whichever!(WireFrameTx: lane, lane => lane.stage(reason, &self.shared)),
        }
        self.send_staged().await?;
        match &mut self.lane {
            FrameTx::Local(_) => Ok(()),
            FrameTx::Wire(lane) => {
                whichever!(WireFrameTx: lane, lane => lane.close(&mut self.timeouts).await)
            }
        }
        .map_err(|e| self.error(e))
    }

    async fn send_staged(&mut self) -> Result<(), SendError> {
        match &mut self.lane {
            FrameTx::Local(lane) => lane.send_staged(&mut self.timeouts).await,
            FrameTx::Wire(lane) => {
                whichever!(WireFrameTx: lane, lane => lane.send_staged(&mut self.timeouts).await)
            }
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneSendError) -> SendError {
        error.sending(&self.shared.peer, self.timeouts.limit())
    }

    fn order(&self, cause: FrameOrderError) -> SendError {
        SendError::Order { peer: self.shared.peer.clone(), cause }
    }
}

/// Queues a message of the frame writer at this side.
fn stage<P: Protocol>(
    encoder: Option<&mut (dyn BatchEncoder<P::Item> + 'static)>,
    lane: &mut FrameTx<P>,
    message: FrameMessage,
    shared: &Shared,
) {
    match lane {
        FrameTx::Local(lane) => match message {
            FrameMessage::Batch(bytes) => {
                // A writer's batches are valid.
                if let Ok(batch) = Batch::new(bytes) {
                    lane.stage(FrameEvent::Batch(batch), shared);
                }
            }
            FrameMessage::End(end) => lane.stage(FrameEvent::End(FrameOutcome::Complete(end)), shared),
            _ => {}
        },
        FrameTx::Wire(lane) => {
            let message = coded(encoder, message);
            whichever!(WireFrameTx: lane, lane => lane.stage(message, shared));
        }
    }
}

/// The wire message for a frame message.
fn coded<I: Item>(
    encoder: Option<&mut (dyn BatchEncoder<I> + 'static)>,
    message: FrameMessage,
) -> FrameMessage {
    let Some(encoder) = encoder else { return message };
    match message {
        FrameMessage::Batch(bytes) => {
            let batch = Batch::new(bytes.clone()).ok();
            let shorter = batch.and_then(|batch| encoder.encode(&batch));
            shorter.map_or(FrameMessage::Batch(bytes), FrameMessage::Coded)
        }
        FrameMessage::End(end) => {
            encoder.end(&end);
            FrameMessage::End(end)
        }
        other => other,
    }
}

impl<P: Protocol> FrameReceiver<P> {
    pub(crate) fn new(
        max_frame: u32,
        lane: FrameRx<P>,
        shared: Shared,
        timeouts: Timeouts,
        rate: Messages,
    ) -> Self {
        let decoder = match lane {
            FrameRx::Wire(_) => P::decoder(max_frame),
            FrameRx::Local(_) => None,
        };
        let assembler = FrameAssembler::new(max_frame);
        Self { assembler, decoder, lane, shared, timeouts, rate, span: FrameSpan::none() }
    }

    /// Waits for the next event. Dropping the future loses nothing.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, broke the protocol, or sent nothing within the link's timeout.
    pub async fn recv(&mut self) -> Result<FrameEvent<P>, RecvError> {
        self.recv_until(None).await
    }

    /// As [`FrameReceiver::recv`], until `deadline` at most. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn recv_by(&mut self, deadline: Instant) -> Result<FrameEvent<P>, RecvError> {
        self.recv_until(Some(deadline)).await
    }

    /// The next event if it has arrived, without waiting: for callers that poll to avoid the cost of being
    /// woken. A peer that hangs is not noticed this way.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub fn try_recv(&mut self) -> Result<Option<FrameEvent<P>>, RecvError> {
        at_once(self.recv_until(None))
    }

    /// Discards everything until the lane ends, and returns how it ended.
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

    async fn recv_until(&mut self, by: Option<Instant>) -> Result<FrameEvent<P>, RecvError> {
        let event = match &mut self.lane {
            FrameRx::Local(lane) => lane.next(by, &self.shared, &mut self.timeouts).await,
            FrameRx::Wire(lane) => {
                let (shared, timeouts) = (&self.shared, &mut self.timeouts);
                let message = whichever!(WireFrameRx: lane, lane => lane.next(by, shared, timeouts).await);
                let rate = &mut self.rate;
                message.and_then(|message| {
                    rate.count(|| self.timeouts.now()).map_err(|e| {
                        self.shared.counters.flooded();
                        LaneError::Protocol(ProtocolError::TooMany(e))
                    })?;
                    decoded::<P>(self.decoder.as_deref_mut(), message)
                })
            }
        };
        let event = event
            .and_then(|event| self.judged(event))
            .map_err(|e| e.receiving(&self.shared.peer, self.timeouts.limit()))?;
        match &event {
            FrameEvent::Begin(start) => {
                self.span = FrameSpan::open(Way::Received, start.frame, &self.shared);
            }
            FrameEvent::Batch(batch) => self.shared.counters.received.count_items(batch.count()),
            FrameEvent::End(FrameOutcome::Complete(end)) => {
                self.span.close(Way::Received, end.items, true, &self.shared);
            }
            FrameEvent::End(FrameOutcome::Incomplete { received, .. }) => {
                self.span.close(Way::Received, *received, false, &self.shared);
            }
        }
        Ok(event)
    }

    /// Checks that the event may come now. The outcome of a frame is decided here.
    fn judged(&mut self, event: FrameEvent<P>) -> Result<FrameEvent<P>, LaneError> {
        let step = match &event {
            FrameEvent::Begin(start) => FrameStep::Begin(start.frame),
            FrameEvent::Batch(batch) => FrameStep::Batch { items: batch.count(), bytes: batch.as_bytes() },
            FrameEvent::End(FrameOutcome::Complete(end)) => FrameStep::End(*end),
            // No peer sends it so.
            FrameEvent::End(FrameOutcome::Incomplete { .. }) => return Ok(event),
        };
        let outcome = self.assembler.take(step).map_err(|e| LaneError::Protocol(ProtocolError::Frame(e)))?;
        Ok(outcome.map_or(event, FrameEvent::End))
    }
}

/// The event in `message`. An end counts as that of a complete frame until it is checked.
fn decoded<P: Protocol>(
    decoder: Option<&mut (dyn BatchDecoder<P::Item> + 'static)>,
    message: FrameMessage,
) -> Result<FrameEvent<P>, LaneError> {
    let broken = |e| LaneError::Protocol(e);
    Ok(match message {
        FrameMessage::Begin { frame, header } => {
            let header = P::Header::read(&header).map_err(|e| broken(ProtocolError::Value(Box::new(e))))?;
            if let Some(decoder) = decoder {
                decoder.begin(frame);
            }
            FrameEvent::Begin(FrameStart { frame, header })
        }
        FrameMessage::Batch(bytes) => {
            let batch = batch(bytes)?;
            if let Some(decoder) = decoder {
                decoder.plain(&batch);
            }
            FrameEvent::Batch(batch)
        }
        FrameMessage::Coded(bytes) => match decoder {
            Some(decoder) => {
                FrameEvent::Batch(decoder.decode(&bytes).map_err(|e| broken(ProtocolError::Coded(e)))?)
            }
            None => return Err(broken(ProtocolError::NotCoded)),
        },
        FrameMessage::End(end) => {
            if let Some(decoder) = decoder {
                decoder.end(&end);
            }
            FrameEvent::End(FrameOutcome::Complete(end))
        }
    })
}

/// The bytes of a batch, already known to be whole items.
fn batch<I: Item>(bytes: Bytes) -> Result<Batch<I>, LaneError> {
    Batch::new(bytes).map_err(|e| LaneError::Protocol(ProtocolError::Batch(e)))
}
