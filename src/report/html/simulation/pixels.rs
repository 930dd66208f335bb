//! What lateness spared pictures, and what deadlines cost them.

use super::{curves, name, network, table};
use crate::report::format::figure;
use crate::report::html::chart::{Chart, Mark, Series};
use crate::report::html::figures::card;
use crate::simulate::{Outcome, Spread};

/// Latency against what it costs the pictures, where that was drawn: a point a session, so that chance shows.
pub(super) fn error_curve(runs: &[Outcome]) -> String {
    let point = |(run, (class, _)): (&Outcome, (&'static str, Mark))| {
        run.pixels?;
        let points = run.sessions.iter();
        let points =
            points.filter_map(|session| Some((session.latency_ms.p99, session.pixels?.wrong_a_frame())));
        Some(Series { name: name(runs, run), class, mark: Mark::Points, points: points.collect() })
    };
    let series: Vec<Series> = runs.iter().zip(curves()).filter_map(point).collect();
    if series.is_empty() {
        return String::new();
    }
    let chart = Chart {
        x: "latency, 99th percentile (ms)",
        y: "wrong pixels a frame",
        series,
        bound: None,
        labels: Vec::new(),
        keys: &[],
    };
    let head = [
        "mean of sessions, ± standard deviation",
        "p99, ms",
        "wrong pixels a frame",
        "needless triangles a frame",
        "sessions",
    ];
    let rows = runs.iter().filter(|run| run.pixels.is_some()).map(|run| {
        let spreads = [
            run.spread(|session| Some(session.latency_ms.p99)),
            run.spread(|session| Some(session.pixels?.wrong_a_frame())),
            run.spread(|session| Some(session.pixels?.needless_a_frame())),
        ];
        let cells = spreads.map(|spread| spread.map_or_else(String::new, around));
        std::iter::once(name(runs, run)).chain(cells).chain([run.sessions.len().to_string()]).collect()
    });
    let network = network(runs);
    let card = card(
        &format!("{network}: what is late in one mode is wrong in the other"),
        &chart.svg(),
        "Pixels that are not as they would have been with every id, over all frames. Each point is a session with a seed of its own.",
    );
    format!("<div class=\"cards\">{card}</div>{}", table(network, &head, rows))
}

/// A mean with how far single values are from it.
fn around(Spread { mean, deviation }: Spread) -> String {
    deviation.map_or_else(|| figure(mean), |apart| format!("{} ± {}", figure(mean), figure(apart)))
}
