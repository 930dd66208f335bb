//! How a simulated session went.

use std::collections::BTreeMap;
use std::ops::Sub;
use std::time::Duration;

use serde::Serialize;
use trimaran_netsim::{Class, FrameLoad, WireTally};
use trimaran_transport::{Instant, Traffic};

use super::{Scenario, Transport};

/// The header that the paper counts around each packet: TCP, IP and Ethernet, 50 bytes (section 3.3).
const PAPER_HEADER: f64 = 50.0;

/// When what happened to a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameTimes {
    /// How many ids it has.
    pub nodes: u32,
    /// Its camera left RVG.
    pub published: Instant,
    /// OR waits for the ids of the frame before, with the camera in its hand.
    pub taken: Instant,
    /// They are there, and OR draws them.
    pub fed: Instant,
    /// OR is complete, and HC begins.
    pub occluded: Instant,
    /// HC has found the last id.
    pub culled: Instant,
    /// The frame's end is at the display.
    pub arrived: Instant,
    /// The picture is shown.
    pub shown: Instant,
}

/// How a session went.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The network's name.
    pub network: String,
    /// What joined the roles.
    pub link: Transport,
    /// How many ids a batch had: the paper's `b`.
    pub batch: usize,
    /// How many frames were shown.
    pub frames: u32,
    /// The seed.
    pub seed: u64,
    /// The mean number of ids a frame: the paper's `n`.
    pub nodes: f64,
    /// Frames a second, from the first picture to the last.
    pub frames_per_second: f64,
    /// From a camera leaving RVG to its picture shown, milliseconds.
    pub latency_ms: Percentiles,
    /// Of that: the camera on its way, and waiting for its machine.
    pub camera_ms: Percentiles,
    /// Of that: OR waiting for the last ids of the frame before, and drawing.
    pub occluders_ms: Percentiles,
    /// Of that: HC.
    pub culling_ms: Percentiles,
    /// Of that: from HC's last id to the frame's end at the display: the network, and the display busy with the frame before.
    pub network_ms: Percentiles,
    /// Of that: RVG.
    pub drawing_ms: Percentiles,
    /// Pictures that came more than a thirtieth of a second after the one before.
    pub late_at_30: u32,
    /// The same for a sixtieth.
    pub late_at_60: u32,
    /// Bytes a frame, from the first camera to the last picture.
    pub bytes: FrameBytes,
    /// A hash of when, between whom and how large every packet was.
    pub trace_hash: String,
    /// When what happened to each frame.
    #[serde(skip)]
    pub times: Vec<FrameTimes>,
}

/// A distribution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Percentiles {
    /// Half are at most this.
    pub p50: f64,
    /// 95 of a hundred are.
    pub p95: f64,
    /// 99 of a hundred are.
    pub p99: f64,
    /// 999 of a thousand are.
    pub p999: f64,
}

/// Bytes a frame over all links, as machines sent them, by what they were.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameBytes {
    /// All of them.
    pub total: f64,
    /// Ids, 4 bytes each.
    pub ids: f64,
    /// The other messages, and the headers of all of them.
    pub messages: f64,
    /// What the transport carries beside messages: in datagrams its own headers, acknowledgements, repetitions and seals; in TCP
    /// repetitions.
    pub transport: f64,
    /// The headers of TCP or UDP.
    pub transport_headers: f64,
    /// Those of IP.
    pub ip_headers: f64,
    /// What Ethernet, or whatever is there, adds.
    pub link_layer: f64,
    /// Packets a frame.
    pub packets: f64,
    /// Of all bytes, those in packets of TCP that only acknowledge.
    pub acknowledgements: f64,
    /// Of all bytes, those in packets of TCP that repeat data.
    pub repetitions: f64,
    /// The paper's formula `8 (nh/b) + 3 (72 + h)`, with its `h` of 50.
    pub paper: f64,
    /// What the same terms come to when ids and headers are added: `2 (4n + hn/b) + 3 (72 + h)`.
    pub corrected: f64,
}

/// What was sent in a time.
#[derive(Debug, Clone, Default)]
pub(super) struct Sent {
    pub(super) wire: BTreeMap<Class, WireTally>,
    pub(super) messages: Traffic,
}

impl Sent {
    pub(super) fn add(&mut self, class: Class, tally: WireTally) {
        *self.wire.entry(class).or_default() += tally;
    }
}

