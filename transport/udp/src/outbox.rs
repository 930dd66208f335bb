//! Sending a lane of units: bytes are kept until they are acknowledged, or no longer worth sending.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use bytes::{BufMut, BytesMut};
use trimaran_wire::{CloseReason, Format, FrameEnd, FrameMessage, FrameNumber, Message};

use crate::chunk::{CODED_UNIT, Tail, UnitLane};
use crate::recovery::Content;
use crate::repair::{Budget, Path};
use crate::spare::Spare;

mod delivery;
mod repair_block;
mod unit;

use unit::Unit;

/// The cost of a unit beside its bytes, so that many small ones are not free.
const UNIT_COST: usize = 256;

/// Units in order of their numbers. A unit is a frame, a message, a block, a close, or, if empty, the end of
/// the lane without a close.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    lane: UnitLane,
    format: Format,
    units: VecDeque<Unit>,
    /// Buffers for later units.
    spare: Spare,
    /// The number of the first unit kept.
    first: u64,
    /// The units with something to send that needs no flow control.
    due: BTreeSet<u64>,
    /// The first unit that has, or may get, bytes not sent yet.
    fresh: u64,
    /// The first unit that may have no deadline yet, and the first that may become late: deadlines rise.
    undated: u64,
    in_time: u64,
    /// The receiver's limit of bytes in all.
    allowed_bytes: u64,
    allowed_units: u64,
    /// Bytes sent for the first time.
    offered: u64,
    kept: usize,
    /// How long after its end a frame is worth sending; always if `None`.
    pub(crate) frame_deadline: Option<Duration>,
    pub(crate) repair: Budget,
    /// The size of the last frame: the next one will be about as large.
    last_length: usize,
    /// Whether the batches of later frames are messages.
    coded: bool,
    /// The newest frame that has arrived completely.
    pub(crate) confirmed: Option<FrameNumber>,
    pub(crate) frames_given_up: u64,
    /// Parts that were retransmitted.
    pub(crate) repeated: u64,
    /// Repair shards that were sent.
    pub(crate) repair_sent: u64,
    /// How often a unit was looked at.
    pub(crate) visited: u64,
}

impl Outbox {
    /// A lane without deadline, repair and coding, whose receiver takes so many bytes and units at first.
    pub(crate) fn new(lane: UnitLane, format: Format, (allowed_bytes, allowed_units): (u64, u64)) -> Self {
        Self { lane, format, allowed_bytes, allowed_units, ..Self::default() }
    }

    /// Bytes that wait for acknowledgement, and the cost of their units.
    pub(crate) const fn kept(&self) -> usize {
        self.kept
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.units.is_empty()
    }

    /// Takes the next message of the lane, which a frame writer has put in order. A coded batch is ignored in
    /// a frame that began without coding.
    pub(crate) fn put(&mut self, message: &FrameMessage, path: Path) {
        match message {
            FrameMessage::Batch(_) | FrameMessage::Coded(_) if self.is_coded() => {
                self.append(path, |out| message.encode(out));
            }
            FrameMessage::Batch(bytes) => self.append(path, |out| out.put_slice(bytes)),
            FrameMessage::Coded(_) => {}
            FrameMessage::End(end) => self.finish(end, path),
            FrameMessage::Begin { frame, .. } => {
                let shard = self.repair.shard(self.last_length, path);
                let unit = Unit::frame(*frame, &self.format, self.coded, shard, self.spare.take());
                self.add(unit);
                if self.coded {
                    self.append(path, |out| out.put_u8(CODED_UNIT));
                }
                self.append(path, |out| message.encode(out));
            }
        }
    }

    /// Takes a message that is a unit by itself: an application's message, a block, or a close.
    pub(crate) fn put_whole(&mut self, message: &Message, path: Path) {
        let unit = Unit::new(&self.format, path.shard, self.spare.take());
        self.add(unit);
        self.append(path, |out| message.encode(out));
        self.end(Tail::End, path);
    }

    pub(crate) const fn set_coded(&mut self, coded: bool) {
        self.coded = coded;
    }

    fn is_coded(&self) -> bool {
        self.units.back().is_some_and(|unit| unit.coded)
    }

    pub(crate) fn end_with(&mut self, reason: CloseReason, path: Path) {
        self.cut(path);
        self.put_whole(&Message::Close(reason), path);
    }

    /// Ends the lane without a close.
    pub(crate) fn gone(&mut self, path: Path) {
        self.cut(path);
        self.add(Unit::new(&self.format, path.shard, BytesMut::new()));
        self.end(Tail::End, path);
    }

