//! Received frames of another culler, until this one asks for them.
//!
//! A frame is only useful for the next one, so at most two are kept, and only their ids: the other culler may
//! send any amount while the display lets this one wait.

use std::collections::VecDeque;

use thiserror::Error;
use trimaran_proto::{DrawableId, FrameNumber};

use crate::{
    ids::{FrameIds, IdError},
    links::FrameEvent,
};

/// How many frames are kept. The other culler begins a frame when this one has begun the previous one.
const KEPT: usize = 2;

/// The last frames of another culler, oldest first.
#[derive(Debug)]
pub(super) struct OtherFrames {
    frames: VecDeque<Frame>,
    /// Those of the newest frame.
    ids: FrameIds,
}

#[derive(Debug)]
struct Frame {
    number: FrameNumber,
    /// Its batches of ids that were not asked for yet.
    batches: VecDeque<Vec<DrawableId>>,
    is_whole: bool,
}

/// Another culler's frame is invalid.
#[derive(Debug, Error)]
pub(super) enum OtherFrameError {
    #[error("it broke the order of frames")]
    Order,
    #[error(transparent)]
    Ids(#[from] IdError),
}

impl OtherFrames {
    /// For frames of a scene with this many drawables.
    pub(super) fn of(drawables: u32) -> Self {
        Self { frames: VecDeque::new(), ids: FrameIds::of(drawables) }
    }

    /// Takes a frame event. Beyond the limit the oldest frame is dropped.
    pub(super) fn take(&mut self, event: FrameEvent) -> Result<(), OtherFrameError> {
        let open = self.frames.back_mut().filter(|frame| !frame.is_whole);
        match (event, open) {
            (FrameEvent::Begin(start), None) => {
                if self.frames.len() == KEPT {
                    self.frames.pop_front();
                }
                let number = start.header.frame();
                self.frames.push_back(Frame { number, batches: VecDeque::new(), is_whole: false });
            }
            (FrameEvent::Batch(batch), Some(frame)) => {
                frame.batches.push_back(self.ids.take(&batch)?.to_vec());
            }
            (FrameEvent::End(_), Some(frame)) => {
                self.ids.finish();
                frame.is_whole = true;
            }
            _ => return Err(OtherFrameError::Order),
        }
        Ok(())
    }

    /// The first frame from this number on; earlier ones are dropped.
    pub(super) fn first_from(&mut self, number: u32) -> Option<FrameNumber> {
        while self.frames.front().is_some_and(|frame| frame.number.0 < number && frame.is_whole) {
            self.frames.pop_front();
        }
        self.frames.front().map(|frame| frame.number).filter(|frame| frame.0 >= number)
    }

    /// The next batch of the first frame: an empty list at its end, none if more are to come. Batches stay as
    /// they were sent, whenever they arrived: what is chosen from each does not depend on the time.
    pub(super) fn next(&mut self) -> Option<Vec<DrawableId>> {
        let frame = self.frames.front_mut()?;
        if let Some(batch) = frame.batches.pop_front() {
            return Some(batch);
        }
        if frame.is_whole {
            self.frames.pop_front();
            return Some(Vec::new());
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trimaran_proto::{Camera, IdBatch};
    use trimaran_transport::{FrameEnd, FrameOutcome, FrameStart};

    use super::*;

    const DRAWABLES: u32 = 50;

    fn begin(number: u32) -> FrameEvent {
        let frame = FrameNumber(number);
        let header = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 0.1, frame).unwrap();
        FrameEvent::Begin(FrameStart { frame, header })
    }

    fn batch(ids: impl IntoIterator<Item = u32>) -> FrameEvent {
        let bytes: Vec<u8> = ids.into_iter().flat_map(u32::to_le_bytes).collect();
        FrameEvent::Batch(IdBatch::new(bytes.into()).unwrap())
    }

    fn end(number: u32) -> FrameEvent {
        let end = FrameEnd { frame: FrameNumber(number), items: 0, hash: 0 };
        FrameEvent::End(FrameOutcome::Complete(end))
    }

    fn numbers(ids: Option<Vec<DrawableId>>) -> Option<Vec<u32>> {
        ids.map(|ids| ids.into_iter().map(|id| id.0).collect())
    }

    #[test]
    fn ids_come_as_they_came_and_once() {
        let mut frames = OtherFrames::of(DRAWABLES);
        assert_eq!(frames.first_from(3), None);
        for event in [begin(2), batch([9]), end(2), begin(3), batch([4, 2]), batch([5])] {
            frames.take(event).unwrap();
        }
        assert_eq!(frames.first_from(3), Some(FrameNumber(3)), "2 is over");
        assert_eq!(numbers(frames.next()), Some(vec![4, 2]));
        assert_eq!(numbers(frames.next()), Some(vec![5]), "a batch at a time");
        assert_eq!(numbers(frames.next()), None, "more is to come");
        frames.take(batch([7])).unwrap();
        frames.take(end(3)).unwrap();
        assert_eq!(numbers(frames.next()), Some(vec![7]));
        assert_eq!(numbers(frames.next()), Some(vec![]), "the end");
        assert_eq!(numbers(frames.next()), None);
    }

    #[test]
    fn what_is_no_frame_is_an_error() {
        for events in [
            vec![batch([1])],
            vec![end(1)],
            vec![begin(1), begin(2)],
            vec![begin(1), end(1), end(1)],
            vec![begin(1), batch([DRAWABLES])],
            vec![begin(1), batch([1]), batch([1])],
        ] {
            let mut frames = OtherFrames::of(DRAWABLES);
            assert!(events.into_iter().any(|event| frames.take(event).is_err()));
        }
        let mut frames = OtherFrames::of(DRAWABLES);
        for event in [begin(1), batch([1]), end(1), begin(2), batch([1])] {
            frames.take(event).unwrap();
        }
    }

    proptest! {
        /// The other culler may send any number of frames and batches without being asked.
        #[test]
        fn no_more_than_two_frames_are_kept(
            events in prop::collection::vec((0..4_u8, prop::collection::vec(0..DRAWABLES, 1..9)), 0..900)
        ) {
            let mut frames = OtherFrames::of(DRAWABLES);
            for (number, (kind, ids)) in (0..).zip(events) {
                let event = match kind {
                    0 => begin(number),
                    1 => end(number),
                    _ => batch(ids),
                };
                let _refused = frames.take(event);
                prop_assert!(frames.frames.len() <= KEPT);
                let held = |frame: &Frame| frame.batches.iter().map(Vec::len).sum::<usize>();
                prop_assert!(frames.frames.iter().all(|frame| held(frame) <= DRAWABLES as usize));
            }
        }
    }
}
