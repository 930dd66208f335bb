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
    /// Bytes that the page received in all.
    pub received_bytes: u64,
    /// Bytes of geometry on its graphics device, at most.
    pub geometry_bytes: u64,
}

impl Drive {
    /// A walk along a path, as JSON. Reports of pages go to `reports`.
    #[must_use]
    pub fn new(path: Vec<u8>, reports: mpsc::Sender<DriveReport>) -> Self {
        Self { path: path.into(), reports }
    }
}
