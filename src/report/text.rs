//! The summary printed at the end of a run.

use super::format::{
    culler_cells, cullers_differ, figure, grouped, loading, not_culled, plural, sent_ahead, sweep_cells,
    with_unit,
};
use super::schema::{METRICS, Report, Run, SweepPoint};

/// The metrics of the printed summary; `report.json` has all.
const PRINTED: [&str; 19] = [
    "or_ms",
    "hc_ms",
    "rvg_ms",
    "occluders_device_ms",
    "pyramid_device_ms",
    "culling_device_ms",
    "picture_device_ms",
    "pair_ms",
    "frame_ms",
    "latency_ms",
    "nodes_drawn",
    "nodes_exact",
    "triangles_drawn",
    "triangles_exact",
    "cut_mismatch_pixels",
    "flip_mean",
    "silhouette_max_px",
    "surface_max_px",
    "bytes",
];

/// The summary of a run: some lines of at most about 100 columns, aligned, ending in a line break.
#[must_use]
pub fn summary(report: &Report) -> String {
    let summary = &report.summary;
    let mut out = format!(
        "{}: {} at {} x {}, epsilon {} px, occlusion test {}, link {}\n\n",
        report.run.scene.file,
        plural(u64::from(summary.frames), "frame", "frames"),
        report.width,
        report.height,
        figure(report.run.epsilon_px),
        report.run.occlusion_test,
        report.run.link
    );
    let rows: Vec<Vec<String>> = PRINTED
        .iter()
        .filter_map(|key| {
            let metric = METRICS.iter().find(|m| m.key == *key)?;
            let stat = summary.metrics.get(*key)?;
            let unit = metric.unit.to_owned();
            Some(vec![
                metric.title.to_owned(),
                figure(stat.median),
                figure(stat.p95),
                figure(stat.max),
                unit,
                stat.frames.to_string(),
            ])
        })
        .collect();
    out += &table(&["", "median", "p95", "max", "unit", "frames"], &rows);
    out.push('\n');

    let none = "not measured";
    let fps = with_unit(summary.measured_fps, "frames/s", none);
    if report.run.alone {
        out += &format!("in turn    {fps} on this machine, one role after another: not a walk's speed\n");
    } else {
        out += &format!("measured   {fps} on this machine\n");
        out += &format!("model      none: {}\n", model_hint(&report.run));
    }
    if let Some(model) = &summary.model {
        out += &format!(
            "MODEL      {} frames/s (at least {}), not measured: a machine for the display and each of {} cullers \
             ({}), no network\n",
            figure(model.fps),
            figure(model.fps_at_least),
            report.run.cullers,
            report.run.schedule,
        );
    }
    out += &format!("culling    {}\n", culling(report));
    if let Some(not_culled) = not_culled(summary) {
        out += &format!("frustum    {not_culled}\n");
    }
    if let Some(found) = &summary.loading {
        out += &format!("loading    {}\n", loading(found, summary.frames).join("\n           "));
    }
    for (what, found) in [("silhouette", summary.silhouette), ("surfaces", summary.surfaces)] {
        if let Some(found) = found {
            out += &format!(
                "detail     {what} off by at most {} px (claimed: {} px){}\n",
                figure(found.max_px),
                figure(found.epsilon_px),
                if found.within_epsilon { "" } else { ": BEYOND THE CLAIM" }
            );
        }
    }
    let tightness = &summary.tightness;
    if tightness.nodes.is_some() || tightness.triangles.is_some() {
        out += &format!(
            "tightness  drawn / exactly visible: {} nodes, {} objects (paper {}), {} triangles (paper {})\n",
            with_unit(tightness.nodes, "", "?"),
            with_unit(tightness.objects, "", "?"),
            figure(tightness.paper_objects),
            with_unit(tightness.triangles, "", "?"),
            figure(tightness.paper_triangles)
        );
    }
    if let Some(b) = &summary.bandwidth {
        out += &format!(
            "bytes      {} a frame; corrected formula {}, paper's formula {}\n",
            grouped(b.measured_bytes),
            grouped(b.corrected_formula_bytes),
            grouped(b.paper_formula_bytes)
        );
    }
    if let Some(memory) = &report.run.memory {
        let megabytes = |bytes: u64| figure(bytes as f64 * 1e-6);
        out += &format!(
            "memory     scene {} MB; on the display's device {} MB of {} MB, {} MB brought, {} dropped\n",
            megabytes(memory.scene_bytes),
            megabytes(memory.device_bytes),
            megabytes(memory.device_taken_bytes),
            megabytes(memory.bytes_brought),
            plural(memory.pieces_dropped, "piece", "pieces"),
        );
    }
    if let Some(ahead) = report.run.ahead.filter(|ahead| ahead.pieces > 0) {
        out += &format!("ahead      {}\n", sent_ahead(&ahead));
    }
    if let Some(ended) = summary.ended.sentence(summary.frames) {
        out += &format!("INCOMPLETE {ended}\n");
    }
    for note in &report.run.notes {
        out += &format!("note       {note}\n");
    }
    out
}

