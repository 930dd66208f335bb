//! Receiving a lane of units: they are assembled in any order, and delivered in theirs.

use std::collections::BTreeMap;

use bytes::Bytes;
use thiserror::Error;
use trimaran_wire::{BatchSize, CloseReason, DecodeError, Format, FrameMessage};

use crate::chunk::{Tail, UnitLane};

mod blocks;
mod buffers;
mod gaps;
mod store;
mod unit;

use buffers::Buffers;
use store::Pool;
use unit::{Step, Unit};

/// How many units may be open at once.
const UNITS: u64 = 1024;

/// An item received on a lane.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Received {
    /// A message of the frames lane.
    Frame(FrameMessage),
    /// A message of the messages lane, encoded by the application.
    Message(Bytes),
    /// A block of the bulk lane.
    Block(Bytes),
    /// The peer leaves.
    Closed(CloseReason),
    /// The peer is gone without a close.
    Gone,
}

/// A violation of the rules of a unit lane by a peer.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum LaneViolation {
    /// It sent more than flow control allowed.
    #[error("more was sent than allowed")]
    FlowControl,
    /// It ended a unit in two places, or sent bytes behind the end.
    #[error("a unit ends in two places")]
    End,
    /// Repair blocks of a unit overlap.
    #[error("repair blocks of a unit overlap")]
    Block,
    /// A unit is not a message.
    #[error("a unit holds no message of the lane")]
    Unit,
    /// A unit does not decode.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// A coded batch does not say how many items it has.
    #[error("a coded batch does not say how many items it has")]
    Coded,
}

/// Units in order of their numbers.
#[derive(Debug)]
pub(crate) struct Inbox {
    lane: UnitLane,
    /// Units with any data received.
    units: BTreeMap<u64, Unit>,
    buffers: Buffers,
    /// The number of the unit that is being delivered.
    first: u64,
    /// Bytes of a full batch when delivered.
    batch: usize,
    window: u64,
    /// Bytes delivered, and bytes of flow control used by the peer.
    taken: u64,
    used: u64,
    /// The repair shards that all units keep.
    repair: usize,
    /// The flow control limits last sent to the peer.
    told: (u64, u64),
    pub(crate) frames_repaired: u64,
}

impl Inbox {
    pub(crate) fn new(lane: UnitLane, format: Format, batch: BatchSize, window: u64) -> Self {
        Self {
            lane,
            units: BTreeMap::new(),
            buffers: Buffers::new(format),
            first: 0,
            batch: full_batch(&format, batch, window),
            window,
            taken: 0,
            used: 0,
            repair: 0,
            told: (window, UNITS),
            frames_repaired: 0,
        }
    }

    /// The initial limit of units for the peer.
    pub(crate) const fn initial_units() -> u64 {
        UNITS
    }

    pub(crate) const fn set_batch(&mut self, batch: BatchSize) {
        self.batch = full_batch(&self.buffers.format, batch, self.window);
    }

    /// Discards received data that nobody reads. Returns whether to send the peer new limits.
    pub(crate) fn discard(&mut self) -> bool {
        self.units.clear();
        self.repair = 0;
        self.taken = self.taken.max(self.used);
        self.max_data_due()
    }

    /// Whether [`Inbox::take`] would return an item or an error.
    pub(crate) fn is_readable(&self) -> bool {
        self.units.get(&self.first).is_some_and(|unit| unit.is_readable(self.batch, &self.buffers.format))
    }

    /// Whether a good part of the window was used since the last limits were sent.
    pub(crate) const fn max_data_due(&self) -> bool {
        let (bytes, units) = self.told;
        self.taken + self.window - bytes >= self.window / 4 || self.first + UNITS - units >= UNITS / 4
    }

    /// The limits of bytes and units for the peer; they count as sent.
    pub(crate) const fn announce_max_data(&mut self) -> (u64, u64) {
        self.told = (self.taken + self.window, self.first + UNITS);
        self.told
    }

    /// Takes a part.
    pub(crate) fn put(
        &mut self,
        number: u64,
        offset: u64,
        tail: Tail,
        data: &[u8],
    ) -> Result<(), LaneViolation> {
        let to = offset.checked_add(data.len() as u64).ok_or(LaneViolation::FlowControl)?;
        self.with_unit(number, |unit, flow, pool| {
            if !unit.is_given_up() {
                flow.use_up_to(unit, to)?;
                unit.note(to, tail)?;
                unit.highest = unit.highest.max(to);
                let found = unit.put(offset, data, pool);
                gaps::restore(unit, flow, pool, found)?;
            }
            Ok(())
        })
    }

    /// Calls `work` on a unit, unless it was delivered already.
    fn with_unit(
        &mut self,
        number: u64,
        work: impl FnOnce(&mut Unit, &mut FlowControl, &mut Pool) -> Result<(), LaneViolation>,
    ) -> Result<(), LaneViolation> {
        let Some(at) = number.checked_sub(self.first) else { return Ok(()) };
        if at >= UNITS {
            return Err(LaneViolation::FlowControl);
        }
        let pool = &mut self.buffers.pool;
        pool.work += 16;
        let unit = self.units.entry(number).or_insert_with(|| Unit::new(pool.store()));
        let before = (unit.repair_shards(), unit.repaired);
        let mut flow = FlowControl { used: self.used, allowed: self.taken + self.window };
        work(unit, &mut flow, pool)?;
        self.used = flow.used;
        self.repair = self.repair + unit.repair_shards() - before.0;
        self.frames_repaired += u64::from(unit.repaired && !before.1);
        Ok(())
    }

