//! The events of frames as they come over a lane.

use std::sync::Arc;

use trimaran_net::{Instant, Net};
use trimaran_wire::{
    Batch, BatchDecoder, Fixed, Format, FrameAssembler, FrameEvent, FrameMessage, FrameOutcome, FrameStart,
    FrameStep, Protocol,
};

use crate::error::{LaneError, ProtocolError, RecvError};
use crate::lanes::ends::{AnyRx, Came, Receiver};
use crate::lanes::shared::Shared;
use crate::lanes::trace::{FrameSpan, Way};
use crate::rates::Messages;

/// Receives the events of all frames.
#[derive(Debug)]
pub(super) struct Events<P: Protocol> {
    assembler: FrameAssembler,
    format: Format,
    /// Set if items may come coded.
    decoder: Option<Box<dyn BatchDecoder<P::Item>>>,
    lane: Receiver<FrameEvent<P>, FrameMessage>,
    rate: Messages,
    span: FrameSpan,
}

impl<P: Protocol> Events<P> {
    pub(super) fn new(
        max_frame: u32,
        format: Format,
        lane: Receiver<FrameEvent<P>, FrameMessage>,
        rate: Messages,
    ) -> Self {
        let decoder = match lane.lane {
            AnyRx::Wire(_) => P::decoder(max_frame),
            AnyRx::Local(_) => None,
        };
        let assembler = FrameAssembler::new(max_frame);
        Self { assembler, format, decoder, lane, rate, span: FrameSpan::none() }
    }

    /// The clock of the link.
    pub(super) fn net(&self) -> &Arc<dyn Net> {
        self.lane.timeouts.net()
    }

    /// The peer and the counters.
    pub(super) const fn shared(&self) -> &Shared {
        &self.lane.shared
    }

    /// Waits for the next event, until `by` at most if that is given. Dropping the future loses nothing.
    pub(super) async fn recv(&mut self, by: Option<Instant>) -> Result<FrameEvent<P>, RecvError> {
        let item = self.format.item;
        let event = match self.lane.next(by).await? {
            Came::Local(event) => Ok(event),
            Came::Wire(message) => {
                let counted = self.lane.count(&mut self.rate);
                counted.and_then(|()| decoded::<P>(self.decoder.as_deref_mut(), item, message))
            }
        };
        let shared = &self.lane.shared;
        let event = event
            .and_then(|event| judged(&mut self.assembler, item, event))
            .map_err(|e| LaneError::Protocol(e).receiving(&shared.peer))?;
        match &event {
            FrameEvent::Begin(start) => {
                self.span = FrameSpan::open(Way::Received, start.frame, self.format.begin(), shared);
            }
            FrameEvent::Batch(batch) => shared.counters.received.count_items(batch.as_bytes().len() / item),
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

/// Checks that the event may come now; `item` is the size of an item on the wire. The outcome of a frame is
/// decided here.
fn judged<P: Protocol>(
    assembler: &mut FrameAssembler,
    item: usize,
    event: FrameEvent<P>,
) -> Result<FrameEvent<P>, ProtocolError> {
    let step = match &event {
        FrameEvent::Begin(start) => FrameStep::Begin(start.frame),
        FrameEvent::Batch(batch) => {
            FrameStep::Batch { items: batch.as_bytes().len() / item, bytes: batch.as_bytes() }
        }
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
    item: usize,
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
            let batch = Batch::of(bytes, item).map_err(ProtocolError::Batch)?;
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
