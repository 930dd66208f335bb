//! `trimaran ping`: round trips over a link of any transport.

use std::{fmt::Write as _, path::PathBuf, sync::Arc, time::Duration};

use clap::Args;
use confique::Config;
use hdrhistogram::Histogram;
use serde::Serialize;
use trimaran::{
    config::{LinkConfig, positive},
    metrics::PathReading,
};
use trimaran_proto::{BatchSize, Goodbye, Identity, Refusal, Role, SceneHash};
use trimaran_transport::{
    ConnectError, Endpoint, Link, Listener, Net, Options, TokioNet, connect,
    probe::{Probe, Reply, answer, probe},
};

use super::{
    Failure,
    args::Coding,
    number, print_json,
    walking::{runtime, stop_on_signal},
};

/// What stands where a session has its scene: peers that ping have none.
const NO_SCENE: SceneHash = SceneHash(u128::from_be_bytes(*b"trimaran ping  \0"));

/// How long a listener waits for its next guest.
const FOR_EVER: Duration = Duration::from_secs(u32::MAX as u64);

/// Longer round trips count as this: an hour, nanoseconds.
const LONGEST_NS: u64 = 3_600_000_000_000;

#[derive(Debug, Args)]
pub(crate) struct PingArgs {
    /// Where, such as `tcp://host:7500`, `udp://host:7500`, `quic://host:7500` or `unix:/path`.
    endpoint: Endpoint,
    /// Listen there and send back what comes, until interrupted: the other end of a ping.
    #[arg(long)]
    answer: bool,
    /// How many round trips.
    #[arg(
        long,
        short,
        value_name = "N",
        default_value_t = 20,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    count: u32,
    /// Seconds from one to the next; 0 sends as soon as the last has come back.
    #[arg(
        long,
        short,
        value_name = "S",
        default_value_t = 0.1,
        value_parser = not_negative,
        allow_negative_numbers = true
    )]
    interval: f64,
    /// Send a frame of so many ids there and back, not a camera.
    #[arg(long, value_name = "N", default_value_t = 0)]
    ids: u32,
    /// How many ids travel in one batch.
    #[arg(
        long,
        value_name = "B",
        default_value_t = 1024,
        value_parser = clap::value_parser!(u16).range(1..=16384)
    )]
    batch: u16,
    /// How this end's ids travel.
    #[arg(long, value_enum, default_value = "plain")]
    coding: Coding,
    /// How long to wait for the other end at the start, and for each camera, seconds.
    #[arg(
        long,
        value_name = "S",
        default_value_t = 5.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    timeout: f64,
    /// This machine's private keys, for transports that encrypt (`trimaran keys new`).
    #[arg(long, value_name = "NAME.key")]
    keys: Option<PathBuf>,
    /// The other end's public keys.
    #[arg(long, value_name = "NAME.pub")]
    peer: Option<PathBuf>,
    #[command(flatten)]
    links: <LinkConfig as Config>::Layer,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// What came of it; times are round trips in microseconds.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Summary {
    endpoint: String,
    /// The ids there and back in each; 0 for a camera.
    ids: u32,
    sent: u32,
    answered: u32,
    /// Frames that came back in part.
    incomplete: u32,
    lost: u32,
    /// Over the lost and the incomplete.
    loss_percent: f64,
    min_us: f64,
    mean_us: f64,
    p50_us: f64,
    p90_us: f64,
    p99_us: f64,
    p999_us: f64,
    max_us: f64,
    /// Mean difference between two round trips that follow each other.
    jitter_us: f64,
    /// The bytes that a round trip took, both ways, this protocol's headers included and those below it not.
    bytes: f64,
    /// Packets and the path, where the transport tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<PathReading>,
}

/// What a ping took.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    /// The bytes of a round trip.
    bytes: f64,
    path: Option<PathReading>,
}

pub(super) fn run(args: &PingArgs) -> Result<(), Failure> {
    let links = LinkConfig::load(args.links.clone()).map_err(Failure::bad_input)?;
    let peer = [("peer", args.peer.as_deref())];
    let guard = links.security(&args.endpoint.clone().into(), args.keys.as_deref(), &peer);
    let guard = guard.map_err(Failure::bad_input)?;
    let mut options = links.options(guard);
    options.link.batch = BatchSize::new(args.batch.into()).map_err(Failure::bad_input)?;
    options.link.coding = args.coding.into();
    let runtime = runtime()?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let stop = stop_on_signal(&runtime);
    if args.answer {
        let answering = keep_answering(&net, &args.endpoint, &options);
        return stop.unless_requested(runtime.handle(), answering).unwrap_or(Ok(()));
    }
    let mut tally = Tally::new().map_err(Failure::broken)?;
    let pinging = ping(args, &net, &options, &mut tally);
    let cost = stop.unless_requested(runtime.handle(), pinging).transpose()?;
    let summary = tally.summary(args, cost.unwrap_or_default());
    if args.json {
        return print_json(&summary);
    }
    print!("{}{}", tally.histogram(), summary.text());
    Ok(())
}

