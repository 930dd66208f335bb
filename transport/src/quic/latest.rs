//! The latest lane over QUIC: each camera is a datagram, sent once. The newest is copied to the control stream, which delivers
//! for certain, when no newer one has followed for a while: so a camera may be lost, but never the last one.

use std::future::poll_fn;
use std::io;
use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use bytes::{BufMut, Bytes, BytesMut};
use quinn::{Connection, ReadDatagram, RecvStream, SendDatagramError, SendStream};
use tokio::sync::Notify;
use trimaran_proto::{
    Camera, CameraNumber, DecodeError, DecodeFault, Decoder, Goodbye, Kind, Lane, Message, NumberedCamera,
};

use super::carrier::{Carrier, all_arrived, loss, write_loss};
use super::frames::{noop, poll_fill};
use crate::desk::lock;
use crate::error::{LaneError, LaneSendError, Loss, ProtocolError, misplaced};
use crate::link::Shared;
use crate::net::{Instant, Timer};
use crate::patience::Patience;

/// The shortest quiet after which the newest camera is copied; where a round trip takes longer, 1.5 of those.
const QUIET: Duration = Duration::from_millis(5);
/// Cameras for which room is made at once.
const CAMERAS: usize = 64;

#[derive(Debug)]
pub(crate) struct LatestTx {
    cell: Arc<Cell>,
    carrier: Arc<Carrier>,
    next: CameraNumber,
    buffer: BytesMut,
}

#[derive(Debug, Default)]
struct Cell {
    state: Mutex<State>,
    /// Rings when there is something to copy or to end.
    changed: Notify,
    /// Rings when the goodbye has arrived, or never will.
    ended: Notify,
}

#[derive(Debug, Default)]
struct State {
    /// The newest camera, until it is copied.
    newest: Option<NumberedCamera>,
    farewell: Option<Goodbye>,
    leaving: bool,
    ended: bool,
    failed: Option<io::ErrorKind>,
}

impl LatestTx {
    pub(crate) fn new(carrier: &Arc<Carrier>, control: SendStream, shared: Shared) -> Self {
        let cell = Arc::<Cell>::default();
        let copier = Copier { cell: Arc::clone(&cell), carrier: Arc::clone(carrier), control, shared };
        carrier.net.spawn(Box::pin(copier.run()));
        Self { cell, carrier: Arc::clone(carrier), next: CameraNumber::default(), buffer: BytesMut::new() }
    }

    pub(crate) fn publish(&mut self, camera: Camera, shared: &Shared) -> Result<(), LaneSendError> {
        let numbered = NumberedCamera { number: self.next, camera };
        if self.buffer.capacity() < NumberedCamera::SIZE {
            self.buffer.reserve(CAMERAS * NumberedCamera::SIZE);
        }
        self.buffer.put_slice(&numbered.to_bytes());
        self.carrier.connection.send_datagram(self.buffer.split().freeze()).map_err(|e| {
            LaneSendError::Lost(match e {
                SendDatagramError::ConnectionLost(e) => loss(e),
                other => Loss::Io(io::Error::other(other)),
            })
        })?;
        shared.counters.sent.count(Kind::Camera, Camera::SIZE);
        self.next = self.next.next();
        // The copier looks by itself for newer ones while it has one to copy.
        if lock(&self.cell.state).newest.replace(numbered).is_none() {
            self.cell.changed.notify_one();
        }
        Ok(())
    }

    pub(crate) async fn goodbye(
        &mut self,
        reason: Goodbye,
        patience: &mut Patience,
    ) -> Result<(), LaneSendError> {
        {
            let mut state = lock(&self.cell.state);
            state.farewell = Some(reason);
            state.leaving = true;
        }
        self.cell.changed.notify_one();
        loop {
            // Made before the look, so that an end in between is not missed.
            let ended = self.cell.ended.notified();
            {
                let state = lock(&self.cell.state);
                if let Some(kind) = state.failed {
                    return Err(LaneSendError::Lost(Loss::Io(kind.into())));
                }
                if state.ended {
                    return Ok(());
                }
            }
            patience.wait(None, ended).await.map_err(|_| LaneSendError::Stalled)?;
        }
    }
}

impl Drop for LatestTx {
    fn drop(&mut self) {
        lock(&self.cell.state).leaving = true;
        self.cell.changed.notify_one();
    }
}

/// Writes the control stream.
struct Copier {
    cell: Arc<Cell>,
    /// Kept until the last camera has arrived, though all halves may be gone.
    carrier: Arc<Carrier>,
    control: SendStream,
    shared: Shared,
}

impl Copier {
    async fn run(mut self) {
        let connection = self.carrier.connection.clone();
        let failed = tokio::select! {
            biased;
            e = connection.closed() => Some(io::Error::from(e).kind()),
            sent = self.copy() => sent.err().map(|e| match write_loss(e) {
                Loss::Io(e) => e.kind(),
                _ => io::ErrorKind::ConnectionAborted,
            }),
        };
        {
            let mut state = lock(&self.cell.state);
            state.ended = true;
            state.failed = failed;
        }
        self.cell.ended.notify_waiters();
        self.carrier.outlive([self.control]);
    }

