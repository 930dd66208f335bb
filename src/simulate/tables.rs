//! The results of simulations: tables to print, and files for other programs.

use super::{FrameBytes, Outcome, Percentiles, Spread};
use crate::report::{format::figure, text::table};

/// A figure of a frame's bytes, for the printed table, the page and `runs.csv`.
pub(super) struct ByteColumn {
    /// Its column head in a table.
    pub(super) title: &'static str,
    /// Its column head in `runs.csv`.
    pub(super) key: &'static str,
    /// The figure.
    pub(super) of: fn(&FrameBytes) -> f64,
}

/// All figures of a frame's bytes, in their order.
pub(super) const BYTES: [ByteColumn; 17] = [
    ByteColumn { title: "all", key: "bytes", of: |bytes| bytes.total },
    ByteColumn { title: "ids", key: "ids", of: |bytes| bytes.ids },
    ByteColumn { title: "geometry", key: "geometry", of: |bytes| bytes.geometry },
    ByteColumn { title: "messages", key: "messages", of: |bytes| bytes.messages },
    ByteColumn { title: "transport", key: "transport", of: |bytes| bytes.transport },
    ByteColumn { title: "tcp/udp", key: "transport_headers", of: |bytes| bytes.transport_headers },
    ByteColumn { title: "ip", key: "ip_headers", of: |bytes| bytes.ip_headers },
    ByteColumn { title: "link layer", key: "link_layer", of: |bytes| bytes.link_layer },
    ByteColumn { title: "packets", key: "packets", of: |bytes| bytes.packets },
    ByteColumn { title: "acks", key: "acknowledgements", of: |bytes| bytes.acknowledgements },
    ByteColumn { title: "repeated", key: "repetitions", of: |bytes| bytes.repetitions },
    ByteColumn { title: "keepalive", key: "keepalive", of: |bytes| bytes.keepalive },
    ByteColumn { title: "handshake, once", key: "handshake", of: |bytes| bytes.handshake },
    ByteColumn { title: "h", key: "header", of: |bytes| bytes.header },
    ByteColumn { title: "paper", key: "paper", of: |bytes| bytes.paper },
    ByteColumn { title: "added", key: "corrected", of: |bytes| bytes.corrected },
    ByteColumn {
        title: "added, h as is",
        key: "corrected_as_measured",
        of: |bytes| bytes.corrected_as_measured,
    },
];

/// The results of simulations: latencies, the division of time, and bytes; one row per run.
#[must_use]
pub fn tables(outcomes: &[Outcome]) -> String {
    let mut out = String::from(
        "latency from a camera leaving RVG to its picture, milliseconds; pictures later than a 30th and a \
         60th of a second; frames that came with gaps\n\n",
    );
    out += &of(outcomes, &["p50", "p95", "p99", "p99.9", "frames/s", "late 30", "late 60", "gaps"], |run| {
        let latency = run.latency_ms;
        let times = [latency.p50, latency.p95, latency.p99, latency.p999, run.frames_per_second];
        let counts = [run.late_at_30, run.late_at_60, run.incomplete].map(|frames| frames.to_string());
        times.map(figure).into_iter().chain(counts).collect()
    });
    out += "\nof that, on average, milliseconds: waiting for a machine that is busy with another frame; the \
            network; OR, HC, RVG\n\n";
    let parts = ["waiting", "network", "network p99", "OR", "HC", "RVG", "all"];
    out += &of(outcomes, &parts, |run| {
        let mean = |part: Percentiles| part.mean;
        let times = [
            mean(run.waiting_ms),
            mean(run.network_ms),
            run.network_ms.p99,
            mean(run.occluders_ms),
            mean(run.culling_ms),
            mean(run.drawing_ms),
            mean(run.latency_ms),
        ];
        times.map(figure).into()
    });
    out += "\nbytes a frame over all links, by what they are; h: headers around a packet; paper: 8nh/b+3(72+h), \
            added: 2(4n+hn/b)+3(72+h), h = 50\n\n";
    out += &of(outcomes, &BYTES.map(|column| column.title), |run| {
        BYTES.map(|column| figure((column.of)(&run.bytes))).into()
    });
    if outcomes.iter().any(|run| run.pixels.is_some()) {
        out += "\nwhat gaps cost the pictures: frames with a wrong pixel, wrong pixels a frame over all frames, \
                the most in one, needless triangles a frame; ±: how far sessions with other seeds are apart, as \
                their standard deviation\n\n";
        let head =
            ["sessions", "frames wrong", "wrong pixels", "±", "worst", "triangles", "±", "p99 ms", "±"];
        out += &of(outcomes, &head, |run| {
            let Some(cost) = run.pixels else { return Vec::new() };
            let [p99, wrong, needless] = deviations(run, figure);
            vec![
                run.sessions.len().to_string(),
                cost.frames_wrong.to_string(),
                figure(cost.wrong_a_frame()),
                wrong,
                cost.worst.to_string(),
                figure(cost.needless_a_frame()),
                needless,
                figure(run.latency_ms.p99),
                p99,
            ]
        });
    }
    out
}

