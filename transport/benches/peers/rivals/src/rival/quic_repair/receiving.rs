//! The receiver's frames: what has come, and what to ask for.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use bytes::Bytes;
use reed_solomon_simd::decode;
use trimaran_net::Instant;

use super::wire::{ALL, Report, Shard, Status};
use crate::meter::frame_number;

/// The most reports of a status.
const MOST: usize = 64;

/// A frame that is incomplete.
#[derive(Debug)]
struct Frame {
    shards: BTreeMap<u8, Shard>,
    first: Instant,
    /// When to ask for what is missing: nothing has come for a while.
    ask: Instant,
    /// Nothing that was sent at first is on its way any more.
    is_over: bool,
    /// How many shards were asked for.
    asked: usize,
}

impl Frame {
    fn new(now: Instant) -> Self {
        Self { shards: BTreeMap::new(), first: now, ask: now, is_over: false, asked: 0 }
    }

    /// The number of shards after the last one that came, counted from the first.
    fn judged(&self) -> usize {
        self.shards.last_key_value().map_or(0, |(last, _)| usize::from(*last) + 1)
    }

    fn report(&self) -> Report {
        let came = self.shards.keys().fold(0, |came, index| came | 1 << *index);
        Report { came, judged: if self.is_over { ALL } else { self.judged() as u8 } }
    }

    /// The bytes of the frame, if there are enough shards.
    fn restore(&self) -> Option<Vec<u8>> {
        let any = self.shards.values().next()?;
        let (data, length) = (any.data, any.length as usize);
        let original = || self.shards.iter().filter(|(index, _)| **index < data);
        if original().count() == usize::from(data) {
            return Some(original().map(|(_, shard)| &shard.bytes[..]).collect::<Vec<_>>().concat());
        }
        let size = self.shards.values().map(|shard| shard.bytes.len()).max()?;
        let pad = |shard: &Shard| {
            let mut bytes = shard.bytes.to_vec();
            bytes.resize(size, 0);
            bytes
        };
        let mut parts: BTreeMap<usize, Vec<u8>> =
            original().map(|(index, shard)| (usize::from(*index), pad(shard))).collect();
        let repair = self.shards.iter().filter(|(index, _)| **index >= data);
        let repair = repair.map(|(index, shard)| (usize::from(*index - data), shard.bytes.to_vec()));
        let here = parts.clone();
        parts.extend(decode(data.into(), any.repair.into(), here, repair).ok()?);
        let mut bytes: Vec<u8> = parts.into_values().flatten().collect();
        bytes.truncate(length);
        Some(bytes)
    }
}

#[derive(Debug)]
pub(super) struct Receiving {
    frames: BTreeMap<u32, Frame>,
    /// All frames before this one are done, and so are these.
    below: u32,
    beyond: BTreeSet<u32>,
    /// One more than the newest frame of which anything has come.
    next: u32,
    deadline: Option<Duration>,
    /// When the last shard came, and how long the pauses within frames are at most, of late.
    last: Option<Instant>,
    pause: Duration,
    /// Frames that are delivered, and whether they are complete.
    pub(super) done: Vec<(u32, bool)>,
    reports: BTreeMap<u32, Report>,
}

impl Receiving {
    pub(super) const fn new(deadline: Option<Duration>) -> Self {
        Self {
            frames: BTreeMap::new(),
            below: 0,
            beyond: BTreeSet::new(),
            next: 0,
            deadline,
            last: None,
            pause: Duration::ZERO,
            done: Vec::new(),
            reports: BTreeMap::new(),
        }
    }

    fn is_done(&self, number: u32) -> bool {
        number < self.below || self.beyond.contains(&number)
    }

    /// A shard has come.
    pub(super) fn shard(&mut self, now: Instant, datagram: Bytes, rtt: Duration) {
        let Some(shard) = Shard::decode(datagram) else { return };
        let number = shard.frame;
        if self.is_done(number) {
            // It was sent again for want of a report.
            self.reports.insert(number, Report { came: u64::MAX, judged: ALL });
            return;
        }
        if number >= self.next {
            // Nothing more of earlier frames is on its way.
            for earlier in self.below.max(number.saturating_sub(64))..number {
                if !self.is_done(earlier) {
                    let frame = self.frames.entry(earlier).or_insert_with(|| Frame::new(now));
                    if !frame.is_over {
                        frame.ask = now;
                    }
                }
            }
            self.next = number + 1;
        }
        let before = self.last.replace(now);
        let frame = self.frames.entry(number).or_insert_with(|| Frame::new(now));
        if !frame.is_over
            && let (Some(before), Some(_)) = (before, frame.shards.last_key_value())
        {
            self.pause = now.since(before).max(self.pause.mul_f64(0.9999));
        }
        let (data, repair) = (usize::from(shard.data), usize::from(shard.repair));
        frame.shards.insert(shard.index, shard);
        if frame.shards.len() >= data {
            let complete = frame.restore().as_deref().and_then(frame_number) == Some(number);
            self.finish(number, complete);
            return;
        }
        if frame.is_over {
            return;
        }
        // More are lost than repair replaces: they are asked for at once. Otherwise more will follow.
        let wanted = (frame.judged() - frame.shards.len()).saturating_sub(repair);
        frame.ask = now.after((rtt / 4).max(self.pause * 2));
        if frame.judged() == data + repair {
            frame.ask = now;
        } else if wanted > frame.asked {
            frame.asked = wanted;
            self.reports.insert(number, frame.report());
        }
    }

    /// When there is something to do.
    pub(super) fn wake(&self) -> Option<Instant> {
        let ask = self.frames.values().map(|frame| frame.ask).min();
        let first = self.frames.values().map(|frame| frame.first).min();
        let give_up = self.deadline.zip(first).map(|(deadline, first)| first.after(deadline));
        ask.into_iter().chain(give_up).min()
    }

    /// Asks for what is missing, and gives frames up.
    pub(super) fn on_time(&mut self, now: Instant, rtt: Duration) {
        for (number, frame) in &mut self.frames {
            if frame.ask <= now {
                frame.is_over = true;
                frame.ask = now.after(rtt * 5 / 4 + Duration::from_millis(2));
                self.reports.insert(*number, frame.report());
            }
        }
        let Some(deadline) = self.deadline else { return };
        let late = self.frames.iter().filter(|(_, frame)| frame.first.after(deadline) <= now);
        let late: Vec<u32> = late.map(|(number, _)| *number).collect();
        late.into_iter().for_each(|number| self.finish(number, false));
    }

    fn finish(&mut self, number: u32, complete: bool) {
        self.done.push((number, complete));
        self.frames.remove(&number);
        self.beyond.insert(number);
        while self.beyond.remove(&self.below) {
            self.below += 1;
        }
        self.reports.insert(number, Report { came: u64::MAX, judged: ALL });
    }

    /// The report that is due, if any.
    pub(super) fn status(&mut self) -> Option<Bytes> {
        if self.reports.is_empty() {
            return None;
        }
        let below = self.below;
        // As many as a datagram has room for.
        let most = self.reports.keys().nth(MOST).copied();
        let later = most.map(|most| self.reports.split_off(&most)).unwrap_or_default();
        let now = std::mem::replace(&mut self.reports, later);
        let frames = now.into_iter().filter(|(number, _)| *number >= below).collect();
        Some(Status { below, frames }.encode())
    }
}
