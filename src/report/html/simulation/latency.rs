//! How long frames take: how many take longer than so many milliseconds, and percentiles.

use super::{curves, escape, name, network, table};
use crate::report::format::{figure, grouped};
use crate::report::html::chart::{Chart, Series};
use crate::report::html::figures::card;
use crate::simulate::Outcome;

/// The curves of a network's runs, as a card.
pub(super) fn chart(runs: &[Outcome]) -> String {
    let series = runs.iter().zip(curves()).map(|(run, (class, mark))| {
        let mut times: Vec<f64> =
            run.splits().iter().map(|split| split.total().as_secs_f64() * 1e3).collect();
        times.sort_by(f64::total_cmp);
        Series { name: name(runs, run), class, mark, points: exceedance(&times) }
    });
    let chart = Chart {
        x: "latency (ms)",
        y: "frames that take longer",
        series: series.collect(),
        bound: None,
        labels: Vec::new(),
        keys: &[],
    };
    let finding = format!("{}: how many frames take longer than so many milliseconds", network(runs));
    card(&finding, &chart.svg(), "")
}

/// Percentiles of a network's runs.
pub(super) fn figures(runs: &[Outcome]) -> String {
    let head =
        ["", "p50", "p95", "p99", "p99.9", "frames/s", "late at 30/s", "late at 60/s", "gaps", "frames"];
    let rows = runs.iter().map(|run| {
        let latency = run.latency_ms;
        let times = [latency.p50, latency.p95, latency.p99, latency.p999, run.frames_per_second].map(figure);
        let counts =
            [run.late_at_30, run.late_at_60, run.incomplete, run.frames].map(|count| grouped(count.into()));
        std::iter::once(name(runs, run)).chain(times).chain(counts).collect()
    });
    let table = table(&format!("{}, milliseconds", network(runs)), &head, rows);
    let mut hopeless: Vec<String> = runs.iter().filter(|run| run.hopeless).map(Outcome::label).collect();
    hopeless.dedup();
    if hopeless.is_empty() {
        return table;
    }
    format!(
        "{table}<p class=\"hint\">{}: a frame may take no longer than the way to the display alone, so that what is lost, or waits at its end, is \
         given up.</p>",
        escape(&hopeless.join(", "))
    )
}

/// For sorted `times`, the share of them above each of some of them: one half, a fifth, a tenth, down to the
/// last one.
fn exceedance(times: &[f64]) -> Vec<(f64, f64)> {
    let count = times.len() as f64;
    let mut points = Vec::new();
    let mut share = 1.0;
    while share * count >= 1.0 {
        let rank = ((1.0 - share) * count).round() as usize;
        if let Some(&time) = times.get(rank.min(times.len().saturating_sub(1))) {
            points.push((time, share));
        }
        share *= 0.85;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_point_says_how_many_frames_take_longer() {
        let times: Vec<f64> = (0..1000).map(f64::from).collect();
        let points = exceedance(&times);
        assert_eq!(points[0], (0.0, 1.0));
        for (time, share) in &points {
            let longer = times.iter().filter(|t| *t >= time).count() as f64 / 1000.0;
            assert!((longer - share).abs() < 0.001, "{time}: {longer} {share}");
        }
        assert!(points.last().unwrap().1 < 0.0012);
        assert!(exceedance(&[]).is_empty());
    }
}
