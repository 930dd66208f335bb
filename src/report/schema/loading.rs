//! Frames that were shown before all of their geometry had come.

use serde::{Deserialize, Serialize};

use super::{Frame, Stat, summary::sum};

/// Pictures that were shown before all of their frame had come, by a display that began without the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Loading {
    /// Pictures that lacked something: coarser drawables were drawn in its place.
    pub frames: u32,
    /// Pictures that showed a frame again, as more of it had come.
    pub again: u32,
    /// Pictures that lacked something, and were compared with the unculled one of the same LOD cut.
    pub audited_frames: u32,
    /// Pixels of those that were not exact yet, summed; `null` if none was compared.
    pub pixels: Option<u64>,
    /// Time from the camera's publication to the exact picture, of frames that lacked something when they
    /// were first shown. A frame that the next one replaced before it was exact is not among them.
    pub exact_after_ms: Option<Stat>,
}

impl Loading {
    /// Of a walk's frames; `None` where none of them lacked anything.
    pub(super) fn of(frames: &[Frame]) -> Option<Self> {
        let count = |is: fn(&Frame) -> bool| {
            u32::try_from(frames.iter().filter(|frame| is(frame)).count()).unwrap_or(u32::MAX)
        };
        let lacking = count(|frame| frame.lacking > 0);
        (lacking > 0).then(|| Self {
            frames: lacking,
            again: count(|frame| frame.again),
            audited_frames: count(|frame| frame.loading_pixels.is_some()),
            pixels: sum(frames, |frame| frame.loading_pixels),
            exact_after_ms: Stat::of(exact_after_ms(frames)),
        })
    }
}

fn exact_after_ms(frames: &[Frame]) -> Vec<f64> {
    let mut found = Vec::new();
    // How old the frame is, if it has lacked something since it was first shown.
    let mut age = None;
    for frame in frames {
        age = match frame.again {
            true => age.zip(frame.frame_ms).map(|(age, since)| age + since),
            false => frame.latency_ms.filter(|_| frame.lacking > 0),
        };
        if frame.lacking == 0 {
            found.extend(age.take());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(latency_ms: f64, lacking: u64) -> Frame {
        Frame { latency_ms: Some(latency_ms), frame_ms: Some(1000.0), lacking, ..Frame::default() }
    }

    fn again(frame_ms: f64, lacking: u64) -> Frame {
        Frame { again: true, frame_ms: Some(frame_ms), lacking, ..Frame::default() }
    }

    #[test]
    fn a_frame_is_exact_after_its_first_latency_and_the_pictures_since() {
        let frames = [
            first(20.0, 0),
            first(30.0, 9),
            again(5.0, 4),
            again(6.0, 0),
            // The next one replaced it.
            first(40.0, 9),
            again(7.0, 3),
            first(50.0, 0),
            first(60.0, 1),
            again(8.0, 0),
        ];
        let audited = Frame { loading_pixels: Some(12), ..frames[4].clone() };
        let none = Frame { loading_pixels: Some(0), ..frames[5].clone() };
        let frames = [&frames[..4], &[audited, none], &frames[6..]].concat();
        let loading = Loading::of(&frames).unwrap();
        assert_eq!((loading.frames, loading.again), (5, 4));
        assert_eq!((loading.audited_frames, loading.pixels), (2, Some(12)));
        let after = loading.exact_after_ms.unwrap();
        assert_eq!((after.frames, after.median, after.max), (2, 41.0, 68.0));
    }

    #[test]
    fn nothing_is_said_where_nothing_was_lacking_or_measured() {
        assert_eq!(Loading::of(&[first(20.0, 0), first(30.0, 0)]), None);
        let loading = Loading::of(&[first(20.0, 2), first(30.0, 0)]).unwrap();
        assert_eq!((loading.frames, loading.again, loading.audited_frames), (1, 0, 0));
        assert_eq!((loading.pixels, loading.exact_after_ms), (None, None), "it never was exact");
    }
}
