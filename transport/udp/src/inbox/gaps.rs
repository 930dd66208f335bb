//! Replacements for lost bytes of a frame: repair, or a notice that they will not come.

use super::blocks::Guarded;
use super::store::Pool;
use super::unit::Unit;
use super::{FlowControl, Inbox, LaneViolation};
use crate::chunk::{GivenUp, Tail};
use crate::repair::Block;

/// The most repair shards kept for all units together; more are refused.
const REPAIR: usize = 256;

impl Inbox {
    /// Takes a repair shard; `hash` is that of the frame which the block ends. Returns whether there was room
    /// for it. If not, its packet must not be acknowledged, or the sender would rely on it.
    pub(crate) fn put_repair(
        &mut self,
        number: u64,
        block: Block,
        hash: Option<u64>,
        index: u8,
        data: &[u8],
    ) -> Result<bool, LaneViolation> {
        let room = self.repair < REPAIR;
        let mut has_place = true;
        self.with_unit(number, |unit, flow, pool| {
            if unit.is_given_up() {
                return Ok(());
            }
            let to = block.range().end;
            flow.allows(unit, to)?;
            unit.note(to, hash.map_or(Tail::More, Tail::Frame))?;
            if !unit.wants_repair(block, pool)? {
                return Ok(());
            }
            let found = match (block.shard_count(), room) {
                // It has a single shard.
                (1, _) => {
                    let bytes = data.get(..block.length as usize).unwrap_or(data).to_vec();
                    return put_restored(unit, flow, pool, vec![(block.offset, bytes)]);
                }
                (_, true) => unit.keep_repair(block, index, data, pool),
                (_, false) => {
                    has_place = false;
                    return Ok(());
                }
            };
            restore(unit, flow, pool, found)
        })?;
        Ok(has_place)
    }

    /// Takes the notice that no more of a frame comes.
    pub(crate) fn give_up(&mut self, number: u64, about: GivenUp, head: &[u8]) -> Result<(), LaneViolation> {
        let format = self.buffers.format;
        self.with_unit(number, |unit, flow, pool| {
            if !unit.is_given_up() {
                flow.use_up_to(unit, about.sent)?;
                unit.give_up(about, head, &format, pool)?;
                unit.highest = unit.highest.max(about.sent);
            }
            Ok(())
        })
    }
}

/// Restores lost bytes of the given blocks.
pub(super) fn restore(
    unit: &mut Unit,
    flow: &mut FlowControl,
    pool: &mut Pool,
    found: Vec<Guarded>,
) -> Result<(), LaneViolation> {
    for block in found {
        let pieces = unit.restore(&block, pool);
        put_restored(unit, flow, pool, pieces)?;
    }
    Ok(())
}