/// Serves one guest after the other.
async fn keep_answering(net: &Arc<dyn Net>, at: &Endpoint, options: &Options) -> Result<(), Failure> {
    let identity = Identity { role: Role::SwitchA, scene: NO_SCENE, settings: None };
    let mut listener = Listener::bind(net, at, identity, options).await.map_err(Failure::bad_input)?;
    eprintln!("trimaran: answers pings on {}", listener.local_endpoint());
    loop {
        let link = listener.accept(net.now().after(FOR_EVER)).await.map_err(Failure::broken)?;
        let guest = link.peer.address;
        tracing::info!(%guest, "came");
        match answer(link).await {
            Ok(_) => tracing::info!(%guest, "left"),
            Err(e) => tracing::warn!(%guest, "{e}"),
        }
    }
}

/// Pings; says what it took.
async fn ping(
    args: &PingArgs,
    net: &Arc<dyn Net>,
    options: &Options,
    tally: &mut Tally,
) -> Result<Cost, Failure> {
    let timeout = Duration::from_secs_f64(args.timeout);
    let identity = Identity { role: Role::Display, scene: NO_SCENE, settings: None };
    let begun = net.now();
    let mut link: Link = connect(net, &args.endpoint, identity, options, begun.after(timeout))
        .await
        .map_err(|e| refused(&e).unwrap_or_else(|| Failure::bad_input(e)))?;
    if !args.json {
        let took = microseconds(net.now().since(begun));
        println!("{} at {}: linked in {} us", args.endpoint, link.peer.address, number(took as u64));
    }
    let before = link.stats.read();
    let plan =
        Probe { count: args.count, interval: Duration::from_secs_f64(args.interval), ids: args.ids, timeout };
    probe(&mut link, net, plan, |reply| tally.add(reply)).await.map_err(Failure::broken)?;
    let carried = link.stats.read() - before;
    let bytes = carried.sent.total_bytes() + carried.received.total_bytes();
    // What the other end makes of the end of the ping is its own business.
    let _left = link.goodbye(Goodbye::Finished).await;
    Ok(Cost { bytes: bytes as f64 / f64::from(args.count), path: carried.path.map(PathReading::from) })
}

/// A role of a session answers no stranger: that is worth saying in other words.
fn refused(error: &ConnectError) -> Option<Failure> {
    let ConnectError::Refused { refusal: Refusal::Scene { .. } | Refusal::RoleTaken { .. }, .. } = error
    else {
        return None;
    };
    Some(Failure::bad_input(
        "the link works, but a role of a session listens there, and it answers its own session only: \
         run `trimaran ping --answer` on another port",
    ))
}

/// Round trips, counted.
struct Tally {
    /// Nanoseconds.
    times: Histogram<u64>,
    incomplete: u32,
    lost: u32,
    last: Option<Duration>,
    /// Sum of the differences between neighbours, and how many.
    differences: (Duration, u32),
}

impl Tally {
    fn new() -> Result<Self, hdrhistogram::CreationError> {
        let times = Histogram::new_with_bounds(1, LONGEST_NS, 3)?;
        Ok(Self { times, incomplete: 0, lost: 0, last: None, differences: (Duration::ZERO, 0) })
    }

    fn add(&mut self, reply: Reply) {
        let took = match reply {
            Reply::Whole(took) => took,
            Reply::Incomplete(took) => {
                self.incomplete += 1;
                took
            }
            Reply::Lost => {
                self.lost += 1;
                self.last = None;
                return;
            }
        };
        self.times.saturating_record(u64::try_from(took.as_nanos()).unwrap_or(u64::MAX));
        if let Some(last) = self.last {
            self.differences.0 += took.abs_diff(last);
            self.differences.1 += 1;
        }
        self.last = Some(took);
    }

    fn summary(&self, args: &PingArgs, Cost { bytes, path }: Cost) -> Summary {
        let answered = u32::try_from(self.times.len()).unwrap_or(u32::MAX);
        let sent = answered + self.lost;
        let at = |quantile| self.times.value_at_quantile(quantile) as f64 / 1e3;
        Summary {
            endpoint: args.endpoint.to_string(),
            ids: args.ids,
            sent,
            answered,
            incomplete: self.incomplete,
            lost: self.lost,
            loss_percent: 100.0 * f64::from(self.lost + self.incomplete) / f64::from(sent.max(1)),
            min_us: self.times.min() as f64 / 1e3,
            mean_us: self.times.mean() / 1e3,
            p50_us: at(0.5),
            p90_us: at(0.9),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: self.times.max() as f64 / 1e3,
            jitter_us: microseconds(self.differences.0) / f64::from(self.differences.1.max(1)),
            bytes,
            path,
        }
    }

