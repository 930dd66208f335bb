//! Sends frames.

use trimaran_wire::{
    Batch, BatchEncoder, Batching, CloseReason, Delivery, Format, FrameEnd, FrameEvent, FrameMessage,
    FrameNumber, FrameOrderError, FrameOutcome, FrameStart, FrameWriter, Item, Protocol, to_bytes,
};

use super::published::PublishedFrame;
use super::shared::{LastShared, SharedFrame};
use crate::error::SendError;
use crate::lanes::ends::{AnyTx, Sender, at_once, lost};
use crate::lanes::trace::{FrameSpan, Way};
use crate::transport::Capabilities;

/// Sends frames: `begin`, any number of `push`, `finish`; or `send` for a whole one.
///
/// Each call waits until the peer has room (backpressure), within the link's timeout. A call's data counts as
/// taken even if its future is dropped: the next call sends it.
#[derive(Debug)]
pub struct FrameSender<P: Protocol> {
    writer: FrameWriter<P::Item>,
    format: Format,
    /// Set if items may travel coded.
    coding: Option<Delivery>,
    /// Codes the frames that this half puts together itself.
    encoder: Option<Box<dyn BatchEncoder<P::Item>>>,
    /// The last frame, if it was a shared one.
    last_shared: Option<LastShared>,
    lane: Sender<FrameEvent<P>, FrameMessage>,
    span: FrameSpan,
}

impl<P: Protocol> FrameSender<P> {
    pub(crate) fn new(
        Batching { size, coded }: Batching,
        max_frame: u32,
        capabilities: Capabilities,
        format: &Format,
        lane: Sender<FrameEvent<P>, FrameMessage>,
    ) -> Self {
        let delivery = if capabilities.reliable { Delivery::Ordered } else { Delivery::Lossy };
        // Nothing is coded within one process.
        let encoder = match lane.lane {
            AnyTx::Wire(_) if coded => P::encoder(delivery),
            _ => None,
        };
        let writer = FrameWriter::new(size).of_at_most(max_frame).of_items(format.item);
        let (format, coding) = (*format, encoder.is_some().then_some(delivery));
        Self { writer, format, coding, encoder, last_shared: None, lane, span: FrameSpan::none() }
    }

    /// Begins a frame; its header has been sent when this returns.
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// If the peer is gone or stalls, a frame is open, or the frame's number is not above the last one's.
    pub async fn begin(&mut self, start: FrameStart<P::Header>) -> Result<(), SendError> {
        self.stage_begin(start)?;
        self.lane.send_staged().await
    }

    fn stage_begin(&mut self, start: FrameStart<P::Header>) -> Result<(), SendError> {
        let frame = start.frame;
        self.write(|writer, _| writer.begin(frame))?;
        self.last_shared = None;
        if self.encoder.is_none() {
            // Shared frames came before: their coding is not known here.
            self.encoder = self.coding.and_then(P::encoder);
        }
        self.span = FrameSpan::open(Way::Sent, frame, self.format.begin(), &self.lane.shared);
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
        .map_err(|loss| lost(loss, &self.lane.shared))
    }

    /// Adds items to the open frame. All batches that this fills are sent together, in one write if there is
    /// room. A remainder waits for more items, [`FrameSender::flush`] or [`FrameSender::finish`].
    ///
    /// Dropping the future undoes nothing: the next call sends it.
    ///
    /// # Errors
    /// If the peer is gone or stalls, no frame is open, or the frame would exceed its limit of items.
    pub async fn push(&mut self, items: &[P::Item]) -> Result<(), SendError> {
        self.stage_items(items)?;
        self.lane.send_staged().await
    }

