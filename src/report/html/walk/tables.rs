//! The page's tables.

use maud::{Markup, html};

use crate::report::format::{culler_cells, cullers_differ, figure, grouped, sent_ahead, sweep_cells};
use crate::report::html::table;
use crate::report::schema::{
    METRICS, Machine, MemoryUse, Metric, Mode, Report, RoleInfo, Run, SceneInfo, SweepPoint, ViewStateInfo,
};

pub(super) fn tables(report: &Report) -> Markup {
    html! {
        h2 #tables { "Figures" }
        div.columns {
            (metrics(report))
            (false_culls(report))
            (conservatively_visible(report))
            (sweep(&report.sweep))
        }
        h2 #settings { "Settings" }
        div.columns {
            (run(report)) (scene(&report.run.scene)) (machines(&report.run)) (view_states(&report.run))
            @if let Some(held) = &report.run.memory { (memory(held)) }
            @if let Some(ahead) = report.run.ahead.filter(|ahead| ahead.pieces > 0) {
                p.note { "Sent ahead: " (sent_ahead(&ahead)) "." }
            }
        }
    }
}

fn metrics(report: &Report) -> Markup {
    let row = |metric: &Metric| {
        let stat = report.summary.metrics.get(metric.key)?;
        let unit = if metric.unit.is_empty() { String::new() } else { format!(" ({})", metric.unit) };
        let values = [figure(stat.median), figure(stat.p95), figure(stat.max), count(stat.frames)];
        Some(named(format!("{}{unit}", metric.title), values))
    };
    let mut rows: Vec<_> = METRICS.iter().filter_map(row).collect();
    if let Some(psnr) = report.summary.psnr_db {
        let value = |v: Option<f64>| v.map_or_else(|| "∞".to_owned(), figure);
        let frames = count(psnr.frames + psnr.infinite);
        rows.push(named(
            "PSNR against full detail (dB): median, p5, lowest",
            [value(psnr.median), value(psnr.p5), value(psnr.min), frames],
        ));
    }
    let caption = "Per frame (nearest-rank percentiles over the frames measured)";
    table("all", caption, &["figure", "median", "p95", "max", "frames"], &rows)
}

/// A row of a table.
fn named(name: impl Into<String>, values: impl IntoIterator<Item = String>) -> Vec<String> {
    std::iter::once(name.into()).chain(values).collect()
}

fn count(frames: u32) -> String {
    grouped(f64::from(frames))
}

fn false_culls(report: &Report) -> Markup {
    let summary = &report.summary;
    let mut rows: Vec<_> = summary
        .false_culls
        .iter()
        .map(|c| named(c.cause.words(), [grouped(c.nodes as f64), grouped(c.pixels as f64)]))
        .collect();
    if rows.is_empty() {
        let total = |of: Option<u64>| of.map_or_else(|| "–".to_owned(), |count| grouped(count as f64));
        let found = match summary.false_culled_nodes_total {
            _ if summary.audited_frames == 0 => "not audited",
            None | Some(0) => "none",
            Some(_) => "no cause was looked for",
        };
        let counts = [summary.false_culled_nodes_total, summary.false_culled_pixels_total];
        rows.push(named(found, counts.map(total)));
    }
    table(
        "numbers",
        "False culls by cause: the first step that went wrong",
        &["cause", "nodes", "pixels"],
        &rows,
    )
}

fn conservatively_visible(report: &Report) -> Markup {
    let conservatively_visible = report.summary.conservatively_visible.iter();
    let rows: Vec<_> = conservatively_visible
        .map(|(reason, nodes)| named(reason.replace('_', " "), [grouped(*nodes as f64)]))
        .collect();
    let caption = "Doubt means visible: nodes drawn because the test could not be decided";
    table("numbers", caption, &["reason", "nodes"], &rows)
}

pub(super) fn bandwidth(report: &Report) -> Markup {
    let Some(b) = report.summary.bandwidth else { return Markup::default() };
    let rate = |bytes: f64| {
        report.summary.measured_fps.map_or_else(|| "–".to_owned(), |fps| figure(bytes * 8.0 * fps / 1e6))
    };
    let row = |name: &str, bytes: f64| named(name, [grouped(bytes), rate(bytes)]);
    let mut rows = vec![row("measured", b.measured_bytes)];
    if let Some(kinds) = report.summary.bytes_by_kind {
        let counted = report.frames.iter().filter(|f| f.bytes_by_kind.is_some()).count().max(1) as f64;
        let kinds = [
            ("– ids", kinds.ids),
            ("– headers", kinds.headers),
            ("– camera", kinds.camera),
            ("– end of frame", kinds.end),
            ("– begin of frame", kinds.begin),
            ("– control", kinds.control),
            ("– geometry", kinds.geometry),
        ];
        rows.extend(kinds.map(|(name, bytes)| row(name, bytes as f64 / counted)));
    }
    rows.push(row("corrected formula, r(4n + hn/b) + (r+1)(72+h)", b.corrected_formula_bytes));
    rows.push(row("paper's formula, 8nh/b + 3(72+h)", b.paper_formula_bytes));
    let caption = format!(
        "Bytes a frame at n = {} ids, b = {}, r = {} receivers, h = {} header bytes a message (means)",
        figure(b.ids_per_frame),
        b.batch,
        b.receivers,
        figure(b.header_bytes)
    );
    table("numbers", &caption, &["", "bytes a frame", "Mbit/s as measured"], &rows)
}

