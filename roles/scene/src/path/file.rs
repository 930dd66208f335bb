//! Camera paths as JSON files.

use glam::DVec3;
use serde::Deserialize;
use serde_json::{Value, json};
use thiserror::Error;

use super::{Pose, PoseError};

/// A camera path: at least one frame, and a valid field of view.
#[derive(Debug, Clone, PartialEq)]
pub struct PosePath {
    vfov_deg: f64,
    near: Option<f32>,
    size: Option<(u32, u32)>,
    frames: Vec<Pose>,
}

/// Why a path file, or a path, was refused.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PathError {
    /// The text is not JSON, or a value in it has the wrong type; the cause names line and column.
    #[error("the path is not the JSON of a walk")]
    Json(#[from] serde_json::Error),
    /// The path has no frames.
    #[error("the path has no frames; give at least one in `frames`")]
    NoFrames,
    /// The vertical field of view is out of range.
    #[error("`vfov_deg` is {0}; it must lie between 0.00115 and 179.99885 degrees")]
    FieldOfView(f64),
    /// The near distance is out of range.
    #[error("`near` is {0}; it must be a positive finite number of metres")]
    Near(f64),
    /// The picture has no pixels.
    #[error("`width` x `height` is {0} x {1}; neither may be 0")]
    Size(u32, u32),
    /// A frame has no valid pose.
    #[error("frame {frame} of the path is unusable")]
    Frame {
        /// Its index in `frames`, from 0.
        frame: usize,
        /// The error.
        source: PoseError,
    },
}

/// The file's content; other keys are ignored.
#[derive(Deserialize)]
struct RawPath {
    width: Option<u32>,
    height: Option<u32>,
    vfov_deg: f64,
    near: Option<f64>,
    frames: Vec<RawPose>,
}

#[derive(Deserialize)]
struct RawPose {
    eye: Option<[f64; 3]>,
    forward: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
}

impl PosePath {
    /// A path with a vertical field of view of `vfov_deg` degrees.
    ///
    /// # Errors
    /// If there are no frames, or the field of view is out of range.
    pub fn new(vfov_deg: f64, frames: Vec<Pose>) -> Result<Self, PathError> {
        // The range of a camera's field of view: its half-angle's tangent lies in 1e-5 ..= 1e5.
        if !(0.001_15..=179.998_85).contains(&vfov_deg) {
            return Err(PathError::FieldOfView(vfov_deg));
        }
        if frames.is_empty() {
            return Err(PathError::NoFrames);
        }
        Ok(Self { vfov_deg, near: None, size: None, frames })
    }

    /// The same path with its near plane at `near` metres.
    ///
    /// # Errors
    /// If `near` is not a positive finite number.
    pub fn with_near(self, near: f64) -> Result<Self, PathError> {
        let near_f32 = near as f32;
        if !(near_f32.is_finite() && near_f32 > 1e-30) {
            return Err(PathError::Near(near));
        }
        Ok(Self { near: Some(near_f32), ..self })
    }

    /// The same path, meant for pictures of `width` x `height` pixels.
    ///
    /// # Errors
    /// If either is 0.
    pub fn with_size(self, width: u32, height: u32) -> Result<Self, PathError> {
        if width == 0 || height == 0 {
            return Err(PathError::Size(width, height));
        }
        Ok(Self { size: Some((width, height)), ..self })
    }

    /// Reads a path: `{"vfov_deg": .., "frames": [{"eye": [x, y, z], "forward": [..], "up": [..]}, ..]}`, and
    /// optionally `width`, `height` (pixels, only together) and `near` (metres). Other keys are ignored.
    ///
    /// # Errors
    /// The error, with the frame and the vector.
    pub fn from_json(text: &str) -> Result<Self, PathError> {
        let raw: RawPath = serde_json::from_str(text)?;
        let frames = raw
            .frames
            .iter()
            .enumerate()
            .map(|(frame, raw)| Pose::try_from(raw).map_err(|source| PathError::Frame { frame, source }))
            .collect::<Result<_, _>>()?;
        let mut path = Self::new(raw.vfov_deg, frames)?;
        if let Some(near) = raw.near {
            path = path.with_near(near)?;
        }
        if let (Some(width), Some(height)) = (raw.width, raw.height) {
            path = path.with_size(width, height)?;
        }
        Ok(path)
    }

