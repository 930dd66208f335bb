//! Keeps cullers' statistics of frames until the frames are shown, and maps frame numbers.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use trimaran_proto::{FrameNumber, FrameStats};

/// For how many frames they are kept.
const KEPT: usize = 64;

/// Cullers' statistics of frames.
///
/// A frame is dealt under one number and shown under another: in a live session some are never shown.
#[derive(Debug)]
pub(super) struct ShownStats {
    /// How many frames have been shown, with those of the walk before this session.
    count: FrameNumber,
    /// The last frames, by dealt and by shown number.
    numbers: VecDeque<(FrameNumber, FrameNumber)>,
    /// For frames that are not shown yet.
    early: BTreeMap<FrameNumber, FrameStats>,
    /// Shown frames without statistics yet.
    awaited: BTreeSet<FrameNumber>,
}

impl ShownStats {
    /// Empty; the first shown frame gets the number `first`.
    pub(super) const fn from(first: FrameNumber) -> Self {
        Self { count: first, numbers: VecDeque::new(), early: BTreeMap::new(), awaited: BTreeSet::new() }
    }

    /// The number under which the next frame is shown.
    pub(super) const fn next_number(&self) -> FrameNumber {
        self.count
    }

    /// The last shown frame, by its dealt number.
    pub(super) fn last_shown(&self) -> Option<FrameNumber> {
        self.numbers.back().map(|(dealt, _)| *dealt)
    }

    /// The frame dealt under this number is shown. Returns its statistics, if known.
    pub(super) fn shown(&mut self, dealt: FrameNumber) -> Option<FrameStats> {
        self.numbers.push_back((dealt, self.count));
        if self.numbers.len() > KEPT {
            self.numbers.pop_front();
        }
        self.count = FrameNumber(self.count.0.saturating_add(1));
        // Statistics of earlier frames that are not shown are useless.
        let later = self.early.split_off(&FrameNumber(dealt.0.saturating_add(1)));
        let known = std::mem::replace(&mut self.early, later).remove(&dealt);
        if known.is_none() {
            self.awaited.insert(dealt);
            if self.awaited.len() > KEPT {
                self.awaited.pop_first();
            }
        }
        known.and_then(|stats| self.as_shown(stats))
    }

    /// The last frame is shown again, without new statistics.
    pub(super) fn shown_again(&mut self) {
        self.count = FrameNumber(self.count.0.saturating_add(1));
    }

    /// Takes statistics of a frame. Returns them if it is shown already.
    pub(super) fn note(&mut self, stats: FrameStats) -> Option<FrameStats> {
        if self.last_shown().is_some_and(|last| stats.frame <= last) {
            self.awaited.remove(&stats.frame);
            return self.as_shown(stats);
        }
        self.early.insert(stats.frame, stats);
        if self.early.len() > KEPT {
            self.early.pop_last();
        }
        None
    }

    /// Whether statistics of a shown frame are still to come.
    pub(super) fn awaits(&self) -> bool {
        !self.awaited.is_empty()
    }

    /// The same by shown numbers; none if this frame was not shown.
    fn as_shown(&self, stats: FrameStats) -> Option<FrameStats> {
        let number =
            |dealt| self.numbers.iter().find(|(known, _)| *known == dealt).map(|(_, number)| *number);
        let occluders_of = stats.occluders_of.and_then(number);
        Some(FrameStats { frame: number(stats.frame)?, occluders_of, ..stats })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stats(frame: u32, of: u32) -> FrameStats {
        FrameStats { frame: FrameNumber(frame), occluders_of: Some(FrameNumber(of)), ..FrameStats::default() }
    }

    #[test]
    fn what_is_said_of_a_frame_is_told_under_the_number_it_is_shown_by() {
        let mut shown = ShownStats::from(FrameNumber(100));
        assert_eq!(shown.note(stats(5, 3)), None, "it is not shown yet");
        assert_eq!(shown.note(stats(4, 2)), None);
        assert_eq!(shown.shown(FrameNumber(3)), None);
        assert!(shown.awaits());
        assert_eq!(shown.shown(FrameNumber(5)), Some(stats(101, 100)), "frame 4 was never shown");
        assert_eq!(shown.note(stats(4, 3)), None);
        let told = shown.note(stats(3, 1)).unwrap();
        assert_eq!((told.frame, told.occluders_of), (FrameNumber(100), None), "frame 1 is unknown");
        assert!(!shown.awaits());
    }
}