    /// A bar for each doubling of time.
    fn histogram(&self) -> String {
        const WIDTH: u64 = 50;
        let doublings: Vec<(u64, u64)> = self
            .times
            .iter_log(1000, 2.0)
            .map(|step| (step.value_iterated_to() + 1, step.count_since_last_iteration()))
            .skip_while(|(_, count)| *count == 0)
            .collect();
        let most = doublings.iter().map(|(_, count)| *count).max().unwrap_or(0).max(1);
        let mut text = String::new();
        for (below, count) in doublings {
            let bar = "#".repeat((count * WIDTH).div_ceil(most) as usize);
            let _infallible =
                writeln!(text, "{:>12} us  {count:>8}  {bar}", format!("< {}", number(below / 1000)));
        }
        text
    }
}

impl Summary {
    fn text(&self) -> String {
        let Self { sent, answered, incomplete, lost, loss_percent, .. } = self;
        let what =
            if self.ids == 0 { "a camera".to_owned() } else { format!("{} ids", number(self.ids.into())) };
        let parts = if *incomplete > 0 { format!(", {incomplete} of them in part") } else { String::new() };
        let path = self.path.as_ref().map(path_line).unwrap_or_default();
        format!(
            "{what} there and back: {sent} sent, {answered} answered{parts}, {lost} lost ({loss_percent:.1} %), {:.0} bytes each\n\
             min {:.1}  mean {:.1}  p50 {:.1}  p90 {:.1}  p99 {:.1}  p99.9 {:.1}  max {:.1}  jitter {:.1} us\n{path}",
            self.bytes,
            self.min_us,
            self.mean_us,
            self.p50_us,
            self.p90_us,
            self.p99_us,
            self.p999_us,
            self.max_us,
            self.jitter_us
        )
    }
}

/// The path in one line.
fn path_line(path: &PathReading) -> String {
    let PathReading { packets_sent, packets_received, packets_lost, parts_repeated, .. } = path;
    let PathReading { repair_sent, frames_repaired, probes, path_mtu, round_trip_ms, .. } = path;
    format!(
        "packets: {packets_sent} sent, {packets_received} received, {packets_lost} lost; {parts_repeated} parts repeated, \
         {repair_sent} repair sent, {frames_repaired} frames repaired, {probes} probes; path: {path_mtu} bytes a datagram, \
         {round_trip_ms:.2} ms, window {} bytes\n",
        number(path.window_bytes)
    )
}

fn microseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e6
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..1e6).contains(&seconds) => Ok(seconds),
        _ => Err("give seconds, 0 or more".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(replies: &[Reply]) -> Tally {
        let mut tally = Tally::new().unwrap();
        replies.iter().for_each(|reply| tally.add(*reply));
        tally
    }

    fn args() -> PingArgs {
        use clap::Parser;
        #[derive(Parser)]
        struct Only {
            #[command(flatten)]
            ping: PingArgs,
        }
        Only::parse_from(["ping", "tcp://host:1"]).ping
    }

    #[test]
    fn times_losses_and_jitter_are_told() {
        let whole = |us| Reply::Whole(Duration::from_micros(us));
        let replies =
            [whole(100), whole(300), Reply::Lost, whole(200), Reply::Incomplete(Duration::from_micros(250))];
        let tally = tally(&replies);
        let summary = tally.summary(&args(), Cost { bytes: 152.0, path: None });
        assert_eq!((summary.sent, summary.answered, summary.incomplete, summary.lost), (5, 4, 1, 1));
        assert_eq!(summary.loss_percent, 40.0);
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-3;
        assert!(near(summary.min_us, 100.0) && near(summary.max_us, 300.0), "{summary:?}");
        assert!(near(summary.mean_us, 212.5) && near(summary.p50_us, 200.0), "{summary:?}");
        // 200 between the first two, 50 between the last two; not across the lost one.
        assert!(near(summary.jitter_us, 125.0), "{summary:?}");
        let text = summary.text();
        assert!(
            text.contains("5 sent, 4 answered, 1 of them in part, 1 lost (40.0 %), 152 bytes each"),
            "{text}"
        );
    }

    #[test]
    fn a_histogram_has_a_bar_for_each_doubling() {
        let replies: Vec<Reply> =
            [3, 3, 3, 3, 30].iter().map(|us| Reply::Whole(Duration::from_micros(*us))).collect();
        let text = tally(&replies).histogram();
        let lines: Vec<&str> = text.lines().collect();
        assert!(
            lines[0].contains("< 4 us") && lines[0].ends_with(&format!("4  {}", "#".repeat(50))),
            "{text}"
        );
        assert!(lines[3].ends_with(&format!("1  {}", "#".repeat(13))), "{text}");
        assert_eq!(tally(&[Reply::Lost]).histogram(), "");
    }

    #[test]
    fn nothing_answered_is_no_division_by_zero() {
        let summary = tally(&[Reply::Lost]).summary(&args(), Cost::default());
        assert_eq!((summary.answered, summary.loss_percent, summary.jitter_us), (0, 100.0, 0.0));
    }
}
