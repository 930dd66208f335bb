//! The delivery status of sent data: arrived, lost, restored, or no longer worth sending.

use std::ops::Range;

use trimaran_net::Instant;

use super::{Outbox, UNIT_COST, Unit};

impl Outbox {
    /// Gives up frames that are no longer worth sending: data sent at `now` arrives at `arrival`.
    pub(crate) fn expire(&mut self, now: Instant, arrival: Instant) {
        let Some(deadline) = self.frame_deadline else { return };
        self.undated = self.undated.max(self.first);
        while let Some(unit) = self.unit(self.undated).filter(|unit| unit.is_ended()) {
            unit.due_by(now.after(deadline));
            self.undated += 1;
        }
        self.in_time = self.in_time.max(self.first);
        while self.in_time < self.undated {
            self.visited += 1;
            let Some(unit) = self.unit(self.in_time) else { return };
            if unit.is_late(arrival) {
                let freed = unit.give_up();
                self.kept = self.kept.saturating_sub(freed);
                self.frames_given_up += 1;
                self.look(self.in_time);
            } else if unit.deadline().is_some() {
                return;
            }
            self.in_time += 1;
        }
    }

    /// The deadline of the next frame.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        self.frame_deadline?;
        let over = usize::try_from(self.in_time.saturating_sub(self.first)).ok()?;
        self.units.range(over.min(self.units.len())..).find_map(Unit::deadline)
    }

    /// A part has arrived; `ended` if it carried the unit's end.
    pub(crate) fn on_ack(&mut self, number: u64, range: Range<u64>, ended: bool) {
        self.on_arrival(number, |unit| unit.on_ack(range, ended));
    }

    /// A repair shard of the block at `offset` has arrived.
    pub(crate) fn on_repair_ack(&mut self, number: u64, offset: u64, index: u8) {
        self.on_arrival(number, |unit| unit.on_repair_ack(offset, index));
    }

    /// Something of a unit has arrived; `note` returns the number of bytes freed.
    fn on_arrival(&mut self, number: u64, note: impl FnOnce(&mut Unit) -> usize) {
        let Some(unit) = self.unit(number) else { return };
        let freed = note(unit);
        let whole = unit.whole_frame();
        self.confirmed = self.confirmed.max(whole);
        self.kept = self.kept.saturating_sub(freed);
        self.look(number);
        self.forget_arrived();
    }

    /// A part was lost: it is retransmitted, unless repair makes up for it.
    pub(crate) fn on_loss(&mut self, number: u64, range: Range<u64>, ended: bool) {
        self.on_event(number, |unit| unit.on_loss(range, ended));
    }

    pub(crate) fn on_repair_loss(&mut self, number: u64, offset: u64, index: u8) {
        self.on_event(number, |unit| unit.on_repair_loss(offset, index));
    }

    /// Retransmits all lost data: nothing is heard of the repair that could make up for it.
    pub(crate) fn stop_waiting(&mut self) {
        let waited: Vec<u64> = (self.first..)
            .zip(&mut self.units)
            .filter_map(|(number, unit)| unit.stop_waiting().then_some(number))
            .collect();
        waited.into_iter().for_each(|number| self.look(number));
    }

    /// The peer knows that a frame was given up.
    pub(crate) fn on_give_up_ack(&mut self, number: u64) {
        self.on_event(number, Unit::on_give_up_ack);
        self.forget_arrived();
    }

    pub(crate) fn on_give_up_loss(&mut self, number: u64) {
        self.on_event(number, Unit::on_give_up_loss);
    }

    fn on_event(&mut self, number: u64, note: impl FnOnce(&mut Unit)) {
        if let Some(unit) = self.unit(number) {
            note(unit);
            self.look(number);
        }
    }

    fn forget_arrived(&mut self) {
        while self.units.front().is_some_and(Unit::has_arrived) {
            let arrived = self.units.pop_front();
            self.due.remove(&self.first);
            arrived.into_iter().for_each(|unit| self.spare.put(unit.data));
            self.first += 1;
            self.kept = self.kept.saturating_sub(UNIT_COST);
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_wire::{FixedBytes, Format, FrameEnd, FrameMessage, FrameNumber};

    use super::*;
    use crate::chunk::{Chunk, UnitLane};
    use crate::outbox::tests::{PATH, at, begin, frame, sender};
    use crate::recovery::Content;
    use crate::repair::{Budget, Path, Repair};
    use crate::samples::FORMAT;
    use crate::wire::Reader;

    #[test]
    fn a_frame_is_given_up_when_it_cannot_arrive_in_time_and_not_before() {
        let mut outbox = sender(Some(50));
        frame(&mut outbox, 0);
        outbox.expire(at(0), at(5));
        let mut out = Vec::new();
        let part = part(0..80, true);
        assert_eq!(outbox.write_next(1172, 1172, &mut out), Some(part));
        assert_eq!(outbox.deadline(), Some(at(50)));
        outbox.on_loss(0, 0..80, true);
        outbox.expire(at(44), at(49));
        assert_eq!(outbox.frames_given_up, 0);
        outbox.expire(at(45), at(50));
        assert_eq!((outbox.frames_given_up, outbox.kept()), (1, UNIT_COST));
        assert_eq!(outbox.visited, 4, "once when it was sent, and at each look for late ones");
        out.clear();
        assert_eq!(
            outbox.write_next(1172, 1172, &mut out),
            Some(Content::GiveUp { lane: UnitLane::Frames, unit: 0 })
        );
        assert!(!outbox.has_due());
        outbox.on_give_up_loss(0);
        assert!(outbox.has_due());
        outbox.on_give_up_ack(0);
        assert!(outbox.is_empty());
    }

    #[test]
    fn the_time_of_a_frame_begins_with_its_end() {
        let mut outbox = sender(Some(50));
        begin(&mut outbox, 0, PATH);
        outbox.expire(at(0), at(5));
        let end = FrameEnd { frame: FrameNumber(0), items: 0, hash: 0 };
        outbox.put(&FrameMessage::End(end), PATH);
        outbox.expire(at(10), at(15));
        assert_eq!((outbox.deadline(), outbox.frames_given_up), (Some(at(60)), 0));
        outbox.expire(at(55), at(60));
        assert_eq!((outbox.deadline(), outbox.frames_given_up), (None, 1));
    }

    #[test]
    fn the_word_of_giving_up_is_said_until_it_arrives_though_the_end_had_arrived() {
        let mut outbox = sender(Some(50));
        frame(&mut outbox, 0);
        outbox.expire(at(0), at(5));
        outbox.on_ack(0, 40..80, true);
        outbox.expire(at(50), at(55));
        let mut out = vec![0; 500];
        // It takes 93 bytes: 80 are the beginning of the frame.
        for (room, is_said) in [(93, true), (92, false), (93, true), (1172, true)] {
            let said = Content::GiveUp { lane: UnitLane::Frames, unit: 0 };
            assert_eq!(outbox.write_next(room, 1172, &mut out), is_said.then_some(said));
            outbox.on_give_up_loss(0);
        }
        assert_eq!(out.len(), 500 + 3 * 93);
        assert!(!outbox.is_empty());
    }

    #[test]
    fn a_long_header_that_was_lost_goes_with_the_word_of_giving_up() {
        let format = Format { header: 1000, ..FORMAT };
        let mut outbox = Outbox { format, ..sender(Some(50)) };
        let header = FixedBytes::from_elem(9, 1000);
        outbox.put(&FrameMessage::Begin { frame: FrameNumber(0), header }, PATH);
        outbox.put(&FrameMessage::Batch(vec![1; 400].into()), PATH);
        let end = FrameEnd { frame: FrameNumber(0), items: 100, hash: 5 };
        outbox.put(&FrameMessage::End(end), PATH);
        outbox.expire(at(0), at(5));
        while again(&mut outbox).is_some() {}
        outbox.on_ack(0, 0..3, false);
        outbox.expire(at(50), at(55));
        let mut out = Vec::new();
        assert_eq!(
            outbox.write_next(1172, 1172, &mut out),
            Some(Content::GiveUp { lane: UnitLane::Frames, unit: 0 })
        );
        let Ok(Chunk::GiveUp { about, head, .. }) = Chunk::read(&mut Reader::new(&out), &format) else {
            panic!("{out:?}")
        };
        assert_eq!((about.length, about.sent, head.len()), (1408, 1408, 1005));
        assert!(head[5..].iter().all(|byte| *byte == 9), "{head:?}");
    }

    #[test]
    fn a_frame_that_was_given_up_is_not_confirmed_by_what_still_arrives_of_it() {
        let mut outbox = sender(Some(50));
        (0..2).for_each(|number| frame(&mut outbox, number));
        outbox.expire(at(0), at(5));
        outbox.expire(at(50), at(55));
        outbox.on_give_up_ack(1);
        outbox.on_ack(1, 0..80, true);
        assert_eq!((outbox.frames_given_up, outbox.confirmed), (2, None));
    }

    #[test]
    fn a_frame_that_arrived_is_not_given_up() {
        let mut outbox = sender(Some(50));
        (0..2).for_each(|number| frame(&mut outbox, number));
        outbox.expire(at(0), at(5));
        outbox.on_ack(1, 0..80, true);
        outbox.expire(at(90), at(95));
        assert_eq!(outbox.frames_given_up, 1, "the first one only");
    }

    const SMALL: Path = Path { shard: 100, loss: 0.0 };

    /// A frame of so many bytes in parts of a hundred, and at least two repair shards; all sent.
    fn repaired(bytes: usize) -> (Outbox, Vec<Content>) {
        let mut outbox = Outbox { repair: Budget::new(Repair::On, 100), ..sender(None) };
        let sent = send(&mut outbox, bytes, SMALL);
        (outbox, sent)
    }

    /// Sends a frame of so many bytes.
    fn send(outbox: &mut Outbox, bytes: usize, path: Path) -> Vec<Content> {
        begin(outbox, 7, path);
        outbox.put(&FrameMessage::Batch(vec![1; bytes - 80].into()), path);
        end(outbox, bytes, path)
    }

    /// Ends a frame of so many bytes; returns all that is sent now.
    fn end(outbox: &mut Outbox, bytes: usize, path: Path) -> Vec<Content> {
        let end = FrameEnd { frame: FrameNumber(7), items: (bytes as u32 - 80) / 4, hash: 5 };
        outbox.put(&FrameMessage::End(end), path);
        std::iter::from_fn(|| again(outbox)).collect()
    }

    /// The next content to be sent.
    fn again(outbox: &mut Outbox) -> Option<Content> {
        outbox.write_next(1172, 1172, &mut Vec::new())
    }

    fn part(range: Range<u64>, ended: bool) -> Content {
        Content::Part { lane: UnitLane::Frames, unit: 0, range, ended }
    }

    #[test]
    fn a_lost_part_is_sent_again_alone_and_one_that_has_arrived_is_not() {
        let mut outbox = sender(None);
        send(&mut outbox, 300, SMALL);
        outbox.on_loss(0, 0..100, false);
        assert_eq!((again(&mut outbox), again(&mut outbox)), (Some(part(0..100, false)), None));
        outbox.on_ack(0, 200..300, true);
        outbox.on_loss(0, 200..300, true);
        assert_eq!(again(&mut outbox), None);
    }

    #[test]
    fn what_is_sent_again_leaves_less_for_repair() {
        let repair = |repeats: bool| {
            let mut outbox = Outbox { repair: Budget::new(Repair::Auto, 15), ..sender(None) };
            send(&mut outbox, 40_000, Path { shard: 1000, loss: 0.0 });
            if repeats {
                outbox.on_loss(0, 39_000..40_000, true);
                assert_eq!(again(&mut outbox), Some(part(39_000..40_000, true)));
            }
            let sent = send(&mut outbox, 4000, Path { shard: 1000, loss: 0.2 });
            sent.iter().filter(|content| matches!(content, Content::Repair { .. })).count()
        };
        assert_eq!((repair(false), repair(true)), (6, 5));
    }

    #[test]
    fn a_frame_that_grows_has_repair_for_each_full_block_and_for_the_rest() {
        let mut outbox = Outbox { repair: Budget::new(Repair::On, 100), ..sender(None) };
        begin(&mut outbox, 7, SMALL);
        outbox.put(&FrameMessage::Batch(vec![1; 6420].into()), SMALL);
        let sent: Vec<_> = std::iter::from_fn(|| again(&mut outbox)).collect();
        assert_eq!(
            (sent.first(), sent.get(64)),
            (Some(&part(0..100, false)), Some(&part(6400..6500, false)))
        );
        let first = |content: &Content| matches!(content, Content::Repair { offset: 0, .. });
        assert!(sent.len() > 65 && sent[65..].iter().all(first), "{sent:?}");
        (0..64).for_each(|at| outbox.on_ack(0, at * 100..at * 100 + 100, false));
        outbox.put(&FrameMessage::Batch(vec![1; 100].into()), SMALL);
        let rest = Content::Repair { lane: UnitLane::Frames, unit: 0, offset: 6400, index: 0 };
        assert_eq!(end(&mut outbox, 6600, SMALL), [part(6500..6600, true), rest]);
    }

    #[test]
    fn what_repair_restores_is_not_sent_again_and_the_frame_is_confirmed() {
        let (mut outbox, sent) = repaired(400);
        let shard = |index| Content::Repair { lane: UnitLane::Frames, unit: 0, offset: 0, index };
        assert_eq!(sent[3..], [part(300..400, true), shard(0), shard(1)]);
        outbox.on_ack(0, 0..100, false);
        outbox.on_loss(0, 100..200, false);
        outbox.on_loss(0, 300..400, true);
        assert!(!outbox.has_due(), "both repair shards may still come");
        outbox.on_repair_ack(0, 0, 1);
        outbox.on_repair_ack(0, 0, 0);
        assert_eq!((outbox.has_due(), outbox.confirmed), (false, None));
        outbox.on_ack(0, 200..300, false);
        assert_eq!((outbox.confirmed, outbox.is_empty(), outbox.kept()), (Some(FrameNumber(7)), true, 0));
    }

    #[test]
    fn only_what_repair_cannot_make_up_for_is_sent_again() {
        let (mut outbox, _) = repaired(400);
        for at in [0, 100, 300] {
            outbox.on_loss(0, at..at + 100, at == 300);
        }
        assert_eq!(
            (again(&mut outbox), again(&mut outbox)),
            (Some(part(0..100, false)), None),
            "one too many"
        );
        outbox.on_repair_loss(0, 0, 0);
        assert_eq!((again(&mut outbox), again(&mut outbox)), (Some(part(100..200, false)), None));
        outbox.stop_waiting();
        assert_eq!(
            (again(&mut outbox), again(&mut outbox)),
            (Some(part(300..400, true)), None),
            "with the end"
        );
        assert_eq!(outbox.repeated, 3);
    }

    #[test]
    fn the_end_of_a_frame_is_said_again_where_repair_does_not_tell_of_it() {
        // 64 shards: the block ends before the end of the frame is known.
        let (mut outbox, sent) = repaired(6400);
        for content in &sent {
            match content {
                Content::Part { range, ended: false, .. } => outbox.on_ack(0, range.clone(), false),
                Content::Part { range, .. } => outbox.on_loss(0, range.clone(), true),
                _ => {}
            }
        }
        assert_eq!(again(&mut outbox), None);
        outbox.on_repair_ack(0, 0, 0);
        assert_eq!(again(&mut outbox), Some(part(6400..6400, true)));
        outbox.on_ack(0, 6400..6400, true);
        assert_eq!(outbox.confirmed, Some(FrameNumber(7)));
        // Of two blocks only the second tells of it.
        let (mut outbox, _) = repaired(6600);
        outbox.on_repair_ack(0, 0, 0);
        assert_eq!(again(&mut outbox), None);
        outbox.on_loss(0, 6500..6600, true);
        outbox.on_ack(0, 6400..6500, false);
        outbox.on_repair_ack(0, 6400, 0);
        assert_eq!((again(&mut outbox), outbox.is_empty()), (None, false));
    }
}
