//! The methods by name.

use std::{fmt, str::FromStr};

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How a culler finds what is visible. Each draws the same picture; `rays` may differ at edges of triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum CullingMethod {
    /// Occluders chosen within a budget from what was visible last, each box tested as it is seen, and
    /// further rounds where much is new.
    #[default]
    Trimaran,
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
}

/// No method has this name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("no culling method is called {name:?}: take {}", names())]
pub struct UnknownMethod {
    name: String,
}

impl CullingMethod {
    /// Every method of this program.
    #[cfg(feature = "lab")]
    pub const ALL: &[Self] = &[Self::Trimaran, Self::GigaWalk, Self::Frustum, Self::Rays, Self::Exact];
    /// Every method of this program. The others take the feature `lab`.
    #[cfg(not(feature = "lab"))]
    pub const ALL: &[Self] = &[Self::Trimaran, Self::Frustum];

    /// The name used on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trimaran => "trimaran",
            #[cfg(feature = "lab")]
            Self::GigaWalk => "gigawalk",
            Self::Frustum => "frustum",
            #[cfg(feature = "lab")]
            Self::Rays => "rays",
            #[cfg(feature = "lab")]
            Self::Exact => "exact",
        }
    }
}

impl fmt::Display for CullingMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for CullingMethod {
    type Err = UnknownMethod;

    fn from_str(name: &str) -> Result<Self, UnknownMethod> {
        let known = Self::ALL.iter().copied().find(|method| method.name() == name);
        known.ok_or_else(|| UnknownMethod { name: name.to_owned() })
    }
}

fn names() -> String {
    CullingMethod::ALL.iter().map(|method| method.name()).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for &method in CullingMethod::ALL {
            assert_eq!(method.name().parse(), Ok(method));
        }
        let error = "GigaWalk".parse::<CullingMethod>().unwrap_err().to_string();
        assert_eq!(
            error,
            "no culling method is called \"GigaWalk\": take trimaran, gigawalk, frustum, rays, exact"
        );
    }
}
