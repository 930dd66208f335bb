//! Ids coded as changes against an earlier frame.
//!
//! Most ids of a frame were also visible in the frame before. A batch of rising ids is written as runs over a
//! *reference*: the ids of a frame that the receiver holds completely. Runs keep, skip or insert ids. Each
//! such batch names its reference and its position in it, so it can be read without the batches before it.

mod coder;
mod reference;

use bytes::{BufMut, Bytes, BytesMut};
use thiserror::Error;

use crate::varint::{get_varint, put_varint};
pub use coder::{CodedViolation, IdDecoder, IdEncoder};
use reference::References;

use crate::{BatchSize, FrameNumber, ID_BYTES, IdBatch};

/// Bytes that are not a batch of changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CodingFault {
    /// The receiver does not hold the reference completely.
    #[error("they refer to a frame {back} before, which is not held complete")]
    UnknownReference {
        /// How many frames before this one.
        back: u32,
    },
    /// A number is cut short or above 32 bits.
    #[error("a number is cut short or too large")]
    Number,
    /// A run reaches beyond the reference.
    #[error("a run reaches beyond the {held} ids of the reference")]
    Beyond {
        /// How many ids the reference has.
        held: usize,
    },
    /// An id is not above the one before it, or above 32 bits.
    #[error("the ids do not rise")]
    NotRising,
    /// The frame would exceed its limit of ids.
    #[error("with them the frame has more than {most} ids, the most that a frame may have here")]
    TooMany {
        /// The limit.
        most: u32,
    },
    /// No id, or more than a batch may have.
    #[error("{0} ids are not 1 to {max}", max = BatchSize::MAX.items())]
    Count(usize),
}

/// How many more ids a frame may have, and its limit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    ids: u64,
    most: u32,
}

/// The operation after a run of kept ids: the low two bits of the run's first number.
mod op {
    pub(super) const SKIP_ONE: u32 = 0;
    pub(super) const PUT_ONE: u32 = 1;
    pub(super) const SKIP: u32 = 2;
    pub(super) const PUT: u32 = 3;
    pub(super) const BITS: u32 = 2;
}

/// The shortest coding of `batch`; `None` if none is shorter than plain or the ids do not rise. `reference`
/// is a frame `back` before this one, with its ids, rising.
pub(crate) fn shortest(batch: &IdBatch, reference: Option<(u32, &[u32])>) -> Option<Bytes> {
    let ids: Vec<u32> = batch.iter().map(|id| id.0).collect();
    if !ids.is_sorted_by(|a, b| a < b) {
        return None;
    }
    let by_itself = write(&ids, 0, &[]);
    let shorter = match reference {
        Some((back, held)) => {
            let changes = write(&ids, back, held);
            if changes.len() < by_itself.len() { changes } else { by_itself }
        }
        None => by_itself,
    };
    (shorter.len() < batch.as_bytes().len()).then(|| shorter.freeze())
}

/// The number of ids that the bytes claim. It is read without the reference, so only an [`IdDecoder`] can
/// verify it.
///
/// # Errors
/// If the bytes cannot be read, or the number is 0 or more than a batch may have.
pub(crate) fn count(mut bytes: &[u8]) -> Result<usize, CodingFault> {
    let bytes = &mut bytes;
    if number(bytes)? != 0 {
        number(bytes)?;
    }
    let mut count = 0;
    while !bytes.is_empty() {
        let run = Run::read(bytes)?;
        // Each id takes at least a byte, so a false large count soon runs out of bytes.
        (0..run.put).try_for_each(|_| number(bytes).map(drop))?;
        count += run.kept as usize + run.put as usize;
        if count > BatchSize::MAX.items() {
            return Err(CodingFault::Count(count));
        }
    }
    if count == 0 { Err(CodingFault::Count(0)) } else { Ok(count) }
}

/// Decodes ids; `references` are the complete frames before `frame`. Ids beyond the limit are not stored.
pub(crate) fn read(
    mut bytes: &[u8],
    frame: FrameNumber,
    references: &mut References,
    room: Room,
) -> Result<IdBatch, CodingFault> {
    let bytes = &mut bytes;
    let back = number(bytes)?;
    let mut reader = if back == 0 {
        Reader::new(&[], 0, room)
    } else {
        let unknown = CodingFault::UnknownReference { back };
        let number_of_reference = frame.0.checked_sub(back).map(FrameNumber).ok_or(unknown)?;
        let held = references.get(number_of_reference).ok_or(unknown)?;
        Reader::new(held, number(bytes)?, room)
    };
    while !bytes.is_empty() {
        reader.run(bytes)?;
    }
    // The reader has refused too many.
    IdBatch::new(reader.ids.freeze()).map_err(|_| CodingFault::Count(0))
}

