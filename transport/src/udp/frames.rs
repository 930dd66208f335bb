//! The frames lane over datagrams, and channels of frames.

use std::collections::VecDeque;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use trimaran_udp::{DeadlineTooShort, Received, UnitLane};
use trimaran_wire::{CloseReason, FrameMessage, FrameNumber, Kind};

use super::port::{Carrier, State};
use super::records::wrong_unit;
use super::units::{UnitRx, UnitTx};
use crate::error::{LaneError, Loss};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::stats::Counters;

#[derive(Debug)]
pub(crate) struct FrameTx {
    of: UnitLane,
    lane: UnitTx,
    counters: Arc<Counters>,
    staged: VecDeque<Staged>,
    /// The warning that frames have less time than the path takes was given.
    warned: bool,
}

/// Waits to be passed to the connection.
#[derive(Debug)]
enum Staged {
    Frame(FrameMessage),
    Close(CloseReason),
}

impl FrameTx {
    pub(crate) fn new(carrier: &Arc<Carrier>, of: UnitLane, counters: &Arc<Counters>) -> Self {
        let (lane, counters) = (UnitTx::new(carrier, of), Arc::clone(counters));
        Self { of, lane, counters, staged: VecDeque::new(), warned: false }
    }
}

impl Half for FrameTx {}

impl LaneTx for FrameTx {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        let Self { of, lane, staged, warned, .. } = self;
        if staged.is_empty() {
            return Poll::Ready(Ok(true));
        }
        let mut late = None;
        let put = |state: &mut State| {
            let connection = &mut state.connection;
            while connection.is_writable(*of)
                && let Some(message) = staged.pop_front()
            {
                match message {
                    Staged::Frame(message) => connection.send_on(*of, &message),
                    Staged::Close(reason) => connection.end_lane(*of, reason),
                }
            }
            late = connection.deadline_too_short().filter(|_| !*warned);
        };
        ready!(lane.poll_room(cx, put))?;
        if let Some(DeadlineTooShort { deadline, way }) = late {
            *warned = true;
            tracing::warn!(peer = %lane.carrier.port().remote(), ?way, ?deadline, "the way to the peer takes longer than a frame may: hardly any will come whole; take a longer deadline, or a link without one");
        }
        Poll::Ready(Ok(staged.is_empty()))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.counters.sent.count(Kind::Close, 0);
        self.staged.push_back(Staged::Close(reason));
        Ok(())
    }

    /// Ends the lane behind its close, once everything has arrived.
    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        self.lane.poll_closed(cx)
    }

    fn confirmed(&self) -> Option<FrameNumber> {
        self.lane.carrier.lock().connection.confirmed_frame(self.of)
    }
}

impl Tx<FrameMessage> for FrameTx {
    fn stage(&mut self, message: FrameMessage) -> Result<(), Loss> {
        self.counters.sent.count(message.kind(), message.payload());
        self.staged.push_back(Staged::Frame(message));
        Ok(())
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx(UnitRx);

impl FrameRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, lane: UnitLane, counters: &Arc<Counters>) -> Self {
        Self(UnitRx::new(carrier, lane, counters))
    }
}

impl Half for FrameRx {}

impl Rx<FrameMessage> for FrameRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FrameMessage>, LaneError>> {
        Poll::Ready(match ready!(self.0.poll_next(cx))? {
            Received::Frame(message) => {
                self.0.counters().received.count(message.kind(), message.payload());
                Ok(Some(message))
            }
            _ => Err(wrong_unit()),
        })
    }
}
