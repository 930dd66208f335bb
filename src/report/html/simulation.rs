//! The page of a simulation: latencies, where the time goes, bytes against the formulas, and when what was done.

use super::chart::{Chart, Mark, Series};
use super::escape;
use super::figures::card;
use super::timeline::Timeline;
use crate::report::format::{figure, grouped};
use crate::report::schema::{Frame, Role, Seat, Span};
use crate::simulate::{FrameTimes, Outcome, Spread};

/// The colours of runs, in turn.
const CLASSES: [&str; 6] = ["k0", "k1", "k2", "k3", "k4", "k5"];
/// So many timelines are on the page at most.
const TIMELINES: usize = 12;

/// The page; its runs are shown network by network.
pub(in crate::report) fn page(outcomes: &[Outcome], command: &[String]) -> String {
    let networks = || outcomes.chunk_by(|a, b| a.network == b.network);
    let latencies: String = networks().map(latency).collect();
    let splits: String = networks().map(split).collect();
    let bytes: String = networks().map(bytes).collect();
    let curves: String = networks().map(error_curve).collect();
    let timelines: String = outcomes.iter().take(TIMELINES).map(timeline).collect();
    let command = escape(&command.join(" "));
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <meta name=\"color-scheme\" content=\"light dark\"><title>Trimaran: simulated networks</title>\n<style>\n{style}</style></head>\n\
         <body>\n<header><h1>Simulated networks</h1><p>Nothing here was measured on a network: the links, QUIC and the datagram connection \
         are the real code in virtual time; the networks, TCP and the roles' computing times are models. To have it again:</p>\
         <pre style=\"white-space: pre-wrap\">{command}</pre></header>\n<main>\n\
         <h2 id=\"latency\">Latency</h2><p class=\"hint\">From a camera leaving RVG to its picture.</p>{latencies}\
         <h2 id=\"split\">Where the time goes</h2>{splits}{curves}\
         <h2 id=\"bytes\">Bytes</h2>{bytes}\
         <h2 id=\"time\">When</h2><p class=\"hint\">The frames around the slowest one of each run.</p>{timelines}\
         </main>\n</body></html>\n",
        style = include_str!("style.css"),
    )
}

/// What tells runs of one network apart.
fn name(runs: &[Outcome], run: &Outcome) -> String {
    let varies = |of: fn(&Outcome) -> String| runs.iter().any(|other| of(other) != of(run));
    let mut name = run.label();
    if varies(|run| run.nodes.to_string()) {
        name += &format!(", n {}", figure(run.nodes));
    }
    if varies(|run| run.batch.to_string()) {
        name += &format!(", b {}", run.batch);
    }
    name
}

fn latency(runs: &[Outcome]) -> String {
    let series = |(run, class): (&Outcome, &&'static str)| {
        let mut times: Vec<f64> =
            run.splits().iter().map(|split| split.total().as_secs_f64() * 1e3).collect();
        times.sort_by(f64::total_cmp);
        Series { name: name(runs, run), class, mark: Mark::Line, points: exceedance(&times) }
    };
    let chart = Chart {
        x: "latency (ms)",
        y: "frames that take longer",
        series: runs.iter().zip(CLASSES.iter().cycle()).map(series).collect(),
        bound: None,
        labels: Vec::new(),
        keys: &[],
    };
    let head =
        ["", "p50", "p95", "p99", "p99.9", "frames/s", "late at 30/s", "late at 60/s", "gaps", "frames"];
    let rows = runs.iter().map(|run| {
        let latency = run.latency_ms;
        let times = [latency.p50, latency.p95, latency.p99, latency.p999, run.frames_per_second].map(figure);
        let counts =
            [run.late_at_30, run.late_at_60, run.incomplete, run.frames].map(|count| grouped(count.into()));
        std::iter::once(name(runs, run)).chain(times).chain(counts).collect()
    });
    let network = runs.first().map_or("", |run| &run.network);
    cards(&format!("{network}: how many frames take longer than so many milliseconds"), &chart.svg(), "")
        + &table(&head, rows)
}

