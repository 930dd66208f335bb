//! Statistics of round trips.

use std::{fmt::Write as _, time::Duration};

use hdrhistogram::Histogram;
use serde::Serialize;
use trimaran::metrics::PathReading;
use trimaran_transport::Endpoint;

use super::probe::Reply;

use crate::cli::number;

/// Longer round trips count as this: an hour, nanoseconds.
const LONGEST_NS: u64 = 3_600_000_000_000;

/// Round trips, counted.
pub(super) struct Tally {
    /// Nanoseconds.
    times: Histogram<u64>,
    incomplete: u32,
    lost: u32,
    last: Option<Duration>,
    /// Sum of the differences between neighbours, and their number.
    differences: (Duration, u32),
}

/// The cost of a ping.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cost {
    /// The bytes of a round trip.
    pub(super) bytes: f64,
    pub(super) path: Option<PathReading>,
}

/// The result; times are round trips in microseconds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Summary {
    endpoint: String,
    /// The ids there and back in each; 0 for a camera.
    ids: u32,
    sent: u32,
    answered: u32,
    /// Frames that came back in part.
    incomplete: u32,
    lost: u32,
    /// Lost and incomplete round trips.
    loss_percent: f64,
    min_us: f64,
    mean_us: f64,
    p50_us: f64,
    p90_us: f64,
    p99_us: f64,
    p999_us: f64,
    max_us: f64,
    /// Mean difference between consecutive round trips.
    jitter_us: f64,
    /// The bytes of a round trip, both ways, with this protocol's headers, without those of lower layers.
    bytes: f64,
    /// Packets and the path, if the transport reports them.
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<PathReading>,
}

impl Tally {
    /// Without any round trip yet.
    pub(super) fn new() -> Result<Self, hdrhistogram::CreationError> {
        let times = Histogram::new_with_bounds(1, LONGEST_NS, 3)?;
        Ok(Self { times, incomplete: 0, lost: 0, last: None, differences: (Duration::ZERO, 0) })
    }

    /// Counts one more.
    pub(super) fn add(&mut self, reply: Reply) {
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

    /// The statistics of all of them.
    pub(super) fn summary(&self, endpoint: &Endpoint, ids: u32, Cost { bytes, path }: Cost) -> Summary {
        let answered = u32::try_from(self.times.len()).unwrap_or(u32::MAX);
        let sent = answered + self.lost;
        let at = |quantile| self.times.value_at_quantile(quantile) as f64 / 1e3;
        Summary {
            endpoint: endpoint.to_string(),
            ids,
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
    pub(super) fn histogram(&self) -> String {
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
    /// In two lines, or three if the transport reports its packets.
    pub(super) fn text(&self) -> String {
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

pub(super) fn microseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(replies: &[Reply]) -> Tally {
        let mut tally = Tally::new().unwrap();
        replies.iter().for_each(|reply| tally.add(*reply));
        tally
    }

    fn summary(tally: &Tally, cost: Cost) -> Summary {
        tally.summary(&"tcp://host:1".parse().unwrap(), 0, cost)
    }

    #[test]
    fn times_losses_and_jitter_are_told() {
        let whole = |us| Reply::Whole(Duration::from_micros(us));
        let replies =
            [whole(100), whole(300), Reply::Lost, whole(200), Reply::Incomplete(Duration::from_micros(250))];
        let tally = tally(&replies);
        let summary = summary(&tally, Cost { bytes: 152.0, path: None });
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
        let summary = summary(&tally(&[Reply::Lost]), Cost::default());
        assert_eq!((summary.answered, summary.loss_percent, summary.jitter_us), (0, 100.0, 0.0));
    }
}