/// Writes the rising `ids` as runs over `held`; without a reference, `back` is 0.
fn write(ids: &[u32], back: u32, held: &[u32]) -> BytesMut {
    let mut out = BytesMut::with_capacity(16 + 2 * ids.len());
    put_varint(&mut out, back);
    let first = ids.first().copied().unwrap_or_default();
    let mut place = held.partition_point(|id| *id < first);
    if back != 0 {
        put_varint(&mut out, place as u32);
    }
    let mut next = place.checked_sub(1).and_then(|before| held.get(before)).map_or(0, |id| above(*id));
    let mut rest = ids;
    while !rest.is_empty() {
        let ahead = held.get(place..).unwrap_or_default();
        let kept = rest.iter().zip(ahead).take_while(|(id, held)| id == held).count();
        let (run, after) = rest.split_at(kept);
        next = run.last().map_or(next, |id| above(*id));
        place += kept;
        let ahead = ahead.get(kept..).unwrap_or_default();
        let until = after.first().copied();
        let skipped = until.map_or(0, |until| ahead.partition_point(|id| *id < until));
        if skipped > 0 || until.is_none() {
            put_run(&mut out, kept, skipped, [op::SKIP_ONE, op::SKIP]);
            place += skipped;
            next = ahead.get(..skipped).and_then(<[u32]>::last).map_or(next, |id| above(*id));
            rest = after;
        } else {
            let stop = ahead.first().copied();
            let put = after.iter().take_while(|id| stop.is_none_or(|stop| **id < stop)).count();
            put_run(&mut out, kept, put, [op::PUT_ONE, op::PUT]);
            let (put, after) = after.split_at(put);
            for id in put {
                put_varint(&mut out, id.wrapping_sub(next));
                next = above(*id);
            }
            rest = after;
        }
    }
    out
}

/// The least possible id after `id`. No id follows the largest one, so the wrapped result is not used.
const fn above(id: u32) -> u32 {
    id.wrapping_add(1)
}

/// Writes a run of kept ids and the number of ids skipped or inserted after it.
fn put_run(out: &mut impl BufMut, kept: usize, count: usize, [one, many]: [u32; 2]) {
    let op = if count == 1 { one } else { many };
    put_varint(out, (kept as u32) << op::BITS | op);
    if op == many {
        put_varint(out, count as u32);
    }
}

/// The numbers of ids that a run keeps, and then skips or inserts.
struct Run {
    kept: u32,
    skipped: u32,
    put: u32,
}

impl Run {
    fn read(bytes: &mut &[u8]) -> Result<Self, CodingFault> {
        let first = number(bytes)?;
        let (skipped, put) = match first & ((1 << op::BITS) - 1) {
            op::SKIP_ONE => (1, 0),
            op::PUT_ONE => (0, 1),
            op::SKIP => (number(bytes)?, 0),
            _ => (0, number(bytes)?),
        };
        Ok(Self { kept: first >> op::BITS, skipped, put })
    }
}

/// Reads runs over a reference.
struct Reader<'r> {
    held: &'r [u32],
    place: usize,
    /// The least possible next id; `None` after the largest.
    next: Option<u32>,
    ids: BytesMut,
    room: Room,
}

impl<'r> Reader<'r> {
    fn new(held: &'r [u32], place: u32, room: Room) -> Self {
        let place = place as usize;
        let before = place.checked_sub(1).and_then(|before| held.get(before));
        let next = before.map_or(Some(0), |id| id.checked_add(1));
        Self { held, place, next, ids: BytesMut::new(), room }
    }

    fn run(&mut self, bytes: &mut &[u8]) -> Result<(), CodingFault> {
        let run = Run::read(bytes)?;
        let kept = self.pass(run.kept)?;
        self.room_for(kept.len())?;
        for id in kept {
            self.push(*id)?;
        }
        self.skip(run.skipped)?;
        // Each id takes at least a byte, so a false large count soon runs out of bytes.
        (0..run.put).try_for_each(|_| self.put(bytes))
    }