/// For sorted `times`, the share of them above each of some of them: one half, a fifth, a tenth, down to the last one.
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

/// Bars of the mean time by what it was for.
fn split(runs: &[Outcome]) -> String {
    let longest = runs.iter().map(|run| run.latency_ms.mean).fold(f64::MIN_POSITIVE, f64::max);
    let network = runs.first().map_or("", |run| &run.network);
    let rows: String = runs
        .iter()
        .map(|run| {
            let parts = [
                ("waiting", "k1", run.waiting_ms.mean),
                ("network", "paper", run.network_ms.mean),
                ("OR", "or", run.occluders_ms.mean),
                ("HC", "hc", run.culling_ms.mean),
                ("RVG", "rvg", run.drawing_ms.mean),
            ];
            let mut left = 0.0;
            let bars: String = parts
                .iter()
                .map(|(what, class, ms)| {
                    let width = ms / longest * 600.0;
                    let bar = format!(
                        "<g><title>{what}: {} ms</title><rect class=\"bar {class}\" x=\"{left:.1}\" y=\"2\" width=\"{width:.1}\" height=\"16\"/></g>",
                        figure(*ms)
                    );
                    left += width;
                    bar
                })
                .collect();
            let cells: String = parts.iter().map(|(_, _, ms)| format!("<td>{}</td>", figure(*ms))).collect();
            format!(
                "<tr><th>{}</th>{cells}<td><svg viewBox=\"0 0 600 20\" width=\"600\" role=\"img\" aria-label=\"where the time goes\">{bars}</svg></td></tr>",
                escape(&name(runs, run))
            )
        })
        .collect();
    format!(
        "<h3>{}</h3><table><thead><tr><th>mean, ms</th><th>waiting</th><th>network</th><th>OR</th><th>HC</th><th>RVG</th><th></th></tr></thead>\
         <tbody>{rows}</tbody></table>",
        escape(network)
    )
}

/// Latency against what it costs the pictures, where that was drawn: a point a session, so that chance shows.
fn error_curve(runs: &[Outcome]) -> String {
    let point = |(run, class): (&Outcome, &&'static str)| {
        run.pixels?;
        let points = run.sessions.iter();
        let points =
            points.filter_map(|session| Some((session.latency_ms.p99, session.pixels?.wrong_a_frame())));
        Some(Series { name: name(runs, run), class, mark: Mark::Points, points: points.collect() })
    };
    let series: Vec<Series> = runs.iter().zip(CLASSES.iter().cycle()).filter_map(point).collect();
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
    let network = runs.first().map_or("", |run| &run.network);
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
    cards(
        &format!("{network}: what is late in one mode is wrong in the other"),
        &chart.svg(),
        "Pixels that are not as they would have been with every id, over all frames. Each point is a session with a seed of its own.",
    ) + &table(&head, rows)
}

/// A mean with how far single values are from it.
fn around(Spread { mean, deviation }: Spread) -> String {
    deviation.map_or_else(|| figure(mean), |apart| format!("{} ± {}", figure(mean), figure(apart)))
}

