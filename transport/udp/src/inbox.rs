//! The frames lane as it is received: units put together in any order, passed on in theirs.

use std::collections::VecDeque;

use bytes::{Buf, BytesMut};
use thiserror::Error;
use trimaran_proto::{
    BatchSize, DecodeError, Decoder, FrameEnd, FrameMessage, FrameNumber, Goodbye, HEADER_BYTES, ID_BYTES,
    IdBatch, Kind, Message,
};

use crate::chunk::Tail;
use crate::ranges::RangeSet;

/// How many units may be under way.
const UNITS: u64 = 1024;
/// How many separate pieces of all units together are kept: an honest peer sends a window of 4 MiB in 3,700 full packets, so that it
/// stays below even if every second one is lost.
const PIECES: usize = 4096;
/// The header and payload of begin: what a frame starts with.
const HEAD: usize = HEADER_BYTES + *Kind::Begin.lengths().end();

/// What comes out of the lane.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Received {
    /// A message of the lane.
    Frame(FrameMessage),
    /// The peer leaves.
    Goodbye(Goodbye),
    /// The peer is gone without a goodbye.
    Gone,
}

/// What a peer did on the frames lane that it must not do.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum LaneViolation {
    /// It sent more than it was allowed.
    #[error("more was sent than allowed")]
    Credit,
    /// It ended a unit in two places, or sent bytes behind the end.
    #[error("a unit ends in two places")]
    End,
    /// It sent with too many gaps.
    #[error("units came in more than {PIECES} separate pieces")]
    Pieces,
    /// A unit is no message.
    #[error("a unit holds no message of the lane")]
    Unit,
    /// A unit does not decode.
    #[error(transparent)]
    Decode(#[from] DecodeError),
}

/// Units in order of their numbers.
#[derive(Debug)]
pub(crate) struct Inbox {
    units: VecDeque<Unit>,
    /// The number of the unit that is passed on now.
    first: u64,
    batch: BatchSize,
    window: u64,
    /// Bytes passed on, and bytes that the peer has used of what it may send.
    taken: u64,
    used: u64,
    /// The pieces of all units.
    pieces: usize,
    /// The credit that the peer was told of.
    told: (u64, u64),
}

#[derive(Debug, Default)]
struct Unit {
    /// Bytes from `base` on, with gaps; what lies before was passed on.
    data: BytesMut,
    base: u64,
    have: RangeSet,
    highest: u64,
    /// Up to where everything shall be passed on.
    pause: u64,
    end: Option<(u64, Tail)>,
    frame: Option<FrameNumber>,
}

impl Inbox {
    pub(crate) fn new(batch: BatchSize, window: u64) -> Self {
        let told = (window, UNITS);
        Self { units: VecDeque::new(), first: 0, batch, window, taken: 0, used: 0, pieces: 0, told }
    }

    /// What the peer may send before it hears of more.
    pub(crate) const fn initial_units() -> u64 {
        UNITS
    }

    pub(crate) const fn set_batch(&mut self, batch: BatchSize) {
        self.batch = batch;
    }

    /// Throws away what has arrived, for nobody reads it. Says whether the peer should hear of the credit that this gives.
    pub(crate) fn discard(&mut self) -> bool {
        self.units.clear();
        self.pieces = 0;
        self.taken = self.used;
        self.credit_due()
    }

    /// Whether [`Inbox::take`] would give a message or find a fault.
    pub(crate) fn is_readable(&self) -> bool {
        self.units.front().is_some_and(|unit| unit.is_readable(self.batch))
    }

    /// Whether a good part of the credit was used up since the peer was told.
    pub(crate) const fn credit_due(&self) -> bool {
        let (bytes, units) = self.told;
        self.taken + self.window - bytes >= self.window / 4 || self.first + UNITS - units >= UNITS / 4
    }

