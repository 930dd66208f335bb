//! The frames lane over a byte stream of its own.

use std::future::poll_fn;

use trimaran_proto::{FrameMessage, Goodbye, IdDecoder, Lane, Message};

use super::source::{Sink, Source};
use crate::error::{LaneError, LaneSendError, Loss, misplaced};
use crate::link::Shared;
use crate::net::Instant;
use crate::patience::Patience;

/// How much is read at once: whole frames, mostly.
const ROOM: usize = 64 * 1024;

#[derive(Debug)]
pub(crate) struct FrameTx {
    sink: Sink,
}

impl FrameTx {
    pub(crate) const fn new(sink: Sink) -> Self {
        Self { sink }
    }

    pub(crate) fn stage(&mut self, message: &Message, shared: &Shared) {
        self.sink.stage(message, &shared.counters.sent);
    }

    /// Writes what is staged. Whatever the peer takes starts the patience anew.
    pub(crate) async fn send_staged(&mut self, patience: &mut Patience) -> Result<(), LaneSendError> {
        while !self.sink.is_drained() {
            patience
                .wait(None, poll_fn(|cx| self.sink.poll_write(cx)))
                .await
                .map_err(|_| LaneSendError::Stalled)?
                .map_err(|e| LaneSendError::Lost(Loss::Io(e)))?;
        }
        Ok(())
    }

    /// Tells the peer that nothing more comes.
    pub(crate) async fn close(&mut self, patience: &mut Patience) -> Result<(), LaneSendError> {
        patience
            .wait(None, poll_fn(|cx| self.sink.poll_shutdown(cx)))
            .await
            .map_err(|_| LaneSendError::Stalled)?
            .map_err(|e| LaneSendError::Lost(Loss::Io(e)))
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx {
    source: Source,
    decoder: IdDecoder,
    farewell: Option<Goodbye>,
}

impl FrameRx {
    pub(crate) fn new(source: Source) -> Self {
        Self { source: source.with_room(ROOM), decoder: IdDecoder::new(), farewell: None }
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        patience: &mut Patience,
    ) -> Result<FrameMessage, LaneError> {
        if let Some(reason) = &self.farewell {
            return Err(LaneError::Goodbye(reason.clone()));
        }
        loop {
            match self.source.next_buffered(&shared.counters.received)? {
                Some(Message::Frame(message)) => return Ok(self.decoder.plain(message)),
                Some(Message::Coded(coded)) => {
                    return self.decoder.coded(&coded).map_err(|e| LaneError::Protocol(e.into()));
                }
                Some(Message::Goodbye(reason)) => {
                    self.farewell = Some(reason.clone());
                    return Err(LaneError::Goodbye(reason));
                }
                Some(other) => return Err(misplaced(other.kind(), Lane::Frames)),
                None => {
                    patience
                        .wait(by, poll_fn(|cx| self.source.poll_fill(cx)))
                        .await
                        .map_err(LaneError::Expired)??;
                }
            }
        }
    }
}
