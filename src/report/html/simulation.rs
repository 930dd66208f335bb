//! The page of a simulation: latencies, where the time goes, bytes against the formulas, and when what was
//! done.

mod bytes;
mod latency;
mod pixels;

use super::chart::Mark;
use super::escape;
use super::timeline::Timeline;
use crate::report::format::figure;
use crate::report::schema::{Frame, Role, Seat, Span};
use crate::simulate::{FrameTimes, Outcome};

/// The colours of runs, in turn.
const CLASSES: [&str; 6] = ["k0", "k1", "k2", "k3", "k4", "k5"];
/// So many timelines are on the page at most.
const TIMELINES: usize = 12;

/// The page; its runs are shown network by network.
pub(in crate::report) fn page(outcomes: &[Outcome], command: &[String]) -> String {
    let networks = || outcomes.chunk_by(|a, b| a.network == b.network);
    let latencies: String = networks().map(latency::chart).collect();
    let percentiles: String = networks().map(latency::figures).collect();
    let splits: String = networks().map(split).collect();
    let curves: String = networks().map(bytes::chart).collect();
    let bytes: String = networks().map(bytes::figures).collect();
    let pixels: String = networks().map(pixels::error_curve).collect();
    let timelines: String = outcomes.iter().take(TIMELINES).map(timeline).collect();
    let command = escape(&command.join(" "));
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <meta name=\"color-scheme\" content=\"light dark\"><title>Trimaran: simulated networks</title>\n<style>\n{style}</style></head>\n\
         <body>\n<header><h1>Simulated networks</h1><p>Nothing here was measured on a network: the links, QUIC and the datagram connection \
         are the real code in virtual time; the networks, TCP (Linux\u{2019}s with CUBIC, not BBR) and the roles\u{2019} computing times are models. To have it again:</p>\
         <pre style=\"white-space: pre-wrap\">{command}</pre></header>\n<main>\n\
         <h2 id=\"latency\">Latency</h2><p class=\"hint\">From a camera leaving RVG to its picture. A picture is late that is shown more than a \
         30th or a 60th of a second after the one before; frames with gaps came without some of their ids.</p>\
         <div class=\"cards\">{latencies}</div>{percentiles}\
         <h2 id=\"split\">Where the time goes</h2>{splits}{pixels}\
         <h2 id=\"bytes\">Bytes</h2><p class=\"hint\">A frame\u{2019}s over all links, each packet counted once where it leaves its machine. <i>h</i> is what \
         headers take around a packet; <i>added</i> is the paper\u{2019}s formula with ids and headers added rather than multiplied.</p>\
         <div class=\"cards\">{curves}</div>{bytes}\
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

/// What a frame's time goes by: its name, its colour, and its mean in a run.
type Part = (&'static str, &'static str, fn(&Outcome) -> f64);
const PARTS: [Part; 5] = [
    ("waiting", "k1", |run| run.waiting_ms.mean),
    ("network", "paper", |run| run.network_ms.mean),
    ("OR", "or", |run| run.occluders_ms.mean),
    ("HC", "hc", |run| run.culling_ms.mean),
    ("RVG", "rvg", |run| run.drawing_ms.mean),
];

/// Bars of the mean time by what it was for.
fn split(runs: &[Outcome]) -> String {
    let longest = runs.iter().map(|run| run.latency_ms.mean).fold(f64::MIN_POSITIVE, f64::max);
    let rows: String = runs
        .iter()
        .map(|run| {
            let mut left = 0.0;
            let bars: String = PARTS
                .iter()
                .map(|(what, class, mean)| {
                    let ms = mean(run);
                    let width = ms / longest * 600.0;
                    let bar = format!(
                        "<g><title>{what}: {} ms</title><rect class=\"bar {class}\" x=\"{left:.1}\" y=\"2\" width=\"{width:.1}\" height=\"16\"/></g>",
                        figure(ms)
                    );
                    left += width;
                    bar
                })
                .collect();
            let cells: String = PARTS.iter().map(|(.., mean)| format!("<td>{}</td>", figure(mean(run)))).collect();
            format!(
                "<tr><th>{}</th>{cells}<td><svg viewBox=\"0 0 600 20\" width=\"600\" role=\"img\" aria-label=\"where the time goes\">{bars}</svg></td></tr>",
                escape(&name(runs, run))
            )
        })
        .collect();
    let titles: String = PARTS
        .iter()
        .map(|(what, class, _)| format!("<th class=\"key\"><i class=\"swatch {class}\"></i>{what}</th>"))
        .collect();
    format!(
        "<div class=\"card scroll runs\"><table><caption>{}, mean milliseconds</caption><thead><tr><th></th>{titles}<th></th></tr></thead>\
         <tbody>{rows}</tbody></table></div>",
        escape(network(runs))
    )
}

/// What a network is called whose runs these are.
fn network(runs: &[Outcome]) -> &str {
    runs.first().map_or("", |run| &run.network)
}

/// How runs are drawn in turn: by colours, and when these are used up, dashed.
fn curves() -> impl Iterator<Item = (&'static str, Mark)> {
    let with = |mark| CLASSES.iter().map(move |class| (*class, mark));
    with(Mark::Line).chain(with(Mark::Dashed)).cycle()
}

fn table(caption: &str, head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
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
        "<div class=\"card scroll runs\"><table><caption>{}</caption><thead><tr>{head}</tr></thead><tbody>{}</tbody></table></div>",
        escape(caption),
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
