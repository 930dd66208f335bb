//! The top of the page: each figure with its error beside it.

use maud::{Markup, html};

use super::file_name;
use crate::report::format::{figure, grouped, loading, not_culled, plural, with_unit};
use crate::report::html::{badged_tile, tile, verdict};
use crate::report::schema::{Bandwidth, DeviationVerdict, Mode, Report, Stat, Summary};
use crate::report::text::model_hint;

const NOT_MEASURED: &str = "not measured";

pub(super) fn headline(report: &Report) -> Markup {
    let (run, summary) = (&report.run, &report.summary);
    let mode = match run.mode {
        Mode::Lockstep => "lockstep",
        Mode::Live => "live",
    };
    html! {
        header {
            div.kicker { "Trimaran " (run.version) " · walkthrough report" }
            h1 { (file_name(&run.scene.file)) }
            p.setting {
                (grouped(run.scene.objects as f64)) " objects, "
                (grouped(run.scene.triangles as f64)) " triangles · "
                (report.width) " × " (report.height) " pixels · ε " (figure(run.epsilon_px)) " px · occlusion test "
                (run.occlusion_test) " · " (mode) " over " (run.link) " · " (run.started)
            }
            @if let Some(ended) = summary.ended.sentence(summary.frames) {
                (verdict("bad", "!", &format!("This walk {ended}.")))
            }
            @for note in &run.notes { p.note { (note) } }
            (audit_verdict(summary))
            @if let Some(not_culled) = not_culled(summary) { p.note { (not_culled) } }
            @if let Some(found) = &summary.loading {
                p.note { (loading(found, summary.frames).join(" ")) }
            }
            div.tiles {
                (measured(report))
                (modelled(report))
                (objects(summary))
                (triangles(summary))
                (full_detail(summary))
                (sent(summary.bandwidth))
            }
        }
    }
}

/// The audit's finding, in one sentence.
fn audit_verdict(summary: &Summary) -> Markup {
    let audited = plural(u64::from(summary.audited_frames), "audited frame", "audited frames");
    let of_all = format!("{audited} of {}", grouped(f64::from(summary.frames)));
    match (summary.cut_mismatch_pixels_total, summary.false_culled_nodes_total) {
        (None, _) if summary.audits_only_loading() => verdict(
            "unknown",
            "?",
            "No exact frame was audited: this run says nothing about how right culling is.",
        ),
        (None, _) => verdict(
            "unknown",
            "?",
            "No frame was audited: this run says how fast, and nothing about how right.",
        ),
        (Some(0), None | Some(0)) => {
            verdict("good", "✓", &format!("Culling changed no pixel and lost no visible node on {of_all}."))
        }
        (Some(pixels), nodes) => {
            let pixels = plural(pixels, "pixel", "pixels");
            let nodes = nodes.map_or_else(
                || "an uncounted number of nodes".to_owned(),
                |nodes| plural(nodes, "visible node", "visible nodes"),
            );
            verdict("bad", "✗", &format!("Culling changed {pixels} and lost {nodes} on {of_all}."))
        }
    }
}

fn measured(report: &Report) -> Markup {
    let summary = &report.summary;
    let error = summary.cut_mismatch_pixels_total.map_or_else(
        || "error not measured".to_owned(),
        |pixels| format!("{} changed by culling", plural(pixels, "pixel", "pixels")),
    );
    let slowest = summary.metrics.get("frame_ms").map_or_else(
        || "frame times not measured".to_owned(),
        |s| format!("p95 {} ms, worst {} ms", figure(s.p95), figure(s.max)),
    );
    let fps = with_unit(summary.measured_fps, "frames/s", NOT_MEASURED);
    if report.run.alone {
        let turns = "not a walk's speed: the roles took turns".to_owned();
        tile("one role after another", &fps, &[error, slowest, turns])
    } else {
        tile("measured, this machine", &fps, &[error, slowest])
    }
}

fn modelled(report: &Report) -> Markup {
    const NAME: &str = "modelled, a machine a role";
    let Some(model) = &report.summary.model else {
        return tile(NAME, "no figure", &[model_hint(&report.run).to_owned()]);
    };
    badged_tile(
        &html! { (NAME) " " span.badge { "model" } },
        &format!("{} frames/s", figure(model.fps)),
        &[
            format!("at least {}; no network", figure(model.fps_at_least)),
            format!("{} cullers, {}", report.run.cullers, report.run.schedule),
        ],
    )
}

fn objects(summary: &Summary) -> Markup {
    let tightness = &summary.tightness;
    tile(
        "objects drawn / exactly visible",
        &with_unit(tightness.objects, "", NOT_MEASURED),
        &[
            format!("paper: {} (objects, its plant)", figure(tightness.paper_objects)),
            medians(summary, "objects_drawn", "objects_exact"),
            format!("nodes: {}", with_unit(tightness.nodes, "", NOT_MEASURED)),
        ],
    )
}

fn triangles(summary: &Summary) -> Markup {
    let tightness = &summary.tightness;
    tile(
        "triangles drawn / exactly visible",
        &with_unit(tightness.triangles, "", NOT_MEASURED),
        &[
            format!("paper: {} (polygons, its plant)", figure(tightness.paper_triangles)),
            medians(summary, "triangles_drawn", "triangles_exact"),
        ],
    )
}

fn medians(summary: &Summary, drawn: &str, exact: &str) -> String {
    let median = |key| with_unit(summary.metrics.get(key).map(|s| s.median), "", "?");
    format!("median {} drawn, {} visible", median(drawn), median(exact))
}

fn full_detail(summary: &Summary) -> Markup {
    let psnr = summary.psnr_db.map_or_else(
        || NOT_MEASURED.to_owned(),
        |s| s.median.map_or_else(|| "equal".to_owned(), |db| format!("{} dB", figure(db))),
    );
    let flip = summary.metrics.get("flip_mean").map(|s: &Stat| s.median);
    let silhouette = |found: DeviationVerdict| {
        let within = if found.within_epsilon { "within" } else { "beyond" };
        let (most, epsilon) = (figure(found.max_px), figure(found.epsilon_px));
        format!("silhouette off by at most {most} px: {within} ε = {epsilon} px")
    };
    tile(
        "against full detail, median",
        &psnr,
        &[
            format!("mean FLIP {}", with_unit(flip, "", NOT_MEASURED)),
            summary.silhouette.map_or_else(|| "silhouette not measured".to_owned(), silhouette),
        ],
    )
}

fn sent(bandwidth: Option<Bandwidth>) -> Markup {
    const NAME: &str = "sent a frame, mean";
    let Some(bandwidth) = bandwidth else {
        return tile(NAME, NOT_MEASURED, &["formulas need counted messages".to_owned()]);
    };
    tile(
        NAME,
        &format!("{} bytes", figure(bandwidth.measured_bytes)),
        &[
            format!("corrected formula: {}", grouped(bandwidth.corrected_formula_bytes)),
            format!("paper's formula: {}", grouped(bandwidth.paper_formula_bytes)),
        ],
    )
}
