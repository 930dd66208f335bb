//! The lanes as their owner uses them: what is given to the connection, and what is taken from it.

use bytes::Bytes;
use trimaran_wire::{CloseReason, FixedBytes, FrameMessage, FrameNumber, Message};

use super::Connection;
use crate::chunk::UnitLane;
use crate::inbox::Received;
use crate::keys::OVERHEAD;
use crate::latest::LatestEnd;
use crate::repair::{LARGEST, Path};

/// What a full packet has beside its part or repair shard at most, bytes: the chunk's own fields, or a short
/// acknowledgement too.
const BESIDE: usize = 36;

impl Connection {
    /// Whether something may be sent on the lane: what waits for its acknowledgement leaves room.
    #[must_use]
    pub const fn is_writable(&self, lane: UnitLane) -> bool {
        self.units(lane).is_writable()
    }

    /// Whether everything that was sent has arrived.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        UnitLane::ALL.into_iter().all(|lane| self.is_lane_drained(lane)) && self.latest_out.is_drained()
    }

    /// Whether everything that was sent on the lane has arrived.
    #[must_use]
    pub fn is_lane_drained(&self, lane: UnitLane) -> bool {
        self.units(lane).outbox.is_empty()
    }

    /// Whether the newest value has arrived, and the end of the lane if there was one.
    #[must_use]
    pub fn is_latest_drained(&self) -> bool {
        self.latest_out.is_drained()
    }

    /// Whether [`Connection::recv`] would give something.
    #[must_use]
    pub fn is_readable(&self, lane: UnitLane) -> bool {
        self.units(lane).inbox.is_readable()
    }

    /// Whether the peer reads the lane no more: what is sent on it is thrown away.
    #[must_use]
    pub const fn is_stopped(&self, lane: UnitLane) -> bool {
        self.units(lane).stopped
    }

    /// The newest frame sent from here all of which has arrived: what the peer reads later may refer to it.
    #[must_use]
    pub const fn confirmed_frame(&self) -> Option<FrameNumber> {
        self.frames.outbox.confirmed
    }

    /// Sends a message of the frames lane; a frame writer has put the messages in order. Frames take coded
    /// batches where [`Connection::set_coded`] or [`Config::coded`](super::Config::coded) said so before they
    /// began.
    pub fn send(&mut self, message: &FrameMessage) {
        self.frames.outbox.put(message, self.path());
    }

    /// Sends a message of the messages lane, as the application wrote it: at most
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

    /// Says behind everything else on the lane that nothing more comes.
    pub fn gone(&mut self, lane: UnitLane) {
        let path = self.path();
        self.units_mut(lane).outbox.gone(path);
    }

    const fn path(&self) -> Path {
        let full = self.mtu.known() - OVERHEAD - BESIDE;
        let most = if full < LARGEST { full } else { LARGEST };
        Path { shard: most & !15, loss: self.recovery.probable_loss() }
    }

    /// Says that the lane is not read any more: the peer need not send what is left of it.
    pub fn stop_reading(&mut self, lane: UnitLane) {
        self.units_mut(lane).stop_reading();
    }

    /// Publishes a value: it replaces the one before. It is sent again until it or a newer one has arrived.
    pub fn publish(&mut self, value: FixedBytes) {
        self.latest_out.publish(value);
    }

    /// Ends the latest lane behind the newest value, with a close or without. The first call counts.
    pub fn end_latest(&mut self, reason: Option<CloseReason>) {
        self.latest_out.end(reason);
    }

    /// The newest value of the peer, if it was not read before.
    pub fn latest(&mut self) -> Option<FixedBytes> {
        self.latest_in.take()
    }

    /// How the peer's latest lane ended, once the last value has come.
    #[must_use]
    pub fn latest_end(&self) -> Option<&LatestEnd> {
        self.latest_in.end()
    }

    /// Whether there is a value or an end of the latest lane to read.
    #[must_use]
    pub fn is_latest_readable(&self) -> bool {
        self.latest_in.is_readable()
    }

    /// What comes next on the lane. What arrived before an end of the connection is still given, up to the
    /// first unit that breaks the rules of the lane.
    pub fn recv(&mut self, lane: UnitLane) -> Option<Received> {
        self.units_mut(lane).recv().unwrap_or_else(|violation| {
            self.end(violation.into());
            None
        })
    }
}
