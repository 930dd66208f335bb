//! `sim.html`, the page of a simulation: latencies, the division of time, bytes against the formulas, and
//! timelines. Runs are shown network by network.

use maud::{Markup, html};

use super::tables::{BYTES, spreads};
use super::{FrameTimes, Outcome, Spread};
use crate::report::format::{figure, grouped};
use crate::report::html::chart::{Chart, Mark, Series, Timeline};
use crate::report::html::{card, document, table};
use crate::report::schema::{Frame, Machine, Role, Span};

/// The colours of runs, in turn.
const CLASSES: [&str; 6] = ["k0", "k1", "k2", "k3", "k4", "k5"];
/// The most timelines on the page.
const TIMELINES: usize = 12;

/// The figures as one page that works offline. `command` reproduces them.
#[must_use]
pub fn page(outcomes: &[Outcome], command: &[String]) -> String {
    let networks = || outcomes.chunk_by(|a, b| a.network == b.network);
    let body = html! {
        header {
            h1 { "Simulated networks" }
            p {
                "Nothing here was measured on a network: the links, QUIC and the datagram connection are the \
                 real code in virtual time; the networks, TCP (Linux’s with CUBIC, not BBR) and the \
                 roles’ computing times are models. To have it again:"
            }
            pre style="white-space: pre-wrap" { (command.join(" ")) }
        }
        main {
            h2 #latency { "Latency" }
            p.hint {
                "From a camera leaving RVG to its picture. A picture is late that is shown more than a 30th or \
                 a 60th of a second after the one before; frames with gaps came without some of their ids."
            }
            div.cards { @for runs in networks() { (latency_curves(runs)) } }
            @for runs in networks() { (percentiles(runs)) }
            h2 #split { "Where the time goes" }
            @for runs in networks() { (time_by_part(runs)) }
            @for runs in networks() { (wrong_pixels(runs)) }
            h2 #bytes { "Bytes" }
            p.hint {
                "A frame’s over all links, each packet counted once where it leaves its machine. "
                i { "h" } " is what headers take around a packet; "
                i { "added" } " is the paper’s formula with ids and headers added rather than multiplied."
            }
            div.cards { @for runs in networks() { (bytes_curves(runs)) } }
            @for runs in networks() { (bytes_by_kind(runs)) }
            h2 #time { "When" }
            p.hint { "The frames around the slowest one of each run." }
            @for run in outcomes.iter().take(TIMELINES) { (timeline(run)) }
        }
    };
    document("Trimaran: simulated networks", &body).into_string()
}

/// The name of the network of these runs.
fn network(runs: &[Outcome]) -> &str {
    runs.first().map_or("", |run| &run.network)
}

/// The label of a run among those of its network.
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

/// The styles of runs in turn: colours, and when these are used up, dashed.
fn styles() -> impl Iterator<Item = (&'static str, Mark)> {
    let with = |mark| CLASSES.iter().map(move |class| (*class, mark));
    with(Mark::Line).chain(with(Mark::Dashed)).cycle()
}

/// A table of a network's runs: one row per run, after its name.
fn runs_table(
    caption: &str,
    head: &[&str],
    runs: &[Outcome],
    cells: impl Fn(&Outcome) -> Vec<String>,
) -> Markup {
    let head: Vec<&str> = std::iter::once("").chain(head.iter().copied()).collect();
    let row = |run| std::iter::once(name(runs, run)).chain(cells(run)).collect();
    let rows: Vec<Vec<String>> = runs.iter().map(row).collect();
    table("runs", caption, &head, &rows)
}

