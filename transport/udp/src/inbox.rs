//! The frames lane as it is received: units put together in any order, passed on in theirs.

use std::collections::VecDeque;

use thiserror::Error;
use trimaran_proto::{BatchSize, CodedIds, CodingFault, DecodeError, FrameMessage, Goodbye};

use crate::chunk::Tail;

mod buffers;
mod gaps;
mod unit;

use buffers::Buffers;
use unit::{Step, Unit};

/// How many units may be under way.
const UNITS: u64 = 1024;
/// How many separate pieces of all units together are kept: an honest peer sends a window of 4 MiB in 3,700 full packets, so that it
/// stays below even if every second one is lost.
const PIECES: usize = 4096;

/// What comes out of the lane.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Received {
    /// A message of the lane.
    Frame(FrameMessage),
    /// A batch of ids as changes against a frame that the reader has complete.
    Coded(CodedIds),
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
    /// Changes cannot be counted.
    #[error("ids came as changes that cannot be read")]
    Coding(#[from] CodingFault),
}

/// Units in order of their numbers.
#[derive(Debug)]
pub(crate) struct Inbox {
    units: VecDeque<Unit>,
    buffers: Buffers,
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
    pub(crate) frames_repaired: u64,
}

impl Inbox {
    pub(crate) fn new(batch: BatchSize, window: u64) -> Self {
        Self {
            units: VecDeque::new(),
            buffers: Buffers::default(),
            first: 0,
            batch,
            window,
            taken: 0,
            used: 0,
            pieces: 0,
            told: (window, UNITS),
            frames_repaired: 0,
        }
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
        self.taken = self.taken.max(self.used);
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
        let to = offset.checked_add(data.len() as u64).ok_or(LaneViolation::Credit)?;
        self.with_unit(number, |unit, credit| {
            if !unit.is_given_up() {
                credit.use_up_to(unit, to)?;
                unit.note(to, tail)?;
                unit.highest = unit.highest.max(to);
                unit.store(offset, data);
                gaps::restore(unit, credit)?;
            }
            Ok(())
        })
    }

    /// Does `work` on a unit, unless it was passed on before.
    fn with_unit(
        &mut self,
        number: u64,
        work: impl FnOnce(&mut Unit, &mut Credit) -> Result<(), LaneViolation>,
    ) -> Result<(), LaneViolation> {
        let Some(at) = number.checked_sub(self.first) else { return Ok(()) };
        if at >= UNITS {
            return Err(LaneViolation::Credit);
        }
        while self.units.len() as u64 <= at {
            self.units.push_back(Unit::new(self.buffers.spare.take()));
        }
        let Some(unit) = usize::try_from(at).ok().and_then(|at| self.units.get_mut(at)) else {
            return Ok(());
        };
        let before = (unit.pieces(), unit.repaired);
        let mut credit = Credit { used: self.used, allowed: self.taken + self.window };
        work(unit, &mut credit)?;
        self.used = credit.used;
        self.pieces = self.pieces + unit.pieces() - before.0;
        self.frames_repaired += u64::from(unit.repaired && !before.1);
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
            let (base, pieces) = (unit.base, unit.pieces());
            let step = unit.step(self.batch, &mut self.buffers)?;
            self.taken += unit.base - base;
            self.pieces -= pieces;
            match step {
                Step::Last(item) => {
                    let over = self.units.pop_front();
                    over.into_iter().for_each(|unit| self.buffers.spare.put(unit.into_buffer()));
                    self.first += 1;
                    if let Some(item) = item {
                        return Ok(Some(item));
                    }
                }
                Step::Wait => {
                    self.pieces += unit.pieces();
                    return Ok(None);
                }
                Step::Item(item) => {
                    self.pieces += unit.pieces();
                    return Ok(Some(item));
                }
            }
        }
    }
}

/// What the peer has used of what it may send.
struct Credit {
    used: u64,
    allowed: u64,
}

impl Credit {
    /// Whether the peer may have sent that much of the unit.
    fn allows(&self, unit: &Unit, to: u64) -> Result<u64, LaneViolation> {
        let used = self.used.checked_add(to.saturating_sub(unit.highest));
        used.filter(|used| *used <= self.allowed).ok_or(LaneViolation::Credit)
    }

    fn use_up_to(&mut self, unit: &Unit, to: u64) -> Result<(), LaneViolation> {
        self.used = self.allows(unit, to)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use bytes::BytesMut;
    use trimaran_proto::{Camera, FrameNumber, FrameStart, Message};

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