    /// Takes the next `count` ids of the reference.
    fn pass(&mut self, count: u32) -> Result<&'r [u32], CodingFault> {
        let beyond = CodingFault::Beyond { held: self.held.len() };
        let end = self.place.checked_add(count as usize).ok_or(beyond)?;
        let passed = self.held.get(self.place..end).ok_or(beyond)?;
        self.place = end;
        Ok(passed)
    }

    fn skip(&mut self, count: u32) -> Result<(), CodingFault> {
        if let (Some(last), Some(next)) = (self.pass(count)?.last(), self.next) {
            self.next = last.checked_add(1).map(|above| above.max(next));
        }
        Ok(())
    }

    fn put(&mut self, bytes: &mut &[u8]) -> Result<(), CodingFault> {
        let gap = number(bytes)?;
        self.room_for(1)?;
        self.push(self.next.and_then(|next| next.checked_add(gap)).ok_or(CodingFault::NotRising)?)
    }

    fn push(&mut self, id: u32) -> Result<(), CodingFault> {
        if self.next.is_none_or(|next| id < next) {
            return Err(CodingFault::NotRising);
        }
        self.next = id.checked_add(1);
        self.ids.put_u32_le(id);
        Ok(())
    }

    /// Keeps a few bytes from naming more ids than a batch or its frame may have.
    fn room_for(&self, more: usize) -> Result<(), CodingFault> {
        let count = self.ids.len() / ID_BYTES + more;
        if count > BatchSize::MAX.items() {
            Err(CodingFault::Count(count))
        } else if count as u64 > self.room.ids {
            Err(CodingFault::TooMany { most: self.room.most })
        } else {
            Ok(())
        }
    }
}