/// Explains why roles that computed at once say nothing of three machines, and the remedy.
pub(super) fn model_hint(run: &Run) -> &'static str {
    if run.link == "inproc" {
        "roles that share a machine slow each other down; for three machines, run with --alone"
    } else {
        "roles may have slowed each other down; for three machines, run with --link inproc --alone"
    }
}

fn culling(report: &Report) -> String {
    let summary = &report.summary;
    let Some(pixels) = summary.cut_mismatch_pixels_total else {
        let none = if summary.audits_only_loading() { "no exact frame was audited" } else { "not audited" };
        return format!("{none}: nothing is known of its error");
    };
    let frames = plural(u64::from(summary.audited_frames), "audited frame", "audited frames");
    let nodes = summary.false_culled_nodes_total.unwrap_or(0);
    let mut text = format!(
        "{} changed, {} lost, on {frames}",
        plural(pixels, "pixel", "pixels"),
        plural(nodes, "visible node", "visible nodes")
    );
    for cull in &summary.false_culls {
        text += &format!(
            "\n           - {}: {}, {}",
            cull.cause.words(),
            plural(cull.nodes, "node", "nodes"),
            plural(cull.pixels, "pixel", "pixels")
        );
    }
    text
}

/// The tables of a sweep: one line per run, ending in a line break.
#[must_use]
pub fn sweep(points: &[SweepPoint]) -> String {
    let modelled = points.iter().any(|point| point.modelled_fps.is_some());
    if cullers_differ(points) {
        return by_cullers(points, modelled);
    }
    let rows: Vec<Vec<String>> = points.iter().map(|point| sweep_cells(point, "-")).collect();
    let head = [
        "epsilon",
        if modelled { "MODEL fps" } else { "fps" },
        "OR ms",
        "HC ms",
        "RVG ms",
        "triangles",
        "changed px",
        "PSNR dB",
        "FLIP",
        "silhouette px",
    ];
    table(&head, &rows) + modelled_how(modelled) + "changed px: by culling, must be 0.\n"
}

fn by_cullers(points: &[SweepPoint], modelled: bool) -> String {
    let head = [
        "cullers",
        "schedule",
        "epsilon",
        if modelled { "MODEL fps" } else { "fps" },
        "latency ms",
        "objects",
        "triangles",
        "bytes",
    ];
    let rows: Vec<Vec<String>> = points.iter().map(|point| culler_cells(point, "-")).collect();
    let what = "objects, triangles: drawn over exactly visible. bytes: a frame.\n";
    table(&head, &rows) + modelled_how(modelled) + what
}

const fn modelled_how(modelled: bool) -> &'static str {
    if modelled { "MODEL: a machine for each role, no network. " } else { "" }
}

