//! Filling packets with pending chunks.

use trimaran_net::Instant;
use trimaran_wire::ChannelNumber;

use super::units::Units;
use super::{Closed, Connection};
use crate::chunk::{Chunk, UnitLane};
use crate::keys::OVERHEAD;
use crate::latest::LatestOut;
use crate::packet::{NUMBERS, data_header};
use crate::recovery::{Content, Contents, Sent, Verdict};
use crate::rtt::GRANULARITY;

/// The bytes of a packet with only a ping.
const QUESTION: usize = 1 + OVERHEAD;
/// The most of these in a round trip.
const QUESTIONS: u32 = 4;

impl Connection {
    /// Writes the next datagram into `out`, which it replaces; false if there is none now.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> bool {
        let mut plain = std::mem::take(&mut self.plain);
        plain.clear();
        let arrival = now.after(self.recovery.rtt.one_way());
        self.frame_lanes_mut().for_each(|frames| frames.outbox.expire(now, arrival));
        let sent = self.write_chunks(now, &mut plain);
        let made = !plain.is_empty() && self.seal(now, &plain, sent, out);
        self.plain = plain;
        if !made && !self.has_data() {
            self.recovery.on_out_of_data();
        }
        made
    }

    /// Fills a packet; returns its contents if it asks for an acknowledgement.
    fn write_chunks(&mut self, now: Instant, plain: &mut Vec<u8>) -> Option<Contents> {
        let all = self.mtu.known() - OVERHEAD;
        if self.closed.is_some() {
            if std::mem::take(&mut self.close_due) {
                Chunk::Close.write(plain);
            }
            return None;
        }
        let mut contents = Contents::new();
        let allowed = self.may_send(now);
        let ack_due = self.acks.due().is_some_and(|due| due <= now);
        let has_data = allowed && self.has_data();
        if (ack_due || has_data || self.pings > 0)
            && let Some(ack) = self.acks.take(now)
        {
            ack.write(plain);
            // This packet leaves anyway.
            for values in self.values_out_mut() {
                values.write_copy(all.saturating_sub(plain.len()), plain, &mut contents);
            }
            if !contents.is_empty() {
                return Some(contents);
            }
        }
        if !allowed {
            if self.question_due().is_some_and(|due| due <= now) {
                Chunk::Ping.write(plain);
                return Some(contents);
            }
            return (!contents.is_empty()).then_some(contents);
        }
        // Where acknowledgements are lost, each second packet asks for one (RFC 9000, section 13.2.2): with
        // one or two a frame, consecutive losses may take all.
        let asks = self.recovery.is_unanswered() && self.recovery.next_number().is_multiple_of(2);
        let ping = self.pings > 0 || has_data && asks;
        if ping {
            self.pings = self.pings.saturating_sub(1);
            Chunk::Ping.write(plain);
        }
        self.frames.write_words(plain, &mut contents);
        self.messages.write_words(plain, &mut contents);
        self.bulk.write_words(plain, &mut contents);
        for channel in &mut self.channels {
            channel.units.write_words(plain, &mut contents);
        }
        for values in self.values_out_mut() {
            values.write(all.saturating_sub(plain.len()), plain, &mut contents);
        }
        // In turn: messages, frames and those of channels do not wait for all data of each other.
        let turns = 2 + self.channels.len() as u64;
        let first = self.recovery.next_number() % turns;
        for turn in (first..turns).chain(0..first) {
            let lane = match turn {
                0 => UnitLane::Messages,
                1 => UnitLane::Frames,
                other => UnitLane::Channel(ChannelNumber((other - 2) as u8)),
            };
            self.units_mut(lane).write(all, plain, &mut contents);
        }
        if self.has_room_for_bulk() {
            self.bulk.write(all, plain, &mut contents);
        }
        if ping {
            return Some(contents);
        }
        if plain.is_empty() && self.may_probe() {
            self.write_probe(now, plain, &mut contents);
        }
        (!contents.is_empty()).then_some(contents)
    }

    /// Fills a packet up to the probed size.
    fn write_probe(&mut self, now: Instant, plain: &mut Vec<u8>, contents: &mut Contents) {
        if let Some(size) = self.mtu.probe(now) {
            Chunk::Ping.write(plain);
            plain.resize(size - OVERHEAD, Chunk::FILLING);
            contents.push(Content::Probe { size });
        }
    }

    /// Whether window and pacer allow a full packet now. A probe may always be sent.
    fn may_send(&mut self, now: Instant) -> bool {
        let due = self.paced_until.take();
        if self.pings > 0 {
            return true;
        }
        let probe = self.mtu.due().is_some_and(|due| due <= now) && self.may_probe();
        if !self.has_data() && !probe || self.recovery.room() < self.mtu.known() {
            return false;
        }
        let ready = self.pacer.ready(now, due, self.recovery.window.window(), self.recovery.rtt.smoothed());
        if ready > now {
            self.paced_until = Some(ready);
        }
        ready <= now
    }

    /// When to send a ping: acknowledgements are lost, and the window has room only for that. It is not a
    /// probe: those exceed the window, and become ever rarer.
    pub(super) fn question_due(&self) -> Option<Instant> {
        let room = self.recovery.room();
        let stuck = self.recovery.is_unanswered() && (QUESTION..self.mtu.known()).contains(&room);
        let pause = self.recovery.rtt.smoothed() / QUESTIONS;
        (stuck && self.has_data()).then(|| self.last_sent.after(pause.max(GRANULARITY)))
    }

    fn has_data(&self) -> bool {
        self.has_precedence() || self.bulk.outbox.has_due() && self.has_room_for_bulk()
    }

    /// Whether anything has priority over blocks.
    fn has_precedence(&self) -> bool {
        self.values_out().any(LatestOut::is_due)
            || self.frame_lanes().any(Units::has_due)
            || self.messages.has_due()
            || self.bulk.has_words_due()
    }

    /// Whether bulk may send: no other lane is due, and the data in flight would not queue.
    fn has_room_for_bulk(&self) -> bool {
        !self.has_precedence() && self.scavenger.allows(self.recovery.in_flight())
    }

    pub(super) fn seal(
        &mut self,
        now: Instant,
        plain: &[u8],
        sent: Option<Contents>,
        out: &mut Vec<u8>,
    ) -> bool {
        let number = self.recovery.next_number();
        out.clear();
        out.extend_from_slice(&data_header(self.there, number));
        if number >= NUMBERS || !self.keys.seal(self.there, number, plain, out) {
            self.closed.get_or_insert(Closed::Exhausted);
            return false;
        }
        self.last_sent = now;
        let bytes = out.len();
        self.sent_bytes += bytes as u64;
        if sent.is_some() {
            self.pacer.on_sent(bytes);
        }
        let lost = self.recovery.on_sent(sent.map(|contents| Sent { at: now, bytes, contents }));
        self.judge(now, Verdict { lost, ..Verdict::default() });
        true
    }
}