fn number(bytes: &mut &[u8]) -> Result<u32, CodingFault> {
    get_varint(bytes).ok_or(CodingFault::Number)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: FrameNumber = FrameNumber(9);
    const ANY: Room = Room { ids: u32::MAX as u64, most: u32::MAX };

    fn batch(ids: &[u32]) -> IdBatch {
        IdBatch::new(Bytes::from(ids.iter().flat_map(|id| id.to_le_bytes()).collect::<Vec<_>>())).unwrap()
    }

    /// References that hold `ids` as frame 7.
    fn holding(ids: &[u32]) -> References {
        let mut references = References::default();
        references.begin();
        if !ids.is_empty() {
            references.add(&batch(ids));
        }
        references.complete(FrameNumber(7));
        references
    }

    fn read(bytes: &[u8], held: &[u32]) -> Result<Vec<u32>, CodingFault> {
        super::read(bytes, FRAME, &mut holding(held), ANY).map(|batch| batch.iter().map(|id| id.0).collect())
    }

    /// The coded size of `ids` against `held`, after reading them back; `None` if they travel plain.
    fn size(ids: &[u32], held: &[u32]) -> Option<usize> {
        let coded = shortest(&batch(ids), Some((2, held)))?;
        assert_eq!(read(&coded, held).as_deref(), Ok(ids));
        assert_eq!(count(&coded), Ok(ids.len()));
        Some(coded.len())
    }

    #[test]
    fn what_stays_costs_nothing() {
        let held: Vec<u32> = (0..4000).map(|i| 17 * i).collect();
        assert_eq!(size(&held, &held), Some(5), "back, place, 4000 kept, none skipped");
        let mut without = held.clone();
        without.remove(2000);
        assert_eq!(size(&without, &held), Some(7));
        let mut with = held.clone();
        with.insert(2000, 17 * 2000 - 1);
        assert_eq!(size(&with, &held), Some(8));
        assert_eq!(size(&held[1000..], &held), Some(6), "a batch in the middle of a frame");
    }

    #[test]
    fn ids_far_from_the_reference_are_written_by_themselves() {
        let held: Vec<u32> = (0..1000).map(|i| 20 * i + 7).collect();
        let ids: Vec<u32> = (0..1000).map(|i| 20 * i).collect();
        assert_eq!(size(&ids, &held), Some(1 + 1 + 2 + 1000));
    }

    #[test]
    fn what_would_be_no_shorter_travels_plain() {
        assert_eq!(size(&[5], &[5]), Some(3), "by its gap");
        assert_eq!(size(&[300], &[300]), None, "4 bytes either way");
        assert_eq!(size(&[0, 1 << 20], &[]), Some(7));
        assert_eq!(size(&[1 << 30, u32::MAX], &[]), None);
        assert_eq!(size(&[3, 2, 1], &[1, 2, 3]), None, "ids that do not rise");
        assert_eq!(size(&[2, 2, 2], &[2]), None);
        let one_twice: Vec<u32> = (0..100).chain([99]).collect();
        assert_eq!(size(&one_twice, &[]), None, "though it would be shorter");
    }

    #[test]
    fn of_two_codings_of_one_size_the_one_without_a_reference_is_taken() {
        let (ids, held) = ([10, 20], [10, 15]);
        assert_eq!([write(&ids, 2, &held).len(), write(&ids, 0, &[]).len()], [5, 5]);
        assert_eq!(shortest(&batch(&ids), Some((2, &held))).as_deref(), Some(&[0, 3, 2, 10, 9][..]));
    }

    #[test]
    fn the_largest_id_can_be_kept_put_and_skipped_over() {
        let end = u32::MAX;
        assert_eq!(read(&[2, 0, 1 << 2 | 2, 0], &[end]), Ok(vec![end]));
        assert_eq!(read(&[0, 1, 0xff, 0xff, 0xff, 0xff, 0x0f], &[]), Ok(vec![end]));
        assert_eq!(read(&[2, 0, 0, 1, 0], &[end]), Err(CodingFault::NotRising), "nothing is above it");
        assert_eq!(
            size(&(end - 9..end).collect::<Vec<_>>(), &[end]),
            Some(16),
            "the first gap takes five bytes"
        );
    }

    #[test]
    fn changes_that_make_no_sense_are_refused() {
        let held = [10, 20, 30];
        for (bytes, fault) in [
            (&[][..], CodingFault::Number),
            (&[2], CodingFault::Number),
            (&[2, 0, 1], CodingFault::Number),
            (&[2, 0, 0x80], CodingFault::Number),
            (&[1, 0, 4], CodingFault::UnknownReference { back: 1 }),
            (&[10, 0, 4], CodingFault::UnknownReference { back: 10 }),
            (&[2, 0], CodingFault::Count(0)),
            (&[2, 0, 0], CodingFault::Count(0)),
            (&[2, 0, 4 << 2], CodingFault::Beyond { held: 3 }),
            (&[2, 0, 3 << 2], CodingFault::Beyond { held: 3 }),
            (&[2, 4, 1 << 2], CodingFault::Beyond { held: 3 }),
            (&[0, 1 << 2], CodingFault::Beyond { held: 0 }),
            // Inserts 40 before it keeps 10.
            (&[2, 0, 1, 40, 1 << 2 | 2, 0], CodingFault::NotRising),
            (&[0, 3, 2, 0xff, 0xff, 0xff, 0xff, 0x0f, 0], CodingFault::NotRising),
            (&[0, 3, 0xff, 0xff, 0xff, 0xff, 0x0f], CodingFault::Number),
        ] {
            assert_eq!(read(bytes, &held), Err(fault), "{bytes:?}");
        }
    }

    #[test]
    fn changes_that_cannot_be_counted_are_refused() {
        for (bytes, fault) in [
            (&[][..], CodingFault::Number),
            (&[2], CodingFault::Number),
            (&[2, 0], CodingFault::Count(0)),
            (&[2, 0, 0], CodingFault::Count(0)),
            (&[2, 0, 4 << 2 | 2], CodingFault::Number),
            (&[0, 1], CodingFault::Number),
            (&[0, 3, 0xff, 0xff, 0xff, 0xff, 0x0f], CodingFault::Number),
        ] {
            assert_eq!(count(bytes), Err(fault), "{bytes:?}");
        }
    }

    #[test]
    fn a_few_bytes_name_no_more_ids_than_a_batch() {
        let held: Vec<u32> = (0..=16_384).collect();
        let mut references = References::default();
        references.begin();
        held.chunks(8192).for_each(|ids| references.add(&batch(ids)));
        references.complete(FrameNumber(7));
        for (kept, expected) in [(16_384, Ok(16_384)), (16_385, Err(CodingFault::Count(16_385)))] {
            let mut bytes = BytesMut::from(&[2, 0][..]);
            put_run(&mut bytes, kept, 0, [op::SKIP_ONE, op::SKIP]);
            assert_eq!(count(&bytes), expected);
            assert_eq!(super::read(&bytes, FRAME, &mut references, ANY).map(|batch| batch.count()), expected);
        }
    }

    #[test]
    fn a_batch_for_which_the_frame_has_no_room_is_refused_at_the_first_id_too_many() {
        let held = [10, 20, 30, 40];
        let most = 7;
        for (bytes, ids) in
            [(&[2, 0, 4 << 2 | 2, 0][..], 4), (&[2, 0, 1, 0, 3 << 2 | 2, 0], 4), (&[0, 3, 4, 0, 0, 0, 0], 4)]
        {
            assert_eq!(count(bytes), Ok(ids), "{bytes:?}");
            let read = |room| {
                let room = Room { ids: room, most };
                super::read(bytes, FRAME, &mut holding(&held), room).map(|batch| batch.count())
            };
            assert_eq!(read(4), Ok(4), "{bytes:?}");
            for room in 0..4 {
                assert_eq!(read(room), Err(CodingFault::TooMany { most }), "{bytes:?}, room for {room}");
            }
        }
    }
}