/// The share of frames that take longer than a time.
fn latency_curves(runs: &[Outcome]) -> Markup {
    let curve = |(run, (class, mark)): (&Outcome, (&'static str, Mark))| {
        let mut times: Vec<f64> =
            run.splits().iter().map(|split| split.total().as_secs_f64() * 1e3).collect();
        times.sort_by(f64::total_cmp);
        Series { name: name(runs, run), class, mark, points: exceedance(&times) }
    };
    let series = runs.iter().zip(styles()).map(curve).collect();
    let chart = Chart { x: "latency (ms)", y: "frames that take longer", series, ..Chart::default() };
    let finding = format!("{}: how many frames take longer than so many milliseconds", network(runs));
    card(&finding, &chart, "")
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

fn percentiles(runs: &[Outcome]) -> Markup {
    let head = ["p50", "p95", "p99", "p99.9", "frames/s", "late at 30/s", "late at 60/s", "gaps", "frames"];
    let mut deadline_too_short: Vec<String> =
        runs.iter().filter(|run| run.deadline_too_short).map(Outcome::label).collect();
    deadline_too_short.dedup();
    html! {
        (runs_table(&format!("{}, milliseconds", network(runs)), &head, runs, |run| {
            let latency = run.latency_ms;
            let times = [latency.p50, latency.p95, latency.p99, latency.p999, run.frames_per_second];
            let counts = [run.late_at_30, run.late_at_60, run.incomplete, run.frames];
            let counts = counts.map(|count| grouped(count.into()));
            times.map(figure).into_iter().chain(counts).collect()
        }))
        @if !deadline_too_short.is_empty() {
            p.hint {
                (deadline_too_short.join(", "))
                ": a frame may take no longer than the way to the display alone, so that what is lost, or \
                 waits at its end, is given up."
            }
        }
    }
}

/// A part of a frame's time: its name, its colour, and its mean in a run.
type Part = (&'static str, &'static str, fn(&Outcome) -> f64);
const PARTS: [Part; 5] = [
    ("waiting", "k1", |run| run.waiting_ms.mean),
    ("network", "paper", |run| run.network_ms.mean),
    ("OR", "or", |run| run.occluders_ms.mean),
    ("HC", "hc", |run| run.culling_ms.mean),
    ("RVG", "rvg", |run| run.drawing_ms.mean),
];

/// Bars of the mean time by part.
fn time_by_part(runs: &[Outcome]) -> Markup {
    let longest = runs.iter().map(|run| run.latency_ms.mean).fold(f64::MIN_POSITIVE, f64::max);
    html! {
        div.card.scroll.runs {
            table {
                caption { (network(runs)) ", mean milliseconds" }
                thead {
                    tr {
                        th {}
                        @for (what, class, _) in PARTS { th.key { i class={ "swatch " (class) } {} (what) } }
                        th {}
                    }
                }
                tbody {
                    @for run in runs {
                        @let parts = PARTS.map(|(what, class, mean)| (what, class, mean(run)));
                        tr {
                            th scope="row" { (name(runs, run)) }
                            @for (.., ms) in parts { td { (figure(ms)) } }
                            td { (stacked_bar("where the time goes", &parts, longest)) }
                        }
                    }
                }
            }
        }
    }
}

/// Latency against wrong pixels, if those were drawn: one point per session, so that chance shows.
fn wrong_pixels(runs: &[Outcome]) -> Markup {
    let session_points = |(run, (class, _)): (&Outcome, (&'static str, Mark))| {
        run.pixels?;
        let sessions = run.sessions.iter();
        let points = sessions.filter_map(|s| Some((s.latency_ms.p99, s.pixels?.wrong_a_frame()))).collect();
        Some(Series { name: name(runs, run), class, mark: Mark::Points, points })
    };
    let series: Vec<Series> = runs.iter().zip(styles()).filter_map(session_points).collect();
    if series.is_empty() {
        return Markup::default();
    }
    let chart =
        Chart { x: "latency, 99th percentile (ms)", y: "wrong pixels a frame", series, ..Chart::default() };
    let head = [
        "mean of sessions, ± standard deviation",
        "p99, ms",
        "wrong pixels a frame",
        "needless triangles a frame",
        "sessions",
    ];
    let row = |run: &Outcome| {
        let cells = spreads(run).map(|spread| spread.map_or_else(String::new, mean_and_deviation));
        std::iter::once(name(runs, run)).chain(cells).chain([run.sessions.len().to_string()]).collect()
    };
    let rows: Vec<Vec<String>> = runs.iter().filter(|run| run.pixels.is_some()).map(row).collect();
    html! {
        div.cards {
            (card(
                &format!("{}: what is late in one mode is wrong in the other", network(runs)),
                &chart,
                "Pixels that are not as they would have been with every id, over all frames. Each point is a \
                 session with a seed of its own.",
            ))
        }
        (table("runs", network(runs), &head, &rows))
    }
}

fn mean_and_deviation(Spread { mean, deviation }: Spread) -> String {
    deviation.map_or_else(|| figure(mean), |apart| format!("{} ± {}", figure(mean), figure(apart)))
}

/// Bytes a frame over the ids a batch, or over the ids a frame if only that varies, beside both formulas.
fn bytes_curves(runs: &[Outcome]) -> Markup {
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
    let of_link = |(link, (class, mark)): (&String, (&'static str, Mark))| {
        curve(link, class, mark, &|run| (run.label() == *link).then_some(run.bytes.total))
    };
    let mut series: Vec<Series> = links.iter().zip(styles()).map(of_link).collect();
    series.push(curve("2(4n+hn/b)+3(72+h), h = 50", "model", Mark::Dashed, &|run| Some(run.bytes.corrected)));
    series.push(curve("paper: 8nh/b+3(72+h)", "paper", Mark::Dashed, &|run| Some(run.bytes.paper)));
    // A single value of x makes no curve.
    if series.iter().all(|series| series.points.len() < 2) {
        return Markup::default();
    }
    let x = if over_nodes { "ids a frame (n)" } else { "ids a batch (b)" };
    let chart = Chart { x, y: "bytes a frame", series, ..Chart::default() };
    card(&format!("{}: bytes a frame beside the formulas", network(runs)), &chart, "")
}

fn bytes_by_kind(runs: &[Outcome]) -> Markup {
    let caption = format!("{}, bytes a frame", network(runs));
    let figures = |run: &Outcome| BYTES.map(|column| figure((column.of)(&run.bytes))).into();
    runs_table(&caption, &BYTES.map(|column| column.title), runs, figures)
}

fn timeline(run: &Outcome) -> Markup {
    let latency = |times: &FrameTimes| times.shown.since(times.published);
    let session_frames = (run.times.len() / run.sessions.len().max(1)).max(1);
    // Each session has its own clock, so only one is shown.
    let session = run.times.chunks(session_frames).max_by_key(|session| session.iter().map(latency).max());
    let session = session.unwrap_or_default();
    let frames: Vec<Frame> = session.iter().zip(0..).map(|(times, frame)| spans(frame, times)).collect();
    let slowest = session.iter().enumerate().max_by_key(|(_, times)| latency(times));
    html! {
        @if let Some(window) = slowest.and_then(|(index, _)| Timeline::around(&frames, index)) {
            details {
                summary { (run.network) ": " (run.label()) ", n " (figure(run.nodes)) ", b " (run.batch) }
                (window)
            }
        }
    }
}

/// The busy spans of the roles for a frame.
fn spans(frame: u32, times: &FrameTimes) -> Frame {
    let ms = |at: trimaran_transport::Instant| at.as_nanos() as f64 / 1e6;
    let machine = Machine::of(times.culler);
    let span = |role, machine, start, end| Span { role, machine, start_ms: ms(start), end_ms: ms(end) };
    let timeline = vec![
        span(Role::Or, machine, times.fed, times.occluded),
        span(Role::Hc, machine, times.occluded, times.culled),
        span(Role::Rvg, Machine::Display, times.arrived, times.shown),
    ];
    Frame { frame, timeline, ..Frame::default() }
}

/// Times side by side, each with a name, a colour class and milliseconds. `full` is the time of the whole
/// width.
fn stacked_bar(label: &str, parts: &[(&str, &str, f64)], full: f64) -> Markup {
    const WIDTH: f64 = 600.0;
    let width = |value: &f64| value / full * WIDTH;
    html! {
        svg viewBox={ "0 0 " (WIDTH) " 20" } width=(WIDTH) role="img" aria-label=(label) {
            @for (index, (name, class, value)) in parts.iter().enumerate() {
                @let left = parts.iter().take(index).fold(0.0, |left, (.., value)| left + width(value));
                g {
                    title { (name) ": " (figure(*value)) " ms" }
                    rect class={ "bar " (class) } x=(format!("{left:.1}")) y="2" width=(format!("{:.1}", width(value)))
                        height="16" {}
                }
            }
        }
    }
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
