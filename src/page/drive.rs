//! A walk that a page repeats by itself, and its report.

use hyper::body::Bytes;
use serde::{Deserialize, Serialize};
use tokio::sync::mpsc;

/// The most bytes of a report.
pub(super) const LONGEST_REPORT: usize = 64 << 10;

/// A walk for the page that is opened at `#drive`.
#[derive(Debug, Clone)]
pub struct Drive {
    /// The camera path, as JSON.
    pub(super) path: Bytes,
    pub(super) reports: mpsc::Sender<DriveReport>,
}

/// The report of a page's walk. Times are seconds unless they say milliseconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct DriveReport {
    /// The browser's graphics device.
    pub device: String,
    /// The picture's size in pixels.
    pub width: u32,
    /// Its height.
    pub height: u32,
    /// From the page's start to its first picture.
    pub first_picture_s: f64,
    /// From the page's start to the first exact picture at the first pose.
    pub exact_picture_s: f64,
    /// How long the walk took.
    pub walk_s: f64,
    /// Pictures that were drawn on it.
    pub pictures: u32,
    /// Milliseconds between two pictures: the median.
    pub picture_ms: f64,
    /// One in twenty is longer.
    pub picture_p95_ms: f64,
    /// Age of the poses for which the drawn sets were culled, milliseconds: the median.
    pub set_age_ms: f64,
    /// One in twenty is older.
    pub set_age_p95_ms: f64,
    /// Milliseconds from the last pose to its exact picture, with the eye at rest.
    pub rest_ms: f64,
    /// Tasks of the page above 50 ms during the walk, if the browser tells: the Long Tasks API.
    pub long_tasks: Option<LongTasks>,
    /// Milliseconds from a click to its object, with the eye at rest: the median.
    pub pick_ms: f64,
    /// The longest of them.
    pub longest_pick_ms: f64,
    /// Bytes that the page received until then.
    pub received_bytes: u64,
    /// Bytes of geometry on its graphics device, at most.
    pub geometry_bytes: u64,
    /// The same at several times of the walk, and at its end.
    pub moments: Vec<Moment>,
    /// The differences between its pictures and the exact ones.
    pub wrong: WrongPixels,
}

/// Tasks of more than 50 ms: input waits for their end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct LongTasks {
    /// How many there were.
    pub count: u32,
    /// The longest, milliseconds.
    pub longest_ms: f64,
}

/// The traffic of a page since its start, and its memory, at one time of its walk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct Moment {
    /// Since the walk began.
    pub seconds: f64,
    /// Bytes sent on the lane of cameras.
    pub camera_bytes: u64,
    /// Bytes received on the lane of ids.
    pub id_bytes: u64,
    /// Bytes received on the lane of geometry.
    pub piece_bytes: u64,
    /// Bytes of geometry on its graphics device.
    pub held_bytes: u64,
    /// Bytes that its scripts take, including garbage not collected yet, if the browser tells.
    pub script_bytes: Option<u64>,
}

/// Pixels of a walk that show another object than the exact picture of the same pose. Such a picture is drawn
/// from the newest pose, with the set that was culled for an earlier one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct WrongPixels {
    /// The audited pictures. Pictures between a jump and the first complete set after it are left out.
    pub pictures: u32,
    /// Those without a wrong pixel.
    pub right: u32,
    /// Wrong pixels of a picture, percent of all: the median.
    pub median_percent: f64,
    /// One picture in twenty has more.
    pub p95_percent: f64,
    /// The mean.
    pub mean_percent: f64,
    /// The picture with most.
    pub most_percent: f64,
    /// The longest time in which every picture had more than 0.1 percent, milliseconds.
    pub longest_ms: f64,
    /// The longest time from a jump to the first complete set after it, milliseconds.
    pub jump_ms: f64,
}

impl Drive {
    /// A walk along a path, as JSON. Reports of pages go to `reports`.
    #[must_use]
    pub fn new(path: Vec<u8>, reports: mpsc::Sender<DriveReport>) -> Self {
        Self { path: path.into(), reports }
    }
}
