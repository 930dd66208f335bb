//! The camera path of a walkthrough: automatic, from a file, or from an earlier report.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use thiserror::Error;
use trimaran_actors::{Cameras, Stopwatch};
use trimaran_proto::{Camera, CameraError, FrameNumber, ViewState, ViewVersion};
use trimaran_scene::{
    ReadError, Scene,
    path::{AutoPathError, AutoPathOptions, PathError, PathKind, Pose, PosePath, auto},
};

use super::{plan::Pace, view_states::ViewStates};

/// The source of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PathChoice {
    /// A seeded walk at eye height.
    Auto {
        /// The same seed makes the same walk.
        seed: u64,
    },
    /// A path file or a report.
    File(PathBuf),
}

impl PathChoice {
    /// `auto`, or a file's name.
    #[must_use]
    pub fn parse(text: &str, seed: u64) -> Self {
        if text == "auto" { Self::Auto { seed } } else { Self::File(text.into()) }
    }
}

/// A camera for each frame of a walkthrough.
#[derive(Debug, Clone)]
pub struct CameraPath {
    cameras: Vec<Camera>,
    views: ViewStates,
    poses: PosePath,
    near: f32,
    /// The kind of an automatic walk; `None` for one from a file.
    pub kind: Option<PathKind>,
}

/// Why there is no path to walk.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CameraPathError {
    /// The file cannot be read.
    #[error("cannot read the path {path}: {cause}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        #[source]
        cause: std::io::Error,
    },
    /// The file is not a valid path.
    #[error("the path {path} cannot be walked", path = path.display())]
    Walk {
        /// The file.
        path: PathBuf,
        /// The cause.
        #[source]
        cause: PathError,
    },
    /// No automatic walk was found.
    #[error("no automatic path was found; give one with --path")]
    Auto(#[from] AutoPathError),
    /// The scene cannot be read during the search for a path.
    #[error("no automatic path was found")]
    Scene(#[from] ReadError),
    /// A pose makes no valid camera.
    #[error("frame {frame} of the path makes no camera")]
    Camera {
        /// Its index in the path.
        frame: usize,
        /// The cause.
        #[source]
        cause: CameraError,
    },
}

impl CameraPath {
    /// How many frames an automatic walk has by default.
    pub const AUTO_FRAMES: u32 = 200;

    /// Finds the path, with the view states `views`. With `frames` it has this many: a path from a file is
    /// cut, or repeated from its start.
    ///
    /// # Errors
    /// The error in the file, or why there is no automatic walk.
    pub fn find(
        choice: &PathChoice,
        scene: &Scene,
        views: ViewStates,
        frames: Option<u32>,
    ) -> Result<Self, CameraPathError> {
        let (poses, kind) = match choice {
            PathChoice::Auto { seed } => {
                let frames = frames.unwrap_or(Self::AUTO_FRAMES);
                let options = AutoPathOptions { seed: *seed, frames, ..AutoPathOptions::default() };
                // Searching for a path reads much more of the scene than walking it.
                let explored = scene.opened_again()?;
                let found = explored.reading(|| auto(&explored, &options))??;
                (found.path, Some(found.kind))
            }
            PathChoice::File(path) => (read(path)?, None),
        };
        Ok(Self { kind, ..Self::of(poses, scene, views, frames)? })
    }

    /// The path through these poses, otherwise as [`find`](Self::find).
    ///
    /// # Errors
    /// If a pose makes no camera.
    pub fn of(
        poses: PosePath,
        scene: &Scene,
        views: ViewStates,
        frames: Option<u32>,
    ) -> Result<Self, CameraPathError> {
        let near = poses.near().unwrap_or_else(|| default_near(scene));
        let camera = |(frame, pose): (usize, &Pose)| {
            pose.camera(poses.vfov_deg(), near, FrameNumber(0))
                .map_err(|cause| CameraPathError::Camera { frame, cause })
        };
        let cameras: Vec<Camera> = poses.frames().iter().enumerate().map(camera).collect::<Result<_, _>>()?;
        let count = frames.map_or(cameras.len(), |frames| frames as usize);
        let seen =
            |(camera, n): (&Camera, u32)| camera.for_frame(FrameNumber(n)).in_view(views.version_at(n));
        let cameras = cameras.iter().cycle().take(count).zip(0..).map(seen).collect();
        Ok(Self { cameras, views, poses, near, kind: None })
    }

    /// How many frames it has; at least one.
    #[must_use]
    pub fn frames(&self) -> u32 {
        u32::try_from(self.cameras.len()).unwrap_or(u32::MAX)
    }

    /// Its poses.
    #[must_use]
    pub const fn poses(&self) -> &PosePath {
        &self.poses
    }

    /// Its view states.
    #[must_use]
    pub const fn views(&self) -> &ViewStates {
        &self.views
    }

    /// The vertical field of view, degrees.
    #[must_use]
    pub fn vfov_deg(&self) -> f64 {
        self.poses.vfov_deg()
    }

    /// The near plane's distance, metres.
    #[must_use]
    pub const fn near(&self) -> f32 {
        self.near
    }

    /// The cameras in order, numbered as the frames of a walk in lockstep.
    pub(super) fn all(&self) -> &[Camera] {
        &self.cameras
    }

    /// The index of the first equal camera of the path, regardless of the frame number.
    #[must_use]
    pub fn index_of(&self, camera: &Camera) -> Option<usize> {
        let same = |other: &Camera| other.for_frame(camera.frame()) == *camera;
        // In lockstep the frame's number is its index.
        let index = camera.frame().0 as usize;
        if self.cameras.get(index).is_some_and(same) {
            Some(index)
        } else {
            self.cameras.iter().position(same)
        }
    }

    /// The pose of a camera of this path, as in the path: eye, forward and up.
    #[must_use]
    pub fn pose_of(&self, camera: &Camera) -> Option<&Pose> {
        let index = self.index_of(camera)?;
        let count = self.poses.frames().len();
        self.poses.frames().get(index % count.max(1))
    }

    /// The cameras of a session that walks it at this pace, after walking this long before.
    #[must_use]
    pub fn cameras(&self, pace: Pace, walked: Duration) -> Box<dyn Cameras> {
        match pace {
            Pace::Lockstep => Box::new(self.clone()),
            Pace::Live { hz } => {
                let clock = Stopwatch::start();
                Box::new(LivePath::new(self.clone(), hz, move || clock.elapsed(), walked))
            }
        }
    }

    /// The camera this many poses into the path, for a frame. Past its end the walk stands still.
    fn camera_at(&self, pose: usize, frame: FrameNumber) -> Camera {
        let last = self.cameras.len().saturating_sub(1);
        self.cameras[pose.min(last)].for_frame(frame)
    }
}

impl Cameras for CameraPath {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.camera_at(frame.0 as usize, frame)
    }

    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        self.views.get(version).cloned()
    }
}

