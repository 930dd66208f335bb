//! `compare.html`: systems compared with each other.

use maud::{Markup, PreEscaped, html};
use trimaran_cull::Image;

use super::{
    figures::Figure,
    schema::{Comparison, ComparisonTable, DrawnFigures, SystemFigures},
    system::System,
    tables::{Table, ratio, right, walks},
};
use crate::report::{
    format::{figure, grouped, plural},
    html::{card, document, embeddable, table, walk},
    interval::Interval,
};

/// A frame, identical for all systems whose pictures have no wrong pixel.
#[derive(Debug, Clone)]
pub struct ComparedPicture {
    /// The error bound, pixels.
    pub epsilon_px: f64,
    /// The path, counted from 0.
    pub path: u32,
    /// The frame.
    pub frame: u32,
    /// Why it was chosen.
    pub which: &'static str,
    /// Mean FLIP against full detail.
    pub flip_mean: f64,
    /// The picture.
    pub shown: Image,
    /// The same at full detail.
    pub full: Image,
}

/// The page.
pub(super) fn page(
    comparison: &Comparison,
    shown: &[ComparedPicture],
    figures: &[Figure],
    tables: &[Table],
) -> Result<String, serde_json::Error> {
    let data = embeddable(comparison)?;
    let named = |prefix: &'static [&'static str]| {
        figures.iter().filter(move |figure| prefix.iter().any(|prefix| figure.name.starts_with(prefix)))
    };
    let tables_of = |prefix: &'static [&'static str]| {
        tables.iter().filter(move |table| prefix.iter().any(|prefix| table.name.starts_with(prefix)))
    };
    let section = |id: &str, title: &str, hint: &str, charts: &'static [&'static str], rows| {
        let (charts, rows): (Vec<_>, Vec<_>) = (named(charts).collect(), tables_of(rows).collect());
        html! {
            @if !charts.is_empty() || !rows.is_empty() {
                h2 id=(id) { (title) }
                p.hint { (hint) }
                @for rows in rows { (whole(rows)) }
                div.cards { @for figure in charts { (card(&figure.title, &figure.chart, figure.caption)) } }
            }
        }
    };
    let body = html! {
        (header(comparison))
        main {
            (pictures(comparison, shown))
            (section(
                "tables", "Frame rate, and what is drawn",
                "MODEL and MEASURED are never mixed: a machine for each role is a model of the times that roles \
                 took alone; processes of this machine share its cores.",
                &["path-"],
                &["speed-", "drawn-", "paper"],
            ))
            (section(
                "error", "Speed against error",
                "All systems choose levels by one rule, so at one error bound their pictures are the same, and \
                 only the cost differs.",
                &[
                    "ms-flip",
                    "ms-deviation",
                    "ms-popping",
                    "triangles-flip",
                    "triangles-deviation",
                    "triangles-popping",
                ],
                &["curve", "popping"],
            ))
            (section(
                "coherence", "Speed against coherence",
                "The same places, with less and less in common between two frames.",
                &["ms-coherence", "triangles-coherence"],
                &["coherence"],
            ))
            (section(
                "lag", "Speed against the camera's age",
                "Walked by the clock: a picture shows where the camera was, not where it is.",
                &["flip-lag", "ms-lag", "triangles-lag"],
                &["lag"],
            ))
            (systems(comparison))
        }
        script type="application/json" id="report" { (PreEscaped(data)) }
        script { (PreEscaped(include_str!("../report/html/walk/script.js"))) }
    };
    let title = format!("Trimaran: systems compared on {}", walk::file_name(&comparison.scene.file));
    Ok(document(&title, &body).into_string())
}

fn whole(rows: &Table) -> Markup {
    table("all", &rows.caption, &rows.head, &rows.rows)
}

/// The pictures of all systems.
fn pictures(comparison: &Comparison, shown: &[ComparedPicture]) -> Markup {
    let wrong: u64 = systems_of(comparison).map(SystemFigures::wrong_pixels).sum();
    html! {
        @if !shown.is_empty() {
            h2 #pictures { "The same pictures" }
            p.hint {
                "Every system draws the same picture. "
                @if wrong > 0 { "The tables say of each how many pixels are not." }
            }
            @for picture in shown {
                section.comparison {
                    h3 {
                        "Path " (picture.path + 1) ", frame " (picture.frame) ", at " (figure(picture.epsilon_px)) " px: the "
                        (picture.which) " error against full detail"
                    }
                    div.panes {
                        (walk::pane_of("all systems", "without a wrong pixel", &picture.shown))
                        (walk::pane_of("full detail", "finest levels", &picture.full))
                        (walk::flip_pane(
                            &picture.full, &picture.shown,
                            &format!("mean FLIP {}; brighter is more visible", figure(picture.flip_mean)),
                        ))
                    }
                }
            }
        }
    }
}

fn systems_of(comparison: &Comparison) -> impl Iterator<Item = &SystemFigures> {
    comparison.tables.iter().flat_map(|table| &table.systems)
}

fn header(comparison: &Comparison) -> Markup {
    html! {
        header {
            div.kicker { "Trimaran " (comparison.version) ", " (comparison.started) }
            h1 { "Systems compared on " (walk::file_name(&comparison.scene.file)) }
            p.setting {
                (grouped(comparison.scene.triangles as f64)) " triangles in "
                (grouped(comparison.scene.objects as f64)) " objects; " (walks(comparison, comparison.paths)) " of "
                (comparison.frames) " frames of " (comparison.width) " × " (comparison.height) " pixels; "
                (comparison.device) ", " (comparison.cores) " cores for all roles. One scene, one level rule, \
                the same paths, one run: only the culling and the roles that do it differ."
            }
            pre style="white-space: pre-wrap" { (comparison.command_line.join(" ")) }
            @for note in &comparison.notes { p.note { (note) } }
            @for table in &comparison.tables { (verdict(table)) }
        }
    }
}

