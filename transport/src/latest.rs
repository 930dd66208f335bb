//! The latest lane: a cell of size one that holds a camera.

use trimaran_proto::{Camera, Goodbye};

use crate::error::{LaneError, LaneSendError};
use crate::link::Shared;
use crate::patience::Patience;
use crate::{RecvError, SendError, inproc, quic, stream, udp};
use trimaran_net::Instant;

/// Publishes cameras: each replaces the one before, whether that has been read or not.
#[derive(Debug)]
pub struct LatestSender {
    pub(crate) lane: LatestTx,
    pub(crate) shared: Shared,
    pub(crate) patience: Patience,
}

/// Reads the newest camera.
#[derive(Debug)]
pub struct LatestReceiver {
    pub(crate) lane: LatestRx,
    pub(crate) shared: Shared,
    pub(crate) patience: Patience,
}

#[derive(Debug)]
pub(crate) enum LatestTx {
    Inproc(inproc::LatestTx),
    Stream(stream::LatestTx),
    Quic(quic::LatestTx),
    Udp(udp::LatestTx),
}

#[derive(Debug)]
pub(crate) enum LatestRx {
    Inproc(inproc::LatestRx),
    Stream(stream::LatestRx),
    Quic(quic::LatestRx),
    Udp(udp::LatestRx),
}

impl LatestSender {
    /// Publishes `camera`. Never waits: when the peer is slow, only the newest camera waits for it.
    ///
    /// # Errors
    /// When the peer is gone.
    pub fn publish(&mut self, camera: Camera) -> Result<(), SendError> {
        match &mut self.lane {
            LatestTx::Inproc(lane) => lane.publish(camera, &self.shared),
            LatestTx::Stream(lane) => lane.publish(camera),
            LatestTx::Quic(lane) => lane.publish(camera, &self.shared),
            LatestTx::Udp(lane) => lane.publish(camera, &self.shared),
        }
        .map_err(|e| self.error(e))
    }

    /// Says goodbye on this lane, after the camera that was published last.
    ///
    /// # Errors
    /// When the peer is gone already, or takes nothing within the link's patience.
    pub async fn goodbye(mut self, reason: Goodbye) -> Result<(), SendError> {
        match &mut self.lane {
            LatestTx::Inproc(lane) => lane.goodbye(reason, &self.shared),
            LatestTx::Stream(lane) => lane.goodbye(reason, &mut self.patience).await,
            LatestTx::Quic(lane) => lane.goodbye(reason, &mut self.patience).await,
            LatestTx::Udp(lane) => lane.goodbye(reason, &mut self.patience).await,
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneSendError) -> SendError {
        error.sending(self.shared.peer, self.patience.limit())
    }
}

impl LatestReceiver {
    /// Waits for a camera that was not read before, and gives the newest.
    ///
    /// Dropping the future loses no camera.
    ///
    /// # Errors
    /// When the peer said goodbye, is lost, broke the protocol, or published nothing within the link's
    /// patience. A camera that came before such an end is given first.
    pub async fn latest(&mut self) -> Result<Camera, RecvError> {
        self.latest_until(None).await
    }

    /// As [`LatestReceiver::latest`], until `deadline` at most.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn latest_by(&mut self, deadline: Instant) -> Result<Camera, RecvError> {
        self.latest_until(Some(deadline)).await
    }

    /// The newest camera that was not read before, or `None` when there is none now. Never waits.
    ///
    /// # Errors
    /// When the peer said goodbye, is lost, or broke the protocol.
    pub fn try_latest(&mut self) -> Result<Option<Camera>, RecvError> {
        match &mut self.lane {
            LatestRx::Inproc(lane) => lane.try_latest(&self.shared),
            LatestRx::Stream(lane) => lane.try_latest(&self.shared),
            LatestRx::Quic(lane) => lane.try_latest(&self.shared),
            LatestRx::Udp(lane) => lane.try_latest(&self.shared),
        }
        .map_err(|e| self.error(e))
    }

    /// Throws away what comes until the lane ends, and says how it ended.
    pub(crate) async fn drain(&mut self) -> RecvError {
        loop {
            if let Err(end) = self.latest().await {
                return end;
            }
        }
    }

    /// Tells the peer's machine that this side is gone, where only a machine that lives can: after both have
    /// said goodbye.
    pub(crate) async fn part(self) {
        if let LatestRx::Quic(lane) = self.lane {
            lane.part().await;
        }
    }

    async fn latest_until(&mut self, by: Option<Instant>) -> Result<Camera, RecvError> {
        match &mut self.lane {
            LatestRx::Inproc(lane) => lane.latest(by, &self.shared, &mut self.patience).await,
            LatestRx::Stream(lane) => lane.latest(by, &self.shared, &mut self.patience).await,
            LatestRx::Quic(lane) => lane.latest(by, &self.shared, &mut self.patience).await,
            LatestRx::Udp(lane) => lane.latest(by, &self.shared, &mut self.patience).await,
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneError) -> RecvError {
        error.receiving(self.shared.peer, self.patience.limit())
    }
}
