//! The page of many walks. It works offline, and refers to nothing but the walks' own pages.

use std::path::Path;

use maud::{Markup, PreEscaped, html};
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_encode};

use super::{ComparedSystem, KindFigures, ManyWalks, OverWalks, WalkRow};
use crate::report::format::{figure, grouped, plural, with_unit};
use crate::report::html::{
    card,
    chart::{Chart, Mark, Series},
    document, table, tile, verdict,
};

/// The characters of a name that a link does not spell out.
const ENCODED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'_').remove(b'.').remove(b'~');
/// The columns of words, which are not numbers.
const WORDS: [&str; 5] = ["scene", "device", "settings", "system", "how it ended"];
/// A figure that was not measured.
const NONE: &str = "–";

impl ManyWalks {
    /// The page, as the file `page`: its links to the walks' pages begin at the folder of that.
    #[must_use]
    pub fn page(&self, page: &Path) -> String {
        let folder = page.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let body = html! {
            (self.headline())
            main {
                (self.kinds())
                @if !self.walks.is_empty() {
                    h2 #walks { "Each walk" }
                    div.cards { (self.rates()) }
                    (self.rows(folder))
                }
                (self.compared(folder))
                (self.folders())
            }
            script { (PreEscaped(include_str!("script.js"))) }
        };
        document(&format!("Trimaran: {}", self.title()), &body).into_string()
    }

    fn title(&self) -> String {
        plural(self.all.walks, "walk", "walks")
    }

    fn headline(&self) -> Markup {
        let all = &self.all;
        let of_all = |figures: Option<OverWalks>, unit: &str| {
            with_unit(figures.map(|figures| figures.median), unit, "not measured")
        };
        let kinds = plural(self.kinds.len() as u64, "kind", "kinds");
        let interval = |figures: Option<OverWalks>| match figures {
            Some(OverWalks { walks, low, high, .. }) => {
                let walks = plural(walks, "finished walk", "finished walks");
                vec![
                    format!("median of {walks} of {kinds}"),
                    format!("95 % interval: {} to {}", figure(low), figure(high)),
                ]
            }
            None => vec!["no finished walk has it".to_owned()],
        };
        html! {
            header {
                div.kicker { "Trimaran " (self.version) " · many walks" }
                h1 { (self.title()) }
                p.setting {
                    (plural(all.frames, "frame", "frames")) " · " (kinds) " of scene, device and settings"
                }
                @match self.gaps() {
                    Some(gaps) => { (verdict("bad", "!", &format!("{gaps}."))) }
                    None => { (verdict("good", "✓", "Each walk came to its end.")) }
                }
                (self.culling())
                div.tiles {
                    (tile("frames a second", &of_all(all.fps, "frames/s"), &interval(all.fps)))
                    (tile(
                        "camera to picture, median of a walk",
                        &of_all(all.latency_median_ms, "ms"),
                        &interval(all.latency_median_ms),
                    ))
                    (tile(
                        "camera to picture, 95th percentile of a walk",
                        &of_all(all.latency_p95_ms, "ms"),
                        &interval(all.latency_p95_ms),
                    ))
                }
            }
        }
    }

    /// The audits' finding.
    fn culling(&self) -> Markup {
        let all = &self.all;
        let audited = plural(all.audited_frames, "audited frame", "audited frames");
        let of_all = format!("{audited} of {}", grouped(all.frames as f64));
        match (all.wrong_pixels, all.lost_nodes.unwrap_or(0)) {
            (None, _) => {
                verdict("unknown", "?", "No frame was audited: nothing is known of the walks' error.")
            }
            (Some(0), 0) => verdict(
                "good",
                "✓",
                &format!("Culling changed no pixel and lost no visible node on {of_all}."),
            ),
            (Some(pixels), nodes) => {
                let [pixels, nodes] =
                    [plural(pixels, "pixel", "pixels"), plural(nodes, "visible node", "visible nodes")];
                verdict("bad", "✗", &format!("Culling changed {pixels} and lost {nodes} on {of_all}."))
            }
        }
    }

    fn kinds(&self) -> Markup {
        let rows: Vec<_> = self.kinds.iter().map(|kind| kind.cells(NONE)).collect();
        html! {
            @if !rows.is_empty() {
                h2 #kinds { "By scene, device and settings" }
                p.hint {
                    "Medians over the finished walks of a kind, of one figure a walk, with their 95 % intervals. \
                     Walks of different kinds do not compare."
                }
                (table("all", "Walks by kind", &KindFigures::HEAD, &rows))
            }
        }
    }

