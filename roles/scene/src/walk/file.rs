//! Walks as JSON files.

use glam::DVec3;
use serde::Deserialize;
use serde_json::{Value, json};
use thiserror::Error;

use super::{FrameError, WalkFrame};

/// A camera path: at least one frame, and a field of view that a camera can have.
#[derive(Debug, Clone, PartialEq)]
pub struct Walk {
    vfov_deg: f64,
    near: Option<f32>,
    size: Option<(u32, u32)>,
    frames: Vec<WalkFrame>,
}

/// Why a path file, or a path, was refused.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WalkError {
    /// The text is not JSON, or a value in it has the wrong type; the cause names line and column.
    #[error("the path is not the JSON of a walk")]
    Json(#[from] serde_json::Error),
    /// A path without frames leads nowhere.
    #[error("the path has no frames; give at least one in `frames`")]
    NoFrames,
    /// The vertical field of view is not one of a perspective camera.
    #[error("`vfov_deg` is {0}; it must lie between 0.00115 and 179.99885 degrees")]
    FieldOfView(f64),
    /// The near distance is not one of a camera.
    #[error("`near` is {0}; it must be a positive finite number of metres")]
    Near(f64),
    /// The picture has no pixels.
    #[error("`width` x `height` is {0} x {1}; neither may be 0")]
    Size(u32, u32),
    /// A frame holds no pose.
    #[error("frame {frame} of the path is unusable")]
    Frame {
        /// Its index in `frames`, from 0.
        frame: usize,
        /// What is wrong with it.
        source: FrameError,
    },
}

/// What the file holds; keys that are not listed here are ignored.
#[derive(Deserialize)]
struct RawWalk {
    width: Option<u32>,
    height: Option<u32>,
    vfov_deg: f64,
    near: Option<f64>,
    frames: Vec<RawFrame>,
}

#[derive(Deserialize)]
struct RawFrame {
    eye: Option<[f64; 3]>,
    forward: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
}

impl Walk {
    /// A path with a vertical field of view of `vfov_deg` degrees.
    ///
    /// # Errors
    /// If there are no frames, or the field of view is not one of a perspective camera.
    pub fn new(vfov_deg: f64, frames: Vec<WalkFrame>) -> Result<Self, WalkError> {
        // The range of a camera's field of view: its half-angle's tangent lies in 1e-5 ..= 1e5.
        if !(0.001_15..=179.998_85).contains(&vfov_deg) {
            return Err(WalkError::FieldOfView(vfov_deg));
        }
        if frames.is_empty() {
            return Err(WalkError::NoFrames);
        }
        Ok(Self { vfov_deg, near: None, size: None, frames })
    }

    /// The same path with its near plane at `near` metres.
    ///
    /// # Errors
    /// If `near` is not a positive finite number.
    pub fn with_near(self, near: f64) -> Result<Self, WalkError> {
        let near_f32 = near as f32;
        if !(near_f32.is_finite() && near_f32 > 1e-30) {
            return Err(WalkError::Near(near));
        }
        Ok(Self { near: Some(near_f32), ..self })
    }

    /// The same path, meant for pictures of `width` x `height` pixels.
    ///
    /// # Errors
    /// If either is 0.
    pub fn with_size(self, width: u32, height: u32) -> Result<Self, WalkError> {
        if width == 0 || height == 0 {
            return Err(WalkError::Size(width, height));
        }
        Ok(Self { size: Some((width, height)), ..self })
    }

    /// Reads a path: `{"vfov_deg": .., "frames": [{"eye": [x, y, z], "forward": [..], "up": [..]}, ..]}`,
    /// with `width`, `height` (pixels, only together) and `near` (metres) if it likes. Other keys are
    /// ignored.
    ///
    /// # Errors
    /// Says what is wrong and names the frame and the vector.
    pub fn from_json(text: &str) -> Result<Self, WalkError> {
        let raw: RawWalk = serde_json::from_str(text)?;
        let frames = raw
            .frames
            .iter()
            .enumerate()
            .map(|(frame, raw)| WalkFrame::try_from(raw).map_err(|source| WalkError::Frame { frame, source }))
            .collect::<Result<_, _>>()?;
        let mut walk = Self::new(raw.vfov_deg, frames)?;
        if let Some(near) = raw.near {
            walk = walk.with_near(near)?;
        }
        if let (Some(width), Some(height)) = (raw.width, raw.height) {
            walk = walk.with_size(width, height)?;
        }
        Ok(walk)
    }

    /// Writes the path as [`Self::from_json`] reads it. Every number survives bit for bit.
    #[must_use]
    pub fn to_json(&self) -> String {
        let frames: Vec<Value> = self
            .frames
            .iter()
            .map(|frame| {
                json!({
                    "eye": frame.eye().to_array(),
                    "forward": frame.forward().to_array(),
                    "up": frame.up().to_array(),
                })
            })
            .collect();
        let mut walk = json!({ "vfov_deg": self.vfov_deg, "frames": frames });
        if let Some(near) = self.near {
            walk["near"] = json!(near);
        }
        if let Some((width, height)) = self.size {
            walk["width"] = json!(width);
            walk["height"] = json!(height);
        }
        // One frame a line: a path is read and compared by people too.
        walk.to_string().replace("},{", "},\n{")
    }

    /// The vertical field of view in degrees.
    #[must_use]
    pub const fn vfov_deg(&self) -> f64 {
        self.vfov_deg
    }

