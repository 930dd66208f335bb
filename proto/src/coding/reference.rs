//! The frames that a change can refer to.

use std::collections::VecDeque;

use crate::{FrameNumber, IdBatch};

/// How many complete frames each side keeps for reference.
const FRAMES: usize = 8;

/// A frame of more ids is not kept.
const IDS: usize = 1 << 18;

/// The last complete frames, newest last: 8 MiB at most.
#[derive(Debug, Default)]
pub(crate) struct References {
    frames: VecDeque<Held>,
    /// The ids of the current frame.
    pending: Vec<u32>,
}

#[derive(Debug)]
struct Held {
    frame: FrameNumber,
    ids: Vec<u32>,
    /// Whether the ids rise. If not, they are sorted on first use.
    rising: bool,
}

impl References {
    /// Begins a frame.
    pub(crate) fn begin(&mut self) {
        self.pending.clear();
    }

    /// Adds ids to the current frame.
    pub(crate) fn add(&mut self, batch: &IdBatch) {
        if self.pending.len() <= IDS {
            self.pending.extend(batch.iter().map(|id| id.0));
        }
    }

    /// Keeps the current frame as complete.
    pub(crate) fn complete(&mut self, frame: FrameNumber) {
        if self.pending.len() > IDS {
            return;
        }
        // Reuses the oldest frame's memory for the next frame's ids.
        let oldest = if self.frames.len() < FRAMES { None } else { self.frames.pop_front() };
        let room = oldest.map_or_else(Vec::new, |held| held.ids);
        let ids = std::mem::replace(&mut self.pending, room);
        self.frames.push_back(Held { frame, ids, rising: false });
    }

    /// The ids of `frame`, rising, without duplicates.
    pub(crate) fn get(&mut self, frame: FrameNumber) -> Option<&[u32]> {
        self.frames.iter_mut().find(|held| held.frame == frame).map(Held::rising)
    }

    /// The newest frame.
    pub(crate) fn newest(&self) -> Option<FrameNumber> {
        self.frames.back().map(|held| held.frame)
    }
}

impl Held {
    fn rising(&mut self) -> &[u32] {
        if !self.rising {
            self.ids.sort_unstable();
            self.ids.dedup();
            self.rising = true;
        }
        &self.ids
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;

    fn batch(ids: &[u32]) -> IdBatch {
        IdBatch::new(Bytes::from(ids.iter().flat_map(|id| id.to_le_bytes()).collect::<Vec<_>>())).unwrap()
    }

    fn take(references: &mut References, frame: u32, ids: &[u32]) {
        references.begin();
        ids.chunks(1000).for_each(|ids| references.add(&batch(ids)));
        references.complete(FrameNumber(frame));
    }

    #[test]
    fn the_last_eight_frames_are_kept_in_order_of_their_ids() {
        let mut references = References::default();
        (0..10).for_each(|frame| take(&mut references, frame, &[frame + 5, frame, frame + 5]));
        assert_eq!(references.get(FrameNumber(1)), None);
        assert_eq!(references.get(FrameNumber(2)), Some(&[2, 7][..]));
        assert_eq!(references.newest(), Some(FrameNumber(9)));
        assert_eq!(references.get(FrameNumber(9)), Some(&[9, 14][..]));
    }

    #[test]
    fn what_was_not_completed_is_forgotten() {
        let mut references = References::default();
        references.begin();
        references.add(&batch(&[1, 2]));
        take(&mut references, 4, &[3]);
        assert_eq!(references.get(FrameNumber(4)), Some(&[3][..]));
    }

    #[test]
    fn a_frame_of_too_many_ids_is_not_kept() {
        let mut references = References::default();
        let ids: Vec<u32> = (0..=IDS as u32).collect();
        take(&mut references, 1, &ids);
        assert_eq!(references.get(FrameNumber(1)), None);
        take(&mut references, 2, &ids[1..]);
        assert_eq!(references.get(FrameNumber(2)).map(<[u32]>::len), Some(IDS));
    }
}
