//! The pending chunks of a unit.

use super::{GivingUp, Repair, Unit};
use crate::chunk::{Chunk, Tail, UnitLane, part_overhead};
use crate::recovery::Content;

impl Unit {
    /// Whether it has something to send that needs no flow control.
    pub(in crate::outbox) fn is_due(&self) -> bool {
        if let Some(given_up) = &self.given_up {
            return given_up.due;
        }
        let all_sent = !self.has_fresh();
        !self.lost.is_empty() || all_sent && (self.is_end_due() || !self.repair.is_empty())
    }

    /// Whether it has bytes not sent yet.
    pub(in crate::outbox) fn has_fresh(&self) -> bool {
        self.given_up.is_none() && self.sent < self.written()
    }

    /// Whether it never gets unsent bytes again.
    pub(in crate::outbox) fn is_all_sent(&self) -> bool {
        !self.has_fresh() && self.is_ended()
    }

    /// Whether the end must be sent by itself. An end whose bytes may be restored waits for their outcome.
    fn is_end_due(&self) -> bool {
        let waits = self.waiting.iter().next_back().is_some_and(|range| range.end == self.written());
        self.end_due && !waits
    }

    /// Writes the pending chunk; returns its content and the number of bytes sent for the first time.
    pub(in crate::outbox) fn write(
        &mut self,
        (lane, number): (UnitLane, u64),
        allowed: u64,
        room: usize,
        whole: usize,
        out: &mut Vec<u8>,
    ) -> Option<(Content, u64)> {
        if let Some(GivingUp { about, head, due }) = &mut self.given_up {
            let chunk = Chunk::GiveUp { lane, unit: number, about: *about, head };
            write_if_fits(&chunk, room, out)?;
            *due = false;
            return Some((Content::GiveUp { lane, unit: number }, 0));
        }
        let written = self.written();
        let overhead = part_overhead(lane, number, written);
        let fresh = (written - self.sent).min(allowed);
        let lost = self.lost.iter().next();
        let wanted = match lost {
            Some(range) => range,
            None if fresh > 0 => self.sent..self.sent + fresh,
            None if self.is_end_due() => self.sent..self.sent,
            None => return self.write_repair((lane, number), room, out).map(|content| (content, 0)),
        };
        let shard = self.shard as u64;
        let wanted = wanted.start..wanted.end.min((wanted.start / shard + 1) * shard);
        let most = room.checked_sub(overhead)? as u64;
        let size = wanted.end - wanted.start;
        let fits_alone = size as usize + overhead <= whole;
        if size > most && (fits_alone || most < self.item as u64) {
            return None;
        }
        let now = if size > most { most - most % self.item as u64 } else { size };
        let range = wanted.start..wanted.start + now;
        self.lost.remove(&range);
        let first_time = range.end.saturating_sub(self.sent);
        self.sent = self.sent.max(range.end);
        let last = range.end == written;
        let tail = if last { self.end.unwrap_or(Tail::Pause) } else { Tail::More };
        let ended = last && self.end.is_some();
        self.end_due &= !ended;
        let from = range.start.saturating_sub(self.base) as usize;
        let to = range.end.saturating_sub(self.base) as usize;
        let data = self.data.get(from..to).unwrap_or_default();
        Chunk::Part { lane, unit: number, offset: range.start, tail, data }.write(out);
        Some((Content::Part { lane, unit: number, range, ended }, first_time))
    }

    fn write_repair(
        &mut self,
        (lane, number): (UnitLane, u64),
        room: usize,
        out: &mut Vec<u8>,
    ) -> Option<Content> {
        let Repair { block, hash, index, data } = self.repair.front()?;
        let chunk = Chunk::Repair { lane, unit: number, block: *block, hash: *hash, index: *index, data };
        write_if_fits(&chunk, room, out)?;
        let content = Content::Repair { lane, unit: number, offset: block.offset, index: *index };
        self.repair.pop_front();
        Some(content)
    }
}

/// Writes `chunk` if it fits.
fn write_if_fits(chunk: &Chunk<'_>, room: usize, out: &mut Vec<u8>) -> Option<()> {
    let before = out.len();
    chunk.write(out);
    if out.len() - before > room {
        out.truncate(before);
        return None;
    }
    Some(())
}
