//! The findings of a check of a frame: errors of culling by their causes, and the error of the levels.
//! `trimaran-audit` checks frames; a report names what it found.

use serde::{Deserialize, Serialize};

/// The largest distance from a pixel's centre of the surface that covers it, in pixels: the rasterizer moves
/// corners by its sub-pixel step of 1/256, and a GPU places vertices in f32.
pub const SURFACE_SLACK_PX: f64 = 1.0 / 64.0;

/// The difference of two images, in the form of a report.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ImageDifference {
    /// Peak signal-to-noise ratio over red, green and blue, decibels; `null` if the images are equal
    /// (infinite).
    pub psnr_db: Option<f64>,
    /// Mean of the FLIP error map, 0 (equal) to 1.
    pub flip_mean: Option<f64>,
    /// 99th percentile of the FLIP error map.
    pub flip_p99: Option<f64>,
    /// Pixels whose colour differs.
    pub mismatching_pixels: u64,
    /// Largest distance of a pixel that only one of the images covers to the nearest surface of the other,
    /// pixels; the image's diagonal if there is none.
    pub silhouette_max_px: Option<f64>,
    /// 95th percentile of that distance, over the outline pixels of both as well (0 where both cover them).
    pub silhouette_p95_px: Option<f64>,
    /// Largest distance of a covered pixel, of either image, to the same thing's surface in the other,
    /// pixels.
    #[serde(default)]
    pub surface_max_px: Option<f64>,
    /// 95th percentile of that distance over the covered pixels of both.
    #[serde(default)]
    pub surface_p95_px: Option<f64>,
}

/// Why a visible drawable was not drawn: the first wrong step on its path from the root of the tree to the
/// picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FalseCullCause {
    /// Another level was drawn in its place, or an occluder outside the frame's LOD cut hides it: the roles
    /// chose differently.
    LevelMismatch,
    /// The rule of the paper's section 4.5.2 was on, and a node above it was drawn in its place.
    PixelCountRule,
    /// A box on the path does not contain the visible surface.
    BoxTooSmall,
    /// A box that contains the surface was classified as outside the frustum.
    OutsideFrustum,
    /// A box that reaches nearer than the near plane was tested instead of being taken as visible.
    NearPlane,
    /// The depth tested against was drawn from the camera of an earlier frame.
    StaleCamera,
    /// The occluders hide it, by their own surfaces and its own in f64: the driver has drawn it in front of
    /// them, so the picture without culling is wrong. It does so with triangles seen edge on.
    HiddenInF64,
    /// The tested depth lies in front of the visible surface: two passes or two devices placed it
    /// differently.
    OccluderTooNear,
    /// The box given to the occlusion test covers none of the surface's visible pixels.
    MissedSamples,
    /// The box, before it is grown, is level with the tested depth, and lost to it.
    DepthTie,
    /// The box is clearly in front at a pixel of the surface, and the occlusion test said that it is hidden.
    #[serde(rename = "occlusion_test_hid")]
    TestHid,
    /// Every step keeps it, and more ids were sent than drawn.
    LostIds,
    /// Every step keeps it when repeated, and all ids arrived.
    Unattributed,
}

impl FalseCullCause {
    /// Whether the picture without culling is wrong, and the one with culling is right.
    #[must_use]
    pub const fn is_of_the_driver(self) -> bool {
        matches!(self, Self::HiddenInF64)
    }

    /// All causes, in the order of tables.
    pub const ALL: [Self; 13] = [
        Self::LevelMismatch,
        Self::PixelCountRule,
        Self::BoxTooSmall,
        Self::OutsideFrustum,
        Self::NearPlane,
        Self::StaleCamera,
        Self::HiddenInF64,
        Self::OccluderTooNear,
        Self::MissedSamples,
        Self::DepthTie,
        Self::TestHid,
        Self::LostIds,
        Self::Unattributed,
    ];

    /// The cause in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::LevelMismatch => "the roles drew different levels of it, or of what hides it",
            Self::PixelCountRule => "the pixel-count rule (option) drew a node above it",
            Self::BoxTooSmall => "a box does not hold its surface",
            Self::OutsideFrustum => "a box that shows was taken to be outside the frustum",
            Self::NearPlane => "a box across the near plane was tested",
            Self::StaleCamera => "the occluders were drawn from an earlier frame's camera",
            Self::HiddenInF64 => "it is hidden: the driver draws it in front, where culling is right",
            Self::OccluderTooNear => "an occluder's depth lies in front of its surface",
            Self::MissedSamples => "its box covers none of its pixels",
            Self::DepthTie => "its box lost a depth tie",
            Self::TestHid => "the occlusion test hid a box that shows",
            Self::LostIds => "its id did not arrive",
            Self::Unattributed => "no step repeats it",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn each_cause_has_words_of_its_own_and_one_is_the_drivers() {
        let words: HashSet<&str> = FalseCullCause::ALL.into_iter().map(FalseCullCause::words).collect();
        assert_eq!((words.len(), words.contains("")), (FalseCullCause::ALL.len(), false));
        let of_the_driver: Vec<_> =
            FalseCullCause::ALL.into_iter().filter(|cause| cause.is_of_the_driver()).collect();
        assert_eq!(of_the_driver, [FalseCullCause::HiddenInF64]);
    }
}
