//! The page's charts, each under a title that states its content.

use maud::{Markup, html};

use super::tables;
use crate::report::format::{figure, plural};
use crate::report::html::chart::{Chart, Mark, Series, Timeline};
use crate::report::html::{card, wide_card};
use crate::report::schema::{
    DeviationVerdict, Frame, METRICS, PAPER_OBJECT_TIGHTNESS, PAPER_TRIANGLE_TIGHTNESS, Report, SentBytes,
    SweepPoint,
};

pub(super) fn figures(report: &Report) -> Markup {
    html! {
        h2 #speed { "Speed" }
        div.cards { (role_times(report)) (device_times(report)) (latency(report)) (timeline(&report.frames)) }
        h2 #visibility { "Drawn against exactly visible" }
        div.cards { (objects(report)) (triangles(report)) }
        h2 #error { "Error" }
        div.cards {
            (culling(report))
            (silhouette(report))
            (surfaces(report))
            (flip(report))
            (sweep(&report.sweep))
        }
        h2 #bytes { "Bytes" }
        div.cards { (bytes(report)) (tables::bandwidth(report)) }
    }
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
    Chart { x: "frame", y, series, keys, ..Chart::default() }
}

fn role_times(report: &Report) -> Markup {
    let frames = &report.frames;
    let chart = over_frames(
        "ms a frame",
        vec![
            series(frames, "or_ms", "OR", "or", Mark::Line),
            series(frames, "hc_ms", "HC", "hc", Mark::Line),
            series(frames, "rvg_ms", "RVG", "rvg", Mark::Line),
            series(frames, "frame_ms", "frame time as measured here", "exact", Mark::Dashed),
        ],
        &["or_ms", "hc_ms", "rvg_ms", "frame_ms"],
    );
    let caption = if report.run.alone {
        "Busy time, of roles that computed one after another: it holds no other role's work."
    } else {
        "Busy time: waiting for another role is not counted. Where roles share a machine, it holds what \
         others took of its cores."
    };
    card(&slowest_role(frames), &chart, caption)
}

/// Empty if no frame has any.
fn device_times(report: &Report) -> Markup {
    const KEYS: &[&str] =
        &["occluders_device_ms", "pyramid_device_ms", "culling_device_ms", "picture_device_ms"];
    let names = [("occluders", "or"), ("depth pyramid", "k1"), ("culling", "hc"), ("picture", "rvg")];
    let lines = KEYS.iter().zip(names);
    let lines = lines.map(|(key, (name, class))| series(&report.frames, key, name, class, Mark::Line));
    let lines: Vec<_> = lines.filter(|series| !series.points.is_empty()).collect();
    if lines.is_empty() {
        return Markup::default();
    }
    let median = |key: &&str| report.summary.metrics.get(*key).map(|stat| stat.median);
    let sum = figure(KEYS.iter().filter_map(median).sum());
    card(
        &format!("The passes of a frame take {sum} ms on devices (sum of medians)"),
        &over_frames("ms a frame", lines, KEYS),
        "Between timestamps on the device. What a role's busy time has beyond that is the host's.",
    )
}

fn slowest_role(frames: &[Frame]) -> String {
    let mut slowest = [("OR", 0_u32), ("HC", 0), ("RVG", 0)];
    for frame in frames {
        if let (Some(or), Some(hc), Some(rvg)) = (frame.or_ms, frame.hc_ms, frame.rvg_ms) {
            let role = if or >= hc && or >= rvg { 0 } else { 1 + usize::from(rvg > hc) };
            slowest[role].1 += 1;
        }
    }
    let total: u32 = slowest.iter().map(|s| s.1).sum();
    match slowest.iter().max_by_key(|s| s.1) {
        Some((role, count)) if total > 0 => {
            let share = 100.0 * f64::from(*count) / f64::from(total);
            format!("{role} is the slowest role on {share:.0} % of the frames")
        }
        _ => "The roles' busy times".to_owned(),
    }
}

fn latency(report: &Report) -> Markup {
    let metrics = &report.summary.metrics;
    let finding = match (metrics.get("latency_ms"), metrics.get("latency_frames")) {
        (Some(ms), Some(frames)) => {
            let frames = plural(frames.median as u64, "frame", "frames");
            format!("A camera is seen after {} ms and {frames} (medians)", figure(ms.median))
        }
        (Some(ms), None) => format!("A camera is seen after {} ms (median)", figure(ms.median)),
        _ => "Camera to picture".to_owned(),
    };
    let line = series(&report.frames, "latency_ms", "camera to picture", "drawn", Mark::Line);
    let chart = over_frames("ms", vec![line], &["latency_ms", "latency_frames"]);
    card(&finding, &chart, "From a camera's publication to its own picture.")
}