pub(crate) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let head: Vec<String> = head.iter().map(|h| (*h).to_owned()).collect();
    let lines = || std::iter::once(&head).chain(rows);
    let width = |column: usize| {
        lines().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: &Vec<String>| {
        let aligned: Vec<String> = cells
            .iter()
            .zip(&widths)
            .enumerate()
            .map(
                |(i, (cell, width))| {
                    if i == 0 { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
                },
            )
            .collect();
        aligned.join("  ").trim_end().to_owned() + "\n"
    };
    lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::sample;
    use crate::report::schema::{Ended, Projection};

    #[test]
    fn columns_are_aligned() {
        let rows = [vec!["a".to_owned(), "10".to_owned()], vec!["long".to_owned(), "7".to_owned()]];
        assert_eq!(table(&["", "n"], &rows), "       n\na     10\nlong   7\n");
    }

    #[test]
    fn a_summary_says_what_is_a_model_and_names_the_false_culls() {
        let text = summary(&sample::report());
        assert!(text.lines().any(|l| l.starts_with("MODEL") && l.contains("not measured")), "{text}");
        assert!(text.contains("ended early, after 60 of 120 frames: it was asked to stop <twice>"), "{text}");
        assert!(text.lines().all(|l| !l.starts_with("measured")), "no walk's speed stands beside it: {text}");
        assert!(text.contains("41 pixels changed, 3 visible nodes lost, on 19 audited frames"), "{text}");
        assert!(text.contains("\nloading    2 of 60 pictures had coarser"), "{text}");
        assert!(text.contains("\n           Not exact yet: 512 pixels of 1 audited picture."), "{text}");
        assert!(text.contains("1 such frame became exact, "), "{text}");
        assert!(text.contains("its box covers none of its pixels: 2 nodes, 11 pixels"), "{text}");
        let passes = text.lines().filter(|l| l.contains(", on the device "));
        let units: Vec<_> = passes.map(|l| l.split_whitespace().rev().nth(1).unwrap_or_default()).collect();
        assert_eq!(units, ["ms"; 4], "{text}");
        assert!(text.lines().all(|l| l.chars().count() <= 130), "{text}");
    }

    #[test]
    fn frames_that_were_not_culled_are_counted() {
        let mut report = sample::report();
        assert!(!summary(&report).contains("\nfrustum"), "all were culled");
        report.summary.not_culled_frames = 7;
        let text = summary(&report);
        assert!(text.contains("\nfrustum    7 of 60 frames drew all in the frustum: "), "{text}");
    }

    #[test]
    fn an_unaudited_run_claims_nothing() {
        let text = summary(&sample::bare());
        assert!(text.contains("not audited: nothing is known of its error"), "{text}");
        assert!(text.contains("measured   not measured"), "{text}");
        assert!(!text.contains("loading") && !text.contains("on the device"), "{text}");
    }

    #[test]
    fn frames_that_were_all_still_loading_claim_nothing_of_culling() {
        let Report { run, width, height, vfov_deg, near, frames, .. } = sample::report();
        let frames = frames.into_iter().filter(|frame| frame.lacking > 0).collect();
        let projection = Projection { width, height, vfov_deg, near };
        let text = summary(&Report::new(run, projection, frames, None, Ended::default()));
        assert!(text.contains("culling    no exact frame was audited: nothing is known"), "{text}");
        assert!(text.contains("None of these frames was exact before the next one"), "{text}");
    }

    #[test]
    fn roles_that_shared_a_machine_are_no_model() {
        for link in ["inproc", "tcp"] {
            let Report { run, width, height, vfov_deg, near, frames, .. } = sample::report();
            let run = Run { alone: false, link: link.to_owned(), ..run };
            let projection = Projection { width, height, vfov_deg, near };
            let text = summary(&Report::new(run, projection, frames, Some(2000.0), Ended::default()));
            assert!(!text.contains("MODEL"), "{text}");
            assert!(text.contains("measured   29.5 frames/s on this machine"), "{text}");
            assert!(text.contains("--alone") && text.lines().all(|l| l.chars().count() <= 130), "{text}");
        }
    }

    #[test]
    fn a_sweep_has_a_line_a_point() {
        let mut points = sample::report().sweep;
        let text = sweep(&points);
        assert_eq!(text.lines().count(), 8, "{text}");
        assert!(text.contains("MODEL fps"), "{text}");
        points.iter_mut().for_each(|point| point.modelled_fps = None);
        assert!(!sweep(&points).contains("MODEL"), "{text}");
    }
}