    async fn copy(&mut self) -> Result<(), quinn::WriteError> {
        let mut timer = self.carrier.net.timer();
        loop {
            self.cell.changed.notified().await;
            while let Some(newest) = self.quiet(&mut *timer).await {
                self.write(&Message::Numbered(newest)).await?;
            }
            let farewell = {
                let mut state = lock(&self.cell.state);
                if !state.leaving {
                    continue;
                }
                state.farewell.take()
            };
            if let Some(reason) = farewell {
                let bytes = self.write(&Message::Goodbye(reason)).await?;
                self.shared.counters.sent.count(Kind::Goodbye, bytes);
            }
            // Fails only for a stream that is closed.
            let _ = self.control.finish();
            all_arrived([&self.control]).await;
            return Ok(());
        }
    }

    /// The newest camera, once no newer one has come for a while; none where there is nothing to copy.
    async fn quiet(&self, timer: &mut dyn Timer) -> Option<NumberedCamera> {
        loop {
            let seen = {
                let mut state = lock(&self.cell.state);
                if state.leaving {
                    return state.newest.take();
                }
                state.newest?.number
            };
            let pause = (self.carrier.connection.rtt() * 3 / 2).max(QUIET);
            timer.reset(self.carrier.net.now().after(pause));
            loop {
                tokio::select! {
                    biased;
                    () = poll_fn(|cx| timer.poll(cx)) => break,
                    () = self.cell.changed.notified() => if lock(&self.cell.state).leaving { break },
                }
            }
            let mut state = lock(&self.cell.state);
            if state.leaving || state.newest.is_some_and(|newest| newest.number == seen) {
                return state.newest.take();
            }
        }
    }

    /// Writes a message; says how long its payload is.
    async fn write(&mut self, message: &Message) -> Result<usize, quinn::WriteError> {
        let mut bytes = BytesMut::new();
        message.encode(&mut bytes);
        let payload = bytes.len() - trimaran_proto::HEADER_BYTES;
        self.control.write_chunk(bytes.freeze()).await?;
        Ok(payload)
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx {
    carrier: Arc<Carrier>,
    control: RecvStream,
    decoder: Decoder,
    /// The newest number that was seen.
    last: Option<CameraNumber>,
    /// Came, and is not read.
    newest: Option<Camera>,
    farewell: Option<Goodbye>,
}

impl LatestRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, control: RecvStream, decoder: Decoder) -> Self {
        let carrier = Arc::clone(carrier);
        Self { carrier, control, decoder, last: None, newest: None, farewell: None }
    }

    pub(crate) fn try_latest(&mut self, shared: &Shared) -> Result<Option<Camera>, LaneError> {
        let connection = self.carrier.connection.clone();
        match self.poll_latest(&connection, pin!(connection.read_datagram()), shared, &mut noop()) {
            Poll::Ready(camera) => camera.map(Some),
            Poll::Pending => Ok(None),
        }
    }

    pub(crate) async fn latest(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        patience: &mut Patience,
    ) -> Result<Camera, LaneError> {
        let connection = self.carrier.connection.clone();
        // What rings for a datagram is this future, so it lives as long as the wait.
        let mut datagram = pin!(connection.read_datagram());
        let camera = poll_fn(|cx| self.poll_latest(&connection, datagram.as_mut(), shared, cx));
        patience.wait(by, camera).await.map_err(LaneError::Expired)?
    }

    /// Takes everything that has arrived, and gives the newest camera; before any end that came behind it.
    fn poll_latest<'a>(
        &mut self,
        connection: &'a Connection,
        mut datagram: Pin<&mut ReadDatagram<'a>>,
        shared: &Shared,
        cx: &mut Context<'_>,
    ) -> Poll<Result<Camera, LaneError>> {
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
            (Some(camera), _) => Poll::Ready(Ok(camera)),
            (None, Some(end)) => Poll::Ready(Err(end)),
            (None, None) => Poll::Pending,
        }
    }

    /// Ready when the lane has ended, and then again each time.
    fn poll_control(&mut self, shared: &Shared, cx: &mut Context<'_>) -> Poll<LaneError> {
        if let Some(reason) = &self.farewell {
            return Poll::Ready(LaneError::Goodbye(reason.clone()));
        }
        loop {
            match self.decoder.next_message() {
                Ok(Some(Message::Numbered(numbered))) => self.see(numbered),
                Ok(Some(Message::Goodbye(reason))) => {
                    shared.counters.received.count(Kind::Goodbye, 0);
                    self.farewell = Some(reason.clone());
                    return Poll::Ready(LaneError::Goodbye(reason));
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

    /// A datagram.
    fn take(&mut self, bytes: &Bytes, shared: &Shared) -> Result<(), LaneError> {
        let kind = Kind::Numbered;
        let fault = match <&[u8; NumberedCamera::SIZE]>::try_from(&bytes[..]) {
            Ok(bytes) => match NumberedCamera::from_bytes(bytes) {
                Ok(numbered) => {
                    shared.counters.received.count(Kind::Camera, Camera::SIZE);
                    self.see(numbered);
                    return Ok(());
                }
                Err(cause) => DecodeFault::Camera { kind, cause },
            },
            Err(_) => DecodeFault::Length { kind, length: bytes.len() },
        };
        Err(LaneError::Protocol(ProtocolError::Decode(DecodeError { offset: 0, fault })))
    }

    fn see(&mut self, numbered: NumberedCamera) {
        if self.last.is_none_or(|last| numbered.number.is_after(last)) {
            self.last = Some(numbered.number);
            self.newest = Some(numbered.camera);
        }
    }
}
