//! Frames that are put together once, for many receivers.

use trimaran_wire::{
    Batch, BatchEncoder, Batching, FrameEnd, FrameEvent, FrameMessage, FrameNumber, FrameOrderError,
    FrameOutcome, FrameStart, FrameWriter, Protocol, to_bytes,
};

use super::sender::coded;

/// A published frame. Clones of its messages share their bytes.
#[derive(Debug)]
pub(crate) struct PublishedFrame<P: Protocol> {
    start: FrameStart<P::Header>,
    /// The published frame before it.
    pub(crate) before: Option<FrameNumber>,
    plain: Vec<FrameMessage>,
    coded: Option<Coded>,
    pub(crate) end: FrameEnd,
}

/// The coded form of its batches.
#[derive(Debug)]
struct Coded {
    batches: Vec<FrameMessage>,
    /// The frame with which the encoder began: receivers need all frames from there on.
    since: FrameNumber,
}

impl<P: Protocol> PublishedFrame<P> {
    pub(crate) const fn number(&self) -> FrameNumber {
        self.start.frame
    }

    pub(crate) const fn items(&self) -> u32 {
        self.end.items
    }

    /// Its totals, under another number.
    pub(crate) const fn end_as(&self, frame: FrameNumber) -> FrameEnd {
        FrameEnd { frame, ..self.end }
    }

    /// The first frame that a receiver needs to have to read its coded batches, if there are any.
    pub(crate) fn coded_since(&self) -> Option<FrameNumber> {
        self.coded.as_ref().map(|coded| coded.since)
    }

    /// Its messages under a number of the receiver's link, for a receiver that has every frame from `since`
    /// to the one before. Without that its batches are plain.
    pub(crate) fn messages(
        &self,
        number: FrameNumber,
        since: Option<FrameNumber>,
    ) -> impl Iterator<Item = FrameMessage> + '_ {
        let begin = FrameMessage::Begin { frame: number, header: to_bytes(&self.start.header) };
        let coded = self
            .coded
            .as_ref()
            .filter(|coded| since.is_some_and(|since| since <= coded.since))
            .map(|coded| &coded.batches);
        let batches = coded.unwrap_or(&self.plain).iter().cloned();
        std::iter::once(begin).chain(batches).chain([FrameMessage::End(self.end_as(number))])
    }

    /// Its events under a number of the receiver's link, for a receiver in this process. `item`: the bytes of
    /// an item.
    pub(crate) fn events(
        &self,
        number: FrameNumber,
        item: usize,
    ) -> impl Iterator<Item = FrameEvent<P>> + '_ {
        let batches = self.plain.iter().filter_map(move |message| match message {
            FrameMessage::Batch(bytes) => Batch::of(bytes.clone(), item).ok().map(FrameEvent::Batch),
            _ => None,
        });
        let end = FrameEvent::End(FrameOutcome::Complete(self.end_as(number)));
        let start = FrameStart { frame: number, header: self.start.header.clone() };
        std::iter::once(FrameEvent::Begin(start)).chain(batches).chain([end])
    }
}

/// Puts frames together.
#[derive(Debug)]
pub(crate) struct Assembly<P: Protocol> {
    writer: FrameWriter<P::Item>,
    /// Whether batches are coded, if the application can.
    coded: bool,
    encoder: Option<Encoder<P>>,
    last: Option<FrameNumber>,
}

#[derive(Debug)]
struct Encoder<P: Protocol> {
    encoder: Box<dyn BatchEncoder<P::Item>>,
    since: FrameNumber,
    frames: u32,
}

/// An encoder begins anew after this many frames at the earliest, for receivers that lack some of them.
const FRAMES: u32 = 16;

impl<P: Protocol> Assembly<P> {
    /// `item`: the bytes of an item on the wire.
    pub(crate) fn new(Batching { size, coded }: Batching, max_frame: u32, item: usize) -> Self {
        let writer = FrameWriter::new(size).of_at_most(max_frame).of_items(item);
        Self { writer, coded, encoder: None, last: None }
    }

    /// The first frame that a receiver needs to have to read coded batches.
    pub(crate) fn since(&self) -> Option<FrameNumber> {
        self.encoder.as_ref().map(|encoder| encoder.since)
    }

    /// Puts a frame together. `lacking`: some receivers lack frames since [`Assembly::since`].
    pub(crate) fn put(
        &mut self,
        start: FrameStart<P::Header>,
        items: &[P::Item],
        lacking: bool,
    ) -> Result<PublishedFrame<P>, FrameOrderError> {
        let mut plain = Vec::new();
        self.writer.begin(start.frame)?;
        let pushed = self.writer.push(items, |message| plain.push(message));
        let finished = self.writer.finish(|message| match message {
            FrameMessage::End(_) => {}
            message => plain.push(message),
        });
        pushed?;
        let end = finished?;
        if self.coded && self.encoder.as_ref().is_none_or(|encoder| lacking && encoder.frames >= FRAMES) {
            let encoder = P::encoder(trimaran_wire::Delivery::Ordered);
            self.encoder = encoder.map(|encoder| Encoder { encoder, since: start.frame, frames: 0 });
        }
        let coded = self.encoder.as_mut().map(|encoder| encoder.code(&plain, &end));
        let before = self.last.replace(start.frame);
        Ok(PublishedFrame { start, before, plain, coded, end })
    }
}

