//! The frames lane: begin, batches, end.

use trimaran_wire::{
    Batch, BatchDecoder, BatchEncoder, Batching, CloseReason, Delivery, Fixed, Format, FrameAssembler,
    FrameEnd, FrameEvent, FrameMessage, FrameNumber, FrameOrderError, FrameOutcome, FrameStart, FrameStep,
    FrameWriter, Item, Protocol, to_bytes,
};

use super::ends::{AnyRx, AnyTx, Came, Receiver, Sender, at_once, lost};
use super::trace::{FrameSpan, Way};
use crate::error::{LaneError, ProtocolError, RecvError, SendError};
use crate::rates::Messages;
use crate::transport::Capabilities;
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
    lane: Sender<FrameEvent<P>, FrameMessage>,
    span: FrameSpan,
}

/// Receives frames.
#[derive(Debug)]
pub struct FrameReceiver<P: Protocol> {
    assembler: FrameAssembler,
    /// Set if items may come coded.
    decoder: Option<Box<dyn BatchDecoder<P::Item>>>,
    lane: Receiver<FrameEvent<P>, FrameMessage>,
    rate: Messages,
    span: FrameSpan,
}

impl<P: Protocol> FrameSender<P> {
    pub(crate) fn new(
        Batching { size, coded }: Batching,
        max_frame: u32,
        capabilities: Capabilities,
        lane: Sender<FrameEvent<P>, FrameMessage>,
    ) -> Self {
        let delivery = if capabilities.reliable { Delivery::Ordered } else { Delivery::Lossy };
        // Nothing is coded within one process.
        let encoder = match lane.lane {
            AnyTx::Wire(_) if coded => P::encoder(delivery),
            _ => None,
        };
        let writer = FrameWriter::new(size).of_at_most(max_frame);
        Self { writer, encoder, lane, span: FrameSpan::none() }
    }

    /// Begins a frame; its header has been sent when this returns.
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// If the peer is gone or stalls, a frame is open, or the frame's number is not above the last one's.
    pub async fn begin(&mut self, start: FrameStart<P::Header>) -> Result<(), SendError> {
        let frame = start.frame;
        self.write(|writer, _| writer.begin(frame))?;
        self.span = FrameSpan::open(Way::Sent, frame, Format::of::<P>().begin(), &self.lane.shared);
        match &mut self.lane.lane {
            AnyTx::Local(lane) => lane.stage(FrameEvent::Begin(start)),
            AnyTx::Wire(lane) => {
                if let Some(encoder) = &mut self.encoder {
                    if let Some(confirmed) = lane.confirmed() {
                        encoder.confirmed(confirmed);
                    }
                    encoder.begin(frame);
                }
                lane.stage(FrameMessage::Begin { frame, header: to_bytes(&start.header) })
            }
        }
        .map_err(|loss| lost(loss, &self.lane.shared))?;
        self.lane.send_staged().await
    }

    /// Adds items to the open frame. All batches that this fills are sent together, in one write if there is
    /// room. A remainder waits for more items, [`FrameSender::flush`] or [`FrameSender::finish`].
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// If the peer is gone or stalls, no frame is open, or the frame would exceed its limit of items.
    pub async fn push(&mut self, items: &[P::Item]) -> Result<(), SendError> {
        self.write(|writer, emit| writer.push(items, emit))?;
        self.lane.shared.counters.sent.count_items(items.len());
        self.lane.send_staged().await
    }

    /// Sends waiting items without waiting for a full batch.
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// As [`FrameSender::push`].
    pub async fn flush(&mut self) -> Result<(), SendError> {
        self.write(|writer, emit| writer.flush(emit))?;
        self.lane.send_staged().await
    }

    /// Ends the open frame: sends waiting items and the end (EOF). Returns the frame's totals.
    ///
    /// Dropping the future undoes nothing: the frame has ended, and the next call sends the rest.
    ///
    /// # Errors
    /// As [`FrameSender::push`].
    pub async fn finish(&mut self) -> Result<FrameEnd, SendError> {
        let end = self.write(|writer, emit| writer.finish(emit))?;
        self.lane.send_staged().await?;
        self.span.close(Way::Sent, end.items, true, &self.lane.shared);
        Ok(end)
    }

    /// Closes this lane. A frame that is open stays unfinished.
    ///
    /// If the future is dropped, the close may not be sent.
    ///
    /// # Errors
    /// If the peer is gone already, or takes nothing within the link's timeout.
    pub async fn close(mut self, reason: CloseReason) -> Result<(), SendError> {
        self.lane.stage_close(reason)?;
        self.lane.send_staged().await?;
        self.lane.closed().await
    }