    /// The walks' frame rates, in the order of the rows.
    fn rates(&self) -> Markup {
        let rates = (1_u32..).zip(&self.walks);
        let points = rates.filter_map(|(number, walk)| Some((f64::from(number), walk.fps?))).collect();
        let series =
            Series { name: "frames a second".to_owned(), class: "drawn", mark: Mark::Points, points };
        let bound = self.all.fps.map(|of| (of.median, format!("median: {}", figure(of.median))));
        let chart = Chart { x: "walk", y: "frames/s", series: vec![series], bound, ..Chart::default() };
        card("Frames a second of each walk", &chart, "In the order of the table below.")
    }

    fn rows(&self, from: &Path) -> Markup {
        html! {
            div.card.scroll.walks {
                table.sortable {
                    thead { tr {
                        @for title in [
                            "folder", "scene", "device", "settings", "frames", "frames/s", "latency ms",
                            "latency p95 ms", "wrong pixels", "audited frames", "how it ended",
                        ] { (column(title)) }
                    } }
                    tbody { @for walk in &self.walks { (walk.row(from)) } }
                }
            }
        }
    }

    fn compared(&self, from: &Path) -> Markup {
        html! {
            @if !self.comparisons.is_empty() {
                h2 #comparisons { "Comparisons" }
                p.hint {
                    "Means over the paths of a comparison, with their 95 % intervals. MODEL: a machine for each \
                     role, no network. Measured: processes of one machine."
                }
                div.card.scroll.walks {
                    table.sortable {
                        thead { tr {
                            (column("folder"))
                            @for title in ComparedSystem::HEAD { (column(title)) }
                        } }
                        tbody { @for system in &self.comparisons { (system.row(from)) } }
                    }
                }
            }
        }
    }

    fn folders(&self) -> Markup {
        let rows: Vec<_> =
            self.without_report.iter().map(|of| vec![of.folder.clone(), of.why.clone()]).collect();
        html! {
            @if !rows.is_empty() {
                h2 #missing { "Without a report" }
                (table("text", "Folders without a report", &["folder", "why"], &rows))
            }
        }
    }
}

impl WalkRow {
    fn row(&self, from: &Path) -> Markup {
        let number = |value: Option<f64>| {
            html! {
                td data-value=(value.map_or_else(String::new, |value| value.to_string())) {
                    (with_unit(value, "", NONE))
                }
            }
        };
        let count = |value: Option<u64>| {
            html! {
                td data-value=(value.map_or_else(String::new, |value| value.to_string())) {
                    (value.map_or_else(|| NONE.to_owned(), |value| grouped(value as f64)))
                }
            }
        };
        html! {
            tr {
                (linked(&self.folder, from, &self.path_of_folder.join("report.html")))
                td.words { (self.kind.scene) }
                td.words { (self.kind.device) }
                td.words { (self.kind.words()) }
                (count(Some(self.frames.into())))
                (number(self.fps))
                (number(self.latency_median_ms))
                (number(self.latency_p95_ms))
                (count(self.wrong_pixels))
                (count(Some(self.audited_frames.into())))
                td.words.early[!self.is_whole()] { (self.ending()) }
            }
        }
    }
}

impl ComparedSystem {
    fn row(&self, from: &Path) -> Markup {
        // As numbers the script sorts them.
        let mean = [self.model_fps, self.measured_fps]
            .map(|of| of.map_or_else(String::new, |of| of.mean.to_string()));
        let [model, measured] = mean;
        let wrong = self.wrong_pixels.map_or_else(String::new, |pixels| pixels.to_string());
        let [_, _, epsilon, _, model_text, measured_text, wrong_text] =
            self.cells(NONE).try_into().unwrap_or_default();
        html! {
            tr {
                (linked(&self.folder, from, &self.path_of_folder.join("compare.html")))
                td.words { (self.scene) }
                td.words { (self.device) }
                td data-value=(self.epsilon_px) { (epsilon) }
                td.words.early[self.ended_early] {
                    (self.system) @if self.ended_early { "; the comparison ended early" }
                }
                td data-value=(model) { (model_text) }
                td data-value=(measured) { (measured_text) }
                td data-value=(wrong) { (wrong_text) }
            }
        }
    }
}

/// The title of a column.
fn column(title: &str) -> Markup {
    html! { th.words[WORDS.contains(&title)] scope="col" { (title) } }
}

/// The name of a folder, which leads to its page if that is there.
fn linked(name: &str, from: &Path, page: &Path) -> Markup {
    html! {
        th scope="row" {
            @match link(from, page) {
                Some(page) => { a href=(page) { (name) } }
                None => { (name) }
            }
        }
    }
}

/// A link to a file from a page in the folder `from`; `None` if one of them is not there.
fn link(from: &Path, to: &Path) -> Option<String> {
    let (from, to) = (from.canonicalize().ok()?, to.canonicalize().ok()?);
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(shared).map(|_| "..".to_owned());
    let down = to.components().skip(shared);
    let down = down.map(|part| percent_encode(part.as_os_str().as_encoded_bytes(), ENCODED).to_string());
    Some(up.chain(down).collect::<Vec<_>>().join("/"))
}