    /// The bytes and units that the peer may send in all; it counts as told.
    pub(crate) const fn tell_credit(&mut self) -> (u64, u64) {
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
        let Some(at) = number.checked_sub(self.first) else { return Ok(()) };
        if at >= UNITS {
            return Err(LaneViolation::Credit);
        }
        while self.units.len() as u64 <= at {
            self.units.push_back(Unit::default());
        }
        let Some(unit) = usize::try_from(at).ok().and_then(|at| self.units.get_mut(at)) else {
            return Ok(());
        };
        let to = offset.checked_add(data.len() as u64).ok_or(LaneViolation::Credit)?;
        let fresh = to.saturating_sub(unit.highest);
        if self.used.checked_add(fresh).is_none_or(|used| used > self.taken + self.window) {
            return Err(LaneViolation::Credit);
        }
        let beyond = unit.end.is_some_and(|(end, _)| to > end);
        let ends = matches!(tail, Tail::End | Tail::Frame(_));
        let moved = ends && (unit.end.is_some_and(|known| known != (to, tail)) || to < unit.highest);
        if beyond || moved {
            return Err(LaneViolation::End);
        }
        self.used += fresh;
        unit.highest = unit.highest.max(to);
        match tail {
            Tail::More => {}
            Tail::Pause => unit.pause = unit.pause.max(to),
            Tail::End | Tail::Frame(_) => {
                unit.end = Some((to, tail));
                unit.pause = to;
            }
        }
        let before = unit.have.len();
        unit.store(offset, data);
        self.pieces = self.pieces + unit.have.len() - before;
        if self.pieces > PIECES { Err(LaneViolation::Pieces) } else { Ok(()) }
    }

    /// The next message, if it has arrived. After a violation there is none: what follows it means nothing.
    pub(crate) fn take(&mut self) -> Result<Option<Received>, LaneViolation> {
        let taken = self.take_next();
        if taken.is_err() {
            self.units.clear();
        }
        taken
    }

    fn take_next(&mut self) -> Result<Option<Received>, LaneViolation> {
        loop {
            let Some(unit) = self.units.front_mut() else { return Ok(None) };
            let (base, pieces) = (unit.base, unit.have.len());
            let step = unit.step(self.batch)?;
            self.taken += unit.base - base;
            self.pieces = self.pieces + unit.have.len() - pieces;
            match step {
                Step::Wait => return Ok(None),
                Step::Item(item) => return Ok(Some(item)),
                Step::Last(item) => {
                    self.units.pop_front();
                    self.first += 1;
                    if let Some(item) = item {
                        return Ok(Some(item));
                    }
                }
            }
        }
    }
}

enum Step {
    Wait,
    Item(Received),
    /// The unit is over.
    Last(Option<Received>),
}

impl Unit {
    fn store(&mut self, offset: u64, data: &[u8]) {
        let skip = (self.base.saturating_sub(offset) as usize).min(data.len());
        let (offset, data) = (offset + skip as u64, data.get(skip..).unwrap_or_default());
        if data.is_empty() {
            return;
        }
        let (from, to) = ((offset - self.base) as usize, (offset - self.base) as usize + data.len());
        if self.data.len() < to {
            self.data.resize(to, 0);
        }
        if let Some(slot) = self.data.get_mut(from..to) {
            slot.copy_from_slice(data);
        }
        self.have.insert(offset..offset + data.len() as u64);
    }

    /// Whether [`Unit::step`] would not wait.
    fn is_readable(&self, batch: BatchSize) -> bool {
        let ready = self.have.end_of_run(self.base) - self.base;
        if self.end.is_some_and(|(end, _)| end == self.base + ready) {
            return true;
        }
        match self.frame {
            None => ready as usize >= HEAD,
            Some(_) => {
                let pause = self.pause.saturating_sub(self.base).min(ready);
                ready >= batch.bytes() as u64 || pause >= ID_BYTES as u64
            }
        }
    }

    fn step(&mut self, batch: BatchSize) -> Result<Step, LaneViolation> {
        let ready = self.have.end_of_run(self.base) - self.base;
        let ended = self.end.filter(|(end, _)| *end == self.base + ready).map(|(_, tail)| tail);
        let Some(frame) = self.frame else {
            return self.first_step(ready as usize, ended);
        };
        let pause = self.pause.saturating_sub(self.base).min(ready);
        let whole = batch.bytes() as u64;
        let now = if ready >= whole { whole } else { pause - pause % ID_BYTES as u64 };
        if now > 0 {
            let bytes = self.split(now as usize).freeze();
            let batch = IdBatch::new(bytes).map_err(|_| LaneViolation::Unit)?;
            return Ok(Step::Item(Received::Frame(FrameMessage::Ids(batch))));
        }
        Ok(match ended {
            None => Step::Wait,
            Some(Tail::Frame(hash)) => {
                let ids = (self.base - HEAD as u64) / ID_BYTES as u64;
                let ids = u32::try_from(ids).map_err(|_| LaneViolation::Unit)?;
                let end = FrameEnd { frame, ids, hash };
                Step::Last(Some(Received::Frame(FrameMessage::End(end))))
            }
            Some(_) => Step::Last(None),
        })
    }

