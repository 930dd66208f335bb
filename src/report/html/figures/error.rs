//! How wrong the pictures are, and what speed that buys.

use super::{card, over_frames, series};
use crate::report::format::figure;
use crate::report::html::chart::{Chart, Mark, Series};
use crate::report::schema::{DeviationVerdict, Frame, Report, SweepPoint};

pub(super) fn html(report: &Report) -> String {
    let frames = &report.frames;
    card(
        &culling_finding(report),
        &culling(frames).svg(),
        "Against the unculled picture of the same level cut, on the audited frames.",
    ) + &card(
        &deviation_finding("The silhouette is", report.summary.silhouette),
        &silhouette(report).svg(),
        "From pixels that only one picture covers, shown or full detail, to the nearest surface of the other.",
    ) + &card(
        &deviation_finding("Surfaces are", report.summary.surfaces),
        &surfaces(report).svg(),
        "From every covered pixel, shown or full detail, to the same thing's surface in the other picture.",
    ) + &card(
        &flip_finding(report),
        &flip(frames).svg(),
        "FLIP against full detail: 0 looks equal, 1 is as different as can be.",
    ) + &sweep(&report.sweep)
}

fn culling(frames: &[Frame]) -> Chart {
    over_frames(
        "pixels",
        vec![
            series(frames, "cut_mismatch_pixels", "unlike the unculled cut", "drawn", Mark::Line),
            series(frames, "false_culled_pixels", "of falsely culled nodes", "or", Mark::Points),
        ],
        &["cut_mismatch_pixels", "false_culled_pixels", "false_culled_nodes"],
    )
}

fn culling_finding(report: &Report) -> String {
    let summary = &report.summary;
    match summary.cut_mismatch_pixels_total {
        Some(0) => format!("Culling changed no pixel on {} audited frames", summary.audited_frames),
        Some(pixels) => format!(
            "Culling changed {} pixels on {} audited frames",
            figure(pixels as f64),
            summary.audited_frames
        ),
        None => "Culling error".to_owned(),
    }
}

fn silhouette(report: &Report) -> Chart {
    against_epsilon(report, &["silhouette_max_px", "silhouette_p95_px"])
}

fn surfaces(report: &Report) -> Chart {
    against_epsilon(report, &["surface_max_px", "surface_p95_px"])
}

/// The largest deviation and its 95th percentile over the frames, with the claimed bound.
fn against_epsilon(report: &Report, keys: &'static [&'static str; 2]) -> Chart {
    let [largest, p95] = keys;
    let lines = vec![
        series(&report.frames, largest, "largest", "drawn", Mark::Line),
        series(&report.frames, p95, "95th percentile", "rvg", Mark::Line),
    ];
    let epsilon = report.run.epsilon_px;
    Chart {
        bound: Some((epsilon, format!("claimed: ε = {} px", figure(epsilon)))),
        ..over_frames("px", lines, keys)
    }
}

fn deviation_finding(what: &str, verdict: Option<DeviationVerdict>) -> String {
    match verdict {
        Some(found) => format!(
            "{what} off by at most {} px, {} the claimed {}",
            figure(found.max_px),
            if found.within_epsilon { "within" } else { "beyond" },
            figure(found.epsilon_px)
        ),
        None => format!("{what} against full detail"),
    }
}

fn flip_finding(report: &Report) -> String {
    report.summary.metrics.get("flip_mean").map_or_else(
        || "How visible the levels of detail are".to_owned(),
        |flip| format!("The levels of detail are visible by a mean FLIP of {} (median)", figure(flip.median)),
    )
}

fn flip(frames: &[Frame]) -> Chart {
    over_frames(
        "FLIP",
        vec![
            series(frames, "flip_mean", "mean", "drawn", Mark::Line),
            series(frames, "flip_p99", "99th percentile", "rvg", Mark::Line),
        ],
        &["flip_mean", "flip_p99", "mismatching_pixels"],
    )
}

fn sweep(points: &[SweepPoint]) -> String {
    if points.is_empty() {
        return card(
            "Error against speed",
            "<p class=\"none\">One run is one point. <code>trimaran sweep</code> draws the curve.</p>",
            "",
        );
    }
    let by = |error: fn(&SweepPoint) -> Option<f64>, y: &'static str, finding: &str| {
        let modelled = points.iter().any(|point| point.modelled_fps.is_some());
        let (name, class) = if modelled {
            ("modelled, three machines".to_owned(), "model")
        } else {
            ("measured, this machine".to_owned(), "drawn")
        };
        let places = points.iter().filter_map(|p| Some((p.fps()?, error(p)?))).collect();
        let speeds = Series { name, class, mark: Mark::Points, points: places };
        let labels = points
            .iter()
            .filter_map(|p| Some((p.fps()?, error(p)?, format!("ε {}", figure(p.epsilon_px)))))
            .collect();
        let chart = Chart { x: "frames/s", y, series: vec![speeds], bound: None, labels, keys: &[] };
        card(finding, &chart.svg(), "Each point is a run; right and down is better.")
    };
    let gain = |of: fn(&SweepPoint) -> Option<f64>| {
        let values = || points.iter().filter_map(of);
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
        if low > 0.0 && high > 0.0 { figure(high / low) } else { "?".to_owned() }
    };
    let title = format!(
        "A coarser ε buys up to {} times the frame rate, and this much visible error",
        gain(SweepPoint::fps)
    );
    by(|p| p.flip_mean, "mean FLIP against full detail", &title)
        + &by(
            |p| p.silhouette_max_px,
            "largest silhouette deviation (px)",
            "What the same runs do to the silhouette",
        )
}
