//! The outcome of a simulated session.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;
use trimaran_actors::{CullerId, Schedule};
use trimaran_proto::DrawableId;
use trimaran_transport::Instant;

use super::bytes::{Account, FrameBytes};
use super::scenario::{Knobs, Scenario, Transport};
use super::statistics::{Percentiles, PixelCost, Spread};

/// The times of a frame's events.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameTimes {
    /// Its culler; none if the display itself culled it.
    pub culler: Option<CullerId>,
    /// How many ids it has.
    pub nodes: u32,
    /// How many of them never reached the display.
    pub missing: u32,
    /// Its camera left RVG.
    pub published: Instant,
    /// Its culler is free, and waits for the camera.
    pub asked: Instant,
    /// The culler has the camera, and OR waits for the ids of the frame before.
    pub taken: Instant,
    /// They are there, and OR draws them.
    pub fed: Instant,
    /// OR is complete, and HC begins.
    pub occluded: Instant,
    /// HC has found the last id.
    pub culled: Instant,
    /// The display, free for it, has the frame's end.
    pub arrived: Instant,
    /// The picture is shown.
    pub shown: Instant,
}

/// How a frame's time divides. The parts add up to the time from its camera leaving RVG to its picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Split {
    /// Waiting for a role that was busy with another frame, or for the other culler's culling.
    pub waiting: Duration,
    /// Waiting for a message under way to a free role.
    pub network: Duration,
    /// OR.
    pub occluders: Duration,
    /// HC.
    pub culling: Duration,
    /// RVG.
    pub drawing: Duration,
}

/// The outcome of a session, or of several that differ only in their seeds.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The network's name.
    pub network: String,
    /// The transport of the links.
    pub link: Transport,
    /// How many cullers there were.
    pub cullers: usize,
    /// The visible set from which they drew their occluders.
    pub schedule: &'static str,
    /// With deadlines: how long after its end a frame might arrive, milliseconds.
    pub deadline_ms: Option<f64>,
    /// With deadlines: whether they end before a frame's end can arrive. Then lost or delayed parts are given
    /// up.
    pub deadline_too_short: bool,
    /// Over `udp`: the most bytes of repair, percent of the frames' own.
    pub repair_percent: Option<u8>,
    /// How ids travelled: `plain` or `changes`.
    pub coding: &'static str,
    /// How many ids a batch had: the paper's `b`.
    pub batch: usize,
    /// How many frames were shown, in all.
    pub frames: u32,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// The mean number of ids a frame: the paper's `n`.
    pub nodes: f64,
    /// Frames a second, from the first picture to the last.
    pub frames_per_second: f64,
    /// From a camera leaving RVG to its picture shown, milliseconds.
    pub latency_ms: Percentiles,
    /// Of that: waiting for a role busy with another frame, or for the culling of the frame before.
    pub waiting_ms: Percentiles,
    /// Of that: waiting for messages under way, the role being free.
    pub network_ms: Percentiles,
    /// Of that: OR.
    pub occluders_ms: Percentiles,
    /// Of that: HC.
    pub culling_ms: Percentiles,
    /// Of that: RVG.
    pub drawing_ms: Percentiles,
    /// Pictures shown more than a thirtieth of a second after the one before.
    pub late_at_30: u32,
    /// The same for a sixtieth.
    pub late_at_60: u32,
    /// Frames that came with gaps.
    pub incomplete: u32,
    /// The effect of the gaps on the pictures, if they were drawn.
    pub pixels: Option<PixelCost>,
    /// Each session by itself, if several were pooled.
    pub sessions: Vec<Session>,
    /// Bytes a frame, from the first camera to the last picture.
    pub bytes: FrameBytes,
    /// A hash per session over the time, ends and size of every packet.
    pub trace_hashes: Vec<String>,
    /// The times of each frame's events.
    #[serde(skip)]
    pub times: Vec<FrameTimes>,
    /// The received ids of each frame that came with gaps.
    #[serde(skip)]
    pub remains: BTreeMap<u32, Vec<DrawableId>>,
    #[serde(skip)]
    account: Account,
}

/// One of several sessions that differ only in their seeds: their spread shows the effect of chance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Session {
    /// Its seed.
    pub seed: u64,
    /// From a camera leaving RVG to its picture shown, milliseconds.
    pub latency_ms: Percentiles,
    /// The effect of its gaps on the pictures, if they were drawn.
    pub pixels: Option<PixelCost>,
}

/// The raw results of a session.
pub(super) struct Ended {
    pub(super) times: Vec<FrameTimes>,
    pub(super) remains: BTreeMap<u32, Vec<DrawableId>>,
    pub(super) account: Account,
    pub(super) trace_hash: u64,
}