    /// Stages the messages that `write` emits.
    fn write<T>(
        &mut self,
        write: impl FnOnce(&mut FrameWriter<P::Item>, &mut dyn FnMut(FrameMessage)) -> Result<T, FrameOrderError>,
    ) -> Result<T, SendError> {
        let Self { writer, encoder, lane: Sender { lane, shared, .. }, .. } = self;
        let mut staged = Ok(());
        let written = write(writer, &mut |message| {
            let stage = match lane {
                AnyTx::Local(lane) => local(message).map_or(Ok(()), |event| lane.stage(event)),
                AnyTx::Wire(lane) => lane.stage(coded(encoder.as_deref_mut(), message)),
            };
            if let Err(loss) = stage {
                staged = Err(loss);
            }
        });
        let written = written.map_err(|cause| SendError::Order { peer: shared.peer.clone(), cause })?;
        staged.map_err(|loss| lost(loss, shared))?;
        Ok(written)
    }
}

/// The event for a message of a writer, within this process.
fn local<P: Protocol>(message: FrameMessage) -> Option<FrameEvent<P>> {
    match message {
        // A writer's batches are valid.
        FrameMessage::Batch(bytes) => Batch::new(bytes).ok().map(FrameEvent::Batch),
        FrameMessage::End(end) => Some(FrameEvent::End(FrameOutcome::Complete(end))),
        FrameMessage::Begin { .. } | FrameMessage::Coded(_) => None,
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
    pub(crate) fn new(max_frame: u32, lane: Receiver<FrameEvent<P>, FrameMessage>, rate: Messages) -> Self {
        let decoder = match lane.lane {
            AnyRx::Wire(_) => P::decoder(max_frame),
            AnyRx::Local(_) => None,
        };
        let assembler = FrameAssembler::new(max_frame);
        Self { assembler, decoder, lane, rate, span: FrameSpan::none() }
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
        let event = match self.lane.next(by).await? {
            Came::Local(event) => Ok(event),
            Came::Wire(message) => {
                let counted = self.lane.count(&mut self.rate);
                counted.and_then(|()| decoded::<P>(self.decoder.as_deref_mut(), message))
            }
        };
        let shared = &self.lane.shared;
        let event = event
            .and_then(|event| judged(&mut self.assembler, event))
            .map_err(|e| LaneError::Protocol(e).receiving(&shared.peer))?;
        match &event {
            FrameEvent::Begin(start) => {
                self.span = FrameSpan::open(Way::Received, start.frame, Format::of::<P>().begin(), shared);
            }
            FrameEvent::Batch(batch) => shared.counters.received.count_items(batch.count()),
            FrameEvent::End(FrameOutcome::Complete(end)) => {
                self.span.close(Way::Received, end.items, true, shared);
            }
            FrameEvent::End(FrameOutcome::Incomplete { received, .. }) => {
                self.span.close(Way::Received, *received, false, shared);
            }
        }
        Ok(event)
    }
}

/// Checks that the event may come now. The outcome of a frame is decided here.
fn judged<P: Protocol>(
    assembler: &mut FrameAssembler,
    event: FrameEvent<P>,
) -> Result<FrameEvent<P>, ProtocolError> {
    let step = match &event {
        FrameEvent::Begin(start) => FrameStep::Begin(start.frame),
        FrameEvent::Batch(batch) => FrameStep::Batch { items: batch.count(), bytes: batch.as_bytes() },
        FrameEvent::End(FrameOutcome::Complete(end)) => FrameStep::End(*end),
        // No peer sends it so.
        FrameEvent::End(FrameOutcome::Incomplete { .. }) => return Ok(event),
    };
    let outcome = assembler.take(step).map_err(ProtocolError::Frame)?;
    Ok(outcome.map_or(event, FrameEvent::End))
}

/// The event in `message`. An end counts as that of a complete frame until it is checked.
fn decoded<P: Protocol>(
    decoder: Option<&mut (dyn BatchDecoder<P::Item> + 'static)>,
    message: FrameMessage,
) -> Result<FrameEvent<P>, ProtocolError> {
    Ok(match message {
        FrameMessage::Begin { frame, header } => {
            let header = P::Header::read(&header).map_err(|e| ProtocolError::Value(Box::new(e)))?;
            if let Some(decoder) = decoder {
                decoder.begin(frame);
            }
            FrameEvent::Begin(FrameStart { frame, header })
        }
        FrameMessage::Batch(bytes) => {
            let batch = Batch::new(bytes).map_err(ProtocolError::Batch)?;
            if let Some(decoder) = decoder {
                decoder.plain(&batch);
            }
            FrameEvent::Batch(batch)
        }
        FrameMessage::Coded(bytes) => {
            let decoder = decoder.ok_or(ProtocolError::NotCoded)?;
            FrameEvent::Batch(decoder.decode(&bytes).map_err(ProtocolError::Coded)?)
        }
        FrameMessage::End(end) => {
            if let Some(decoder) = decoder {
                decoder.end(&end);
            }
            FrameEvent::End(FrameOutcome::Complete(end))
        }
    })
}