fn sweep(points: &[SweepPoint]) -> Markup {
    if cullers_differ(points) {
        return by_cullers(points);
    }
    let rows: Vec<_> = points.iter().map(|point| sweep_cells(point, "–")).collect();
    let modelled = points.iter().any(|point| point.modelled_fps.is_some());
    let head = [
        "ε (px)",
        if modelled { "frames/s, modelled" } else { "frames/s" },
        "OR ms",
        "HC ms",
        "RVG ms",
        "triangles",
        "changed px",
        "PSNR dB",
        "FLIP",
        "silhouette px",
    ];
    let caption = "Speed against error (medians; changed pixels are sums, silhouette is the largest)";
    table("all", caption, &head, &rows)
}

fn by_cullers(points: &[SweepPoint]) -> Markup {
    let rows: Vec<_> = points.iter().map(|point| culler_cells(point, "–")).collect();
    let modelled = points.iter().any(|point| point.modelled_fps.is_some());
    let head = [
        "cullers",
        "schedule",
        "ε (px)",
        if modelled { "frames/s, modelled" } else { "frames/s" },
        if modelled { "latency ms, modelled" } else { "latency ms" },
        "objects",
        "triangles",
        "bytes a frame",
    ];
    let caption = "Speed by cullers (medians; objects and triangles drawn over exactly visible)";
    table("all", caption, &head, &rows)
}

/// A table of names and values.
fn pairs<const N: usize>(caption: &str, rows: [(&str, String); N]) -> Markup {
    table("pairs", caption, &[], &rows.map(|(name, value)| named(name, [value])))
}

fn run(report: &Report) -> Markup {
    let run = &report.run;
    let mode = match run.mode {
        Mode::Lockstep => "lockstep: every camera of the path is a frame",
        Mode::Live => "live: the newest camera wins",
    };
    let roles = if run.alone { "computed one after another" } else { "computed at once" };
    let audited = run.audit_every.map(|k| match k {
        1 => "every frame".to_owned(),
        k => format!("every {k} frames"),
    });
    let or_dash = |v: Option<String>| v.unwrap_or_else(|| "–".to_owned());
    pairs(
        "Run",
        [
            ("command line", run.command_line.join(" ")),
            ("started", run.started.clone()),
            ("version", run.version.clone()),
            ("mode", mode.to_owned()),
            ("roles", roles.to_owned()),
            ("link", run.link.clone()),
            ("transport", run.transport.clone()),
            ("cullers", run.cullers.to_string()),
            ("schedule", run.schedule.clone()),
            ("occlusion test", run.occlusion_test.clone()),
            ("ids a message, at most", count(run.batch)),
            ("ε", format!("{} px", figure(run.epsilon_px))),
            ("picture", format!("{} × {} pixels", report.width, report.height)),
            ("vertical field of view", format!("{}°", figure(report.vfov_deg))),
            ("near plane", format!("{} m", figure(report.near))),
            ("path", run.path.clone()),
            ("seed", or_dash(run.seed.map(|seed| seed.to_string()))),
            ("audited", or_dash(audited)),
            ("schema version", report.schema_version.to_string()),
        ],
    )
}

fn view_states(run: &Run) -> Markup {
    let row = |state: &ViewStateInfo| {
        let counted = |set: Option<u64>| set.map_or_else(|| "–".to_owned(), |count| grouped(count as f64));
        vec![
            grouped(f64::from(state.from_frame)),
            format!("{} × {}", state.width, state.height),
            format!("{} px", figure(state.epsilon_px)),
            state.occlusion_test.clone(),
            grouped(state.sections as f64),
            grouped(state.hidden as f64),
            counted(state.isolated),
            counted(state.see_through),
        ]
    };
    let rows: Vec<_> = run.view_states.iter().map(row).collect();
    if rows.is_empty() {
        return Markup::default();
    }
    let caption = "View states: what was seen, from a frame of the path on (objects counted)";
    let head = ["frame", "picture", "ε", "test", "sections", "hidden", "isolated", "see-through"];
    table("view-states", caption, &head, &rows)
}

fn scene(scene: &SceneInfo) -> Markup {
    let or_dash = |v: Option<u64>| v.map_or_else(|| "–".to_owned(), |v| grouped(v as f64));
    pairs(
        "Scene",
        [
            ("file", scene.file.clone()),
            ("fingerprint", scene.hash.clone()),
            ("file size (bytes)", or_dash(scene.file_bytes)),
            ("objects", grouped(scene.objects as f64)),
            ("nodes", grouped(scene.nodes as f64)),
            ("nodes × levels", grouped(scene.drawables as f64)),
            ("triangles, instances counted each", grouped(scene.triangles as f64)),
            ("made from", scene.sources.join(", ")),
        ],
    )
}

fn memory(memory: &MemoryUse) -> Markup {
    let row = |name, value: u64| (name, grouped(value as f64));
    pairs(
        "Memory of the display's process when the walk ended",
        [
            row("the scene's records (bytes)", memory.scene_bytes),
            row("taken on the device for triangles (bytes)", memory.device_taken_bytes),
            row("triangles on the device (bytes)", memory.device_bytes),
            row("pieces of geometry brought to the device", memory.pieces_brought),
            row("their size (bytes)", memory.bytes_brought),
            row("pieces dropped to make room", memory.pieces_dropped),
        ],
    )
}

fn machines(run: &Run) -> Markup {
    let row = |role: &RoleInfo| {
        let does = match role.machine {
            Machine::Culler(_) => "OR, HC",
            Machine::Display => "RVG",
        };
        named(format!("{} ({does})", role.machine), [role.device.clone(), role.driver.clone()])
    };
    let rows: Vec<_> = run.roles.iter().map(row).collect();
    table("text", "Machines", &["role", "device", "driver"], &rows)
}