    /// The distance of the near plane in metres, if the path names one.
    #[must_use]
    pub const fn near(&self) -> Option<f32> {
        self.near
    }

    /// Width and height of the pictures in pixels, if the path names them.
    #[must_use]
    pub const fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    /// The frames; at least one.
    #[must_use]
    pub fn frames(&self) -> &[WalkFrame] {
        &self.frames
    }
}

impl TryFrom<&RawFrame> for WalkFrame {
    type Error = FrameError;

    fn try_from(raw: &RawFrame) -> Result<Self, FrameError> {
        let vector =
            |value: Option<[f64; 3]>, name| value.map(DVec3::from_array).ok_or(FrameError::Missing(name));
        Self::new(vector(raw.eye, "eye")?, vector(raw.forward, "forward")?, vector(raw.up, "up")?)
    }
}

#[cfg(test)]
mod tests {
    use std::{env, fs, path::PathBuf};

    use proptest::prelude::*;

    use super::*;

    const ONE: &str = r#"{"vfov_deg":60,"frames":[{"eye":[1,2,3],"forward":[0,0,-1],"up":[0,1,0],"visible_objects":7}],"far":9}"#;

    #[test]
    fn unknown_keys_are_ignored() {
        let walk = Walk::from_json(ONE).unwrap();
        assert_eq!((walk.vfov_deg(), walk.near(), walk.size()), (60.0, None, None));
        assert_eq!(walk.frames()[0].eye(), DVec3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn a_bad_frame_is_named_with_its_field() {
        let bad = |from: &str, to: &str| match Walk::from_json(&ONE.replace(from, to)).unwrap_err() {
            WalkError::Frame { frame: 0, source } => source,
            other => panic!("{other}"),
        };
        assert_eq!(bad("[0,0,-1]", "[0,0,0]"), FrameError::NoDirection("forward"));
        assert_eq!(bad("[0,1,0]", "[0,0,2]"), FrameError::ParallelUp);
        assert_eq!(bad("\"up\"", "\"top\""), FrameError::Missing("up"));
        assert_eq!(bad("[1,2,3]", "null"), FrameError::Missing("eye"));
    }

    #[test]
    fn bad_headers_are_named() {
        let bad = |from: &str, to: &str| Walk::from_json(&ONE.replace(from, to)).unwrap_err();
        assert!(matches!(bad("60", "180"), WalkError::FieldOfView(v) if v == 180.0));
        assert!(matches!(bad("\"far\":9", "\"near\":0"), WalkError::Near(v) if v == 0.0));
        assert!(matches!(bad("\"far\":9", "\"width\":0,\"height\":5"), WalkError::Size(0, 5)));
        assert!(matches!(bad("[1,2,3]", "[1,2]"), WalkError::Json(_)));
        assert!(matches!(bad("[1,2,3]", "[1,2,1e999]"), WalkError::Json(_)));
        assert!(matches!(Walk::from_json(r#"{"vfov_deg":60,"frames":[]}"#), Err(WalkError::NoFrames)));
        assert!(matches!(Walk::from_json(""), Err(WalkError::Json(_))));
    }

    #[test]
    fn real_walks_are_read_and_survive_a_round_trip() {
        let Some(folder) = data() else { return };
        for (name, near) in [("huldra_x14_13Mtri", 0.199_282), ("ldraw_town_hall_1.3Mtri", 0.000_581_281)] {
            let path = folder.join("truth").join(format!("{name}.walk.json"));
            let walk = Walk::from_json(&fs::read_to_string(path).unwrap()).unwrap();
            assert_eq!((walk.frames().len(), walk.vfov_deg()), (60, 60.0));
            assert_eq!((walk.size(), walk.near()), (Some((1024, 1024)), Some(near)));
            assert_eq!(Walk::from_json(&walk.to_json()).unwrap(), walk);
        }
    }

    /// The folder of real data, or nothing where tests may do without it.
    fn data() -> Option<PathBuf> {
        let folder = env::var_os("TRIMARAN_DATA").map(PathBuf::from).filter(|f| f.join("truth").is_dir());
        assert!(
            folder.is_some() || env::var_os("TRIMARAN_REQUIRE_DATA").is_none_or(|v| v != "1"),
            "TRIMARAN_REQUIRE_DATA is set, but TRIMARAN_DATA names no folder with `truth` in it"
        );
        if folder.is_none() {
            eprintln!("skipped: TRIMARAN_DATA is not set");
        }
        folder
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(prop_oneof![-1e8f64..1e8, -1.0f64..1.0]).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn json_round_trips_bit_for_bit(
            eyes in prop::collection::vec((vector(), vector()), 1..5),
            vfov in 0.01f64..179.0, near in prop::option::of(1e-6f64..10.0), size in prop::option::of((1u32.., 1u32..))
        ) {
            let frames: Result<Vec<_>, _> =
                eyes.iter().map(|&(eye, forward)| WalkFrame::new(eye, forward, DVec3::Y)).collect();
            prop_assume!(frames.is_ok());
            let mut walk = Walk::new(vfov, frames.unwrap()).unwrap();
            if let Some(near) = near { walk = walk.with_near(near).unwrap(); }
            if let Some((w, h)) = size { walk = walk.with_size(w, h).unwrap(); }
            prop_assert_eq!(Walk::from_json(&walk.to_json()).unwrap(), walk);
        }
    }
}
