//! Frames as a whole.

use std::collections::VecDeque;
use std::time::Duration;

use trimaran_net::Instant;
use trimaran_wire::{Batch, FrameEnd, FrameEvent, FrameOutcome, FrameStart, Protocol};

use crate::stats::Skipped;

/// A complete frame.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct WholeFrame<P: Protocol> {
    /// Its number and header.
    pub start: FrameStart<P::Header>,
    /// Its items, in the batches in which they came.
    pub batches: Vec<Batch<P::Item>>,
    /// Its totals.
    pub end: FrameEnd,
    /// The time between the arrival of its begin and the return of this frame to its reader. The way from the
    /// sender is not part of it: the clocks of two machines differ.
    pub age: Duration,
    /// The frames between the last returned one and this one that were not returned.
    pub skipped: Skipped,
}

impl<P: Protocol> WholeFrame<P> {
    /// The items in the order in which they were pushed.
    pub fn items(&self) -> impl Iterator<Item = P::Item> + '_ {
        self.batches.iter().flat_map(Batch::iter)
    }
}

/// A complete frame that waits for its reader.
#[derive(Debug)]
pub(super) struct Arrived<P: Protocol> {
    start: FrameStart<P::Header>,
    batches: Vec<Batch<P::Item>>,
    end: FrameEnd,
    begun: Instant,
}

impl<P: Protocol> Arrived<P> {
    pub(super) const fn age(&self, now: Instant) -> Duration {
        now.since(self.begun)
    }

    pub(super) fn returned(self, now: Instant, skipped: Skipped) -> WholeFrame<P> {
        let age = self.age(now);
        let Self { start, batches, end, .. } = self;
        WholeFrame { start, batches, end, age, skipped }
    }

    /// Its begin, and the events that follow.
    pub(super) fn into_events(self) -> (FrameEvent<P>, VecDeque<FrameEvent<P>>) {
        let Self { start, batches, end, .. } = self;
        let end = FrameEvent::End(FrameOutcome::Complete(end));
        let others = batches.into_iter().map(FrameEvent::Batch).chain([end]).collect();
        (FrameEvent::Begin(start), others)
    }
}

/// Puts a frame's events together.
#[derive(Debug)]
pub(super) struct Gathering<P: Protocol>(Option<Begun<P>>);

/// A frame's start, its items so far, and when it began.
type Begun<P> = (FrameStart<<P as Protocol>::Header>, Vec<Batch<<P as Protocol>::Item>>, Instant);

/// The result of an event.
pub(super) enum Gathered<P: Protocol> {
    /// The frame is not over, or its begin was not seen.
    Part,
    /// The frame is complete.
    Whole(Arrived<P>),
    /// The frame lacks items.
    Incomplete,
}

impl<P: Protocol> Default for Gathering<P> {
    fn default() -> Self {
        Self(None)
    }
}

impl<P: Protocol> Gathering<P> {
    /// Takes the event that has come at this time.
    pub(super) fn take(&mut self, event: FrameEvent<P>, now: Instant) -> Gathered<P> {
        match event {
            FrameEvent::Begin(start) => self.0 = Some((start, Vec::new(), now)),
            FrameEvent::Batch(batch) => {
                if let Some((_, batches, _)) = &mut self.0 {
                    batches.push(batch);
                }
            }
            FrameEvent::End(outcome) => match (outcome, self.0.take()) {
                (FrameOutcome::Complete(end), Some((start, batches, begun))) => {
                    return Gathered::Whole(Arrived { start, batches, end, begun });
                }
                (FrameOutcome::Incomplete { .. }, Some(_)) => return Gathered::Incomplete,
                (_, None) => {}
            },
        }
        Gathered::Part
    }
}
