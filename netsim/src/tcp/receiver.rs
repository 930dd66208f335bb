//! The receiving half: order, the window, and when to acknowledge.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use bytes::{Buf, Bytes};
use trimaran_net::Instant;

use super::delayed_ack::DelayedAck;
use super::segment::{MOST_SACKS, Range, Segment};

/// Linux's `tcp_rmem`: the initial and the largest buffer.
const BUFFER: u32 = 131_072;
const BUFFER_MAX: u32 = 6_291_456;
/// The first window that Linux offers with that buffer.
const FIRST_WINDOW: u32 = 64_240;

#[derive(Debug, Default)]
pub(super) struct Receiver {
    /// The next expected sequence number.
    pub(super) next: u64,
    ready: VecDeque<Bytes>,
    ready_bytes: u32,
    /// Data out of order, by sequence number; no two pieces overlap.
    ahead: BTreeMap<u64, Bytes>,
    ahead_bytes: u32,
    /// The ranges of the newest of those, the latest first.
    recent: Vec<Range>,
    /// A duplicate range, to be reported once (RFC 2883).
    duplicate: Option<Range>,
    /// Where the peer's stream ends.
    fin: Option<u64>,
    /// How far the peer may send. This never shrinks.
    promised: u64,
    acknowledged: u64,
    /// Half of the buffer: the other half pays for the bookkeeping.
    space: u32,
    /// The window grows up to here as data comes.
    threshold: u32,
    /// Whether the buffer grows with the program's reads.
    grows: bool,
    measure: Measure,
    segment: u32,
    pub(super) acks: DelayedAck,
    /// An acknowledgement must be sent.
    pub(super) ack_now: bool,
}

/// How much the program reads in a round trip.
#[derive(Debug, Default)]
struct Measure {
    since: Instant,
    read: u64,
    largest: u64,
}

impl Receiver {
    /// A receiver that waits for byte `next`. `buffer` fixes the buffer; without it, it grows.
    pub(super) fn new(next: u64, segment: u32, buffer: Option<usize>) -> Self {
        // Linux doubles the requested size, and offers half of its buffer.
        let asked = buffer.map(|bytes| u32::try_from(bytes).unwrap_or(u32::MAX).min(BUFFER_MAX));
        let space = asked.unwrap_or(BUFFER / 2);
        let threshold = space.min(FIRST_WINDOW);
        Self {
            next,
            promised: next + u64::from(threshold),
            acknowledged: next,
            space,
            threshold,
            grows: buffer.is_none(),
            measure: Measure { largest: 10 * u64::from(segment), ..Measure::default() },
            segment,
            acks: DelayedAck::new(),
            ..Self::default()
        }
    }

    /// Whether a read would return data or the end.
    pub(super) fn is_readable(&self) -> bool {
        self.ready_bytes > 0 || self.has_ended()
    }

    pub(super) const fn unread(&self) -> u32 {
        self.ready_bytes
    }

    /// Whether all of the peer's stream has come.
    pub(super) fn has_ended(&self) -> bool {
        self.fin.is_some_and(|fin| self.next > fin)
    }

    /// A segment with data or the end came.
    pub(super) fn receive(
        &mut self,
        now: Instant,
        segment: &Segment,
        rto: Duration,
        smoothed: Option<Duration>,
    ) {
        let window = self.window();
        if segment.end() <= self.next {
            if segment.length() > 0 {
                self.duplicate = Some(Range { from: segment.seq, to: segment.end() });
                self.acks.out_of_order(window);
            }
            self.ack_now = true;
            return;
        }
        if segment.seq >= self.promised {
            self.ack_now = true; // a probe of a closed window, or nonsense
            return;
        }
        if segment.fin {
            self.fin = Some(segment.end() - 1);
        }
        let bytes = segment.data.len() as u32;
        let push = segment.fin || bytes < self.segment;
        if segment.seq > self.next {
            self.put_ahead(segment);
            self.acks.out_of_order(window);
            self.ack_now = true;
            return;
        }
        let had_gap = !self.ahead.is_empty();
        let known = (self.next - segment.seq) as usize;
        self.take(segment.data.get(known..).map(|_| segment.data.slice(known..)).unwrap_or_default());
        self.take_from_ahead();
        if self.fin == Some(self.next) {
            self.next += 1;
            self.ack_now = true;
        }
        self.acks.received(now, bytes, push, window, rto);
        if self.threshold < self.space {
            self.threshold = (self.threshold + 2 * self.segment).min(self.space);
        }
        self.ack_now |= had_gap || self.acks.wants_now(now, self.next - self.acknowledged, smoothed);
    }