fn timeline(frames: &[Frame]) -> Markup {
    let Some(timeline) = Timeline::around_slowest(frames) else { return Markup::default() };
    let (first, last) = timeline.range();
    let (busy, machines) = (figure(timeline.busy()), timeline.machines());
    let finding = format!("{busy} of {machines} machines are busy on average around the slowest frame");
    let caption = format!("Frames {first} to {last}. The role that drew a frame's occluders culls it.");
    wide_card(&finding, &timeline, &caption)
}

fn objects(report: &Report) -> Markup {
    let finding = drawn_for_visible("objects", report.summary.tightness.objects, PAPER_OBJECT_TIGHTNESS);
    let keys = &["objects_drawn", "objects_exact", "nodes_drawn", "nodes_exact", "occluders_drawn"];
    drawn_and_visible(report, &finding, "objects", keys)
}

fn triangles(report: &Report) -> Markup {
    let finding =
        drawn_for_visible("triangles", report.summary.tightness.triangles, PAPER_TRIANGLE_TIGHTNESS);
    let keys = &["triangles_drawn", "triangles_exact", "occluder_triangles"];
    drawn_and_visible(report, &finding, "triangles", keys)
}

fn drawn_for_visible(what: &str, ratio: Option<f64>, paper: f64) -> String {
    ratio.map_or_else(
        || format!("How many {what} are drawn; the exactly visible were not counted"),
        |ratio| {
            let (ratio, paper) = (figure(ratio), figure(paper));
            format!("{ratio} {what} are drawn for each exactly visible one (the paper: {paper})")
        },
    )
}

/// The drawn and the visible nodes, by the first two of `keys`.
fn drawn_and_visible(
    report: &Report,
    finding: &str,
    what: &'static str,
    keys: &'static [&'static str],
) -> Markup {
    let names = [("drawn", "drawn"), ("exactly visible, same LOD cut", "exact")];
    let lines = keys
        .iter()
        .zip(names)
        .map(|(key, (name, class))| series(&report.frames, key, name, class, Mark::Line));
    card(
        finding,
        &over_frames(what, lines.collect(), keys),
        "Exactly visible: owns a pixel of the item buffer of the same LOD cut, drawn without culling.",
    )
}

fn culling(report: &Report) -> Markup {
    let (frames, summary) = (&report.frames, &report.summary);
    let finding = summary.cut_mismatch_pixels_total.map_or_else(
        || "Culling error".to_owned(),
        |pixels| {
            let pixels =
                if pixels == 0 { "no pixel".to_owned() } else { format!("{} pixels", figure(pixels as f64)) };
            format!("Culling changed {pixels} on {} audited frames", summary.audited_frames)
        },
    );
    let chart = over_frames(
        "pixels",
        vec![
            series(frames, "cut_mismatch_pixels", "unlike the unculled cut", "drawn", Mark::Line),
            series(frames, "false_culled_pixels", "of falsely culled nodes", "or", Mark::Points),
        ],
        &["cut_mismatch_pixels", "false_culled_pixels", "false_culled_nodes"],
    );
    card(&finding, &chart, "Against the unculled picture of the same LOD cut, on the audited frames.")
}

fn silhouette(report: &Report) -> Markup {
    card(
        &off_by("The silhouette is", report.summary.silhouette),
        &against_epsilon(report, &["silhouette_max_px", "silhouette_p95_px"]),
        "From pixels that only one picture covers, shown or full detail, to the nearest surface of the other.",
    )
}

fn surfaces(report: &Report) -> Markup {
    card(
        &off_by("Surfaces are", report.summary.surfaces),
        &against_epsilon(report, &["surface_max_px", "surface_p95_px"]),
        "From every covered pixel, shown or full detail, to the same thing's surface in the other picture.",
    )
}

fn off_by(what: &str, verdict: Option<DeviationVerdict>) -> String {
    let Some(found) = verdict else { return format!("{what} against full detail") };
    let within = if found.within_epsilon { "within" } else { "beyond" };
    let (most, epsilon) = (figure(found.max_px), figure(found.epsilon_px));
    format!("{what} off by at most {most} px, {within} the claimed {epsilon}")
}