/// The spread over seeds of latency at the 99th percentile, wrong pixels a frame and needless triangles a
/// frame.
pub(super) fn spreads(run: &Outcome) -> [Option<Spread>; 3] {
    [
        run.spread(|session| Some(session.latency_ms.p99)),
        run.spread(|session| Some(session.pixels?.wrong_a_frame())),
        run.spread(|session| Some(session.pixels?.needless_a_frame())),
    ]
}

/// The standard deviation; empty for a single session.
fn deviations(run: &Outcome, written: impl Fn(f64) -> String + Copy) -> [String; 3] {
    spreads(run).map(|spread| spread.and_then(|spread| spread.deviation).map_or_else(String::new, written))
}

fn of(outcomes: &[Outcome], head: &[&str], row: impl Fn(&Outcome) -> Vec<String>) -> String {
    let rows: Vec<Vec<String>> =
        outcomes.iter().map(|run| names(run).into_iter().chain(row(run)).collect()).collect();
    let head: Vec<&str> = ["network", "link", "n", "b"].iter().chain(head).copied().collect();
    table(&head, &rows)
}

fn names(run: &Outcome) -> [String; 4] {
    [run.network.clone(), run.label(), figure(run.nodes), run.batch.to_string()]
}

/// One line per run, with the figures of the tables. Pixels are empty if nothing was drawn, deviations for a
/// single session.
#[must_use]
pub fn runs_csv(outcomes: &[Outcome]) -> String {
    let bytes = BYTES.map(|column| column.key).join(",");
    let mut csv = format!(
        "network,link,cullers,schedule,coding,nodes,batch,seed,frames,p50_ms,p95_ms,p99_ms,p999_ms,waiting_ms,\
         network_ms,or_ms,\
         hc_ms,rvg_ms,frames_per_second,late_at_30,late_at_60,incomplete,{bytes},frames_wrong,wrong_pixels,\
         worst_pixels,needless_triangles,p99_ms_deviation,wrong_pixels_deviation,\
         needless_triangles_deviation\n"
    );
    for run in outcomes {
        let latency = run.latency_ms;
        let figures = [
            latency.p50,
            latency.p95,
            latency.p99,
            latency.p999,
            run.waiting_ms.mean,
            run.network_ms.mean,
            run.occluders_ms.mean,
            run.culling_ms.mean,
            run.drawing_ms.mean,
            run.frames_per_second,
            f64::from(run.late_at_30),
            f64::from(run.late_at_60),
            f64::from(run.incomplete),
        ];
        let bytes = BYTES.map(|column| (column.of)(&run.bytes));
        let figures: Vec<String> = figures.iter().chain(&bytes).map(f64::to_string).collect();
        let figures = figures.join(",");
        // Empty if nothing was drawn: not measured.
        let pixels = run.pixels.map_or_else(
            || ",,,".to_owned(),
            |cost| {
                let (wrong, needless) = (cost.wrong_a_frame(), cost.needless_a_frame());
                format!("{},{wrong},{},{needless}", cost.frames_wrong, cost.worst)
            },
        );
        let apart = deviations(run, |apart| apart.to_string()).join(",");
        csv += &format!("{},{},{figures},{pixels},{apart}\n", key(run), run.frames);
    }
    csv
}

/// The times of each frame's events, in nanoseconds of the run's own clock.
#[must_use]
pub fn frames_csv(outcomes: &[Outcome]) -> String {
    let mut csv = String::from(
        "network,link,cullers,schedule,coding,nodes_mean,batch,seed,frame,nodes,missing,published_ns,asked_ns,taken_ns,fed_ns,\
         occluded_ns,culled_ns,arrived_ns,shown_ns\n",
    );
    for run in outcomes {
        let key = key(run);
        for (frame, times) in run.times.iter().enumerate() {
            let moments = [
                times.published,
                times.asked,
                times.taken,
                times.fed,
                times.occluded,
                times.culled,
                times.arrived,
                times.shown,
            ];
            let moments = moments.map(|at| at.as_nanos().to_string()).join(",");
            csv += &format!("{key},{frame},{},{},{moments}\n", times.nodes, times.missing);
        }
    }
    csv
}

fn key(run: &Outcome) -> String {
    let seeds: Vec<String> = run.seeds.iter().map(u64::to_string).collect();
    let network = run.network.replace([',', '"', '\n'], " ");
    let who = format!("{},{}", run.cullers, run.schedule);
    format!("{network},{},{who},{},{},{},{}", run.label(), run.coding, run.nodes, run.batch, seeds.join(" "))
}