    /// Writes the path for [`Self::from_json`]. Every number survives bit for bit.
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
        let mut path = json!({ "vfov_deg": self.vfov_deg, "frames": frames });
        if let Some(near) = self.near {
            path["near"] = json!(near);
        }
        if let Some((width, height)) = self.size {
            path["width"] = json!(width);
            path["height"] = json!(height);
        }
        // One frame per line, for people who read and compare paths.
        path.to_string().replace("},{", "},\n{")
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
    pub fn frames(&self) -> &[Pose] {
        &self.frames
    }
}

impl TryFrom<&RawPose> for Pose {
    type Error = PoseError;

    fn try_from(raw: &RawPose) -> Result<Self, PoseError> {
        let vector =
            |value: Option<[f64; 3]>, name| value.map(DVec3::from_array).ok_or(PoseError::Missing(name));
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
        let path = PosePath::from_json(ONE).unwrap();
        assert_eq!((path.vfov_deg(), path.near(), path.size()), (60.0, None, None));
        assert_eq!(path.frames()[0].eye(), DVec3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn a_bad_frame_is_named_with_its_field() {
        let bad = |from: &str, to: &str| match PosePath::from_json(&ONE.replace(from, to)).unwrap_err() {
            PathError::Frame { frame: 0, source } => source,
            other => panic!("{other}"),
        };
        assert_eq!(bad("[0,0,-1]", "[0,0,0]"), PoseError::NoDirection("forward"));
        assert_eq!(bad("[0,1,0]", "[0,0,2]"), PoseError::ParallelUp);
        assert_eq!(bad("\"up\"", "\"top\""), PoseError::Missing("up"));
        assert_eq!(bad("[1,2,3]", "null"), PoseError::Missing("eye"));
    }

    #[test]
    fn bad_headers_are_named() {
        let bad = |from: &str, to: &str| PosePath::from_json(&ONE.replace(from, to)).unwrap_err();
        assert!(matches!(bad("60", "180"), PathError::FieldOfView(v) if v == 180.0));
        assert!(matches!(bad("\"far\":9", "\"near\":0"), PathError::Near(v) if v == 0.0));
        assert!(matches!(bad("\"far\":9", "\"width\":0,\"height\":5"), PathError::Size(0, 5)));
        assert!(matches!(bad("[1,2,3]", "[1,2]"), PathError::Json(_)));
        assert!(matches!(bad("[1,2,3]", "[1,2,1e999]"), PathError::Json(_)));
        assert!(matches!(PosePath::from_json(r#"{"vfov_deg":60,"frames":[]}"#), Err(PathError::NoFrames)));
        assert!(matches!(PosePath::from_json(""), Err(PathError::Json(_))));
    }

    #[test]
    fn real_paths_are_read_and_survive_a_round_trip() {
        let Some(folder) = data() else { return };
        for (name, near) in [("huldra_x14_13Mtri", 0.199_282), ("ldraw_town_hall_1.3Mtri", 0.000_581_281)] {
            let path = folder.join("truth").join(format!("{name}.walk.json"));
            let path = PosePath::from_json(&fs::read_to_string(path).unwrap()).unwrap();
            assert_eq!((path.frames().len(), path.vfov_deg()), (60, 60.0));
            assert_eq!((path.size(), path.near()), (Some((1024, 1024)), Some(near)));
            assert_eq!(PosePath::from_json(&path.to_json()).unwrap(), path);
        }
    }

    /// The folder of real data, or nothing if tests may do without it.
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
                eyes.iter().map(|&(eye, forward)| Pose::new(eye, forward, DVec3::Y)).collect();
            prop_assume!(frames.is_ok());
            let mut path = PosePath::new(vfov, frames.unwrap()).unwrap();
            if let Some(near) = near { path = path.with_near(near).unwrap(); }
            if let Some((w, h)) = size { path = path.with_size(w, h).unwrap(); }
            prop_assert_eq!(PosePath::from_json(&path.to_json()).unwrap(), path);
        }
    }
}