    /// The next item, if it has arrived. After a violation there is none: the rest has no meaning.
    pub(crate) fn take(&mut self) -> Result<Option<Received>, LaneViolation> {
        let taken = self.take_next();
        if taken.is_err() {
            self.units.clear();
        }
        taken
    }

    fn take_next(&mut self) -> Result<Option<Received>, LaneViolation> {
        loop {
            let Some(unit) = self.units.get_mut(&self.first) else { return Ok(None) };
            let (base, repair) = (unit.base, unit.repair_shards());
            let step = unit.step(self.batch, &mut self.buffers)?;
            self.taken += unit.base - base;
            self.repair = self.repair + unit.repair_shards() - repair;
            match step {
                Step::Last(item) => {
                    if let Some(over) = self.units.remove(&self.first) {
                        self.repair -= over.repair_shards();
                        self.buffers.pool.take_back(over.store);
                    }
                    self.first += 1;
                    if let Some(item) = item {
                        return self.belongs(item).map(Some);
                    }
                }
                Step::Wait => return Ok(None),
                Step::Item(item) => return self.belongs(item).map(Some),
            }
        }
    }

    /// The received item, if it belongs on this lane.
    fn belongs(&self, item: Received) -> Result<Received, LaneViolation> {
        let belongs = match &item {
            Received::Frame(_) => matches!(self.lane, UnitLane::Frames | UnitLane::Channel(_)),
            Received::Message(_) => self.lane == UnitLane::Messages,
            Received::Block(_) => self.lane == UnitLane::Bulk,
            Received::Closed(_) | Received::Gone => true,
        };
        if belongs { Ok(item) } else { Err(LaneViolation::Unit) }
    }

    /// The cost of received data, in steps of eight bytes or one look-up each.
    pub(crate) const fn work(&self) -> u64 {
        self.buffers.pool.work
    }
}

/// The bytes of a full batch, at most a part of the window: the peer has no room to fill a larger one while
/// nothing is delivered.
const fn full_batch(format: &Format, batch: BatchSize, window: u64) -> usize {
    let room = (window / 4) as usize / format.item;
    let items = if batch.items() < room { batch.items() } else { room };
    if items == 0 { format.item } else { items * format.item }
}

/// The flow control used by the peer.
struct FlowControl {
    used: u64,
    allowed: u64,
}

impl FlowControl {
    /// Whether flow control allows that much of the unit.
    fn allows(&self, unit: &Unit, to: u64) -> Result<u64, LaneViolation> {
        let used = self.used.checked_add(to.saturating_sub(unit.highest));
        used.filter(|used| *used <= self.allowed).ok_or(LaneViolation::FlowControl)
    }