    fn add(&mut self, unit: Unit) {
        self.units.push_back(unit);
        self.kept += UNIT_COST;
    }

    fn finish(&mut self, end: &FrameEnd, path: Path) {
        if let Some(unit) = self.units.back_mut() {
            unit.items = end.items;
            self.last_length = usize::try_from(unit.written()).unwrap_or(usize::MAX);
        }
        self.end(Tail::Frame(end.hash), path);
    }

    fn append(&mut self, path: Path, write: impl FnOnce(&mut BytesMut)) {
        if let Some(unit) = self.units.back_mut() {
            self.kept += unit.append(write);
            unit.protect(&mut self.repair, path);
        }
        self.look_at_last();
    }

    fn end(&mut self, tail: Tail, path: Path) {
        if let Some(unit) = self.units.back_mut() {
            unit.end(tail);
            unit.protect(&mut self.repair, path);
        }
        self.look_at_last();
    }

    fn look_at_last(&mut self) {
        self.look(self.first + (self.units.len() as u64).saturating_sub(1));
    }

    /// Updates the pending work of a changed unit.
    fn look(&mut self, number: u64) {
        if self.unit(number).is_some_and(|unit| unit.is_due()) {
            self.due.insert(number);
        } else {
            self.due.remove(&number);
        }
        self.fresh = self.fresh.max(self.first);
        while self.unit(self.fresh).is_some_and(|unit| unit.is_all_sent()) {
            self.fresh += 1;
            self.visited += 1;
        }
    }

    /// Ends a frame that will never be finished.
    fn cut(&mut self, path: Path) {
        if self.units.back().is_some_and(|unit| !unit.is_ended()) {
            self.end(Tail::End, path);
        }
    }

    /// Discards everything: nobody reads the lane.
    pub(crate) fn drop_all(&mut self) {
        self.first += self.units.len() as u64;
        self.units.clear();
        self.due.clear();
        self.kept = 0;
    }

    pub(crate) fn allow(&mut self, bytes: u64, units: u64) {
        self.allowed_bytes = self.allowed_bytes.max(bytes);
        self.allowed_units = self.allowed_units.max(units);
    }

    /// Whether [`Outbox::write_next`] has something to write, given room.
    pub(crate) fn has_due(&self) -> bool {
        self.next_due().is_some()
    }

    /// The first unit that has something to send now.
    fn next_due(&self) -> Option<u64> {
        let due = self.due.first().copied();
        let at = usize::try_from(self.fresh.saturating_sub(self.first)).ok()?;
        let fresh = self.units.get(at).filter(|unit| unit.has_fresh() && self.allowed_bytes > self.offered);
        let next = due.into_iter().chain(fresh.map(|_| self.fresh)).min();
        next.filter(|number| *number < self.allowed_units)
    }

    /// Writes the next pending chunk into `out`, at most `room` bytes; older units and lost parts first. A
    /// part that would fit alone, `whole`, is not split.
    pub(crate) fn write_next(&mut self, room: usize, whole: usize, out: &mut Vec<u8>) -> Option<Content> {
        let number = self.next_due()?;
        let allowed = self.allowed_bytes.saturating_sub(self.offered);
        let at = (self.lane, number);
        let (content, fresh) = self.unit(number)?.write(at, allowed, room, whole, out)?;
        self.look(number);
        self.offered += fresh;
        match &content {
            Content::Part { range, .. } if range.end - range.start > fresh => {
                self.repeated += 1;
                self.repair.on_repeated((range.end - range.start) as usize);
            }
            Content::Repair { .. } => self.repair_sent += 1,
            _ => {}
        }
        Some(content)
    }