impl<P: Protocol> Encoder<P> {
    fn code(&mut self, plain: &[FrameMessage], end: &FrameEnd) -> Coded {
        self.frames += 1;
        self.encoder.begin(end.frame);
        let batches = plain.iter().map(|message| coded(Some(&mut *self.encoder), message.clone())).collect();
        self.encoder.end(end);
        Coded { batches, since: self.since }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

    use super::*;
    use crate::conformance::{Robot, points, start};
    use proptest::prelude::*;
    use trimaran_wire::BatchSize;

    fn assembly(batch: u32, max_frame: u32) -> Assembly<Robot> {
        Assembly::new(Batching { size: BatchSize::new(batch).unwrap(), coded: true }, max_frame, 4)
    }

    /// A receiver that decodes.
    struct Receiver {
        decoder: Box<dyn trimaran_wire::BatchDecoder<u32>>,
        /// The last frame and the first one of those without a gap up to it.
        last: Option<(FrameNumber, FrameNumber)>,
        /// The frames that came coded, at least in part.
        coded: Vec<u32>,
    }

    impl Receiver {
        fn new() -> Self {
            Self { decoder: Robot::decoder(1 << 20).unwrap(), last: None, coded: Vec::new() }
        }

        fn take(&mut self, frame: &PublishedFrame<Robot>) -> Vec<u32> {
            let first = match self.last {
                Some((last, first)) if frame.before == Some(last) => first,
                _ => frame.number(),
            };
            self.last = Some((frame.number(), first));
            let mut items = Vec::new();
            for message in frame.messages(frame.number(), Some(first)) {
                match message {
                    FrameMessage::Begin { frame, .. } => self.decoder.begin(frame),
                    FrameMessage::Batch(bytes) => {
                        let batch = Batch::new(bytes).unwrap();
                        self.decoder.plain(&batch);
                        items.extend(batch.iter());
                    }
                    FrameMessage::Coded(bytes) => {
                        self.coded.push(frame.number().0);
                        items.extend(self.decoder.decode(&bytes).unwrap().iter());
                    }
                    FrameMessage::End(end) => self.decoder.end(&end),
                }
            }
            items
        }

        fn lacks(&self, since: FrameNumber) -> bool {
            self.last.is_none_or(|(_, first)| first > since)
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Each receiver gets a part of the frames, and reads every frame that it gets.
        #[test]
        fn receivers_that_skip_any_frames_read_what_they_get(
            gets in prop::collection::vec(prop::array::uniform3(prop::bool::weighted(0.8)), 1..80),
        ) {
            let mut assembly = assembly(100, 1 << 20);
            let mut receivers = [Receiver::new(), Receiver::new(), Receiver::new()];
            for (number, gets) in (0..).zip(&gets) {
                let mut items = points(1000);
                items[number as usize] = 7;
                let lacking = assembly.since().is_some_and(|since| receivers.iter().any(|r| r.lacks(since)));
                let frame = assembly.put(start(number), &items, lacking).unwrap();
                for (receiver, gets) in receivers.iter_mut().zip(gets) {
                    if *gets {
                        prop_assert_eq!(receiver.take(&frame), items.clone());
                    }
                }
            }
        }
    }

    #[test]
    fn a_receiver_that_lacked_a_frame_gets_coded_ones_again_once_the_encoder_begins_anew() {
        let mut assembly = assembly(100, 1 << 20);
        let mut receiver = Receiver::new();
        for number in 0..(3 * FRAMES) {
            let lacking = assembly.since().is_some_and(|since| receiver.lacks(since));
            let frame = assembly.put(start(number), &points(1000), lacking).unwrap();
            // It lacks one frame.
            if number != 5 {
                assert_eq!(receiver.take(&frame), points(1000));
            }
        }
        receiver.coded.dedup();
        assert_eq!(receiver.coded, (0..5).chain(FRAMES..3 * FRAMES).collect::<Vec<_>>());
    }

    #[test]
    fn a_frame_that_cannot_be_is_no_part_of_the_sequence() {
        let mut assembly = assembly(10, 50);
        assembly.put(start(3), &points(50), false).unwrap();
        let early = assembly.put(start(3), &points(1), false).unwrap_err();
        assert!(matches!(early, FrameOrderError::NotRising { .. }), "{early}");
        let large = assembly.put(start(4), &points(51), false).unwrap_err();
        assert!(matches!(large, FrameOrderError::TooMany { .. }), "{large}");
        let next = assembly.put(start(5), &points(2), false).unwrap();
        assert_eq!((next.before, next.items()), (Some(FrameNumber(3)), 2));
    }
}
