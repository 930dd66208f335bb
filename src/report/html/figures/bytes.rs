//! What is sent, against the formulas.

use super::{card, over_frames, series};
use crate::report::format::figure;
use crate::report::html::chart::{Chart, Mark, Series};
use crate::report::html::tables;
use crate::report::schema::{
    Bandwidth, BytesByKind, Frame, Report, corrected_formula_bytes, paper_formula_bytes,
};

pub(super) fn html(report: &Report) -> String {
    card(
        &finding(report),
        &chart(report).svg(),
        "The formulas are evaluated at each frame's own number of ids. The paper's 8nh/b + 3(72+h) multiplies id bytes by \
         header bytes; what is sent is 2(4n + hn/b) + 3(72+h).",
    ) + &tables::bandwidth(report)
}

fn chart(report: &Report) -> Chart {
    let frames = &report.frames;
    let mut all = vec![
        area(frames, "ids", "k0", |b| b.ids),
        area(frames, "headers", "k1", |b| b.headers),
        area(frames, "camera", "k2", |b| b.camera),
        area(frames, "EOF", "k3", |b| b.eof),
        area(frames, "begin", "k4", |b| b.begin),
        area(frames, "control", "k5", |b| b.control),
    ];
    if all.iter().all(|s| s.points.is_empty()) {
        all = vec![series(frames, "bytes", "sent", "drawn", Mark::Line)];
    }
    if let Some(bandwidth) = &report.summary.bandwidth {
        all.push(formula(frames, "paper's formula", "paper", bandwidth, paper_formula_bytes));
        all.push(formula(frames, "corrected formula", "exact", bandwidth, corrected_formula_bytes));
    }
    over_frames("bytes a frame", all, &["bytes", "nodes_drawn"])
}

fn area(frames: &[Frame], name: &str, class: &'static str, of: fn(&BytesByKind) -> u64) -> Series {
    let points = frames
        .iter()
        .filter_map(|f| Some((f64::from(f.frame), of(f.bytes_by_kind.as_ref()?) as f64)))
        .collect();
    Series { name: name.to_owned(), class, mark: Mark::Area, points }
}

fn formula(
    frames: &[Frame],
    name: &str,
    class: &'static str,
    at: &Bandwidth,
    bytes: fn(f64, u32, f64) -> f64,
) -> Series {
    let points = frames
        .iter()
        .filter_map(|f| Some((f64::from(f.frame), bytes(f.nodes_drawn? as f64, at.batch, at.header_bytes))))
        .collect();
    Series { name: name.to_owned(), class, mark: Mark::Dashed, points }
}

fn finding(report: &Report) -> String {
    report.summary.bandwidth.map_or_else(
        || "Bytes sent".to_owned(),
        |b| {
            format!(
                "What is sent is {} times the corrected formula, {} times the paper's",
                figure(b.measured_bytes / b.corrected_formula_bytes),
                figure(b.measured_bytes / b.paper_formula_bytes)
            )
        },
    )
}