    fn stage_items(&mut self, items: &[P::Item]) -> Result<(), SendError> {
        self.write(|writer, emit| writer.push(items, emit))?;
        let count = items.len() * P::Item::SIZE / self.format.item;
        self.lane.shared.counters.sent.count_items(count);
        Ok(())
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

    /// Sends a whole frame: begins it, adds `items` and ends it. Returns its totals.
    ///
    /// Dropping the future undoes nothing: the next call sends the rest.
    ///
    /// # Errors
    /// As [`FrameSender::begin`], or if there are more items than a frame may have; then nothing of it is
    /// sent.
    pub async fn send(
        &mut self,
        start: FrameStart<P::Header>,
        items: &[P::Item],
    ) -> Result<FrameEnd, SendError> {
        self.write(|writer, _| writer.check(start.frame, items))?;
        self.stage_begin(start)?;
        self.stage_items(items)?;
        self.finish().await
    }

    /// Sends a whole frame that was put together for many links, under a number of this link. Returns its
    /// totals.
    ///
    /// Dropping the future undoes nothing: the next call sends the rest.
    ///
    /// # Errors
    /// As [`FrameSender::begin`].
    pub async fn send_shared(
        &mut self,
        frame: &SharedFrame<P>,
        number: FrameNumber,
    ) -> Result<FrameEnd, SendError> {
        let last = LastShared::after(self.last_shared.take(), frame, number);
        let first = last.first();
        if frame.is_coded_for_others_than(first) && self.takes_coded() {
            frame.ask_for_new_coding();
        }
        self.stage_whole(frame.frame(), number, first)?;
        self.last_shared = Some(last);
        self.lane.send_staged().await?;
        Ok(frame.frame().end_as(number))
    }

    /// Whether a frame may be coded against any frame before it.
    fn takes_coded(&self) -> bool {
        self.coding == Some(Delivery::Ordered)
    }

    /// Stages a whole frame under this number, for a receiver that has every frame from `since`, in the
    /// frame's own numbers, to the one before.
    pub(crate) fn stage_whole(
        &mut self,
        frame: &PublishedFrame<P>,
        number: FrameNumber,
        since: FrameNumber,
    ) -> Result<(), SendError> {
        self.write(|writer, _| {
            writer.begin(number)?;
            writer.finish(|_| {})
        })?;
        (self.encoder, self.last_shared) = (None, None);
        let coded_since = Some(since).filter(|_| self.takes_coded());
        let shared = &self.lane.shared;
        self.span = FrameSpan::open(Way::Sent, number, self.format.begin(), shared);
        let item = self.format.item;
        match &mut self.lane.lane {
            AnyTx::Local(lane) => frame.events(number, item).try_for_each(|event| lane.stage(event)),
            AnyTx::Wire(lane) => {
                frame.messages(number, coded_since).try_for_each(|message| lane.stage(message))
            }
        }
        .map_err(|loss| lost(loss, shared))?;
        shared.counters.sent.count_items(frame.items() as usize);
        self.span.close(Way::Sent, frame.items(), true, shared);
        Ok(())
    }

    /// Passes on what is staged, as far as there is room now. Returns whether that was all.
    pub(crate) fn try_send_staged(&mut self) -> Result<bool, SendError> {
        at_once(self.lane.send_staged()).map(|sent| sent.is_some())
    }

    /// Passes on what is staged, and waits for room.
    pub(crate) async fn send_staged(&mut self) -> Result<(), SendError> {
        self.lane.send_staged().await
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
        let Self { writer, format, encoder, lane: Sender { lane, shared, .. }, .. } = self;
        let mut staged = Ok(());
        let written = write(writer, &mut |message| {
            let stage = match lane {
                AnyTx::Local(lane) => local(message, format.item).map_or(Ok(()), |event| lane.stage(event)),
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
fn local<P: Protocol>(message: FrameMessage, item: usize) -> Option<FrameEvent<P>> {
    match message {
        // A writer's batches are valid.
        FrameMessage::Batch(bytes) => Batch::of(bytes, item).ok().map(FrameEvent::Batch),
        FrameMessage::End(end) => Some(FrameEvent::End(FrameOutcome::Complete(end))),
        FrameMessage::Begin { .. } | FrameMessage::Coded(_) => None,
    }
}

/// The wire message for a frame message.
pub(super) fn coded<I: Item>(
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