    /// The unit with that number, if it is kept.
    fn unit(&mut self, number: u64) -> Option<&mut Unit> {
        let at = usize::try_from(number.checked_sub(self.first)?).ok()?;
        self.units.get_mut(at)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use trimaran_net::Instant;

    use super::*;
    use crate::repair::Repair;
    use crate::samples::{FORMAT, value};

    pub(super) const PATH: Path = Path { shard: 1136, loss: 0.0 };

    /// A sender without repair.
    pub(super) fn sender(frame_deadline: Option<u64>) -> Outbox {
        let outbox = Outbox::new(UnitLane::Frames, FORMAT, (1 << 20, 1024));
        Outbox { frame_deadline: frame_deadline.map(Duration::from_millis), ..outbox }
    }

    pub(super) fn frame(outbox: &mut Outbox, number: u32) {
        begin(outbox, number, PATH);
        let end = FrameEnd { frame: FrameNumber(number), items: 0, hash: 0 };
        outbox.put(&FrameMessage::End(end), PATH);
    }

    pub(super) fn begin(outbox: &mut Outbox, number: u32, path: Path) {
        let begin = FrameMessage::Begin { frame: FrameNumber(number), header: value(number) };
        outbox.put(&begin, path);
    }

    pub(super) fn at(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn empty_frames_cost_as_well_and_give_back_what_they_cost() {
        let mut outbox = sender(None);
        (0..3).for_each(|number| frame(&mut outbox, number));
        assert_eq!(outbox.kept(), 3 * (80 + UNIT_COST));
        for unit in 0..3 {
            outbox.on_ack(unit, 0..80, true);
        }
        assert_eq!((outbox.kept(), outbox.is_empty()), (0, true));
    }

    /// The units of the parts that may be sent now, each with its range if that ends the unit.
    fn ends(outbox: &mut Outbox) -> Vec<(u64, Option<Range<u64>>)> {
        let contents = std::iter::from_fn(|| outbox.write_next(1172, 1172, &mut Vec::new()));
        let end = |content| match content {
            Content::Part { unit, range, ended, .. } => (unit, ended.then_some(range)),
            other => panic!("{other:?}"),
        };
        contents.map(end).collect()
    }

    #[test]
    fn the_end_of_a_lane_ends_an_open_frame_first_which_gets_no_repair() {
        for (reason, length) in [(None, 0), (Some(CloseReason::new(0, "over")), 10)] {
            let mut outbox = sender(None);
            frame(&mut outbox, 0);
            assert_eq!(ends(&mut outbox), [(0, Some(0..80))]);
            outbox.on_ack(0, 0..80, true);
            outbox.repair = Budget::new(Repair::On, 100);
            begin(&mut outbox, 1, PATH);
            assert_eq!(ends(&mut outbox), [(1, None)]);
            match reason {
                Some(reason) => outbox.end_with(reason, PATH),
                None => outbox.gone(PATH),
            }
            assert_eq!(ends(&mut outbox), [(1, Some(80..80)), (2, Some(0..length))]);
        }
    }

    #[test]
    fn what_nobody_reads_is_dropped_and_its_numbers_are_used_up() {
        let mut outbox = sender(None);
        (0..2).for_each(|number| frame(&mut outbox, number));
        outbox.drop_all();
        assert_eq!((outbox.kept(), outbox.is_empty(), outbox.has_due()), (0, true, false));
        frame(&mut outbox, 2);
        assert_eq!(ends(&mut outbox), [(2, Some(0..80))]);
    }

    #[test]
    fn as_many_units_leave_as_are_allowed() {
        let mut outbox = Outbox::new(UnitLane::Frames, FORMAT, (1 << 20, 1));
        (0..3).for_each(|number| frame(&mut outbox, number));
        assert_eq!(ends(&mut outbox), [(0, Some(0..80))]);
        outbox.allow(0, 2);
        assert_eq!(ends(&mut outbox), [(1, Some(0..80))]);
    }

    /// A frame of nine items of 250 bytes, in shards of 1,136.
    fn long_items() -> Outbox {
        let mut outbox = Outbox { format: Format { item: 250, ..FORMAT }, ..sender(None) };
        begin(&mut outbox, 0, PATH);
        outbox.put(&FrameMessage::Batch(vec![1; 250 * 9].into()), PATH);
        outbox
    }

    #[test]
    fn a_part_that_no_packet_takes_is_cut_to_the_length_of_whole_items() {
        // A part has 14 bytes beside its data here.
        for (room, whole, expected) in [
            (1150, 1172, Some(1136)),
            (1149, 1172, None),
            (600, 1150, None),
            (600, 1149, Some(500)),
            (264, 264, Some(250)),
            (263, 263, None),
        ] {
            let part = |to| Content::Part { lane: UnitLane::Frames, unit: 0, range: 0..to, ended: false };
            let written = long_items().write_next(room, whole, &mut Vec::new());
            assert_eq!(written, expected.map(part), "{room} of {whole} bytes");
        }
    }

    #[test]
    fn a_part_is_cut_only_where_it_does_not_fit() {
        let mut outbox = long_items();
        // A full packet takes everything up to the next shard, even if these are not whole items. So does the
        // rest of a packet if the rest of the frame fits.
        for (room, expected) in [(1172, 0..1136), (1172, 1136..2272), (20, 0..0), (80, 2272..2330)] {
            let lane = UnitLane::Frames;
            let part = Content::Part { lane, unit: 0, range: expected.clone(), ended: false };
            let expected = Some(part).filter(|_| !expected.is_empty());
            assert_eq!(outbox.write_next(room, 1172, &mut Vec::new()), expected, "{room} bytes");
        }
    }
}