    /// What a unit starts with says what it is.
    fn first_step(&mut self, ready: usize, ended: Option<Tail>) -> Result<Step, LaneViolation> {
        let begins = self.data.first() == Some(&Kind::Begin.code());
        let length = match ended {
            Some(_) if ready == 0 => return Ok(Step::Last(Some(Received::Gone))),
            _ if begins && ready >= HEAD => HEAD,
            Some(_) => ready,
            None => return Ok(Step::Wait),
        };
        let mut decoder = Decoder::new();
        decoder.push(&self.split(length));
        match decoder.next_message()? {
            Some(Message::Frame(FrameMessage::Begin(start))) if decoder.pending() == 0 => {
                self.frame = Some(start.frame);
                Ok(Step::Item(Received::Frame(FrameMessage::Begin(start))))
            }
            Some(Message::Frame(stats @ FrameMessage::Stats(_))) if decoder.pending() == 0 => {
                Ok(Step::Last(Some(Received::Frame(stats))))
            }
            Some(Message::Goodbye(reason)) if decoder.pending() == 0 => {
                Ok(Step::Last(Some(Received::Goodbye(reason))))
            }
            _ => Err(LaneViolation::Unit),
        }
    }

    fn split(&mut self, count: usize) -> BytesMut {
        self.base += count as u64;
        self.have.remove(&(0..self.base));
        if count >= self.data.len() {
            return std::mem::take(&mut self.data);
        }
        let mut head = BytesMut::with_capacity(count);
        head.extend_from_slice(self.data.get(..count).unwrap_or_default());
        self.data.advance(count);
        head
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Camera, FrameStart};

    use super::*;

    fn camera() -> Camera {
        Camera::new([1.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(3)).unwrap()
    }

    fn empty() -> Inbox {
        Inbox::new(BatchSize::default(), 4 << 20)
    }

    /// Sends `count` lone bytes with gaps between, `each` of them to a unit.
    fn scatter(inbox: &mut Inbox, count: u64, each: u64) -> Result<(), LaneViolation> {
        (0..count).try_for_each(|at| inbox.put(at / each, 1 + at % each * 2, Tail::More, &[0]))
    }

    #[test]
    fn pieces_are_counted_over_all_units() {
        for each in [4, 7, 4096] {
            let mut inbox = empty();
            assert_eq!(scatter(&mut inbox, 4096, each), Ok(()), "{each} a unit");
            assert_eq!(scatter(&mut inbox, 4096, each), Ok(()), "the same again changes nothing");
            assert_eq!(inbox.put(1023, 9, Tail::More, &[0]), Err(LaneViolation::Pieces), "{each} a unit");
        }
    }

    #[test]
    fn what_is_readable_is_what_can_be_taken() {
        let mut inbox = empty();
        assert!(!inbox.is_readable());
        let begin = FrameStart { frame: FrameNumber(0), camera: camera() };
        let mut bytes = BytesMut::new();
        Message::Frame(FrameMessage::Begin(begin)).encode(&mut bytes);
        bytes.extend_from_slice(&[7; 8]);
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
    }

    #[test]
    fn what_nobody_reads_is_thrown_away_and_makes_room() {
        let mut inbox = Inbox::new(BatchSize::default(), 1000);
        for unit in 0..10 {
            inbox.put(unit, 0, Tail::More, &[0; 900]).unwrap();
            assert!(inbox.discard(), "the peer should hear of new room");
            assert_eq!((inbox.take(), inbox.pieces), (Ok(None), 0));
        }
    }

    #[test]
    fn gaps_that_close_and_units_that_pass_make_room_for_pieces() {
        let mut inbox = empty();
        scatter(&mut inbox, 4096, 1024).unwrap();
        inbox.put(3, 0, Tail::More, &[0; 2048]).unwrap();
        assert_eq!(inbox.pieces, 3 * 1024 + 1);

        let mut inbox = empty();
        let mut goodbye = BytesMut::new();
        Message::Goodbye(Goodbye::Finished).encode(&mut goodbye);
        inbox.put(0, 0, Tail::End, &goodbye).unwrap();
        assert_eq!((inbox.pieces, inbox.take()), (1, Ok(Some(Received::Goodbye(Goodbye::Finished)))));
        assert_eq!(inbox.pieces, 0, "what was passed on is no piece any more");
    }
}
