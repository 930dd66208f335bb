//! Receiving values from datagrams and from the control stream.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll};

use bytes::Bytes;
use quinn::{Connection, ReadDatagram, RecvStream};
use trimaran_wire::{
    CloseReason, DecodeError, DecodeFault, Decoder, FixedBytes, Kind, Lane, Message, Numbered, Serial,
};

use crate::error::{LaneError, Loss, ProtocolError, misplaced};
use crate::lanes::shared::Shared;
use crate::quic::carrier::{Carrier, loss};
use crate::quic::frames::{noop, poll_fill};
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

#[derive(Debug)]
pub(crate) struct LatestRx {
    carrier: Arc<Carrier>,
    control: RecvStream,
    decoder: Decoder,
    /// The newest number that was seen.
    last: Option<Serial>,
    /// Received, and not read.
    newest: Option<FixedBytes>,
    closed: Option<CloseReason>,
}

impl LatestRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, control: RecvStream, decoder: Decoder) -> Self {
        let carrier = Arc::clone(carrier);
        Self { carrier, control, decoder, last: None, newest: None, closed: None }
    }

    pub(crate) fn try_latest(&mut self, shared: &Shared) -> Result<Option<FixedBytes>, LaneError> {
        let connection = self.carrier.connection.clone();
        match self.poll_latest(&connection, pin!(connection.read_datagram()), shared, &mut noop()) {
            Poll::Ready(value) => value.map(Some),
            Poll::Pending => Ok(None),
        }
    }

    pub(crate) async fn latest(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FixedBytes, LaneError> {
        let connection = self.carrier.connection.clone();
        // This future is woken by a datagram, so it lives as long as the wait.
        let mut datagram = pin!(connection.read_datagram());
        let value = poll_fn(|cx| self.poll_latest(&connection, datagram.as_mut(), shared, cx));
        timeouts.wait(by, value).await.map_err(LaneError::Expired)?
    }

    #[cfg(test)]
    pub(crate) fn connection(&self) -> Connection {
        self.carrier.connection.clone()
    }

    /// Closes the connection, after both sides have closed the link.
    pub(crate) async fn part(self) {
        self.carrier.part().await;
    }

    /// Takes everything that has arrived, and returns the newest value, before any end that came behind it.
    fn poll_latest<'a>(
        &mut self,
        connection: &'a Connection,
        mut datagram: Pin<&mut ReadDatagram<'a>>,
        shared: &Shared,
        cx: &mut Context<'_>,
    ) -> Poll<Result<FixedBytes, LaneError>> {
        let lost = loop {
            match datagram.as_mut().poll(cx) {
                Poll::Ready(Ok(bytes)) => {
                    datagram.set(connection.read_datagram());
                    if let Err(e) = self.take(&bytes, shared) {
                        return Poll::Ready(Err(e));
                    }
                }
                Poll::Ready(Err(e)) => break Some(e),
                Poll::Pending => break None,
            }
        };
        let end = match self.poll_control(shared, cx) {
            Poll::Ready(end) => Some(end),
            Poll::Pending => None,
        };
        match (self.newest.take(), end.or(lost.map(|e| LaneError::Lost(loss(e))))) {
            (Some(value), _) => Poll::Ready(Ok(value)),
            (None, Some(end)) => Poll::Ready(Err(end)),
            (None, None) => Poll::Pending,
        }
    }

    /// Ready when the lane has ended, and on every call after that.
    fn poll_control(&mut self, shared: &Shared, cx: &mut Context<'_>) -> Poll<LaneError> {
        if let Some(reason) = &self.closed {
            return Poll::Ready(LaneError::Closed(reason.clone()));
        }
        loop {
            match self.decoder.next_message() {
                Ok(Some(Message::Numbered(numbered))) => self.see(numbered),
                Ok(Some(Message::Close(reason))) => {
                    shared.counters.received.count(Kind::Close, 0);
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
    fn take(&mut self, bytes: &Bytes, shared: &Shared) -> Result<(), LaneError> {
        if let Some(numbered) = Numbered::read(bytes, shared.format.latest) {
            shared.counters.received.count(Kind::Latest, shared.format.latest);
            self.see(numbered);
            return Ok(());
        }
        let kind = Kind::Numbered;
        let (least, most) = kind.lengths(&shared.format).into_inner();
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
