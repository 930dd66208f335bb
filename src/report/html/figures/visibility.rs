//! How much more than the visible is drawn.

use super::{card, over_frames, series};
use crate::report::format::figure;
use crate::report::html::chart::{Chart, Mark};
use crate::report::schema::{Frame, PAPER_OBJECT_TIGHTNESS, PAPER_TRIANGLE_TIGHTNESS, Report};

const CAPTION: &str =
    "Exactly visible: owns a pixel of the item buffer of the same level cut, drawn without culling.";

pub(super) fn html(report: &Report) -> String {
    let (frames, tightness) = (&report.frames, &report.summary.tightness);
    card(&finding("objects", tightness.objects, PAPER_OBJECT_TIGHTNESS), &objects(frames).svg(), CAPTION)
        + &card(
            &finding("triangles", tightness.triangles, PAPER_TRIANGLE_TIGHTNESS),
            &triangles(frames).svg(),
            CAPTION,
        )
}

fn objects(frames: &[Frame]) -> Chart {
    over_frames(
        "objects",
        vec![
            series(frames, "objects_drawn", "drawn", "drawn", Mark::Line),
            series(frames, "objects_exact", "exactly visible, same level cut", "exact", Mark::Line),
        ],
        &["objects_drawn", "objects_exact", "nodes_drawn", "nodes_exact", "occluders_drawn"],
    )
}

fn triangles(frames: &[Frame]) -> Chart {
    over_frames(
        "triangles",
        vec![
            series(frames, "triangles_drawn", "drawn", "drawn", Mark::Line),
            series(frames, "triangles_exact", "exactly visible, same level cut", "exact", Mark::Line),
        ],
        &["triangles_drawn", "triangles_exact", "occluder_triangles"],
    )
}

fn finding(what: &str, ratio: Option<f64>, paper: f64) -> String {
    ratio.map_or_else(
        || format!("How many {what} are drawn; the exactly visible were not counted"),
        |ratio| {
            format!(
                "{} {what} are drawn for each exactly visible one (the paper: {})",
                figure(ratio),
                figure(paper)
            )
        },
    )
}
