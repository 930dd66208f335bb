//! Receiving values from datagrams and from the control stream.

use std::fmt;
use std::sync::Arc;
use std::task::{Context, Poll};

use bytes::Bytes;
use futures_util::future::{BoxFuture, FutureExt};
use futures_util::stream::StreamExt;
use quinn::RecvStream;
use trimaran_wire::{
    CloseReason, DecodeError, DecodeFault, Decoder, FixedBytes, Format, Kind, Lane, Message, Numbered, Serial,
};

use crate::error::{LaneError, Loss, ProtocolError, misplaced};
use crate::lanes::half::{Half, Rx};
use crate::quic::carrier::{Carrier, loss};
use crate::quic::datagrams::Datagrams;
use crate::quic::frames::poll_fill;
use crate::stats::Counters;

pub(crate) struct LatestRx {
    carrier: Arc<Carrier>,
    counters: Arc<Counters>,
    format: Format,
    datagrams: Datagrams,
    control: RecvStream,
    decoder: Decoder,
    /// The newest number that was seen.
    last: Option<Serial>,
    /// Received, and not read.
    newest: Option<FixedBytes>,
    closed: Option<CloseReason>,
    /// Closes the connection, after both sides have closed the link.
    parting: Option<BoxFuture<'static, ()>>,
}

impl fmt::Debug for LatestRx {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LatestRx").field("last", &self.last).finish_non_exhaustive()
    }
}

impl LatestRx {
    pub(crate) fn new(
        carrier: &Arc<Carrier>,
        control: RecvStream,
        decoder: Decoder,
        (format, datagrams): (Format, Datagrams),
        counters: &Arc<Counters>,
    ) -> Self {
        Self {
            carrier: Arc::clone(carrier),
            counters: Arc::clone(counters),
            format,
            datagrams,
            control,
            decoder,
            last: None,
            newest: None,
            closed: None,
            parting: None,
        }
    }

    /// Ready when the lane has ended, and on every call after that.
    fn poll_control(&mut self, cx: &mut Context<'_>) -> Poll<LaneError> {
        if let Some(reason) = &self.closed {
            return Poll::Ready(LaneError::Closed(reason.clone()));
        }
        loop {
            match self.decoder.next_message() {
                Ok(Some(Message::Numbered(numbered))) => self.see(numbered),
                // The stream of a channel begins with one.
                Ok(Some(Message::KeepAlive)) => {}
                Ok(Some(Message::Close(reason))) => {
                    self.counters.received.count(Kind::Close, 0);
                    self.closed = Some(reason.clone());
                    return Poll::Ready(LaneError::Closed(reason));
                }
                Ok(Some(other)) => {
                    return Poll::Ready(misplaced(other.kind(), Lane::Latest));
                }
                Ok(None) => match poll_fill(&mut self.control, &mut self.decoder, cx) {
                    Poll::Ready(Ok(0)) => return Poll::Ready(LaneError::Lost(Loss::Closed)),
                    Poll::Ready(Ok(_)) => {}
                    Poll::Ready(Err(e)) => return Poll::Ready(e),
                    Poll::Pending => return Poll::Pending,
                },
                Err(e) => return Poll::Ready(LaneError::Protocol(ProtocolError::Decode(e))),
            }
        }
    }

    /// Takes a datagram.
    fn take(&mut self, bytes: &Bytes) -> Result<(), LaneError> {
        if let Some(numbered) = Numbered::read(bytes, self.format.latest) {
            self.counters.received.count(Kind::Latest, self.format.latest);
            self.see(numbered);
            return Ok(());
        }
        let kind = Kind::Numbered;
        let (least, most) = kind.lengths(&self.format).into_inner();
        let fault = DecodeFault::Length { kind, length: bytes.len(), least, most };
        Err(LaneError::Protocol(ProtocolError::Decode(DecodeError { offset: 0, fault })))
    }

    fn see(&mut self, numbered: Numbered) {
        if self.last.is_none_or(|last| numbered.number.is_after(last)) {
            self.last = Some(numbered.number);
            self.newest = Some(numbered.value);
        }
    }
}

impl Half for LatestRx {}

impl Rx<FixedBytes> for LatestRx {
    /// Takes everything that has arrived, and returns the newest value, before any end that came behind it.
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FixedBytes>, LaneError>> {
        let lost = loop {
            match self.datagrams.poll_next_unpin(cx) {
                Poll::Ready(Some(Ok(bytes))) => self.take(&bytes)?,
                Poll::Ready(Some(Err(e))) => break Some(e),
                Poll::Ready(None) | Poll::Pending => break None,
            }
        };
        let end = match self.poll_control(cx) {
            Poll::Ready(end) => Some(end),
            Poll::Pending => None,
        };
        match (self.newest.take(), end.or(lost.map(|e| LaneError::Lost(loss(e))))) {
            (None, None) => Poll::Pending,
            (None, Some(end)) => Poll::Ready(Err(end)),
            (newest, _) => Poll::Ready(Ok(newest)),
        }
    }

    fn poll_part(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let carrier = &self.carrier;
        let part = || {
            let carrier = Arc::clone(carrier);
            async move { carrier.part().await }.boxed()
        };
        self.parting.get_or_insert_with(part).poll_unpin(cx)
    }
}
