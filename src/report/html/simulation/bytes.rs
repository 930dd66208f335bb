//! What a frame puts on the wire, beside the formulas.

use super::{curves, name, network, table};
use crate::report::format::figure;
use crate::report::html::chart::{Chart, Mark, Series};
use crate::report::html::figures::card;
use crate::report::simulation::COLUMNS;
use crate::simulate::Outcome;

/// Bytes a frame over the ids a batch, or over the ids a frame where only that varies, beside both formulas.
pub(super) fn chart(runs: &[Outcome]) -> String {
    let over_nodes = runs.iter().all(|run| runs.first().is_some_and(|first| first.batch == run.batch))
        && runs.iter().any(|run| runs.first().is_some_and(|first| first.nodes != run.nodes));
    let x = |run: &Outcome| if over_nodes { run.nodes } else { run.batch as f64 };
    // In the order of the flags, as everywhere on the page.
    let mut links: Vec<String> = Vec::new();
    for label in runs.iter().map(Outcome::label) {
        if !links.contains(&label) {
            links.push(label);
        }
    }
    let curve = |name: &str, class, mark, of: &dyn Fn(&Outcome) -> Option<f64>| {
        let mut points: Vec<(f64, f64)> = runs.iter().filter_map(|run| Some((x(run), of(run)?))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup();
        Series { name: name.to_owned(), class, mark, points }
    };
    let mut series: Vec<Series> = links
        .iter()
        .zip(curves())
        .map(|(link, (class, mark))| {
            curve(link, class, mark, &|run| (run.label() == *link).then_some(run.bytes.total))
        })
        .collect();
    series.push(curve("2(4n+hn/b)+3(72+h), h = 50", "model", Mark::Dashed, &|run| Some(run.bytes.corrected)));
    series.push(curve("paper: 8nh/b+3(72+h)", "paper", Mark::Dashed, &|run| Some(run.bytes.paper)));
    let chart = Chart {
        x: if over_nodes { "ids a frame (n)" } else { "ids a batch (b)" },
        y: "bytes a frame",
        series,
        bound: None,
        labels: Vec::new(),
        keys: &[],
    };
    // A single value of x makes no curve.
    if chart.series.iter().all(|series| series.points.len() < 2) {
        return String::new();
    }
    card(&format!("{}: bytes a frame beside the formulas", network(runs)), &chart.svg(), "")
}

/// The bytes of a network's runs, by what they were.
pub(super) fn figures(runs: &[Outcome]) -> String {
    let head: Vec<&str> = std::iter::once("").chain(COLUMNS.map(|column| column.title)).collect();
    let rows = runs.iter().map(|run| {
        let figures = COLUMNS.map(|column| figure((column.of)(&run.bytes)));
        std::iter::once(name(runs, run)).chain(figures).collect()
    });
    table(&format!("{}, bytes a frame", network(runs)), &head, rows)
}