impl Outcome {
    pub(super) fn new(scenario: &Scenario, ended: Ended) -> Self {
        let Scenario { network, link, cullers, schedule, batch, frames, seed, workload, knobs, .. } =
            scenario;
        let Ended { times, remains, account, trace_hash } = ended;
        let deadline = (*link == Transport::UdpDeadline).then_some(knobs.deadline);
        let over_udp = matches!(link, Transport::Udp | Transport::UdpDeadline);
        let nothing = Percentiles::of(Vec::new());
        Self {
            network: network.name.clone(),
            link: *link,
            cullers: *cullers,
            schedule: schedule.name(),
            deadline_ms: deadline.map(milliseconds),
            deadline_too_short: scenario.gives_up_everything(),
            repair_percent: over_udp.then_some(knobs.repair_percent),
            coding: knobs.coding.name(),
            batch: batch.items(),
            frames: *frames,
            seeds: vec![*seed],
            nodes: workload.mean_nodes(*frames),
            frames_per_second: 0.0,
            latency_ms: nothing,
            waiting_ms: nothing,
            network_ms: nothing,
            occluders_ms: nothing,
            culling_ms: nothing,
            drawing_ms: nothing,
            late_at_30: 0,
            late_at_60: 0,
            incomplete: 0,
            pixels: None,
            sessions: Vec::new(),
            bytes: FrameBytes::of(&account, 0.0, 1, 1),
            trace_hashes: vec![format!("{trace_hash:016x}")],
            times,
            remains,
            account,
        }
        .summed_up()
    }

    /// Computes the figures from the times and the account.
    fn summed_up(self) -> Self {
        // The time between two sessions' pictures does not count.
        let gaps: Vec<Duration> = self.times.windows(2).filter_map(gap).collect();
        let total: Duration = gaps.iter().sum();
        let late = |limit: f64| gaps.iter().filter(|gap| gap.as_secs_f64() > limit).count() as u32;
        let splits = self.splits();
        let part = |of: fn(&Split) -> Duration| {
            Percentiles::of(splits.iter().map(|split| milliseconds(of(split))).collect())
        };
        Self {
            frames_per_second: if total.is_zero() { 0.0 } else { gaps.len() as f64 / total.as_secs_f64() },
            latency_ms: part(Split::total),
            waiting_ms: part(|split| split.waiting),
            network_ms: part(|split| split.network),
            occluders_ms: part(|split| split.occluders),
            culling_ms: part(|split| split.culling),
            drawing_ms: part(|split| split.drawing),
            late_at_30: late(1.0 / 30.0),
            late_at_60: late(1.0 / 60.0),
            incomplete: self.times.iter().filter(|times| times.missing > 0).count() as u32,
            bytes: FrameBytes::of(&self.account, self.nodes, self.batch, self.receivers()),
            ..self
        }
    }

    /// How many receivers a frame's ids had.
    fn receivers(&self) -> u8 {
        match self.cullers {
            0 => 0,
            _ if self.schedule == Schedule::Switch.name() => 2,
            _ => 1,
        }
    }

    /// How the time of each frame divides.
    #[must_use]
    pub fn splits(&self) -> Vec<Split> {
        let before = std::iter::once(None).chain(self.times.iter().map(Some));
        self.times.iter().zip(before).map(|(times, before)| times.split(before)).collect()
    }

    /// The transport and, if it has several, its mode: its label in a table.
    #[must_use]
    pub fn label(&self) -> String {
        let deadline = self.deadline_ms.map_or_else(String::new, |ms| format!("/{ms}ms"));
        let usual = Knobs::default().repair_percent;
        let repair = self.repair_percent.filter(|percent| *percent != usual);
        let repair = repair.map_or_else(String::new, |percent| format!("/r{percent}"));
        let cullers = match (self.schedule, self.cullers) {
            (schedule, _) if schedule == Schedule::Switch.name() => "/switch".to_owned(),
            (_, 2) => String::new(),
            (_, cullers) => format!("/k{cullers}"),
        };
        format!("{}{cullers}{deadline}{repair}", self.link.name())
    }

    /// The spread of a figure over the sessions; none if one of them lacks it.
    #[must_use]
    pub fn spread(&self, of: impl Fn(&Session) -> Option<f64>) -> Option<Spread> {
        Spread::of(&self.sessions.iter().map(of).collect::<Option<Vec<f64>>>()?)
    }

    /// Lists itself as the only session, unless it has some.
    fn by_itself(mut self) -> Self {
        if let ([seed], true) = (self.seeds.as_slice(), self.sessions.is_empty()) {
            self.sessions.push(Session { seed: *seed, latency_ms: self.latency_ms, pixels: self.pixels });
        }
        self
    }

    /// Whether the two differ only in their seeds.
    fn is_like(&self, other: &Self) -> bool {
        let what = |outcome: &Self| {
            let session = (outcome.cullers, outcome.schedule);
            (outcome.network.clone(), outcome.label(), session, outcome.coding, outcome.batch)
        };
        what(self) == what(other) && self.nodes.to_bits() == other.nodes.to_bits()
    }
}

