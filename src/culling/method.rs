//! The methods by name.

use std::fmt;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use trimaran_proto::OcclusionTestKind;

/// How a culler finds what is visible. Each draws the same picture; `rays` may differ at edges of triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum CullingMethod {
    /// Occluders chosen within a budget from what was visible last, each box tested as it is seen, and
    /// further rounds where much is new.
    #[default]
    Trimaran,
    /// As the paper does (sections 4.1, 4.2 and 4.5.1): all that was visible last as occluders, and boxes
    /// tested by hardware occlusion queries, once, level by level. Nothing is known at first and after a
    /// jump.
    #[cfg(feature = "lab")]
    Paper,
    /// As CHC++ does (Mattausch, Bittner and Wimmer 2008): hardware occlusion queries, several hidden nodes a
    /// query, and few of what was visible before.
    #[cfg(feature = "lab")]
    #[value(name = "chc++")]
    #[serde(rename = "chc++")]
    Chc,
    /// As GigaWalk does (paper, section 5): all that was visible last as occluders, their depth read back, a
    /// pyramid of farthest depths on the CPU, and the rectangle around each box tested against at most 2 x 2
    /// of its texels.
    #[cfg(feature = "lab")]
    GigaWalk,
    /// Levels of detail and the frustum, nothing else: all that is in sight is drawn.
    Frustum,
    /// A ray cast on the CPU through the centre of each pixel, and what it hits first taken: what a machine
    /// without a GPU can do. A rasterizer may differ at the edges of triangles, so that now and then the
    /// picture lacks what shows at a single pixel.
    #[cfg(feature = "lab")]
    Rays,
    /// All that is in sight drawn into an item buffer, and what owns a pixel of it taken: no method that
    /// draws the same picture finds less.
    #[cfg(feature = "lab")]
    Exact,
    /// The whole model at full detail in each frame, without levels and culling: for comparisons of speed.
    #[cfg(feature = "lab")]
    #[value(skip)]
    Whole,
}

impl CullingMethod {
    /// The name used on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trimaran => "trimaran",
            #[cfg(feature = "lab")]
            Self::Paper => "paper",
            #[cfg(feature = "lab")]
            Self::Chc => "chc++",
            #[cfg(feature = "lab")]
            Self::GigaWalk => "gigawalk",
            Self::Frustum => "frustum",
            #[cfg(feature = "lab")]
            Self::Rays => "rays",
            #[cfg(feature = "lab")]
            Self::Exact => "exact",
            #[cfg(feature = "lab")]
            Self::Whole => "whole",
        }
    }

    /// Whether it always shows the picture of the LOD cut, pixel by pixel.
    #[must_use]
    pub const fn shows_the_cut(self) -> bool {
        match self {
            #[cfg(feature = "lab")]
            Self::Rays | Self::Whole => false,
            _ => true,
        }
    }

    /// Whether it can stop at nodes that show at few pixels, with this occlusion test.
    #[must_use]
    pub fn counts_pixels(self, test: OcclusionTestKind) -> bool {
        match self {
            Self::Trimaran => test != OcclusionTestKind::Hzb,
            #[cfg(feature = "lab")]
            Self::Paper => true,
            _ => false,
        }
    }
}

impl fmt::Display for CullingMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for method in CullingMethod::value_variants() {
            assert_eq!(CullingMethod::from_str(method.name(), false).as_ref(), Ok(method));
        }
    }
}
