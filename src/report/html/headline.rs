//! The top of the page: each figure with its error beside it.

use super::{escape, file_name};
use crate::report::format::{figure, grouped, plural, with_unit};
use crate::report::schema::{Mode, Report, Summary};
use crate::report::text::model_hint;

pub(super) fn html(report: &Report) -> String {
    let run = &report.run;
    let mode = match run.mode {
        Mode::Lockstep => "lockstep",
        Mode::Live => "live",
    };
    let ended = report.summary.ended.sentence(report.summary.frames);
    let ended = ended.map_or_else(String::new, |text| {
        format!(
            "<p class=\"verdict bad\"><span aria-hidden=\"true\">!</span> This walk {}.</p>",
            escape(&text)
        )
    });
    let notes: String = run.notes.iter().map(|n| format!("<p class=\"note\">{}</p>", escape(n))).collect();
    format!(
        "<header><div class=\"kicker\">Trimaran {} · walkthrough report</div><h1>{}</h1>\
         <p class=\"setting\">{} objects, {} triangles · {} × {} pixels · ε {} px · tester {} · {} over {} · {}</p>{ended}{notes}{}\
         <div class=\"tiles\">{}</div></header>",
        escape(&run.version),
        escape(file_name(&run.scene.file)),
        grouped(run.scene.objects as f64),
        grouped(run.scene.triangles as f64),
        report.width,
        report.height,
        figure(run.epsilon_px),
        escape(&run.tester),
        mode,
        escape(&run.link),
        escape(&run.started),
        verdict(&report.summary),
        tiles(report).concat(),
    )
}

/// What the audit found, in one sentence.
fn verdict(summary: &Summary) -> String {
    let audited = plural(u64::from(summary.audited_frames), "audited frame", "audited frames");
    let of_all = format!("{audited} of {}", grouped(f64::from(summary.frames)));
    let (class, mark, text) = match (summary.cut_mismatch_pixels_total, summary.false_culled_nodes_total) {
        (None, _) => (
            "unknown",
            "?",
            "No frame was audited: this run says how fast, and nothing about how right.".to_owned(),
        ),
        (Some(0), None | Some(0)) => {
            ("good", "✓", format!("Culling changed no pixel and lost no visible node on {of_all}."))
        }
        (Some(pixels), nodes) => (
            "bad",
            "✗",
            format!(
                "Culling changed {} and lost {} on {of_all}.",
                plural(pixels, "pixel", "pixels"),
                nodes.map_or_else(
                    || "an uncounted number of nodes".to_owned(),
                    |n| plural(n, "visible node", "visible nodes")
                ),
            ),
        ),
    };
    format!("<p class=\"verdict {class}\"><span aria-hidden=\"true\">{mark}</span> {text}</p>")
}

fn tiles(report: &Report) -> [String; 6] {
    let summary = &report.summary;
    let stat = |key: &str| summary.metrics.get(key);
    let none = "not measured";
    let error = match summary.cut_mismatch_pixels_total {
        Some(pixels) => format!("{} changed by culling", plural(pixels, "pixel", "pixels")),
        None => "error not measured".to_owned(),
    };
    let slowest = stat("frame_ms").map_or_else(
        || "frame times not measured".to_owned(),
        |s| format!("p95 {} ms, worst {} ms", figure(s.p95), figure(s.max)),
    );
    let (measured, and_so) = if report.run.alone {
        ("one role after another", "not a walk's speed: the roles took turns")
    } else {
        ("measured, this machine", "")
    };
    let (modelled, by) = match &summary.model {
        Some(model) => (
            format!("{} frames/s", figure(model.fps)),
            [
                format!("at least {}; no network, each frame max(OR + HC, RVG)", figure(model.fps_at_least)),
                format!(
                    "the second culler brings nothing, since OR waits for HC; if it did not: at most {}",
                    figure(model.fps_overlapped)
                ),
            ],
        ),
        None => ("no figure".to_owned(), [model_hint(&report.run).to_owned(), String::new()]),
    };
    let silhouette = summary.silhouette.map_or_else(
        || "silhouette not measured".to_owned(),
        |s| {
            let within = if s.within_epsilon { "within" } else { "beyond" };
            format!(
                "silhouette off by at most {} px: {within} ε = {} px",
                figure(s.max_px),
                figure(s.epsilon_px)
            )
        },
    );
    let psnr = summary.psnr_db.map_or_else(
        || none.to_owned(),
        |s| s.median.map_or_else(|| "equal".to_owned(), |db| format!("{} dB", figure(db))),
    );
    let flip = with_unit(stat("flip_mean").map(|s| s.median), "", none);
    let tightness = &summary.tightness;
    let bandwidth = summary.bandwidth;
    [
        tile(measured, "", &with_unit(summary.measured_fps, "frames/s", none), &[&error, &slowest, and_so]),
        tile(
            "modelled, three machines",
            if summary.model.is_some() { "model" } else { "" },
            &modelled,
            &by.each_ref().map(String::as_str),
        ),
        tile(
            "objects drawn / exactly visible",
            "",
            &with_unit(tightness.objects, "", none),
            &[
                &format!("paper: {} (objects, its plant)", figure(tightness.paper_objects)),
                &counts(stat("objects_drawn").map(|s| s.median), stat("objects_exact").map(|s| s.median)),
                &format!("nodes: {}", with_unit(tightness.nodes, "", none)),
            ],
        ),
        tile(
            "triangles drawn / exactly visible",
            "",
            &with_unit(tightness.triangles, "", none),
            &[
                &format!("paper: {} (polygons, its plant)", figure(tightness.paper_triangles)),
                &counts(stat("triangles_drawn").map(|s| s.median), stat("triangles_exact").map(|s| s.median)),
            ],
        ),
        tile("against full detail, median", "", &psnr, &[&format!("mean FLIP {flip}"), &silhouette]),
        tile(
            "sent a frame, mean",
            "",
            &with_unit(bandwidth.map(|b| b.measured_bytes), "bytes", none),
            &[
                &bandwidth.map_or_else(
                    || "formulas need counted messages".to_owned(),
                    |b| format!("corrected formula: {}", grouped(b.corrected_formula_bytes)),
                ),
                &bandwidth.map_or_else(String::new, |b| {
                    format!("paper's formula: {}", grouped(b.paper_formula_bytes))
                }),
            ],
        ),
    ]
}

fn counts(drawn: Option<f64>, exact: Option<f64>) -> String {
    let words = |value| with_unit(value, "", "?");
    format!("median {} drawn, {} visible", words(drawn), words(exact))
}

fn tile(name: &str, badge: &str, value: &str, beside: &[&str]) -> String {
    let badge =
        if badge.is_empty() { String::new() } else { format!(" <span class=\"badge\">{badge}</span>") };
    let lines: String = beside
        .iter()
        .filter(|l| !l.is_empty())
        .map(|l| format!("<div class=\"beside\">{}</div>", escape(l)))
        .collect();
    format!(
        "<div class=\"tile\"><div class=\"name\">{}{badge}</div><div class=\"value\">{}</div>{lines}</div>",
        escape(name),
        escape(value)
    )
}