/// Pools neighbours that differ only in their seeds: their frames become one distribution.
#[must_use]
pub fn pooled(outcomes: &[Outcome]) -> Vec<Outcome> {
    let alone = |alike: &[Outcome]| alike.iter().cloned().map(Outcome::by_itself).reduce(pool);
    outcomes.chunk_by(Outcome::is_like).filter_map(alone).collect()
}

fn pool(mut all: Outcome, more: Outcome) -> Outcome {
    let first = all.frames;
    all.frames += more.frames;
    all.seeds.extend(more.seeds);
    all.trace_hashes.extend(more.trace_hashes);
    all.times.extend(more.times);
    all.remains.extend(more.remains.into_iter().map(|(frame, ids)| (first + frame, ids)));
    all.sessions.extend(more.sessions);
    all.pixels = all.pixels.zip(more.pixels).map(|(one, other)| one + other);
    all.account = all.account + more.account;
    all.summed_up()
}

fn gap(pair: &[FrameTimes]) -> Option<Duration> {
    let [before, after] = pair else { return None };
    (after.shown > before.shown).then(|| after.shown.since(before.shown))
}

impl FrameTimes {
    /// How the frame's time divides; `before` is the frame before it.
    #[must_use]
    pub fn split(&self, before: Option<&Self>) -> Split {
        // A frame without one before it, or the first of another session.
        let before = before.filter(|before| before.shown < self.shown);
        // A display may give a frame up before all of it is culled: the culler's work counts up to that time.
        let by_then = |at: Instant| at.min(self.arrived);
        let free = by_then(self.asked.max(self.published));
        let taken = by_then(self.taken).max(free);
        // The first frame has no ids to wait for.
        let fed = by_then(self.fed).max(taken);
        let occluded = by_then(self.occluded).max(fed);
        let culled = by_then(self.culled).max(occluded);
        let culled_before = before.map_or(taken, |before| before.culled).clamp(taken, fed);
        let display_free = before.map_or(culled, |before| before.shown).clamp(culled, self.arrived);
        Split {
            waiting: free.since(self.published) + culled_before.since(taken) + display_free.since(culled),
            network: taken.since(free) + fed.since(culled_before) + self.arrived.since(display_free),
            occluders: occluded.since(fed),
            culling: culled.since(occluded),
            drawing: self.shown.since(self.arrived),
        }
    }
}

impl Split {
    /// The sum of all parts.
    #[must_use]
    pub fn total(&self) -> Duration {
        self.waiting + self.network + self.occluders + self.culling + self.drawing
    }
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame([published, asked, taken, fed, occluded, culled, arrived, shown]: [u64; 8]) -> FrameTimes {
        let at = Instant::from_nanos;
        FrameTimes {
            culler: None,
            nodes: 10,
            missing: 0,
            published: at(published),
            asked: at(asked),
            taken: at(taken),
            fed: at(fed),
            occluded: at(occluded),
            culled: at(culled),
            arrived: at(arrived),
            shown: at(shown),
        }
    }

    #[test]
    fn a_free_machine_waits_for_the_network_and_a_busy_one_is_waited_for() {
        let before = frame([0, 0, 10, 10, 20, 100, 110, 150]);
        // Its machine is free 30 late and has the camera 5 later. The frame before is culled at 100, and its
        // ids come at 107. The display is free at 150 and has the end at 153.
        let after = frame([20, 50, 55, 107, 117, 140, 153, 160]);
        let ns = Duration::from_nanos;
        let split = after.split(Some(&before));
        let expected = Split {
            waiting: ns(30 + 45 + 10),
            network: ns(5 + 7 + 3),
            occluders: ns(10),
            culling: ns(23),
            drawing: ns(7),
        };
        assert_eq!(split, expected);
        assert_eq!(split.total(), after.shown.since(after.published));
        // The first frame has no ids to wait for.
        let first = frame([0, 0, 10, 10, 20, 100, 110, 150]).split(None);
        assert_eq!((first.waiting, first.network), (ns(0), ns(20)));
    }

    #[test]
    fn a_frame_that_was_given_up_before_it_was_culled_counts_what_was_done_of_it() {
        let before = frame([0, 0, 10, 10, 20, 100, 110, 150]);
        for [taken, fed, occluded, culled] in
            [[55, 60, 70, 300], [55, 60, 250, 300], [55, 230, 250, 300], [220, 230, 250, 300]]
        {
            let given_up = frame([20, 50, taken, fed, occluded, culled, 200, 210]);
            let split = given_up.split(Some(&before));
            assert_eq!(split.total(), given_up.shown.since(given_up.published), "{given_up:?}");
            assert_eq!(split.drawing, Duration::from_nanos(10));
        }
    }
}
