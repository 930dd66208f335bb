//! The page's tables.

use std::collections::BTreeMap;

use super::escape;
use crate::report::format::{figure, grouped, sweep_cells};
use crate::report::schema::{METRICS, Mode, Report, Role, Seat, Stat};

pub(super) fn html(report: &Report) -> String {
    format!(
        "<h2 id=\"tables\">Figures</h2><div class=\"columns\">{}{}{}{}{}</div><h2 id=\"settings\">Settings</h2>\
         <div class=\"columns\">{}{}{}</div>",
        metrics(report),
        false_culls(report),
        doubts(report),
        passes(report),
        sweep(report),
        settings(report),
        scene(report),
        machines(report),
    )
}

/// A table under its caption; nothing if it has no rows. The first column is text, the others are numbers.
fn table(caption: &str, head: &[&str], rows: &[Vec<String>], wide: bool) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let head: String = head.iter().map(|h| format!("<th scope=\"col\">{}</th>", escape(h))).collect();
    let cells =
        |row: &Vec<String>| -> String { row.iter().map(|c| format!("<td>{}</td>", escape(c))).collect() };
    let body: String = rows.iter().map(|row| format!("<tr>{}</tr>", cells(row))).collect();
    let class = if wide { "card scroll all" } else { "card scroll" };
    format!(
        "<div class=\"{class}\"><table><caption>{}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>",
        escape(caption)
    )
}

/// A table of names and values.
fn pairs(caption: &str, rows: Vec<(&str, String)>) -> String {
    let body: String = rows
        .into_iter()
        .map(|(name, value)| {
            format!("<tr><th scope=\"row\">{}</th><td>{}</td></tr>", escape(name), escape(&value))
        })
        .collect();
    format!(
        "<div class=\"card scroll\"><table class=\"pairs\"><caption>{}</caption><tbody>{body}</tbody></table></div>",
        escape(caption)
    )
}

fn metrics(report: &Report) -> String {
    let row = |metric: &crate::report::schema::Metric| {
        let stat = report.summary.metrics.get(metric.key)?;
        let name = if metric.unit.is_empty() {
            metric.title.to_owned()
        } else {
            format!("{} ({})", metric.title, metric.unit)
        };
        Some(vec![
            name,
            figure(stat.median),
            figure(stat.p95),
            figure(stat.max),
            grouped(f64::from(stat.frames)),
        ])
    };
    let mut rows: Vec<_> = METRICS.iter().filter_map(row).collect();
    if let Some(psnr) = report.summary.psnr_db {
        let value = |v: Option<f64>| v.map_or_else(|| "∞".to_owned(), figure);
        let name = "PSNR against full detail (dB): median, p5, lowest".to_owned();
        rows.push(vec![
            name,
            value(psnr.median),
            value(psnr.p5),
            value(psnr.min),
            grouped(f64::from(psnr.frames + psnr.infinite)),
        ]);
    }
    let caption = "Per frame (nearest-rank percentiles over the frames measured)";
    table(caption, &["figure", "median", "p95", "max", "frames"], &rows, true)
}

fn false_culls(report: &Report) -> String {
    let rows: Vec<_> = report
        .summary
        .false_culls
        .iter()
        .map(|c| vec![c.cause.words().to_owned(), grouped(c.nodes as f64), grouped(c.pixels as f64)])
        .collect();
    let rows = match (rows.is_empty(), report.summary.audited_frames) {
        (true, 0) => vec![vec!["not audited".to_owned(), "–".to_owned(), "–".to_owned()]],
        (true, _) => vec![vec!["none".to_owned(), "0".to_owned(), "0".to_owned()]],
        (false, _) => rows,
    };
    table("False culls by cause: the first step that went wrong", &["cause", "nodes", "pixels"], &rows, false)
}

fn doubts(report: &Report) -> String {
    let rows: Vec<_> = report
        .summary
        .doubts
        .iter()
        .map(|(reason, nodes)| vec![reason.replace('_', " "), grouped(*nodes as f64)])
        .collect();
    table(
        "Doubt means visible: nodes drawn because the test could not be decided",
        &["reason", "nodes"],
        &rows,
        false,
    )
}

