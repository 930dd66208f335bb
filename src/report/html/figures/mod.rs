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
        section("speed", "Speed", &speed::html(report)),
        section("visibility", "Drawn against exactly visible", &visibility::html(report)),
        section("error", "Error", &error::html(report)),
        section("bytes", "Bytes", &bytes::html(report)),
    ]
    .concat()
}

fn section(id: &str, title: &str, cards: &str) -> String {
    format!("<h2 id=\"{id}\">{title}</h2><div class=\"cards\">{cards}</div>")
}

/// A chart under its finding.
pub(super) fn card(finding: &str, svg: &str, caption: &str) -> String {
    figure("card", finding, svg, caption)
}

/// A chart that takes the page's whole width.
fn wide_card(finding: &str, svg: &str, caption: &str) -> String {
    figure("card all", finding, svg, caption)
}

fn figure(class: &str, finding: &str, svg: &str, caption: &str) -> String {
    format!(
        "<figure class=\"{class}\"><h3>{}</h3>{svg}<figcaption>{}</figcaption></figure>",
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
