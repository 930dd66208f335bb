//! The error of a setting.

use thiserror::Error;

/// A setting outside its range.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// A side of the picture is 0 or above 65,536 pixels.
    #[error("a picture of {width}x{height} pixels has a side outside 1 to 65536")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// The text is not a size.
    #[error("{0:?} is no size of a picture: give WIDTHxHEIGHT, such as 1920x1080")]
    NoSize(String),
    /// No coding has this name.
    #[error("no coding of ids is called {0:?}: take plain or changes")]
    Coding(String),
    /// No occlusion test has this name.
    #[error("no occlusion test is called {0:?}: take query, raster or hzb")]
    OcclusionTest(String),
}
