//! How wrong the pictures are, and what speed that buys.

use super::{card, over_frames, series};
use crate::report::format::figure;
use crate::report::html::chart::{Chart, Mark, Series};
use crate::report::schema::{Frame, Report, SweepPoint};

pub(super) fn html(report: &Report) -> String {
    let frames = &report.frames;
    card(
        &culling_finding(report),
        &culling(frames).svg(),
        "Against the unculled picture of the same level cut, on the audited frames.",
    ) + &card(
        &silhouette_finding(report),
        &silhouette(report).svg(),
        "Two-sided Hausdorff distance of the covered pixels against full detail; sampling at pixel centres may add 0.71 px.",
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
    let lines = vec![
        series(&report.frames, "silhouette_max_px", "largest", "drawn", Mark::Line),
        series(&report.frames, "silhouette_p95_px", "95th percentile", "rvg", Mark::Line),
    ];
    let epsilon = report.run.epsilon_px;
    Chart {
        bound: Some((epsilon, format!("claimed: ε = {} px", figure(epsilon)))),
        ..over_frames("px", lines, &["silhouette_max_px", "silhouette_p95_px"])
    }
}

fn silhouette_finding(report: &Report) -> String {
    match report.summary.silhouette {
        Some(s) if s.within_epsilon => {
            format!(
                "The silhouette is off by at most {} px, within the claimed {}",
                figure(s.max_px),
                figure(s.epsilon_px)
            )
        }
        Some(s) if s.within_epsilon_and_sampling => format!(
            "The silhouette is off by at most {} px: the claimed {} and what sampling adds",
            figure(s.max_px),
            figure(s.epsilon_px)
        ),
        Some(s) => {
            format!(
                "The silhouette is off by up to {} px, beyond the claimed {}",
                figure(s.max_px),
                figure(s.epsilon_px)
            )
        }
        None => "Silhouette against full detail".to_owned(),
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
        let of = |name: &str, class, fps: fn(&SweepPoint) -> Option<f64>| Series {
            name: name.to_owned(),
            class,
            mark: Mark::Points,
            points: points.iter().filter_map(|p| Some((fps(p)?, error(p)?))).collect(),
        };
        let measured = of("measured, this machine", "drawn", |p| p.measured_fps);
        let modelled = of("modelled, three machines", "model", |p| p.modelled_fps);
        let labels = points
            .iter()
            .filter_map(|p| Some((p.measured_fps?, error(p)?, format!("ε {}", figure(p.epsilon_px)))))
            .collect();
        let chart =
            Chart { x: "frames/s", y, series: vec![measured, modelled], bound: None, labels, keys: &[] };
        card(finding, &chart.svg(), "Each point is a run; right and down is better.")
    };
    let gain = |of: fn(&SweepPoint) -> Option<f64>| {
        let values = || points.iter().filter_map(of);
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
        if low > 0.0 && high > 0.0 { figure(high / low) } else { "?".to_owned() }
    };
    let title = format!(
        "A coarser ε buys up to {} times the frame rate, and this much visible error",
        gain(|p| p.measured_fps)
    );
    by(|p| p.flip_mean, "mean FLIP against full detail", &title)
        + &by(
            |p| p.silhouette_max_px,
            "largest silhouette deviation (px)",
            "What the same runs do to the silhouette",
        )
}
