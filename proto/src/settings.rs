//! What the display decides for the whole session.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{BatchSize, FrameNumber, IdCoding};

/// What the display decides for all three roles. It travels in the handshake; each field is valid by its
/// type.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The size of the picture and of the culling depth buffer.
    pub size: PictureSize,
    /// The level-of-detail error allowed on the screen.
    pub epsilon: EpsilonPx,
    /// How many ids a batch holds at most.
    pub batch: BatchSize,
    /// How ids travel where links are not within one process.
    pub coding: IdCoding,
    /// How the switch tests boxes for visibility.
    pub tester: TesterKind,
    /// Whether every camera is exactly one frame (deterministic), rather than the latest camera whenever a
    /// frame starts.
    pub lockstep: bool,
    /// Whether culling stops at nodes that show at fewer pixels than the error bound (paper, section 4.5.2).
    /// What is drawn then depends on what is visible, so pictures may differ from those without culling.
    /// Needs a tester that counts pixels.
    pub few_pixels: bool,
    /// The frame that comes first: above 0 where a session goes on after a peer was lost.
    pub first: FrameNumber,
    /// With which frame the session ends: it has this many, counted from 0. `None` until someone leaves.
    pub frames: Option<u32>,
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size, epsilon, batch, coding, tester, lockstep, few_pixels, first, frames } = self;
        let pace = if *lockstep { "lockstep" } else { "live" };
        write!(
            f,
            "{size} at {epsilon} px, {} ids a batch, coding {coding}, tester {tester}, {pace}",
            batch.items()
        )?;
        if *few_pixels {
            f.write_str(", stopping at few pixels")?;
        }
        if first.0 > 0 {
            write!(f, ", from {first} on")?;
        }
        match frames {
            Some(frames) => write!(f, ", {frames} frames"),
            None => f.write_str(", no frame limit"),
        }
    }
}

/// A picture's size in pixels, each side 1 to 65,536.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "(u32, u32)", into = "(u32, u32)")]
pub struct PictureSize {
    width: u32,
    height: u32,
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
    /// The error bound is negative, infinite or NaN.
    #[error("an error bound of {0} pixels is not a finite number of at least 0")]
    Epsilon(f64),
    /// No coding has this name.
    #[error("no coding of ids is called {0:?}: take plain or changes")]
    Coding(String),
    /// No tester has this name.
    #[error("no tester is called {0:?}: take query, raster or hzb")]
    Tester(String),
}

impl PictureSize {
    /// A picture of `width` by `height` pixels.
    ///
    /// # Errors
    /// When a side is 0 or above 65,536.
    pub const fn new(width: u32, height: u32) -> Result<Self, SettingsError> {
        if width == 0 || height == 0 || width > 65_536 || height > 65_536 {
            return Err(SettingsError::Size { width, height });
        }
        Ok(Self { width, height })
    }

    /// Pixels, 1 to 65,536.
    #[must_use]
    pub const fn width(self) -> u32 {
        self.width
    }

    /// Pixels, 1 to 65,536.
    #[must_use]
    pub const fn height(self) -> u32 {
        self.height
    }
}

impl TryFrom<(u32, u32)> for PictureSize {
    type Error = SettingsError;

    fn try_from((width, height): (u32, u32)) -> Result<Self, SettingsError> {
        Self::new(width, height)
    }
}

impl From<PictureSize> for (u32, u32) {
    fn from(size: PictureSize) -> Self {
        (size.width, size.height)
    }
}

impl fmt::Display for PictureSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// How far on the screen a level of detail may lie from the finest geometry, in pixels: finite and not
/// negative.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct EpsilonPx(f64);

impl EpsilonPx {
    /// An error bound of `pixels`.
    ///
    /// # Errors
    /// When it is negative, infinite or NaN.
    pub fn new(pixels: f64) -> Result<Self, SettingsError> {
        if pixels.is_finite() && pixels >= 0.0 {
            Ok(Self(pixels))
        } else {
            Err(SettingsError::Epsilon(pixels))
        }
    }

    /// Pixels.
    #[must_use]
    pub const fn pixels(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for EpsilonPx {
    type Error = SettingsError;

    fn try_from(pixels: f64) -> Result<Self, SettingsError> {
        Self::new(pixels)
    }
}

impl From<EpsilonPx> for f64 {
    fn from(epsilon: EpsilonPx) -> Self {
        epsilon.0
    }
}

impl fmt::Display for EpsilonPx {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// How the switch tests whether a node's box is visible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum TesterKind {
    /// Precise occlusion queries: the paper's method.
    Query,
    /// One instanced draw with the early depth test and counters in storage.
    Raster,
    /// A compute test against a farthest-depth pyramid.
    Hzb,
}

impl TesterKind {
    /// Every tester.
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

impl fmt::Display for TesterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for TesterKind {
    type Err = SettingsError;

    fn from_str(name: &str) -> Result<Self, SettingsError> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| SettingsError::Tester(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_is_1_to_65536_pixels() {
        assert_eq!(PictureSize::new(1, 65_536).map(Into::into), Ok((1, 65_536)));
        for (width, height) in [(0, 1), (1, 0), (65_537, 1), (1, 65_537)] {
            assert_eq!(PictureSize::new(width, height), Err(SettingsError::Size { width, height }));
        }
    }

    #[test]
    fn an_error_bound_is_finite_and_not_negative() {
        assert_eq!(EpsilonPx::new(0.0).map(EpsilonPx::pixels), Ok(0.0));
        for bad in [-1.0, f64::INFINITY, f64::NAN] {
            assert!(matches!(EpsilonPx::new(bad), Err(SettingsError::Epsilon(_))));
        }
    }

    #[test]
    fn bad_settings_do_not_decode() {
        let sizes: Vec<u8> = postcard::to_stdvec(&(0u32, 5u32)).unwrap();
        assert!(postcard::from_bytes::<PictureSize>(&sizes).is_err());
        let epsilon = postcard::to_stdvec(&f64::NAN).unwrap();
        assert!(postcard::from_bytes::<EpsilonPx>(&epsilon).is_err());
        let batch = postcard::to_stdvec(&16_385u32).unwrap();
        assert!(postcard::from_bytes::<BatchSize>(&batch).is_err());
    }

    #[test]
    fn tester_names_read_back() {
        for kind in TesterKind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert_eq!(
            "Query".parse::<TesterKind>().map_err(|e| e.to_string()),
            Err("no tester is called \"Query\": take query, raster or hzb".to_owned())
        );
    }
}
