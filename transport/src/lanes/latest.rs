//! The latest lane: a cell of size one.

use trimaran_wire::{CloseReason, Fixed, Protocol, to_bytes};

use crate::error::{LaneError, LaneSendError, ProtocolError, RecvError, SendError};
use crate::inproc::lanes as inproc;
use crate::lanes::shared::Shared;
#[cfg(feature = "quic")]
use crate::quic::latest as quic;
use crate::stream::latest as stream;
use crate::timeouts::Timeouts;
#[cfg(feature = "udp")]
use crate::udp::latest as udp;
use trimaran_net::Instant;

/// Publishes values: each replaces the one before, whether that has been read or not.
#[derive(Debug)]
pub struct LatestSender<P: Protocol> {
    pub(crate) lane: LatestTx<P>,
    pub(crate) shared: Shared,
    pub(crate) timeouts: Timeouts,
}

/// Reads the newest value.
#[derive(Debug)]
pub struct LatestReceiver<P: Protocol> {
    pub(crate) lane: LatestRx<P>,
    pub(crate) shared: Shared,
    pub(crate) timeouts: Timeouts,
}

#[derive(Debug)]
pub(crate) enum LatestTx<P: Protocol> {
    Local(inproc::LatestTx<P>),
    Wire(WireLatestTx),
}

#[derive(Debug)]
pub(crate) enum LatestRx<P: Protocol> {
    Local(inproc::LatestRx<P>),
    Wire(Box<WireLatestRx>),
}

over_bytes!(WireLatestTx: LatestTx);
over_bytes!(WireLatestRx: LatestRx);

impl<P: Protocol> LatestSender<P> {
    /// Publishes `value`. Never waits: if the peer is slow, only the newest value waits for it.
    ///
    /// # Errors
    /// If the peer is gone.
    pub fn publish(&mut self, value: P::Latest) -> Result<(), SendError> {
        match &mut self.lane {
            LatestTx::Local(lane) => lane.publish(value, &self.shared),
            LatestTx::Wire(lane) => {
                whichever!(WireLatestTx: lane, lane => lane.publish(to_bytes(&value), &self.shared))
            }
        }
        .map_err(|e| self.error(e))
    }

    /// Closes this lane, after the last published value.
    ///
    /// If the future is dropped, the close may not be sent.
    ///
    /// # Errors
    /// If the peer is gone already, or takes nothing within the link's timeout.
    pub async fn close(mut self, reason: CloseReason) -> Result<(), SendError> {
        match &mut self.lane {
            LatestTx::Local(lane) => lane.close(reason, &self.shared),
            LatestTx::Wire(lane) => {
                whichever!(WireLatestTx: lane, lane => lane.close(reason, &mut self.timeouts).await)
            }
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneSendError) -> SendError {
        error.sending(&self.shared.peer, self.timeouts.limit())
    }
}

impl<P: Protocol> LatestReceiver<P> {
    /// Waits for an unread value, and returns the newest.
    ///
    /// Dropping the future loses no value.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, broke the protocol, or published nothing within the link's
    /// timeout. A value that came before such an end is returned first.
    pub async fn latest(&mut self) -> Result<P::Latest, RecvError> {
        self.latest_until(None).await
    }

    /// As [`LatestReceiver::latest`], until `deadline` at most. Dropping the future loses no value.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn latest_by(&mut self, deadline: Instant) -> Result<P::Latest, RecvError> {
        self.latest_until(Some(deadline)).await
    }

    /// The newest unread value, or `None` if there is none now. Never waits.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub fn try_latest(&mut self) -> Result<Option<P::Latest>, RecvError> {
        match &mut self.lane {
            LatestRx::Local(lane) => lane.try_latest(&self.shared),
            LatestRx::Wire(lane) => {
                let bytes = whichever!(WireLatestRx: &mut **lane, lane => lane.try_latest(&self.shared));
                bytes.and_then(|bytes| bytes.as_deref().map(read::<P>).transpose())
            }
        }
        .map_err(|e| self.error(e))
    }

    /// Discards everything until the lane ends, and returns how it ended.
    pub(crate) async fn drain(&mut self) -> RecvError {
        loop {
            if let Err(end) = self.latest().await {
                return end;
            }
        }
    }

    /// Tells the peer's machine that this side is gone, on transports that need a live process for that:
    /// after both have closed the link.
    pub(crate) async fn part(self) {
        #[cfg(feature = "quic")]
        if let LatestRx::Wire(lane) = self.lane
            && let WireLatestRx::Quic(lane) = *lane
        {
            lane.part().await;
        }
    }

    async fn latest_until(&mut self, by: Option<Instant>) -> Result<P::Latest, RecvError> {
        match &mut self.lane {
            LatestRx::Local(lane) => lane.latest(by, &self.shared, &mut self.timeouts).await,
            LatestRx::Wire(lane) => {
                let (shared, timeouts) = (&self.shared, &mut self.timeouts);
                let bytes =
                    whichever!(WireLatestRx: &mut **lane, lane => lane.latest(by, shared, timeouts).await);
                bytes.and_then(|bytes| read::<P>(&bytes))
            }
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneError) -> RecvError {
        error.receiving(&self.shared.peer, self.timeouts.limit())
    }
}

/// The value in `bytes`, which have the length of a value.
fn read<P: Protocol>(bytes: &[u8]) -> Result<P::Latest, LaneError> {
    P::Latest::read(bytes).map_err(|e| LaneError::Protocol(ProtocolError::Value(Box::new(e))))
}
