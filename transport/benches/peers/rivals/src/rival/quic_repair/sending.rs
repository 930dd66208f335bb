//! The sender's frames: their shards, and which are sent again.

use std::collections::BTreeMap;
use std::time::Duration;

use bytes::Bytes;
use quinn::PathStats;
use reed_solomon_simd::encode;
use trimaran_net::Instant;

use super::super::budget::{Budget, Path, Repair};
use super::wire::{HEADER, Report, Shard, Status};

/// quinn's header and tag, the frame's type and length, for the largest packets.
const QUINN: usize = 44;
/// So many packets tell the share of lost ones.
const SAMPLE: f64 = 4000.0;

/// A frame that has not arrived.
struct Frame {
    begun: Instant,
    shards: Vec<Shard>,
    /// When each shard was sent last.
    sent: Vec<Instant>,
    /// When to ask for a report, and how often that was done.
    probe: Instant,
    probes: u32,
}

pub(super) struct Sending {
    frames: BTreeMap<u32, Frame>,
    budget: Budget,
    deadline: Option<Duration>,
    /// Sent and lost packets, where older ones count less; and those of quinn's count so far.
    recent: [f64; 2],
    counted: [u64; 2],
}

impl Sending {
    pub(super) fn new(deadline: Option<Duration>) -> Self {
        let budget = Budget::new(Repair::Auto, 15);
        Self { frames: BTreeMap::new(), budget, deadline, recent: [0.0; 2], counted: [0; 2] }
    }

    /// The share of lost packets.
    fn loss(&mut self, stats: &PathStats) -> f64 {
        let now = [stats.sent_packets, stats.lost_packets];
        for ((recent, counted), now) in self.recent.iter_mut().zip(&mut self.counted).zip(now) {
            *recent += now.saturating_sub(*counted) as f64;
            *counted = now;
        }
        let [sent, lost] = self.recent;
        if sent > SAMPLE {
            self.recent = [SAMPLE, lost * SAMPLE / sent];
        }
        lost / sent.max(1.0)
    }

    /// Sends a new frame.
    pub(super) fn frame(
        &mut self,
        now: Instant,
        number: u32,
        bytes: Vec<u8>,
        stats: &PathStats,
        out: &mut Vec<Bytes>,
    ) {
        let most = (usize::from(stats.current_mtu) - QUINN - HEADER) & !1;
        let path = Path { shard: most, loss: self.loss(stats) };
        let length = bytes.len();
        let size = self.budget.shard(length, path) & !1;
        let repair = self.budget.spend(length, size, path);
        let mut rest = Bytes::from(bytes);
        let mut parts = Vec::new();
        while !rest.is_empty() {
            parts.push(rest.split_to(size.min(rest.len())));
        }
        let data = parts.len();
        if repair > 0 {
            let padded = parts.iter().map(|part| {
                let mut part = part.to_vec();
                part.resize(size, 0);
                part
            });
            parts.extend(encode(data, repair, padded).unwrap_or_default().into_iter().map(Bytes::from));
        }
        let (data, repair, length) = (data as u8, repair as u8, length as u32);
        let shards: Vec<Shard> = (0u8..)
            .zip(parts)
            .map(|(index, bytes)| Shard { frame: number, index, data, repair, length, bytes })
            .collect();
        out.extend(shards.iter().map(Shard::encode));
        let sent = vec![now; shards.len()];
        let probe = now.after(wait(stats.rtt, 0));
        self.frames.insert(number, Frame { begun: now, shards, sent, probe, probes: 0 });
    }

    /// When there is something to do.
    pub(super) fn wake(&self) -> Option<Instant> {
        self.frames.values().map(|frame| frame.probe).min()
    }

    /// Frames of which the receiver says nothing: their last shard again, which it answers.
    pub(super) fn on_time(&mut self, now: Instant, rtt: Duration, is_sent: bool, out: &mut Vec<Bytes>) {
        self.give_up(now, rtt);
        for frame in self.frames.values_mut().filter(|frame| frame.probe <= now) {
            frame.probes += 1;
            frame.probe = now.after(wait(rtt, frame.probes));
            if let (true, Some(shard), Some(sent)) = (is_sent, frame.shards.last(), frame.sent.last_mut()) {
                out.push(shard.encode());
                *sent = now;
            }
        }
    }

    /// The receiver reports.
    pub(super) fn status(
        &mut self,
        now: Instant,
        bytes: &[u8],
        rtt: Duration,
        is_sent: bool,
        out: &mut Vec<Bytes>,
    ) {
        let Some(status) = Status::decode(bytes) else { return };
        self.frames = self.frames.split_off(&status.below);
        self.give_up(now, rtt);
        for (number, Report { came, judged }) in status.frames {
            if came == u64::MAX {
                self.frames.remove(&number);
                continue;
            }
            let Some(frame) = self.frames.get_mut(&number).filter(|_| is_sent) else { continue };
            frame.probes = 0;
            frame.probe = now.after(wait(rtt, 0));
            let begun = frame.begun;
            // A shard that was sent again is on its way for a round trip.
            let counts = |index: usize, sent: Instant| {
                let is_first = sent == begun;
                let on_its_way =
                    if is_first { index >= judged.into() } else { now.since(sent) < rtt * 9 / 10 };
                came >> index & 1 == 1 || on_its_way
            };
            let have = (0..).zip(&frame.sent).filter(|(index, sent)| counts(*index, **sent)).count();
            let data = frame.shards.first().map_or(0, |shard| usize::from(shard.data));
            let missing = frame.shards.iter().zip(&mut frame.sent).enumerate();
            let missing = missing.filter(|(index, (_, sent))| !counts(*index, **sent));
            for (_, (shard, sent)) in missing.take(data.saturating_sub(have)) {
                out.push(shard.encode());
                self.budget.on_repeated(shard.bytes.len());
                *sent = now;
            }
        }
    }

    /// Forgets what cannot arrive in time.
    fn give_up(&mut self, now: Instant, rtt: Duration) {
        if let Some(deadline) = self.deadline {
            self.frames.retain(|_, frame| now.since(frame.begun) + rtt / 2 < deadline);
        }
    }
}

/// How long a report may take.
fn wait(rtt: Duration, probes: u32) -> Duration {
    (rtt * 5 / 4 + Duration::from_millis(4)) * (1 << probes.min(5))
}