/// Bytes a frame over the ids a batch, or over the ids a frame where only that varies, beside both formulas.
fn bytes(runs: &[Outcome]) -> String {
    let over_nodes = runs.iter().all(|run| runs.first().is_some_and(|first| first.batch == run.batch))
        && runs.iter().any(|run| runs.first().is_some_and(|first| first.nodes != run.nodes));
    let x = |run: &Outcome| if over_nodes { run.nodes } else { run.batch as f64 };
    let mut links: Vec<String> = runs.iter().map(Outcome::label).collect();
    links.dedup();
    links.sort();
    links.dedup();
    let curve = |name: &str, class, mark, of: &dyn Fn(&Outcome) -> Option<f64>| {
        let mut points: Vec<(f64, f64)> = runs.iter().filter_map(|run| Some((x(run), of(run)?))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup();
        Series { name: name.to_owned(), class, mark, points }
    };
    let mut series: Vec<Series> = links
        .iter()
        .zip(CLASSES.iter().cycle())
        .map(|(link, class)| {
            curve(link, class, Mark::Line, &|run| (run.label() == *link).then_some(run.bytes.total))
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
    let head = [
        "",
        "all",
        "ids",
        "messages",
        "transport",
        "tcp/udp",
        "ip",
        "link layer",
        "packets",
        "h",
        "acks",
        "repeated",
        "handshake, once",
        "added",
        "added, h as is",
        "paper",
    ];
    let rows = runs.iter().map(|run| {
        let bytes = &run.bytes;
        let parts = [
            bytes.total,
            bytes.ids,
            bytes.messages,
            bytes.transport,
            bytes.transport_headers,
            bytes.ip_headers,
            bytes.link_layer,
            bytes.packets,
            bytes.header,
            bytes.acknowledgements,
            bytes.repetitions,
            bytes.handshake,
            bytes.corrected,
            bytes.corrected_as_measured,
            bytes.paper,
        ];
        std::iter::once(name(runs, run)).chain(parts.map(figure)).collect()
    });
    let network = runs.first().map_or("", |run| &run.network);
    // A single value of x makes no curve.
    let varies = chart.series.iter().any(|series| series.points.len() > 1);
    let finding = format!("{network}: bytes a frame beside the formulas");
    let curves =
        if varies { cards(&finding, &chart.svg(), "") } else { format!("<h3>{}</h3>", escape(&finding)) };
    curves + &table(&head, rows)
}

/// A chart in a row of its own.
fn cards(finding: &str, svg: &str, caption: &str) -> String {
    format!("<div class=\"cards\">{}</div>", card(finding, svg, caption))
}

fn table(head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let head: String = head.iter().map(|cell| format!("<th>{cell}</th>")).collect();
    let row = |cells: Vec<String>| {
        let cells: String = cells
            .iter()
            .enumerate()
            .map(|(place, cell)| {
                let tag = if place == 0 { "th" } else { "td" };
                format!("<{tag}>{}</{tag}>", escape(cell))
            })
            .collect();
        format!("<tr>{cells}</tr>")
    };
    format!(
        "<table><thead><tr>{head}</tr></thead><tbody>{}</tbody></table>",
        rows.map(row).collect::<String>()
    )
}

fn timeline(run: &Outcome) -> String {
    let frames: Vec<Frame> = run.times.iter().zip(0..).map(|(times, frame)| spans(frame, times)).collect();
    let slowest = run.times.iter().enumerate().max_by_key(|(_, times)| times.shown.since(times.published));
    let Some(window) = slowest.and_then(|(place, _)| Timeline::around(&frames, place)) else {
        return String::new();
    };
    format!(
        "<details><summary>{}: {}, n {}, b {}</summary>{}</details>",
        escape(&run.network),
        escape(&run.label()),
        figure(run.nodes),
        run.batch,
        window.svg()
    )
}

/// When the roles were busy with a frame.
fn spans(frame: u32, times: &FrameTimes) -> Frame {
    let ms = |at: trimaran_transport::Instant| at.as_nanos() as f64 / 1e6;
    let seat = if frame.is_multiple_of(2) { Seat::SwitchA } else { Seat::SwitchB };
    let span = |role, seat, start, end| Span { role, seat, start_ms: ms(start), end_ms: ms(end) };
    let timeline = vec![
        span(Role::Or, seat, times.fed, times.occluded),
        span(Role::Hc, seat, times.occluded, times.culled),
        span(Role::Rvg, Seat::Display, times.arrived, times.shown),
    ];
    Frame { frame, timeline, ..Frame::default() }
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
