//! The usual time of a frame, to detect late ones.

use std::{collections::VecDeque, time::Duration};

use crate::median::median;

/// The culling times of the last frames, over all cullers.
#[derive(Debug, Default)]
pub(super) struct Usual {
    times: VecDeque<Duration>,
}

impl Usual {
    /// How many times are kept.
    const KEPT: usize = 31;
    /// A frame is late at this multiple of the median.
    const MULTIPLE: u32 = 3;
    /// How long the first frames may take, while a culler makes its device ready.
    const AT_FIRST: Duration = Duration::from_secs(2);

    pub(super) fn note(&mut self, took: Duration) {
        if self.times.len() == Self::KEPT {
            self.times.pop_front();
        }
        self.times.push_back(took);
    }

    /// When a frame is late, but never before `least`.
    pub(super) fn late(&self, least: Duration) -> Duration {
        if self.times.len() < 3 {
            return Self::AT_FIRST.max(least);
        }
        let median = median(self.times.iter().copied()).unwrap_or_default();
        (median * Self::MULTIPLE).max(least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_is_three_times_the_median_of_the_last_frames() {
        let mut usual = Usual::default();
        let ms = Duration::from_millis;
        assert_eq!(usual.late(ms(5)), ms(2000), "nothing is usual yet");
        [30, 10, 500].into_iter().for_each(|took| usual.note(ms(took)));
        assert_eq!(usual.late(ms(5)), ms(90));
        assert_eq!(usual.late(ms(100)), ms(100));
        (0..31).for_each(|_| usual.note(ms(7)));
        assert_eq!(usual.late(ms(5)), ms(21), "what was usual long ago is forgotten");
    }
}