    fn use_up_to(&mut self, unit: &Unit, to: u64) -> Result<(), LaneViolation> {
        self.used = self.allows(unit, to)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trimaran_wire::{FrameNumber, Message};

    use super::*;
    use crate::samples::{FORMAT, FORMAT_OF_12, encoded, value};

    pub(super) fn empty() -> Inbox {
        Inbox::new(UnitLane::Frames, FORMAT, BatchSize::default(), 4 << 20)
    }

    /// The unit of a frame with these item bytes, its header as large as `format` says.
    pub(super) fn unit_of(format: &Format, items: &[u8]) -> Vec<u8> {
        let header = value(3).iter().copied().cycle().take(format.header).collect();
        let begin = FrameMessage::Begin { frame: FrameNumber(0), header };
        [&encoded(&Message::Frame(begin))[..], items].concat()
    }

    pub(super) fn all(inbox: &mut Inbox) -> Vec<Received> {
        std::iter::from_fn(|| inbox.take().unwrap()).collect()
    }

    /// The batches among received items.
    pub(super) fn batches(items: &[Received]) -> impl Iterator<Item = &Bytes> {
        items.iter().filter_map(|item| match item {
            Received::Frame(FrameMessage::Batch(bytes)) => Some(bytes),
            _ => None,
        })
    }

    #[test]
    fn lone_bytes_take_a_page_each_at_most_and_are_passed_on_once_no_more_comes() {
        for (each, pages) in [(64, 1024), (4096, 16)] {
            let mut inbox = empty();
            for at in 0..4096 * 16 {
                inbox.put(at / each, 1 + at % each * 2, Tail::More, &[0]).unwrap();
            }
            let kept: usize = inbox.units.values().map(|unit| unit.store.pages()).sum();
            assert_eq!((inbox.take(), kept), (Ok(None), pages * (2 * each as usize).div_ceil(store::PAGE)));
        }
    }

    #[test]
    fn what_is_readable_is_what_can_be_taken() {
        let mut inbox = empty();
        assert!(!inbox.is_readable());
        let bytes = unit_of(&FORMAT, &[7; 8]);
        for (range, tail, messages) in [
            (84..88, Tail::More, 0),
            (0..79, Tail::More, 0),
            (79..84, Tail::More, 1),
            (88..88, Tail::Pause, 1),
            (88..88, Tail::End, 0),
        ] {
            inbox.put(0, range.start as u64, tail, bytes.get(range).unwrap()).unwrap();
            assert_eq!(inbox.is_readable(), messages > 0 || tail == Tail::End);
            for _ in 0..messages {
                assert!(inbox.take().unwrap().is_some());
            }
            assert_eq!(inbox.take(), Ok(None));
            assert!(!inbox.is_readable());
        }
        inbox.put(1, 0, Tail::More, &bytes).unwrap();
        assert_eq!((all(&mut inbox).len(), inbox.is_readable()), (1, false));
        inbox.set_batch(BatchSize::new(2).unwrap());
        assert_eq!((inbox.is_readable(), all(&mut inbox).len()), (true, 1), "two items are a batch now");
    }

    #[test]
    fn a_message_longer_than_the_beginning_of_a_frame_is_readable_once_it_is_whole() {
        let mut inbox = Inbox::new(UnitLane::Messages, FORMAT_OF_12, BatchSize::default(), 4 << 20);
        let message = Bytes::from(vec![7; 100]);
        let bytes = encoded(&Message::Message(message.clone()));
        inbox.put(0, 0, Tail::More, &bytes[..90]).unwrap();
        assert_eq!((inbox.is_readable(), inbox.take()), (false, Ok(None)));
        inbox.put(0, 90, Tail::End, &bytes[90..]).unwrap();
        assert_eq!((inbox.is_readable(), inbox.take()), (true, Ok(Some(Received::Message(message)))));
    }

    #[test]
    fn what_nobody_reads_is_thrown_away_and_makes_room() {
        let mut inbox = Inbox::new(UnitLane::Frames, FORMAT, BatchSize::default(), 1000);
        for unit in 0..10 {
            inbox.put(unit, 0, Tail::More, &[0; 900]).unwrap();
            assert!(inbox.discard(), "the peer should hear of new room");
            assert_eq!((inbox.take(), inbox.units.len()), (Ok(None), 0));
        }
    }

    #[test]
    fn a_batch_that_the_window_cannot_hold_is_passed_on_in_smaller_ones() {
        let format = Format { item: 256, ..FORMAT };
        let mut inbox = Inbox::new(UnitLane::Frames, format, BatchSize::MAX, 10_000);
        let bytes = unit_of(&format, &[9; 256 * 100]);
        let (mut sent, mut items) = (0, Vec::new());
        while sent < bytes.len() {
            let (allowed, _) = inbox.announce_max_data();
            let to = bytes.len().min(allowed as usize);
            assert!(to > sent, "no more room after {sent} bytes");
            inbox.put(0, sent as u64, Tail::More, &bytes[sent..to]).unwrap();
            sent = to;
            items.extend(all(&mut inbox));
        }
        inbox.put(0, sent as u64, Tail::Frame(7), &[]).unwrap();
        items.extend(all(&mut inbox));
        assert!(batches(&items).all(|batch| batch.len().is_multiple_of(256)));
        assert_eq!(batches(&items).map(Bytes::len).sum::<usize>(), 256 * 100);
    }

    proptest! {
        #[test]
        fn a_frame_comes_whole_in_any_order_of_its_parts(
            count in 0u32..300, cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..20),
            order in any::<u64>(), batch in 1u32..300, twice: bool,
        ) {
            let sent: Vec<u8> = (0..count * 12).map(|at| (at * 31 / 7) as u8).collect();
            let bytes = unit_of(&FORMAT_OF_12, &sent);
            let mut cuts: Vec<_> = cuts.iter().map(|at| at.index(bytes.len())).collect();
            cuts.extend([0, bytes.len()]);
            cuts.sort_unstable();
            let mut parts: Vec<_> = cuts.windows(2).map(|cut| cut[0]..cut[1]).collect();
            parts.sort_by_key(|part| (part.start as u64 + 1).wrapping_mul(order | 1).rotate_left(17));
            if twice {
                parts.extend_from_within(..);
            }
            let mut inbox = Inbox::new(UnitLane::Frames, FORMAT_OF_12, BatchSize::new(batch).unwrap(), 4 << 20);
            let mut items = Vec::new();
            for part in parts {
                let tail = if part.end == bytes.len() { Tail::Frame(7) } else { Tail::More };
                inbox.put(0, part.start as u64, tail, &bytes[part.clone()]).unwrap();
                items.extend(all(&mut inbox));
            }
            prop_assert_eq!(batches(&items).flatten().copied().collect::<Vec<_>>(), sent);
            prop_assert!(batches(&items).all(|bytes| bytes.len() % 12 == 0 && bytes.len() <= batch as usize * 12));
            let is_end = matches!(items.last(), Some(Received::Frame(FrameMessage::End(end))) if end.items == count);
            prop_assert!(is_end, "{:?}", items.last());
        }
    }
}