/// A summary of an error bound's figures.
fn verdict(table: &ComparisonTable) -> Markup {
    let named = |system: System| table.systems.iter().find(|figures| figures.system == system);
    let Some(ours) = named(System::Independent2).or_else(|| table.systems.first()) else {
        return Markup::default();
    };
    let over = |base: Option<&SystemFigures>| {
        let base = base?;
        let ratio = ratio(&ours.alone.model_fps, &base.alone.model_fps);
        Some(format!("{ratio} times {}", base.system))
    };
    let others = [System::DistributedGigaWalk, System::GigaWalk, System::Frustum].map(named);
    let others: Vec<String> = others.into_iter().filter_map(over).collect();
    let wrong: u64 = table
        .systems
        .iter()
        .map(|figures| figures.wrong_pixels().saturating_sub(figures.right_pixels()))
        .sum();
    let audited: u32 = table.systems.iter().map(SystemFigures::audited_frames).sum();
    let over_exact = |of: fn(&DrawnFigures) -> Option<f64>| {
        Some(Interval::of_mean(ours.drawn.iter().filter_map(of))?.value)
    };
    let objects = over_exact(|drawn| drawn.objects_over_exact);
    let triangles = over_exact(|drawn| drawn.triangles_over_exact);
    html! {
        p.verdict.(if wrong == 0 && audited > 0 { "good" } else { "unknown" }) {
            "At " (figure(table.epsilon_px)) " px, modelled: " (ours.system) " shows " (others.join(", ")) " ("
            (bounds(ours)) "). "
            @if let (Some(objects), Some(triangles)) = (objects, triangles) {
                "It draws " (figure(objects)) " objects and " (figure(triangles))
                " triangles for each exactly visible one. "
            }
            @if audited == 0 {
                "No picture was checked."
            } @else {
                (checked(table, audited))
            }
        }
    }
}

/// The systems whose pictures have wrong pixels.
fn checked(table: &ComparisonTable, frames: u32) -> String {
    let wrong = table.systems.iter().filter(|figures| figures.wrong_pixels() > 0);
    let wrong: Vec<_> = wrong
        .map(|figures| {
            let pixels = plural(figures.wrong_pixels(), "wrong pixel", "wrong pixels");
            format!("{} has {pixels}{}", figures.system, right(figures))
        })
        .collect();
    let frames = plural(u64::from(frames), "frame was", "frames were");
    let found = if wrong.is_empty() { "no pixel is wrong".to_owned() } else { wrong.join(", ") };
    format!("{frames} checked against the picture without culling: {found}.")
}

/// The bottleneck of a system.
fn bounds(figures: &SystemFigures) -> String {
    let alone = &figures.alone;
    let mean = |figures: &[f64]| Some(Interval::of_mean(figures.iter().copied())?.value);
    let (Some(or), Some(hc), Some(rvg)) = (mean(&alone.or_ms), mean(&alone.hc_ms), mean(&alone.rvg_ms))
    else {
        return "times not known".to_owned();
    };
    let cullers = f64::from(figures.system.cullers().max(1));
    let culling = (or + hc) / cullers;
    if culling > rvg {
        format!("culling bounds it: {} ms a culler, RVG {}", figure(culling), figure(rvg))
    } else {
        format!("RVG bounds it: {} ms, culling {} a culler", figure(rvg), figure(culling))
    }
}

fn systems(comparison: &Comparison) -> Markup {
    let all = systems_of(comparison).map(|figures| figures.system);
    let mut names: Vec<System> = Vec::new();
    for system in all {
        if !names.contains(&system) {
            names.push(system);
        }
    }
    let row = |system: &System| {
        vec![
            system.to_string(),
            system.about().to_owned(),
            system.cullers().to_string(),
            system.culling().to_string(),
            system.processes().to_string(),
        ]
    };
    let rows: Vec<_> = names.iter().map(row).collect();
    html! {
        h2 #systems { "The systems" }
        (table("text", "What each is", &["system", "", "cullers", "culling", "processes measured"], &rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::{figures::figures, sample, tables::tables};

    fn of(comparison: &Comparison) -> String {
        page(comparison, &[], &figures(comparison), &tables(comparison)).unwrap()
    }

    #[test]
    fn the_page_refers_to_nothing_outside_and_names_stay_in_their_place() {
        let html = of(&sample::comparison());
        for outside in ["http://", "https://", "//cdn", "url(", "@import", "<link", " href=", "src=\"/"] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert!(!html.contains("<b>platform") && !html.contains("<i>interrupted"));
        assert_eq!(html.matches("</script>").count(), 2, "the data's and the script's own");
        assert!(!html.contains("NaN") && !html.contains("inf\""));
    }

    #[test]
    fn what_bounds_a_system_is_said() {
        let html = of(&sample::comparison());
        // (9 + 0.5) / 2 of culling a culler against 12 of drawing.
        assert!(html.contains("RVG bounds it: 12 ms, culling 4.75 a culler"), "{html}");
        assert!(html.contains("1 (1 to 1.02) times distributed-gigawalk"));
    }

    #[test]
    fn pictures_that_nobody_checked_are_not_called_right() {
        let mut comparison = sample::comparison();
        for figures in &mut comparison.tables[0].systems {
            figures.drawn.iter_mut().for_each(|drawn| drawn.audited_frames = 0);
        }
        let html = of(&comparison);
        assert!(html.contains("No picture was checked") && !html.contains("verdict good"));
    }
}
