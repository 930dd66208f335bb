//! Both lanes as their owner uses them: what is given to the connection, and what is taken from it.

use trimaran_wire::{CloseReason, FixedBytes, FrameMessage, FrameNumber};

use super::Connection;
use crate::inbox::Received;
use crate::keys::OVERHEAD;
use crate::latest::LatestEnd;
use crate::repair::{LARGEST, Path};

/// What a full packet has beside its part or repair shard at most, bytes: the chunk's own fields, or a short
/// acknowledgement too.
const BESIDE: usize = 36;

impl Connection {
    /// Whether [`Connection::send`] may be called: what waits for its acknowledgement leaves room.
    #[must_use]
    pub const fn is_writable(&self) -> bool {
        self.outbox.kept() < self.config.send_buffer
    }

    /// Whether everything that was sent has arrived.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.outbox.is_empty() && self.latest_out.is_drained()
    }

    /// Whether everything that was sent on the frames lane has arrived.
    #[must_use]
    pub fn is_lane_drained(&self) -> bool {
        self.outbox.is_empty()
    }

    /// Whether the newest value has arrived, and the end of the lane if there was one.
    #[must_use]
    pub fn is_latest_drained(&self) -> bool {
        self.latest_out.is_drained()
    }

    /// Whether [`Connection::recv`] would give something.
    #[must_use]
    pub fn is_readable(&self) -> bool {
        self.inbox.is_readable()
    }

    /// Whether the peer reads the frames lane no more: what is sent on it is thrown away.
    #[must_use]
    pub const fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// The newest frame sent from here all of which has arrived: what the peer reads later may refer to it.
    #[must_use]
    pub const fn confirmed_frame(&self) -> Option<FrameNumber> {
        self.outbox.confirmed
    }

    /// Sends a message of the frames lane; a frame writer has put the messages in order. Frames take coded
    /// batches where [`Connection::set_coded`] or [`Config::coded`](super::Config::coded) said so before they
    /// began.
    pub fn send(&mut self, message: &FrameMessage) {
        self.outbox.put(message, self.path());
    }

    /// Sends a close behind everything else on the frames lane.
    pub fn end_frames(&mut self, reason: CloseReason) {
        self.outbox.end_with(reason, self.path());
    }

    /// Says behind everything else on the frames lane that nothing more comes.
    pub fn gone(&mut self) {
        self.outbox.gone(self.path());
    }

    const fn path(&self) -> Path {
        let full = self.mtu.known() - OVERHEAD - BESIDE;
        let most = if full < LARGEST { full } else { LARGEST };
        Path { shard: most & !15, loss: self.recovery.probable_loss() }
    }

    /// Says that the frames lane is not read any more: the peer need not send what is left of it.
    pub fn stop_reading(&mut self) {
        self.stop_sending_due |= !self.unread;
        self.unread = true;
        self.credit_due |= self.inbox.discard();
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

    /// The next message of the frames lane. What arrived before an end of the connection is still given,
    /// up to the first unit that breaks the rules of the lane.
    pub fn recv(&mut self) -> Option<Received> {
        match self.inbox.take() {
            Ok(item) => {
                self.credit_due |= self.inbox.credit_due();
                item
            }
            Err(violation) => {
                self.end(violation.into());
                None
            }
        }
    }
}