impl Sub for Sent {
    type Output = Self;

    fn sub(mut self, earlier: Self) -> Self {
        for (class, tally) in &mut self.wire {
            *tally = *tally - earlier.wire.get(class).copied().unwrap_or_default();
        }
        self.messages = self.messages - earlier.messages;
        self
    }
}

impl Outcome {
    pub(super) fn new(scenario: &Scenario, times: Vec<FrameTimes>, sent: Sent, trace_hash: u64) -> Self {
        let Scenario { network, link, batch, frames, seed, workload } = scenario;
        let nodes = workload.mean_nodes(*frames);
        let gaps: Vec<Duration> = times.windows(2).filter_map(gap).collect();
        let total: Duration = gaps.iter().sum();
        let late = |limit: f64| gaps.iter().filter(|gap| gap.as_secs_f64() > limit).count() as u32;
        let span = |from: fn(&FrameTimes) -> Instant, to: fn(&FrameTimes) -> Instant| {
            Percentiles::of(
                times.iter().map(|frame| to(frame).since(from(frame)).as_secs_f64() * 1e3).collect(),
            )
        };
        Self {
            network: network.name.clone(),
            link: *link,
            batch: batch.ids(),
            frames: *frames,
            seed: *seed,
            nodes,
            frames_per_second: if total.is_zero() { 0.0 } else { gaps.len() as f64 / total.as_secs_f64() },
            latency_ms: span(|f| f.published, |f| f.shown),
            camera_ms: span(|f| f.published, FrameTimes::in_hand),
            occluders_ms: span(FrameTimes::in_hand, |f| f.occluded),
            culling_ms: span(|f| f.occluded, |f| f.culled),
            network_ms: span(|f| f.culled, |f| f.arrived),
            drawing_ms: span(|f| f.arrived, |f| f.shown),
            late_at_30: late(1.0 / 30.0),
            late_at_60: late(1.0 / 60.0),
            bytes: FrameBytes::of(&sent, nodes, batch.ids(), *frames),
            trace_hash: format!("{trace_hash:016x}"),
            times,
        }
    }
}

fn gap(pair: &[FrameTimes]) -> Option<Duration> {
    let [before, after] = pair else { return None };
    Some(after.shown.since(before.shown))
}

impl FrameTimes {
    /// When OR began to wait for ids; the first frame has none to wait for.
    fn in_hand(&self) -> Instant {
        if self.taken < self.published { self.fed } else { self.taken }
    }
}

impl Percentiles {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        // The smallest value that so many are not above.
        let at = |share: f64| {
            let rank = (share * values.len() as f64).ceil() as usize;
            values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Self { p50: at(0.5), p95: at(0.95), p99: at(0.99), p999: at(0.999) }
    }
}

impl FrameBytes {
    fn of(sent: &Sent, nodes: f64, batch: usize, frames: u32) -> Self {
        let all = sent.wire.values().fold(WireTally::default(), |all, tally| all + *tally);
        let of = |class| sent.wire.get(&class).map_or(0, WireTally::bytes);
        let each = |bytes: u64| bytes as f64 / f64::from(frames.max(1));
        let ids = sent.messages.ids.bytes;
        let load = FrameLoad { ids: nodes, batch: batch as f64, header: PAPER_HEADER };
        Self {
            total: each(all.bytes()),
            ids: each(ids),
            messages: each(sent.messages.total_bytes().saturating_sub(ids)),
            transport: each(all.payload.saturating_sub(sent.messages.total_bytes())),
            transport_headers: each(all.transport_headers),
            ip_headers: each(all.ip_headers),
            link_layer: each(all.link_layer),
            packets: each(all.packets),
            acknowledgements: each(of(Class::Acknowledgement)),
            repetitions: each(of(Class::Retransmission)),
            paper: load.paper_bytes(),
            corrected: load.sent_bytes(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_occurred() {
        let values = (1..=1000).rev().map(f64::from).collect();
        let expected = Percentiles { p50: 500.0, p95: 950.0, p99: 990.0, p999: 999.0 };
        assert_eq!(Percentiles::of(values), expected);
        assert_eq!(Percentiles::of(vec![7.0]).p999, 7.0);
        assert_eq!(Percentiles::of(Vec::new()).p50, 0.0);
    }
}
