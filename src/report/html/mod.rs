//! Pages, such as `report.html` of a walk. Each works offline: it embeds its data, pictures, style and
//! script, and refers to nothing outside.
//!
//! `maud` writes them, and escapes every text and attribute. Only the style, the script and the script's JSON
//! are inserted verbatim (`PreEscaped`).

pub(crate) mod chart;
pub(crate) mod walk;

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use serde::Serialize;

pub(super) use walk::{Comparison, choose, page};

/// A whole page.
pub(crate) fn document(title: &str, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(include_str!("chart.css"))) (PreEscaped(include_str!("style.css"))) }
            }
            body { (body) }
        }
    }
}

/// JSON for a script element.
pub(crate) fn embeddable(data: &impl Serialize) -> Result<String, serde_json::Error> {
    // Within JSON `<` occurs in strings only. As JSON's own escape it cannot end the script element.
    Ok(serde_json::to_string(data)?.replace('<', "\\u003c"))
}

/// A finding in one sentence, with a mark before it. `class` is `good`, `bad` or `unknown`.
pub(crate) fn verdict(class: &str, mark: &str, text: &str) -> Markup {
    html! {
        p class={ "verdict " (class) } { span aria-hidden="true" { (mark) } " " (text) }
    }
}

/// A figure; `beside` states its error.
pub(crate) fn tile(name: &str, value: &str, beside: &[String]) -> Markup {
    badged_tile(&html! { (name) }, value, beside)
}

fn badged_tile(name: &Markup, value: &str, beside: &[String]) -> Markup {
    html! {
        div.tile {
            div.name { (name) }
            div.value { (value) }
            @for line in beside { div.beside { (line) } }
        }
    }
}

/// A chart under its finding.
pub(crate) fn card(finding: &str, chart: &impl Render, caption: &str) -> Markup {
    figure("card", finding, chart, caption)
}

/// A chart that takes the page's whole width.
fn wide_card(finding: &str, chart: &impl Render, caption: &str) -> Markup {
    figure("card all", finding, chart, caption)
}

fn figure(class: &str, finding: &str, chart: &impl Render, caption: &str) -> Markup {
    html! {
        figure class=(class) {
            h3 { (finding) }
            (chart)
            figcaption { (caption) }
        }
    }
}

/// A table under its caption; nothing if it has no rows. The first cell of a row is its name. `class` is one
/// of the style's: `numbers`, `all` (numbers over the page's whole width), `runs` (many columns), `text`, and
/// `pairs` (names and values).
pub(crate) fn table(class: &str, caption: &str, head: &[&str], rows: &[Vec<String>]) -> Markup {
    html! {
        @if !rows.is_empty() {
            div class={ "card scroll " (class) } {
                table {
                    caption { (caption) }
                    @if !head.is_empty() {
                        thead { tr { @for title in head { th scope="col" { (title) } } } }
                    }
                    tbody { @for row in rows { (table_row(row)) } }
                }
            }
        }
    }
}

fn table_row(cells: &[String]) -> Markup {
    html! {
        @if let [name, values @ ..] = cells {
            tr {
                th scope="row" { (name) }
                @for value in values { td { (value) } }
            }
        }
    }
}