pub(super) fn bandwidth(report: &Report) -> String {
    let Some(b) = report.summary.bandwidth else { return String::new() };
    let rate = |bytes: f64| {
        report.summary.measured_fps.map_or_else(|| "–".to_owned(), |fps| figure(bytes * 8.0 * fps / 1e6))
    };
    let row = |name: &str, bytes: f64| vec![name.to_owned(), grouped(bytes), rate(bytes)];
    let mut rows = vec![
        row("measured", b.measured_bytes),
        row("corrected formula, 2(4n + hn/b) + 3(72+h)", b.corrected_formula_bytes),
        row("paper's formula, 8nh/b + 3(72+h)", b.paper_formula_bytes),
    ];
    if let Some(kinds) = report.summary.bytes_by_kind {
        let counted = report.frames.iter().filter(|f| f.bytes_by_kind.is_some()).count().max(1) as f64;
        for (name, bytes) in [
            ("– ids", kinds.ids),
            ("– headers", kinds.headers),
            ("– camera", kinds.camera),
            ("– end of frame", kinds.eof),
            ("– begin of frame", kinds.begin),
            ("– control", kinds.control),
        ] {
            rows.insert(rows.len() - 2, row(name, bytes as f64 / counted));
        }
    }
    let caption = format!(
        "Bytes a frame at n = {} ids, b = {}, h = {} header bytes a message (means)",
        figure(b.ids_per_frame),
        b.batch,
        figure(b.header_bytes)
    );
    table(&caption, &["", "bytes a frame", "Mbit/s as measured"], &rows, false)
}

fn passes(report: &Report) -> String {
    let mut times: BTreeMap<(Role, &str), Vec<f64>> = BTreeMap::new();
    for pass in report.frames.iter().flat_map(|f| &f.passes) {
        times.entry((pass.role, &pass.pass)).or_default().push(pass.ms);
    }
    let rows: Vec<_> = times
        .into_iter()
        .filter_map(|((role, pass), ms)| {
            let role = match role {
                Role::Or => "OR",
                Role::Hc => "HC",
                Role::Rvg => "RVG",
            };
            let stat = Stat::of(ms)?;
            Some(vec![format!("{role}: {pass}"), figure(stat.median), figure(stat.p95), figure(stat.max)])
        })
        .collect();
    table("Passes on the device (ms)", &["pass", "median", "p95", "max"], &rows, false)
}

fn sweep(report: &Report) -> String {
    let rows: Vec<_> = report.sweep.iter().map(|point| sweep_cells(point, "–")).collect();
    let modelled = report.sweep.iter().any(|point| point.modelled_fps.is_some());
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
    table(
        "Speed against error (medians; changed pixels are sums, silhouette is the largest)",
        &head,
        &rows,
        true,
    )
}

fn settings(report: &Report) -> String {
    let run = &report.run;
    let mode = match run.mode {
        Mode::Lockstep => "lockstep: every camera of the path is a frame",
        Mode::Live => "live: the newest camera wins",
    };
    let roles = if run.alone { "computed one after another" } else { "computed at once" };
    let optional = |v: Option<String>| v.unwrap_or_else(|| "–".to_owned());
    pairs(
        "Run",
        vec![
            ("command line", run.command_line.join(" ")),
            ("started", run.started.clone()),
            ("version", run.version.clone()),
            ("mode", mode.to_owned()),
            ("roles", roles.to_owned()),
            ("link", run.link.clone()),
            ("transport", run.transport.clone()),
            ("tester", run.tester.clone()),
            ("ids a message, at most", grouped(f64::from(run.batch))),
            ("ε", format!("{} px", figure(run.epsilon_px))),
            ("picture", format!("{} × {} pixels", report.width, report.height)),
            ("vertical field of view", format!("{}°", figure(report.vfov_deg))),
            ("near plane", format!("{} m", figure(report.near))),
            ("path", run.path.clone()),
            ("seed", optional(run.seed.map(|s| s.to_string()))),
            (
                "audited",
                optional(
                    run.audit_every
                        .map(|k| if k == 1 { "every frame".to_owned() } else { format!("every {k} frames") }),
                ),
            ),
            ("schema version", report.schema_version.to_string()),
        ],
    )
}

fn scene(report: &Report) -> String {
    let scene = &report.run.scene;
    let optional = |v: Option<u64>| v.map_or_else(|| "–".to_owned(), |v| grouped(v as f64));
    pairs(
        "Scene",
        vec![
            ("file", scene.file.clone()),
            ("fingerprint", scene.hash.clone()),
            ("file size (bytes)", optional(scene.file_bytes)),
            ("objects", grouped(scene.objects as f64)),
            ("nodes", grouped(scene.nodes as f64)),
            ("nodes × levels", grouped(scene.drawables as f64)),
            ("triangles, instances counted each", grouped(scene.triangles as f64)),
            ("triangles, each mesh once", optional(scene.triangles_unique)),
            ("made from", scene.sources.join(", ")),
        ],
    )
}

fn machines(report: &Report) -> String {
    let rows: Vec<_> = report
        .run
        .roles
        .iter()
        .map(|r| {
            let seat = match r.seat {
                Seat::SwitchA => "switch A (OR, HC)",
                Seat::SwitchB => "switch B (HC, OR)",
                Seat::Display => "display (RVG)",
            };
            vec![seat.to_owned(), r.device.clone(), r.driver.clone()]
        })
        .collect();
    table("Machines", &["role", "device", "driver"], &rows, false)
        .replace("<table>", "<table class=\"text\">")
}
