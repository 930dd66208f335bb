//! The page's charts, each under a title that says what it shows.

mod bytes;
mod error;
mod speed;
mod visibility;

use super::chart::{Chart, Mark, Series};
use super::escape;
use crate::report::schema::{Frame, METRICS, Report};

pub(super) fn html(report: &Report) -> String {
    [
        "<h2 id=\"speed\">Speed</h2>".to_owned(),
        speed::html(report),
        "<h2 id=\"visibility\">Drawn against exactly visible</h2>".to_owned(),
        visibility::html(report),
        "<h2 id=\"error\">Error</h2>".to_owned(),
        error::html(report),
        "<h2 id=\"bytes\">Bytes</h2>".to_owned(),
        bytes::html(report),
    ]
    .concat()
}

/// A chart under its finding.
fn card(finding: &str, svg: &str, caption: &str) -> String {
    format!(
        "<figure class=\"card\"><h3>{}</h3>{svg}<figcaption>{}</figcaption></figure>",
        escape(finding),
        escape(caption)
    )
}

/// A figure of the frames as a series; `key` is one of [`METRICS`].
fn series(frames: &[Frame], key: &str, name: &str, class: &'static str, mark: Mark) -> Series {
    let of = METRICS.iter().find(|m| m.key == key).map(|m| m.of);
    let points =
        frames.iter().filter_map(|f| Some((f64::from(f.frame), of?(f).filter(|v| v.is_finite())?))).collect();
    Series { name: name.to_owned(), class, mark, points }
}

/// A chart over the frames; `keys` are shown under the pointer.
fn over_frames(y: &'static str, series: Vec<Series>, keys: &'static [&'static str]) -> Chart {
    Chart { x: "frame", y, series, bound: None, labels: Vec::new(), keys }
}
