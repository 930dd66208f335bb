//! How wrong a walk was.

use std::collections::HashSet;

use trimaran_cull::View;
use trimaran_proto::{DrawableId, FrameNumber};

/// Stands in tables where nothing is measured.
pub(super) const NONE: &str = "–";

/// How wrong a walk was, and how much it drew.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Figures {
    /// How many frames were compared, of all walks.
    pub frames: u32,
    /// Pixels that show another triangle than the LOD cut without culling does.
    pub wrong_pixels: u64,
    /// Drawables that own a pixel without culling, and were not drawn; each counts in every frame.
    pub lost_nodes: u64,
    /// Drawables that came or went between two frames of a camera that had stood still long enough. `None`
    /// for a system that changes its method while it walks.
    pub toggles: Option<u64>,
    /// Drawables that were drawn, and are not of the frame's LOD cut.
    pub outside_cut: u64,
    /// Pixels at which nothing was drawn.
    pub background: u64,
    /// The most frames that were shown between the time when a frame's camera was published and its picture.
    pub latency_frames: u32,
    /// The first frame with a wrong pixel or a lost drawable.
    pub first_wrong: Option<u32>,
    /// How many drawables were drawn, of all frames.
    pub drawn: u64,
    /// How many the LOD cuts had.
    pub whole: u64,
}

impl Figures {
    /// Whether culling lost nothing and changed no pixel.
    #[must_use]
    pub const fn is_exact(&self) -> bool {
        self.wrong_pixels == 0 && self.lost_nodes == 0 && self.outside_cut == 0
    }

    /// Whether it is exact, and nothing toggled.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.is_exact() && self.toggles.unwrap_or(0) == 0
    }

    /// The worse one of each figure.
    #[must_use]
    pub fn worse(self, other: Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            wrong_pixels: self.wrong_pixels.max(other.wrong_pixels),
            lost_nodes: self.lost_nodes.max(other.lost_nodes),
            toggles: self.toggles.max(other.toggles),
            outside_cut: self.outside_cut.max(other.outside_cut),
            background: self.background.max(other.background),
            latency_frames: self.latency_frames.max(other.latency_frames),
            first_wrong: self.first_wrong.or(other.first_wrong),
            drawn: self.drawn.max(other.drawn),
            whole: self.whole.max(other.whole),
        }
    }

    /// Adds a frame.
    pub(super) fn add(&mut self, frame: FrameNumber, wrong_pixels: u64, lost_nodes: u64) {
        self.frames += 1;
        self.wrong_pixels += wrong_pixels;
        self.lost_nodes += lost_nodes;
        if wrong_pixels + lost_nodes > 0 && self.first_wrong.is_none() {
            self.first_wrong = Some(frame.0);
        }
    }
}

/// How many of the drawn ones are not of the cut.
pub(super) fn outside(drawn: &[DrawableId], cut: &[DrawableId]) -> u64 {
    let cut: HashSet<_> = cut.iter().collect();
    drawn.iter().filter(|id| !cut.contains(id)).count() as u64
}

/// The drawables that come or go between frames whose camera stands still, once it has stood for `settled`
/// frames.
pub(super) fn toggles<'f>(
    frames: impl IntoIterator<Item = (&'f View, &'f [DrawableId])>,
    settled: usize,
) -> u64 {
    let (mut toggles, mut stood) = (0, 0);
    let mut last: Option<(&View, HashSet<DrawableId>)> = None;
    for (view, ids) in frames {
        let ids: HashSet<DrawableId> = ids.iter().copied().collect();
        match &last {
            Some((before, had)) if same_but_for_the_frame(before, view) => {
                stood += 1;
                if stood >= settled {
                    toggles += had.symmetric_difference(&ids).count() as u64;
                }
            }
            _ => stood = 0,
        }
        last = Some((view, ids));
    }
    toggles
}

fn same_but_for_the_frame(a: &View, b: &View) -> bool {
    a.camera().for_frame(b.camera().frame()) == *b.camera()
        && (a.viewport(), a.sections()) == (b.viewport(), b.sections())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_audit::cases::looking;
    use trimaran_cull::Viewport;

    use super::*;

    #[test]
    fn only_changes_while_the_camera_stands_are_toggles() {
        let size = Viewport::new(8, 8).unwrap();
        let view = |x: f64, frame| looking(DVec3::X * x, DVec3::Y * 5.0, 60.0, size, frame).unwrap();
        let (a, b, c) = (DrawableId(1), DrawableId(2), DrawableId(3));
        let sets: [(f64, &[DrawableId]); 6] =
            [(0.0, &[a]), (1.0, &[b]), (1.0, &[a, b]), (1.0, &[b, a]), (1.0, &[b, c]), (2.0, &[])];
        let views: Vec<_> = (0..).zip(&sets).map(|(frame, (x, _))| view(*x, frame)).collect();
        let frames = || views.iter().zip(&sets).map(|(view, (_, ids))| (view, *ids));
        assert_eq!(toggles(frames(), 1), 3, "a comes; a goes, and c comes");
        assert_eq!(toggles(frames(), 2), 2);
        assert_eq!(toggles(frames(), 4), 0);
    }
}