    fn take(&mut self, data: Bytes) {
        self.next += data.len() as u64;
        self.ready_bytes += data.len() as u32;
        if !data.is_empty() {
            self.ready.push_back(data);
        }
    }

    fn take_from_ahead(&mut self) {
        while let Some(entry) = self.ahead.first_entry() {
            if *entry.key() > self.next {
                break;
            }
            let (seq, data) = entry.remove_entry();
            self.ahead_bytes -= data.len() as u32;
            let known = ((self.next - seq) as usize).min(data.len());
            self.take(data.slice(known..));
        }
        self.recent.retain(|range| range.to > self.next);
    }

    fn put_ahead(&mut self, segment: &Segment) {
        if segment.data.is_empty() {
            return;
        }
        let mut range = Range { from: segment.seq, to: segment.seq + segment.data.len() as u64 };
        let known = |from: u64, to: u64| self.recent.iter().any(|r| r.from <= from && to <= r.to);
        if known(range.from, range.to) {
            self.duplicate = Some(range);
            return;
        }
        if self.ahead.insert(segment.seq, segment.data.clone()).is_none() {
            self.ahead_bytes += segment.data.len() as u32;
        }
        // Ranges that touch become one; the newest comes first.
        self.recent.retain(|other| {
            let apart = other.to < range.from || range.to < other.from;
            if !apart {
                range = Range { from: range.from.min(other.from), to: range.to.max(other.to) };
            }
            apart
        });
        self.recent.insert(0, range);
    }

    /// Reads into `buffer` and returns the number of bytes; `rtt` is the round-trip time.
    pub(super) fn read(&mut self, now: Instant, buffer: &mut [u8], rtt: Option<Duration>) -> usize {
        let mut filled = 0;
        while let Some(chunk) = self.ready.front_mut() {
            let Some(rest) = buffer.get_mut(filled..).filter(|rest| !rest.is_empty()) else { break };
            let count = chunk.len().min(rest.len());
            chunk.copy_to_slice(rest.get_mut(..count).unwrap_or_default());
            filled += count;
            if chunk.is_empty() {
                self.ready.pop_front();
            }
        }
        self.ready_bytes -= filled as u32;
        if filled > 0 {
            self.adjust(now, filled as u64, rtt);
            let before = self.window();
            let room = self.room();
            let opens = 2 * before <= self.space && room > 0 && room >= 2 * before;
            let empty = self.ready_bytes == 0;
            self.ack_now |= opens || (empty && self.acks.wants_after_reading(self.next - self.acknowledged));
        }
        filled
    }

    /// Grows the buffer to twice the program's reads in a round trip, so that the window never limits a
    /// sender.
    fn adjust(&mut self, now: Instant, bytes: u64, rtt: Option<Duration>) {
        self.measure.read += bytes;
        let Some(rtt) = rtt.filter(|rtt| now.since(self.measure.since) >= *rtt) else { return };
        let (read, largest) = (self.measure.read, self.measure.largest);
        if self.grows && !rtt.is_zero() && read > largest {
            let wanted = 2 * read + 16 * u64::from(self.segment);
            let wanted = wanted + 2 * (wanted * (read - largest) / largest.max(1));
            let wanted = u32::try_from(wanted).unwrap_or(u32::MAX).min(BUFFER_MAX / 2);
            self.space = self.space.max(wanted);
        }
        self.measure = Measure { since: now, read: 0, largest: largest.max(read) };
    }

    /// The bytes that the peer may still send.
    fn window(&self) -> u32 {
        self.promised.saturating_sub(self.next) as u32
    }

    /// The bytes that there is room for.
    fn room(&self) -> u32 {
        let free = self.space.saturating_sub(self.ready_bytes + self.ahead_bytes);
        let room = free.min(self.threshold);
        // Less than a segment is no room at all.
        if room < self.segment.min(self.space / 2) { 0 } else { room }
    }

    /// Fills in the acknowledgement fields of a segment.
    pub(super) fn acknowledge(&mut self, segment: &mut Segment) {
        self.promised = self.promised.max(self.next + u64::from(self.room()));
        self.acknowledged = self.next;
        segment.ack = Some(self.next);
        segment.window = self.window();
        segment.sacks =
            self.duplicate.take().into_iter().chain(self.recent.iter().copied()).take(MOST_SACKS).collect();
        self.ack_now = false;
        self.acks.sent();
    }
}