/// The largest deviation and its 95th percentile over the frames, with the claimed bound.
fn against_epsilon(report: &Report, keys: &'static [&'static str; 2]) -> Chart {
    let [largest, p95] = keys;
    let lines = vec![
        series(&report.frames, largest, "largest", "drawn", Mark::Line),
        series(&report.frames, p95, "95th percentile", "rvg", Mark::Line),
    ];
    let epsilon = report.run.epsilon_px;
    let bound = Some((epsilon, format!("claimed: ε = {} px", figure(epsilon))));
    Chart { bound, ..over_frames("px", lines, keys) }
}

fn flip(report: &Report) -> Markup {
    let finding = report.summary.metrics.get("flip_mean").map_or_else(
        || "How visible the levels of detail are".to_owned(),
        |flip| format!("The levels of detail are visible by a mean FLIP of {} (median)", figure(flip.median)),
    );
    let chart = over_frames(
        "FLIP",
        vec![
            series(&report.frames, "flip_mean", "mean", "drawn", Mark::Line),
            series(&report.frames, "flip_p99", "99th percentile", "rvg", Mark::Line),
        ],
        &["flip_mean", "flip_p99", "mismatching_pixels"],
    );
    card(&finding, &chart, "FLIP against full detail: 0 looks equal, 1 is as different as can be.")
}

fn sweep(points: &[SweepPoint]) -> Markup {
    let speeds = || points.iter().filter_map(SweepPoint::fps);
    let (low, high) = (speeds().fold(f64::INFINITY, f64::min), speeds().fold(0.0, f64::max));
    let gain = if low > 0.0 && high > 0.0 { figure(high / low) } else { "?".to_owned() };
    let finding = format!("A coarser ε buys up to {gain} times the frame rate, and this much visible error");
    html! {
        @if points.is_empty() {
            (card(
                "Error against speed",
                &html! { p.none { "One run is one point. " code { "trimaran sweep" } " draws the curve." } },
                "",
            ))
        } @else {
            (over_speed(points, &finding))
        }
    }
}

/// The error of a sweep's runs over their speed.
fn over_speed(points: &[SweepPoint], finding: &str) -> Markup {
    let modelled = points.iter().any(|point| point.modelled_fps.is_some());
    let (name, class) =
        if modelled { ("modelled, three machines", "model") } else { ("measured, this machine", "drawn") };
    let labels: Vec<(f64, f64, String)> = points
        .iter()
        .filter_map(|p| Some((p.fps()?, p.flip_mean?, format!("ε {}", figure(p.epsilon_px)))))
        .collect();
    let points = labels.iter().map(|(speed, error, _)| (*speed, *error)).collect();
    let series = vec![Series { name: name.to_owned(), class, mark: Mark::Points, points }];
    let chart =
        Chart { x: "frames/s", y: "mean FLIP against full detail", series, labels, ..Chart::default() };
    card(finding, &chart, "Each point is a run; right and down is better.")
}

fn bytes(report: &Report) -> Markup {
    let frames = &report.frames;
    let mut all = vec![
        area(frames, "ids", "k0", |b| b.ids),
        area(frames, "headers", "k1", |b| b.headers),
        area(frames, "camera", "k2", |b| b.camera),
        area(frames, "EOF", "k3", |b| b.end),
        area(frames, "begin", "k4", |b| b.begin),
        area(frames, "control", "k5", |b| b.control),
        area(frames, "geometry", "k6", |b| b.geometry),
    ];
    if all.iter().all(|s| s.points.is_empty()) {
        all = vec![series(frames, "bytes", "sent", "drawn", Mark::Line)];
    }
    let mut finding = "Bytes sent".to_owned();
    if let Some(bandwidth) = &report.summary.bandwidth {
        let corrected = figure(bandwidth.measured_bytes / bandwidth.corrected_formula_bytes);
        let paper = figure(bandwidth.measured_bytes / bandwidth.paper_formula_bytes);
        finding =
            format!("What is sent is {corrected} times the corrected formula, {paper} times the paper's");
    }
    card(
        &finding,
        &over_frames("bytes a frame", all, &["bytes", "nodes_drawn"]),
        "The paper's 8nh/b + 3(72+h) multiplies id bytes by header bytes; what is sent is \
         2(4n + hn/b) + 3(72+h).",
    )
}

fn area(frames: &[Frame], name: &str, class: &'static str, of: fn(&SentBytes) -> u64) -> Series {
    let points = frames
        .iter()
        .filter_map(|f| Some((f64::from(f.frame), of(f.bytes_by_kind.as_ref()?) as f64)))
        .collect();
    Series { name: name.to_owned(), class, mark: Mark::Area, points }
}
