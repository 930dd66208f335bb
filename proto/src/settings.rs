//! The display's settings for a session.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{BatchSize, IdCoding, LodRule, Viewport};

/// The display's settings for itself and its cullers, sent in the handshake. Each field is valid by its type.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The size of the picture and of the culling depth buffer.
    pub viewport: Viewport,
    /// The LOD selection rule.
    pub lod: LodRule,
    /// The largest number of ids in a batch.
    pub batch: BatchSize,
    /// The coding of ids on links between processes.
    pub coding: IdCoding,
    /// The occlusion test. A LOD rule that stops at few pixels needs a test that counts pixels.
    pub occlusion_test: OcclusionTestKind,
}

impl Settings {
    /// Batches of the default size, ids as changes, and boxes tested against a depth pyramid.
    #[must_use]
    pub fn new(viewport: Viewport, lod: LodRule) -> Self {
        Self {
            viewport,
            lod,
            batch: BatchSize::default(),
            coding: IdCoding::Changes,
            occlusion_test: OcclusionTestKind::Hzb,
        }
    }
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { viewport, lod, batch, coding, occlusion_test } = self;
        write!(
            f,
            "{viewport} at {} px, {} ids a batch, coding {coding}, occlusion test {occlusion_test}",
            lod.epsilon_px(),
            batch.items()
        )?;
        if lod.stops_at_few_pixels() {
            f.write_str(", stopping at few pixels")?;
        }
        Ok(())
    }
}

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

/// The occlusion test for a node's box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum OcclusionTestKind {
    /// Precise occlusion queries: the paper's method.
    Query,
    /// One instanced draw with the early depth test and counters in a storage buffer.
    Raster,
    /// A compute test against a farthest-depth pyramid.
    Hzb,
}

impl OcclusionTestKind {
    /// Every occlusion test.
    pub const ALL: [Self; 3] = [Self::Query, Self::Raster, Self::Hzb];

    /// The name used on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Query => "query",
            Self::Raster => "raster",
            Self::Hzb => "hzb",
        }
    }
}

impl fmt::Display for OcclusionTestKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for OcclusionTestKind {
    type Err = SettingsError;

    fn from_str(name: &str) -> Result<Self, SettingsError> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| SettingsError::OcclusionTest(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_is_1_to_65536_pixels() {
        assert_eq!(Viewport::new(1, 65_536).map(Into::into), Ok((1, 65_536)));
        for (width, height) in [(0, 1), (1, 0), (65_537, 1), (1, 65_537)] {
            assert_eq!(Viewport::new(width, height), Err(SettingsError::Size { width, height }));
        }
    }

    #[test]
    fn a_size_reads_back_from_its_text() {
        let size = Viewport::new(1920, 1080).unwrap();
        assert_eq!(size.to_string().parse(), Ok(size));
        for text in ["", "x", "8", "8x", "x8", "8x8x8", "-1x8", "8 x 8", "8X8"] {
            assert_eq!(text.parse::<Viewport>(), Err(SettingsError::NoSize(text.to_owned())));
        }
        assert_eq!("0x8".parse::<Viewport>(), Err(SettingsError::Size { width: 0, height: 8 }));
    }

    #[test]
    fn bad_settings_do_not_decode() {
        let sizes: Vec<u8> = postcard::to_stdvec(&(0u32, 5u32)).unwrap();
        assert!(postcard::from_bytes::<Viewport>(&sizes).is_err());
        let rule = postcard::to_stdvec(&(f64::NAN, false)).unwrap();
        assert!(postcard::from_bytes::<LodRule>(&rule).is_err());
        let batch = postcard::to_stdvec(&16_385u32).unwrap();
        assert!(postcard::from_bytes::<BatchSize>(&batch).is_err());
    }

    #[test]
    fn names_of_occlusion_tests_read_back() {
        for kind in OcclusionTestKind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert_eq!(
            "Query".parse::<OcclusionTestKind>().map_err(|e| e.to_string()),
            Err("no occlusion test is called \"Query\": take query, raster or hzb".to_owned())
        );
    }
}
