//! A lane of units in both directions.

use super::Config;
use crate::chunk::{Chunk, UnitLane};
use crate::inbox::{Inbox, LaneViolation, Received};
use crate::outbox::Outbox;
use crate::recovery::{Content, Contents};
use crate::repair::Budget;

/// Bytes of the messages lane that the receiver buffers for a slow reader, and that the sender keeps until
/// they are acknowledged: four of the longest messages.
pub(crate) const MESSAGES_WINDOW: u64 = 64 * 1024;
/// The same for the bulk lane: 100 Mbit/s over a round trip of 40 ms.
pub(crate) const BULK_WINDOW: u64 = 512 * 1024;

/// Both directions of one lane, and pending control chunks about it.
#[derive(Debug)]
pub(super) struct Units {
    lane: UnitLane,
    pub(super) outbox: Outbox,
    pub(super) inbox: Inbox,
    pub(super) max_data_due: bool,
    /// This side does not read the lane.
    unread: bool,
    pub(super) stop_sending_due: bool,
    /// The peer does not read the lane.
    pub(super) stopped: bool,
    /// The limit of bytes that wait for acknowledgement.
    send_buffer: usize,
}

impl Units {
    /// A lane of frames.
    pub(super) fn frames(lane: UnitLane, config: &Config) -> Self {
        let mut frames = Self::new(lane, config, config.window);
        frames.send_buffer = config.send_buffer;
        frames.outbox.frame_deadline = config.frame_deadline;
        frames.outbox.repair = Budget::new(config.repair, config.repair_percent);
        frames.outbox.set_coded(config.coded);
        frames
    }

    /// A lane with this window in each direction. It has no deadline and no repair; lost data is
    /// retransmitted.
    pub(super) fn new(lane: UnitLane, config: &Config, window: u64) -> Self {
        Self {
            lane,
            outbox: Outbox::new(lane, config.format, (window, Inbox::initial_units())),
            inbox: Inbox::new(lane, config.format, config.batch, window),
            max_data_due: false,
            unread: false,
            stop_sending_due: false,
            stopped: false,
            send_buffer: window as usize,
        }
    }

    pub(super) const fn is_writable(&self) -> bool {
        self.outbox.kept() < self.send_buffer
    }

    /// The peer stops reading.
    pub(super) fn on_stop(&mut self) {
        self.stopped = true;
        self.outbox.drop_all();
    }

    pub(super) fn stop_reading(&mut self) {
        self.stop_sending_due |= !self.unread;
        self.unread = true;
        self.max_data_due |= self.inbox.discard();
    }

    /// Discards received data, if nobody reads it.
    pub(super) fn discard_unread(&mut self) {
        if self.unread {
            self.max_data_due |= self.inbox.discard();
        }
    }

    pub(super) fn recv(&mut self) -> Result<Option<Received>, LaneViolation> {
        let received = self.inbox.take()?;
        self.max_data_due |= self.inbox.max_data_due();
        Ok(received)
    }

    /// The cost of the peer's packets on this lane, in steps.
    pub(super) const fn work(&self) -> u64 {
        self.inbox.work() + self.outbox.visited
    }

    pub(super) fn has_due(&self) -> bool {
        self.has_words_due() || self.outbox.has_due()
    }

    /// Whether a control chunk of the lane is due.
    pub(super) const fn has_words_due(&self) -> bool {
        self.max_data_due || self.stop_sending_due
    }

    /// Writes the control chunks of the lane that are due.
    pub(super) fn write_words(&mut self, plain: &mut Vec<u8>, contents: &mut Contents) {
        let lane = self.lane;
        if std::mem::take(&mut self.max_data_due) {
            let (bytes, units) = self.inbox.announce_max_data();
            Chunk::MaxData { lane, bytes, units }.write(plain);
            contents.push(Content::MaxData { lane });
        }
        if std::mem::take(&mut self.stop_sending_due) {
            Chunk::StopSending { lane }.write(plain);
            contents.push(Content::StopSending { lane });
        }
    }

    /// Fills a packet that has room for `all` bytes with pending unit data.
    pub(super) fn write(&mut self, all: usize, plain: &mut Vec<u8>, contents: &mut Contents) {
        while let Some(content) = self.outbox.write_next(all.saturating_sub(plain.len()), all, plain) {
            contents.push(content);
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_wire::{FrameMessage, FrameNumber};

    use super::*;
    use crate::chunk::Tail;
    use crate::repair::Path;
    use crate::samples::{FORMAT, value};

    /// The beginning of a frame has 80 bytes, and a unit costs 256 more.
    #[test]
    fn a_lane_is_writable_until_what_waits_has_reached_its_limit() {
        for (send_buffer, writable) in [(335, false), (336, false), (337, true)] {
            let config = Config { send_buffer, ..Config::new(FORMAT) };
            let mut units = Units::frames(UnitLane::Frames, &config);
            assert!(units.is_writable());
            let begin = FrameMessage::Begin { frame: FrameNumber(0), header: value(0) };
            units.outbox.put(&begin, Path { shard: 1136, loss: 0.0 });
            assert_eq!(units.is_writable(), writable, "{send_buffer}");
        }
    }

    #[test]
    fn a_side_that_reads_no_more_makes_room_at_once_and_for_all_that_still_comes() {
        let lane = UnitLane::Messages;
        let mut units = Units::new(lane, &Config::new(FORMAT), 1000);
        let words = |units: &mut Units| {
            let mut contents = Contents::new();
            units.write_words(&mut Vec::new(), &mut contents);
            contents
        };
        units.inbox.put(0, 0, Tail::More, &[0; 900]).unwrap();
        units.discard_unread();
        assert_eq!(words(&mut units)[..], [], "it may still be read");
        units.stop_reading();
        assert_eq!(words(&mut units)[..], [Content::MaxData { lane }, Content::StopSending { lane }]);
        for unit in 1..9 {
            units.inbox.put(unit, 0, Tail::More, &[0; 900]).unwrap();
            units.discard_unread();
            assert_eq!(words(&mut units)[..], [Content::MaxData { lane }]);
        }
        units.stop_reading();
        assert_eq!(words(&mut units)[..], [], "it has said so");
    }
}
