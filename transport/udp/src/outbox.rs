//! The frames lane as it is sent: units whose bytes are kept until they are acknowledged.

use std::collections::VecDeque;
use std::ops::Range;

use bytes::{Buf, BufMut, BytesMut};
use trimaran_proto::{FrameMessage, Goodbye, Message};

use crate::chunk::{Chunk, Tail, part_overhead};
use crate::ranges::RangeSet;

/// Units in order of their numbers. A unit is a frame, statistics, a goodbye, or, empty, the end of the lane without one.
#[derive(Debug)]
pub(crate) struct Outbox {
    units: VecDeque<Unit>,
    /// The number of the first unit kept.
    first: u64,
    /// What the receiver allows in all.
    allowed_bytes: u64,
    allowed_units: u64,
    /// Bytes that were sent for the first time.
    offered: u64,
    kept: usize,
}

#[derive(Debug, Default)]
struct Unit {
    /// Bytes from `base` on; what lies before is acknowledged.
    data: BytesMut,
    base: u64,
    sent: u64,
    acked: RangeSet,
    lost: RangeSet,
    /// The end, once it is known, and whether it must be sent, and whether it has arrived.
    end: Option<Tail>,
    end_due: bool,
    end_acked: bool,
}

impl Outbox {
    pub(crate) fn new(allowed_bytes: u64, allowed_units: u64) -> Self {
        Self { units: VecDeque::new(), first: 0, allowed_bytes, allowed_units, offered: 0, kept: 0 }
    }

    /// Bytes that wait for their acknowledgement.
    pub(crate) const fn kept(&self) -> usize {
        self.kept
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.units.is_empty()
    }

    /// Takes the next message of the lane, which a frame writer has put in order.
    pub(crate) fn put(&mut self, message: FrameMessage) {
        match message {
            FrameMessage::Ids(batch) => self.append(batch.as_bytes()),
            FrameMessage::End(end) => self.end(Tail::Frame(end.hash)),
            begin @ FrameMessage::Begin(_) => {
                self.units.push_back(Unit::default());
                self.append_message(&Message::Frame(begin));
            }
            stats @ FrameMessage::Stats(_) => self.whole(&Message::Frame(stats)),
        }
    }

    pub(crate) fn goodbye(&mut self, reason: Goodbye) {
        self.cut();
        self.whole(&Message::Goodbye(reason));
    }

    /// Ends the lane without a goodbye.
    pub(crate) fn gone(&mut self) {
        self.cut();
        self.units.push_back(Unit::default());
        self.end(Tail::End);
    }

    fn whole(&mut self, message: &Message) {
        self.units.push_back(Unit::default());
        self.append_message(message);
        self.end(Tail::End);
    }

    fn append_message(&mut self, message: &Message) {
        let mut bytes = BytesMut::new();
        message.encode(&mut bytes);
        self.append(&bytes);
    }

    fn append(&mut self, bytes: &[u8]) {
        if let Some(unit) = self.units.back_mut() {
            unit.data.put_slice(bytes);
            self.kept += bytes.len();
        }
    }

    fn end(&mut self, tail: Tail) {
        if let Some(unit) = self.units.back_mut() {
            unit.end = Some(tail);
            unit.end_due = true;
        }
    }

    /// Ends a frame that will never be finished.
    fn cut(&mut self) {
        if self.units.back().is_some_and(|unit| unit.end.is_none()) {
            self.end(Tail::End);
        }
    }

    /// Throws everything away: nobody reads the lane.
    pub(crate) fn drop_all(&mut self) {
        self.first += self.units.len() as u64;
        self.units.clear();
        self.kept = 0;
    }

    pub(crate) fn allow(&mut self, bytes: u64, units: u64) {
        self.allowed_bytes = self.allowed_bytes.max(bytes);
        self.allowed_units = self.allowed_units.max(units);
    }

    /// Whether [`Outbox::write_part`] has something, given room.
    pub(crate) fn has_due(&self) -> bool {
        let units = self.allowed_units.saturating_sub(self.first);
        let credit = self.offered < self.allowed_bytes;
        self.units.iter().zip(0..units).any(|(unit, _)| {
            let fresh = unit.sent < unit.written();
            !unit.lost.is_empty() || fresh && credit || !fresh && unit.end_due
        })
    }

    /// Writes the next part that is due into `out`, at most `room` bytes; older units and lost parts first.
    pub(crate) fn write_part(&mut self, room: usize, out: &mut Vec<u8>) -> Option<(u64, Range<u64>)> {
        let units = self.allowed_units.saturating_sub(self.first);
        for (unit, at) in self.units.iter_mut().zip(0..units) {
            let number = self.first + at;
            let most = room.checked_sub(part_overhead(number, unit.written())).filter(|most| *most >= 4)?
                as u64
                & !3;
            let fresh = (unit.written() - unit.sent).min(self.allowed_bytes.saturating_sub(self.offered));
            let range = match unit.lost.pop_front(most) {
                Some(range) => range,
                None if fresh > 0 => {
                    let range = unit.sent..unit.sent + fresh.min(most);
                    unit.sent = range.end;
                    self.offered += range.end - range.start;
                    range
                }
                None if unit.end_due && unit.sent == unit.written() => unit.sent..unit.sent,
                None => continue,
            };
            let last = range.end == unit.written();
            let tail = if last { unit.end.unwrap_or(Tail::Pause) } else { Tail::More };
            unit.end_due &= !(last && unit.end.is_some());
            let from = range.start.saturating_sub(unit.base) as usize;
            let to = range.end.saturating_sub(unit.base) as usize;
            let data = unit.data.get(from..to).unwrap_or_default();
            Chunk::Part { unit: number, offset: range.start, tail, data }.write(out);
            return Some((number, range));
        }
        None
    }

    /// A part has arrived; `ended` if it carried the unit's end.
    pub(crate) fn on_ack(&mut self, number: u64, range: Range<u64>, ended: bool) {
        let Some(unit) = self.unit(number) else { return };
        unit.lost.remove(&range);
        unit.acked.insert(range);
        unit.end_acked |= ended;
        let done = unit.acked.end_of_run(unit.base);
        let freed = (done - unit.base) as usize;
        unit.data.advance(freed.min(unit.data.len()));
        unit.base = done;
        self.kept = self.kept.saturating_sub(freed);
        while self.units.front().is_some_and(|unit| unit.end_acked && unit.data.is_empty()) {
            self.units.pop_front();
            self.first += 1;
        }
    }

    /// A part has to be sent again.
    pub(crate) fn on_loss(&mut self, number: u64, range: Range<u64>, ended: bool) {
        let Some(unit) = self.unit(number) else { return };
        unit.end_due |= ended && !unit.end_acked;
        for gap in unit.acked.gaps(range) {
            unit.lost.insert(gap);
        }
    }

    /// Whether the part ends its unit, as far as is known now.
    pub(crate) fn ends(&self, number: u64, range: &Range<u64>) -> bool {
        let at = number.checked_sub(self.first).and_then(|at| usize::try_from(at).ok());
        at.and_then(|at| self.units.get(at))
            .is_some_and(|unit| unit.end.is_some() && range.end == unit.written())
    }

    fn unit(&mut self, number: u64) -> Option<&mut Unit> {
        let at = usize::try_from(number.checked_sub(self.first)?).ok()?;
        self.units.get_mut(at)
    }
}

impl Unit {
    /// How many bytes the unit has so far.
    fn written(&self) -> u64 {
        self.base + self.data.len() as u64
    }
}