fn put_restored(
    unit: &mut Unit,
    flow: &mut FlowControl,
    pool: &mut Pool,
    pieces: Vec<(u64, Vec<u8>)>,
) -> Result<(), LaneViolation> {
    for (offset, bytes) in pieces {
        let to = offset + bytes.len() as u64;
        flow.use_up_to(unit, to)?;
        unit.highest = unit.highest.max(to);
        // No further block results: blocks do not overlap.
        unit.put(offset, &bytes, pool);
        unit.repaired = true;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trimaran_wire::{BatchSize, Format, FrameEnd, FrameMessage, FrameNumber};

    use super::super::Received;
    use super::super::tests::{all, batches, empty, unit_of};
    use super::*;
    use crate::chunk::UnitLane;
    use crate::samples::{FORMAT, FORMAT_OF_12};

    /// The unit of a frame of the items 0, 1, ..
    fn frame_of(count: u32) -> Vec<u8> {
        unit_of(&FORMAT, &(0..count).flat_map(u32::to_le_bytes).collect::<Vec<_>>())
    }

    /// The received items of 4 bytes.
    fn items_of(received: &[Received]) -> Vec<u32> {
        let bytes: Vec<u8> = batches(received).flatten().copied().collect();
        bytes.chunks(4).map(|item| u32::from_le_bytes(item.try_into().unwrap())).collect()
    }

    #[test]
    fn a_frame_that_is_given_up_passes_on_what_came_and_gives_its_window_back() {
        let mut inbox = Inbox::new(UnitLane::Frames, FORMAT, BatchSize::default(), 4000);
        let bytes = frame_of(100);
        for range in [0..96, 200..246, 403..440] {
            inbox.put(0, range.start as u64, Tail::More, &bytes[range]).unwrap();
        }
        assert_eq!(items_of(&all(&mut inbox)), [0; 0], "nothing says that more will not come");
        let about = GivenUp { length: 480, sent: 460, hash: 7, coded: None };
        inbox.give_up(0, about, &[]).unwrap();
        inbox.put(0, 96, Tail::More, &bytes[96..100]).unwrap();
        let items = all(&mut inbox);
        let expected: Vec<u32> = [0..4, 30..41, 81..90].into_iter().flatten().collect();
        assert_eq!(items_of(&items), expected, "whole items, in order, none that came later");
        assert_eq!(batches(&items).count(), 3, "none is empty");
        let end = FrameEnd { frame: FrameNumber(0), items: 100, hash: 7 };
        assert_eq!(items.last(), Some(&Received::Frame(FrameMessage::End(end))));
        assert_eq!((inbox.taken, inbox.used, inbox.units.len(), inbox.first), (460, 460, 0, 1));
    }

    #[test]
    fn a_beginning_that_was_lost_comes_with_the_word_that_no_more_does() {
        let mut inbox = empty();
        let bytes = frame_of(10);
        inbox.put(0, 100, Tail::More, &bytes[100..120]).unwrap();
        inbox.give_up(0, GivenUp { length: 120, sent: 120, hash: 7, coded: None }, &bytes[..80]).unwrap();
        let items = all(&mut inbox);
        assert!(matches!(items[0], Received::Frame(FrameMessage::Begin { .. })), "{items:?}");
        assert_eq!(items_of(&items), [5, 6, 7, 8, 9]);
        assert_eq!(inbox.taken, inbox.used);

        let mut inbox = empty();
        inbox.give_up(0, GivenUp { length: 120, sent: 0, hash: 7, coded: None }, &[]).unwrap();
        assert_eq!(inbox.take(), Err(LaneViolation::Unit), "no beginning at all");
    }

    #[test]
    fn a_long_header_comes_with_the_word_that_no_more_does() {
        let format = Format { header: 1000, ..FORMAT_OF_12 };
        let bytes = unit_of(&format, &[5; 24]);
        let mut inbox = Inbox::new(UnitLane::Frames, format, BatchSize::default(), 4 << 20);
        inbox.put(0, 0, Tail::More, &bytes[..3]).unwrap();
        inbox.put(0, 1015, Tail::More, &bytes[1015..1032]).unwrap();
        let about = GivenUp { length: 1032, sent: 1032, hash: 7, coded: None };
        inbox.give_up(0, about, &bytes[3..1008]).unwrap();
        let received = all(&mut inbox);
        let [Received::Frame(FrameMessage::Begin { header, .. }), _, _] = &received[..] else {
            panic!("{received:?}")
        };
        assert_eq!(&header[..], &bytes[8..1008]);
        assert_eq!(batches(&received).map(|batch| batch.len()).collect::<Vec<_>>(), [12]);
    }

    #[test]
    fn what_is_no_frame_cannot_be_given_up() {
        let mut inbox = empty();
        inbox.put(0, 0, Tail::More, &[0x23; 100]).unwrap();
        inbox.give_up(0, GivenUp { length: 120, sent: 120, hash: 7, coded: None }, &[]).unwrap();
        assert_eq!(inbox.take(), Err(LaneViolation::Unit));
    }

    #[test]
    fn word_that_contradicts_what_came_is_a_violation() {
        let bytes = frame_of(10);
        for about in [(119, 119, 7), (120, 119, 7), (60, 60, 7), (120, 120, 8)] {
            let mut inbox = empty();
            inbox.put(0, 0, Tail::More, &bytes[..80]).unwrap();
            inbox.put(0, 100, Tail::Frame(7), &bytes[100..]).unwrap();
            let (length, sent, hash) = about;
            assert_eq!(
                inbox.give_up(0, GivenUp { length, sent, hash, coded: None }, &[]),
                Err(LaneViolation::End),
                "{about:?}"
            );
        }
        let mut inbox = empty();
        inbox.put(0, 100, Tail::Frame(7), &bytes[100..]).unwrap();
        for (length, kept) in [(120, Ok(true)), (121, Err(LaneViolation::End))] {
            let block = Block { offset: 0, length, shard: 62, count: 1 };
            assert_eq!(inbox.put_repair(0, block, None, 0, &[0; 62]), kept);
            let mut inbox = empty();
            inbox.put_repair(0, block, None, 0, &[0; 62]).unwrap();
            let put = inbox.put(0, 100, Tail::Frame(7), &bytes[100..]);
            assert_eq!(put.err(), kept.err(), "the other way round");
        }
        let mut inbox = Inbox::new(UnitLane::Frames, FORMAT, BatchSize::default(), 100);
        let about = GivenUp { length: 480, sent: 101, hash: 7, coded: None };
        assert_eq!(inbox.give_up(0, about, &[]), Err(LaneViolation::FlowControl));
    }

    #[test]
    fn a_whole_frame_cannot_be_given_up_any_more() {
        let mut inbox = empty();
        inbox.put(0, 0, Tail::More, &frame_of(10)).unwrap();
        inbox.give_up(0, GivenUp { length: 120, sent: 120, hash: 7, coded: None }, &[]).unwrap();
        assert_eq!(inbox.put(0, 120, Tail::More, &[1]), Err(LaneViolation::End), "it still ends there");
        assert_eq!(items_of(&all(&mut inbox)), (0..10).collect::<Vec<_>>());
        assert_eq!(inbox.first, 1, "only its end had been lost");

        let mut inbox = empty();
        inbox.give_up(0, GivenUp { length: 80, sent: 80, hash: 7, coded: None }, &frame_of(0)).unwrap();
        let items = all(&mut inbox);
        let end = FrameEnd { frame: FrameNumber(0), items: 0, hash: 7 };
        assert_eq!(items[1..], [Received::Frame(FrameMessage::End(end))], "the beginning is all of it");
    }

    #[test]
    fn repair_stands_in_for_what_is_lost_though_part_of_the_block_was_passed_on() {
        let bytes = frame_of(1000);
        let block = Block { offset: 0, length: 4080, shard: 512, count: 2 };
        let shards = crate::repair::protect(&bytes, 512, 2);
        let mut inbox = empty();
        inbox.put(0, 0, Tail::Pause, &bytes[..1024]).unwrap();
        assert_eq!(items_of(&all(&mut inbox)).len(), 236);
        inbox.put(0, 1536, Tail::More, &bytes[1536..3584]).unwrap();
        inbox.put_repair(0, block, Some(7), 1, &shards[1]).unwrap();
        assert_eq!((all(&mut inbox).len(), inbox.frames_repaired), (0, 0), "two are lost");
        inbox.put_repair(0, block, Some(7), 1, &shards[1]).unwrap();
        assert_eq!(all(&mut inbox).len(), 0, "the same again");
        inbox.put_repair(0, block, Some(7), 0, &shards[0]).unwrap();
        let items = all(&mut inbox);
        assert_eq!(items_of(&items), (236..1000).collect::<Vec<_>>());
        let end = FrameEnd { frame: FrameNumber(0), items: 1000, hash: 7 };
        assert_eq!(items.last(), Some(&Received::Frame(FrameMessage::End(end))));
        assert_eq!((inbox.frames_repaired, inbox.taken, inbox.used), (1, 4080, 4080));
    }

    #[test]
    fn repair_is_kept_within_limits() {
        let mut inbox = empty();
        for unit in 0..100 {
            let block = Block { offset: 0, length: 4096, shard: 2, count: 32 };
            let block = Block { length: 128, ..block };
            for index in 0..32 {
                let taken = inbox.put_repair(unit, block, None, index, &[0; 2]);
                assert_eq!(taken, Ok(unit * 32 + u64::from(index) < REPAIR as u64));
            }
        }
        let kept: usize = inbox.units.values().map(Unit::repair_shards).sum();
        assert_eq!((kept, inbox.repair), (REPAIR, REPAIR));
        inbox.put(99, 0, Tail::More, &[0; 128]).unwrap();
        let block = Block { offset: 0, length: 128, shard: 2, count: 32 };
        assert_eq!(
            inbox.put_repair(99, block, None, 0, &[0; 2]),
            Ok(true),
            "of no use, so there is no need of a place"
        );
        inbox.put(0, 0, Tail::More, &[0; 128]).unwrap();
        assert!((0..32).all(|index| inbox.put_repair(8, block, None, index, &[0; 2]) == Ok(true)));
        assert_eq!(inbox.put_repair(0, block, None, 0, &[0; 2]), Ok(true), "this block came whole, too");
        let beyond = Block { offset: 4 << 20, length: 2, shard: 2, count: 1 };
        assert_eq!(inbox.put_repair(0, beyond, None, 0, &[0; 2]), Err(LaneViolation::FlowControl));
    }

    /// A block of 64 shards of 100 bytes in unit 0, of which two are missing.
    fn damaged() -> (Inbox, Block) {
        let mut inbox = empty();
        for at in (0..64).filter(|at| !matches!(at, 3 | 40)) {
            inbox.put(0, at * 100, Tail::More, &[1; 100]).unwrap();
        }
        (inbox, Block { offset: 0, length: 6400, shard: 100, count: 32 })
    }

    #[test]
    fn a_part_costs_as_much_however_much_repair_waits() {
        let work = |repair: u8| {
            let (mut inbox, block) = damaged();
            for index in 0..repair {
                inbox.put_repair(0, block, None, index, &[7; 100]).unwrap();
            }
            let before = inbox.work();
            for _ in 0..1000 {
                inbox.put(0, 300, Tail::More, &[1]).unwrap();
            }
            inbox.work() - before
        };
        assert!(work(1) < 2 * work(0), "{} and {} steps", work(1), work(0));
    }

    #[test]
    fn a_block_is_restored_once() {
        let (mut inbox, block) = damaged();
        let shards = crate::repair::protect(&[1; 6400], 100, 32);
        let mut costs = Vec::new();
        for (index, data) in (0..).zip(&shards) {
            let before = inbox.work();
            inbox.put_repair(0, block, None, index, data).unwrap();
            costs.push(inbox.work() - before >= block.cost());
        }
        assert_eq!(costs.iter().position(|decoded| *decoded), Some(1), "by the second repair shard");
        assert_eq!(costs.iter().filter(|decoded| **decoded).count(), 1);
        assert_eq!((inbox.repair, inbox.frames_repaired), (0, 1));
    }

    #[test]
    fn blocks_that_overlap_are_a_violation_also_where_one_was_passed_on() {
        let (mut inbox, block) = damaged();
        assert_eq!(inbox.put_repair(0, block, None, 0, &[7; 100]), Ok(true));
        for other in [
            Block { length: 6300, ..block },
            Block { count: 31, ..block },
            Block { shard: 102, ..block },
            Block { offset: 100, ..block },
            Block { offset: 6300, ..block },
        ] {
            let data = vec![7; other.shard.into()];
            assert_eq!(inbox.put_repair(0, other, None, 1, &data), Err(LaneViolation::Block), "{other:?}");
        }
        assert_eq!(inbox.put_repair(0, Block { offset: 6400, ..block }, None, 0, &[7; 100]), Ok(true));

        let bytes = frame_of(4000);
        let mut inbox = empty();
        let block = Block { offset: 0, length: 6400, shard: 100, count: 2 };
        inbox.put_repair(0, block, None, 0, &[7; 100]).unwrap();
        inbox.put(0, 0, Tail::Pause, &bytes[..8000]).unwrap();
        all(&mut inbox);
        assert_eq!(inbox.repair, 0, "it is whole");
        let late = Block { offset: 100, length: 8400, shard: 200, count: 2 };
        assert_eq!(inbox.put_repair(0, late, None, 0, &[7; 200]), Err(LaneViolation::Block));
        assert_eq!(inbox.put_repair(0, block, None, 1, &[7; 100]), Ok(true), "late, and of no use");

        let bytes = frame_of(50_000);
        let mut inbox = empty();
        inbox.put(0, 0, Tail::Pause, &bytes[..150_000]).unwrap();
        all(&mut inbox);
        assert_eq!(inbox.put_repair(0, block, None, 0, &[7; 100]), Ok(true));
        assert_eq!(inbox.repair, 0, "delivered so long ago that its bytes are no longer kept");
    }

    #[test]
    fn repair_of_one_shard_is_the_shard() {
        let bytes = frame_of(4);
        let mut inbox = empty();
        let block = Block { offset: 0, length: 96, shard: 96, count: 2 };
        let shards = crate::repair::protect(&bytes, 96, 2);
        inbox.put_repair(0, block, Some(9), 1, &shards[1]).unwrap();
        assert_eq!(items_of(&all(&mut inbox)), [0, 1, 2, 3]);
        assert_eq!((inbox.frames_repaired, inbox.first), (1, 1));
    }
    proptest! {
        /// Items of 12 bytes are delivered whole or not at all, and all that came whole are delivered.
        #[test]
        fn a_frame_with_gaps_passes_on_whole_items_wherever_parts_were_cut(
            count in 1u64..300, lost in prop::collection::vec((0u64..3600, 1u64..100), 0..12), batch in 1u32..40,
        ) {
            let sent: Vec<u8> = (0..count).flat_map(|item| [item as u8; 12]).collect();
            let bytes = unit_of(&FORMAT_OF_12, &sent);
            let came = |at: usize| at < 16 || lost.iter().all(|(from, length)| !(*from..from + length).contains(&(at as u64)));
            let mut inbox = Inbox::new(UnitLane::Frames, FORMAT_OF_12, BatchSize::new(batch).unwrap(), 4 << 20);
            for (at, byte) in (0..).zip(&bytes).filter(|(at, _)| came(*at)) {
                inbox.put(0, at as u64, Tail::More, &[*byte]).unwrap();
            }
            let length = bytes.len() as u64;
            inbox.give_up(0, GivenUp { length, sent: length, hash: 7, coded: None }, &[]).unwrap();
            let received = all(&mut inbox);
            let expected: Vec<u8> = (0..count as usize)
                .filter(|item| (16 + item * 12..28 + item * 12).all(came))
                .flat_map(|item| [item as u8; 12])
                .collect();
            prop_assert_eq!(batches(&received).flatten().copied().collect::<Vec<_>>(), expected);
            prop_assert!(batches(&received).all(|bytes| bytes.len() % 12 == 0 && bytes.len() <= batch as usize * 12));
            let end = FrameEnd { frame: FrameNumber(0), items: count as u32, hash: 7 };
            prop_assert_eq!(received.last(), Some(&Received::Frame(FrameMessage::End(end))));
        }
    }
}
