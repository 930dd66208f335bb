//! The lanes as the connection's owner uses them.

use bytes::Bytes;
use trimaran_wire::{ChannelNumber, CloseReason, FixedBytes, FrameMessage, FrameNumber, Message};

use super::Connection;
use crate::chunk::UnitLane;
use crate::inbox::Received;
use crate::keys::OVERHEAD;
use crate::latest::{LatestEnd, LatestOut};
use crate::repair::{LARGEST, Path};

/// The most bytes of a full packet beside its part or repair shard: the chunk's own fields, and perhaps a
/// short acknowledgement.
const BESIDE: usize = 36;

impl Connection {
    /// Whether the lane takes more to send: data that waits for acknowledgement leaves room.
    #[must_use]
    pub fn is_writable(&self, lane: UnitLane) -> bool {
        self.units(lane).is_writable()
    }

    /// Whether all sent data has arrived.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        let others = [&self.messages, &self.bulk];
        self.frame_lanes().chain(others).all(|units| units.outbox.is_empty())
            && self.values_out().all(LatestOut::is_drained)
    }

    /// Whether all data sent on the lane has arrived.
    #[must_use]
    pub fn is_lane_drained(&self, lane: UnitLane) -> bool {
        self.units(lane).outbox.is_empty()
    }

    /// Whether the newest value has arrived, and the end of the lane if there was one.
    #[must_use]
    pub fn is_latest_drained(&self, channel: Option<ChannelNumber>) -> bool {
        self.latest_out(channel).is_drained()
    }

    /// Whether [`Connection::recv`] would return something.
    #[must_use]
    pub fn is_readable(&self, lane: UnitLane) -> bool {
        self.units(lane).inbox.is_readable()
    }

    /// Whether the peer no longer reads the lane: data sent on it is discarded.
    #[must_use]
    pub fn is_stopped(&self, lane: UnitLane) -> bool {
        self.units(lane).stopped
    }

    /// The newest frame sent from here that has arrived completely: later ones may refer to it.
    #[must_use]
    pub fn confirmed_frame(&self, lane: UnitLane) -> Option<FrameNumber> {
        self.units(lane).outbox.confirmed
    }

    /// Sends a message of the frames lane; a frame writer has put the messages in order. Frames take coded
    /// batches if [`Connection::set_coded`] or [`Config::coded`](super::Config::coded) allowed it before they
    /// began.
    pub fn send(&mut self, message: &FrameMessage) {
        self.send_on(UnitLane::Frames, message);
    }

    /// As [`Connection::send`], on the frames lane or a channel of frames. Those of a channel are coded if
    /// its declaration says so as well.
    pub fn send_on(&mut self, lane: UnitLane, message: &FrameMessage) {
        let path = self.path();
        self.units_mut(lane).outbox.put(message, path);
    }

    /// Sends a message of the messages lane, encoded by the application: at most
    /// [`MAX_MESSAGE`](trimaran_wire::MAX_MESSAGE) bytes.
    pub fn say(&mut self, message: Bytes) {
        self.messages.outbox.put_whole(&Message::Message(message), self.path());
    }

    /// Sends a block of the bulk lane: at most [`MAX_BLOCK`](trimaran_wire::MAX_BLOCK) bytes.
    pub fn carry(&mut self, block: Bytes) {
        self.bulk.outbox.put_whole(&Message::Block(block), self.path());
    }

    /// Sends a close behind everything else on the lane.
    pub fn end_lane(&mut self, lane: UnitLane, reason: CloseReason) {
        let path = self.path();
        self.units_mut(lane).outbox.end_with(reason, path);
    }

    /// Sends an end without a close behind everything else on the lane.
    pub fn gone(&mut self, lane: UnitLane) {
        let path = self.path();
        self.units_mut(lane).outbox.gone(path);
    }

    const fn path(&self) -> Path {
        let full = self.mtu.known() - OVERHEAD - BESIDE;
        let most = if full < LARGEST { full } else { LARGEST };
        Path { shard: most & !15, loss: self.recovery.probable_loss() }
    }

    /// Stops reading the lane: the peer need not send the rest of it.
    pub fn stop_reading(&mut self, lane: UnitLane) {
        self.units_mut(lane).stop_reading();
    }

    /// Publishes a value on a channel, or on the latest lane: it replaces the one before, and is sent again
    /// until it or a newer one has arrived.
    pub fn publish(&mut self, channel: Option<ChannelNumber>, value: FixedBytes) {
        self.latest_out_mut(channel).publish(value);
    }

    /// Ends a channel of values, or the latest lane, behind the newest value, with a close or without. The
    /// first call counts.
    pub fn end_latest(&mut self, channel: Option<ChannelNumber>, reason: Option<CloseReason>) {
        self.latest_out_mut(channel).end(reason);
    }

    /// The newest value of the peer, if it was not read yet.
    pub fn latest(&mut self, channel: Option<ChannelNumber>) -> Option<FixedBytes> {
        self.latest_in_mut(channel).take()
    }

    /// How the peer's latest lane ended, once the last value has come.
    #[must_use]
    pub fn latest_end(&self, channel: Option<ChannelNumber>) -> Option<&LatestEnd> {
        self.latest_in(channel).end()
    }

    /// Whether a value or an end of the latest lane can be read.
    #[must_use]
    pub fn is_latest_readable(&self, channel: Option<ChannelNumber>) -> bool {
        self.latest_in(channel).is_readable()
    }

    /// The next item of the lane. Items that arrived before the connection ended are still returned, up to
    /// the first unit that breaks the rules of the lane.
    pub fn recv(&mut self, lane: UnitLane) -> Option<Received> {
        self.units_mut(lane).recv().unwrap_or_else(|violation| {
            self.end(violation.into());
            None
        })
    }
}
