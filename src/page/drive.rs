//! A walk that a page repeats by itself, and how that went.

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

/// How a page fared on its walk. Times are seconds where they are not said to be milliseconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct DriveReport {
    /// What draws in the browser.
    pub device: String,
    /// The picture's size in pixels.
    pub width: u32,
    /// Its height.
    pub height: u32,
    /// From the page's start until something is to be seen.
    pub first_picture_s: f64,
    /// Until all is there that is to be seen from the first pose.
    pub exact_picture_s: f64,
    /// How long the walk took.
    pub walk_s: f64,
    /// Pictures that were drawn on it.
    pub pictures: u32,
    /// Milliseconds between two pictures: the median.
    pub picture_ms: f64,
    /// One in twenty is longer.
    pub picture_p95_ms: f64,
    /// How old the poses are for which the sets that are drawn were culled, milliseconds: the median.
    pub set_age_ms: f64,
    /// One in twenty is older.
    pub set_age_p95_ms: f64,
    /// Milliseconds from the last pose until its exact picture: the eye stands still.
    pub rest_ms: f64,
    /// Bytes that the page received until then.
    pub received_bytes: u64,
    /// Bytes of geometry on its graphics device, at most.
    pub geometry_bytes: u64,
    /// The same from time to time on the walk, and at its end.
    pub moments: Vec<Moment>,
    /// How far its pictures were from the exact ones.
    pub wrong: WrongPixels,
}

/// What a page had taken since its start, and held, at a time of its walk.
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
    /// Bytes that its scripts take, if the browser says so. It counts what is not collected yet.
    pub script_bytes: Option<u64>,
}

/// Pixels of a walk that show another object than the exact picture of the same pose does. Such a picture is
/// drawn from the newest pose, out of the set that was culled for an earlier one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct WrongPixels {
    /// The pictures that were audited. None is of a jump: not before a set of behind it is all there.
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
    /// The longest time from a jump until a set of behind it was all there, milliseconds.
    pub jump_ms: f64,
}

impl Drive {
    /// A walk along a path, as JSON. Reports of pages go to `reports`.
    #[must_use]
    pub fn new(path: Vec<u8>, reports: mpsc::Sender<DriveReport>) -> Self {
        Self { path: path.into(), reports }
    }
}
