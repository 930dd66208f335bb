//! Bytes a frame on the network: by the paper's formula, and as sent.

/// The quantities that determine the bytes of one frame, in the paper's letters (section 3.3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameLoad {
    /// `n`: how many node ids HC sends to each receiver.
    pub ids: f64,
    /// `b`: how many ids travel in one packet, at least 1.
    pub batch: f64,
    /// `h`: bytes of header around each packet, of all layers; the paper takes 50 for TCP, IP and Ethernet.
    pub header: f64,
    /// How many receivers the ids have: RVG, and in the schedule `switch` the other culler's OR. None where
    /// the display culls for itself.
    pub receivers: u8,
}

/// The bytes of a camera: `72`.
const CAMERA: f64 = 72.0;
/// The bytes of a node id: `4`.
const ID: f64 = 4.0;
/// Cameras a frame in the paper: RVG to both cullers, HC to RVG.
const PAPER_CAMERAS: f64 = 3.0;
/// Receivers of the ids in the paper: OR and RVG.
const PAPER_RECEIVERS: f64 = 2.0;

impl FrameLoad {
    /// Bytes a frame by the paper's formula, `8 (nh/b) + 3 (72 + h)` (section 3.3).
    ///
    /// Its first term multiplies the bytes of the ids, `2 * 4n`, by those of the headers, `h/b` an id; the
    /// two should be added, as in [`FrameLoad::sent_bytes`]. Given for comparison with the paper's
    /// figures only.
    #[must_use]
    pub fn paper_bytes(&self) -> f64 {
        PAPER_RECEIVERS * ID * (self.ids * self.header / self.batch) + self.camera_bytes(PAPER_CAMERAS)
    }

    /// Bytes a frame as sent to `r` receivers, `r (4n + hn/b) + (r + 1) (72 + h)`: each id, a header for each
    /// packet of ids, and the cameras, to the culler and from it to each receiver.
    ///
    /// It assumes that every packet is full. A frame whose ids do not fill the last one sends up to one more
    /// header a receiver, and frame ends come on top.
    #[must_use]
    pub fn sent_bytes(&self) -> f64 {
        let receivers = f64::from(self.receivers);
        let cameras = if self.receivers == 0 { 0.0 } else { receivers + 1.0 };
        receivers * (ID * self.ids + self.header * self.ids / self.batch) + self.camera_bytes(cameras)
    }

    fn camera_bytes(&self, cameras: f64) -> f64 {
        cameras * (CAMERA + self.header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The case of the paper's section 5.1, at 30 frames a second.
    const PAPER: FrameLoad = FrameLoad { ids: 4000.0, batch: 10.0, header: 50.0, receivers: 2 };

    fn megabits(bytes: f64) -> f64 {
        8.0 * bytes * 30.0 / 1e6
    }

    #[test]
    fn the_papers_figure_is_39_megabits_a_second() {
        assert_eq!(PAPER.paper_bytes(), 160_366.0);
        assert!((megabits(PAPER.paper_bytes()) - 38.5).abs() < 0.05);
    }

    #[test]
    fn what_is_sent_is_less_than_half_of_that() {
        assert_eq!(PAPER.sent_bytes(), 72_366.0);
        assert!((megabits(PAPER.sent_bytes()) - 17.4).abs() < 0.05);
    }

    #[test]
    fn without_ids_both_are_three_cameras() {
        let still = FrameLoad { ids: 0.0, ..PAPER };
        assert_eq!((still.paper_bytes(), still.sent_bytes()), (366.0, 366.0));
    }

    #[test]
    fn one_receiver_takes_half_the_ids_and_none_takes_nothing() {
        assert_eq!(FrameLoad { receivers: 1, ..PAPER }.sent_bytes(), 36_000.0 + 244.0);
        assert_eq!(FrameLoad { receivers: 0, ..PAPER }.sent_bytes(), 0.0);
    }

    #[test]
    fn larger_batches_approach_the_bare_ids() {
        let large = FrameLoad { batch: 16_384.0, header: 4.0, ..PAPER };
        assert!((large.sent_bytes() - (2.0 * 16_000.0 + 3.0 * 76.0)).abs() < 2.0);
    }
}