fn read(path: &Path) -> Result<PosePath, CameraPathError> {
    let text = std::fs::read_to_string(path)
        .map_err(|cause| CameraPathError::Read { path: path.to_owned(), cause })?;
    PosePath::from_json(&text).map_err(|cause| CameraPathError::Walk { path: path.to_owned(), cause })
}

/// The default near plane: a ten-thousandth of the scene's diagonal.
fn default_near(scene: &Scene) -> f32 {
    let diagonal = scene.nodes().first().map_or(1.0, |root| {
        let (min, max) = root.world_box();
        (max - min).length()
    });
    ((diagonal * 1e-4) as f32).max(1e-6)
}

/// The poses of a path at a fixed rate. Time starts when the first one is requested.
struct LivePath<C> {
    path: CameraPath,
    hz: f64,
    /// Time since some origin.
    clock: C,
    start: Option<Duration>,
    /// How long it was walked before.
    before: Duration,
}

impl<C: Fn() -> Duration> LivePath<C> {
    const fn new(path: CameraPath, hz: f64, clock: C, before: Duration) -> Self {
        Self { path, hz, clock, start: None, before }
    }

    /// How many poses have been walked past.
    fn walked(&self) -> usize {
        let start = self.start.unwrap_or_default();
        let time = self.before.saturating_add((self.clock)().saturating_sub(start));
        // Rounded down, and saturating for a walk of that many poses.
        (time.as_secs_f64() * self.hz) as usize
    }
}

impl<C: Fn() -> Duration> Cameras for LivePath<C> {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        if self.start.is_none() {
            self.start = Some((self.clock)());
        }
        self.path.camera_at(self.walked(), frame)
    }

    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        self.path.view_state(version)
    }

    fn is_over(&self) -> bool {
        self.start.is_some() && self.walked() >= self.path.frames() as usize
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_proto::{LodRule, Settings, Viewport};

    use super::*;

    fn path() -> CameraPath {
        let file = tempfile::NamedTempFile::new().unwrap();
        let pose = |x: u32| format!(r#"{{"eye":[{x},0,0],"forward":[0,0,-1],"up":[0,1,0]}}"#);
        let frames = (0..3).map(pose).collect::<Vec<_>>().join(",");
        std::fs::write(file.path(), format!(r#"{{"vfov_deg":60,"near":0.1,"frames":[{frames}]}}"#)).unwrap();
        let choice = PathChoice::File(file.path().to_owned());
        let scene = cook(&plant(&PlantOptions::small(1)), &CookOptions::default(), &()).unwrap();
        let settings = Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(1.0).unwrap());
        CameraPath::find(&choice, &scene, settings.into(), None).unwrap()
    }

    #[test]
    fn the_newest_pose_is_handed_out_until_the_walk_is_over() {
        let now = Cell::new(Duration::from_secs(5));
        let mut live = LivePath::new(path(), 2.0, || now.get(), Duration::ZERO);
        assert!(!live.is_over(), "the clock starts with the first camera");
        let mut poses = Vec::new();
        for ms in [5000, 5400, 5500, 6100, 6499, 6500] {
            now.set(Duration::from_millis(ms));
            poses.push((live.camera(FrameNumber(9)).eye()[0], live.is_over()));
        }
        let expected = [(0.0, false), (0.0, false), (1.0, false), (2.0, false), (2.0, false), (2.0, true)];
        assert_eq!(poses, expected);
        assert_eq!(live.camera(FrameNumber(9)).frame(), FrameNumber(9));
    }
    #[test]
    fn a_walk_that_goes_on_begins_where_it_was() {
        let now = Cell::new(Duration::from_secs(5));
        let mut live = LivePath::new(path(), 2.0, || now.get(), Duration::from_millis(700));
        assert_eq!(live.camera(FrameNumber(9)).eye()[0], 1.0);
        now.set(Duration::from_millis(5300));
        assert_eq!((live.camera(FrameNumber(9)).eye()[0], live.is_over()), (2.0, false));
        now.set(Duration::from_millis(5800));
        assert!(live.is_over());
    }
}
