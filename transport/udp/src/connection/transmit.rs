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
            return None;
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bytes::Bytes;
    use trimaran_wire::{FixedBytes, Format};

    use super::*;
    use crate::connection::Config;
    use crate::connection::tests::{HERE, acknowledged, after, connection, now, sealed};
    use crate::pacer::Pacer;
    use crate::packet::{ConnectionId, MIN_DATAGRAM, Packet, TAG};
    use crate::samples::{FORMAT, value};
    use crate::wire::Reader;

    /// The chunks of the next packet but for its filling; none if nothing leaves.
    fn packet(connection: &mut Connection, at: Instant) -> Vec<&'static str> {
        let (mut out, mut chunks) = (Vec::new(), Vec::new());
        if connection.poll_transmit(at, &mut out) {
            let Ok(Packet::Data { sealed, .. }) = Packet::parse(&out) else { panic!("{out:?}") };
            let mut reader = Reader::new(&sealed[..sealed.len() - TAG]);
            while !reader.is_empty() {
                match Chunk::read(&mut reader, &connection.config.format).unwrap() {
                    Chunk::Pad => {}
                    Chunk::Ack { .. } => chunks.push("ack"),
                    Chunk::Ping => chunks.push("ping"),
                    Chunk::Latest { .. } => chunks.push("value"),
                    Chunk::Part { .. } => chunks.push("part"),
                    other => panic!("{other:?}"),
                }
            }
        }
        chunks
    }

    const NOTHING: [&str; 0] = [];
    const WORD: Bytes = Bytes::from_static(b"word");

    #[test]
    fn an_acknowledgement_rides_with_what_leaves_and_else_leaves_late_and_is_not_acknowledged() {
        type Case = (fn(&mut Connection), &'static [&'static str], &'static [&'static str]);
        let cases: [Case; 4] = [
            (|_| {}, &[], &["ack"]),
            (|connection| connection.say(WORD), &["ack", "part"], &[]),
            (Connection::ping, &["ack", "ping"], &[]),
            // The pacer holds the message up.
            (
                |connection| {
                    connection.say(WORD);
                    connection.pacer.on_sent(1 << 20);
                },
                &[],
                &["ack"],
            ),
        ];
        for (prepare, at_once, late) in cases {
            let mut connection = connection();
            let came = Chunk::Latest { channel: None, number: 1, value: &value(1) };
            connection.handle(now(), &sealed(0, &came));
            prepare(&mut connection);
            assert_eq!(packet(&mut connection, now()), at_once);
            let in_flight = connection.stats().in_flight;
            assert_eq!(packet(&mut connection, after(1)), late);
            assert_eq!(connection.stats().in_flight, in_flight);
        }
    }

    /// Packets of 300 bytes, in a window of 2,400.
    #[test]
    fn the_window_must_have_room_for_a_full_packet_or_for_a_question() {
        let value = || FixedBytes::from_elem(7, 270);
        let format = Format { latest: 270, ..FORMAT };
        let config = Config { format, initial_window: 2, ..Config::new(format) };
        let mut connection = Connection::plaintext(now(), HERE, ConnectionId(20), config);
        for _ in 0..5 {
            connection.publish(None, value());
            assert_eq!(packet(&mut connection, now()), ["value"]);
            assert!(connection.poll_timeout() > Some(now()), "nothing more is due");
        }
        connection.publish(None, value());
        assert_eq!(packet(&mut connection, now()), NOTHING, "there is room for 900 bytes");
        let due = connection.recovery.timeout().unwrap();
        connection.handle_timeout(due);
        assert_eq!(packet(&mut connection, due), ["ping", "value"]);
        assert_eq!(packet(&mut connection, due), ["ping"]);
        connection.publish(None, value());
        assert_eq!(packet(&mut connection, due), NOTHING);
        // A quarter of the assumed round trip.
        let question = due.after(Duration::from_millis(25));
        assert_eq!(connection.poll_timeout(), Some(question));
        assert_eq!(packet(&mut connection, question), ["ping"]);
        for (room, has_room) in [(29, true), (28, false)] {
            let bytes = connection.recovery.room() - room;
            connection.recovery.on_sent(Some(Sent { at: question, bytes, contents: Contents::new() }));
            assert_eq!(connection.question_due().is_some(), has_room, "{room} bytes");
        }
    }

    #[test]
    fn nothing_waits_for_the_pacer_if_there_is_nothing_to_send_and_a_probe_leaves_by_itself() {
        let mut connection = connection();
        connection.handle(now(), &sealed(0, &Chunk::Pad));
        connection.pacer.on_sent(1 << 20);
        assert_eq!(packet(&mut connection, now()), NOTHING);
        assert_eq!(connection.poll_timeout(), Some(after(100)), "the first probe is due then");
        connection.pacer = Pacer::new(MIN_DATAGRAM);
        connection.publish(None, value(1));
        assert_eq!(packet(&mut connection, after(100)), ["value"]);
        assert_eq!(packet(&mut connection, after(100)), ["ping"]);
        assert_eq!(packet(&mut connection, after(100)), NOTHING);
        assert_eq!(connection.stats().sent_bytes, 102 + 1452);
    }

    /// A twentieth of the packets is lost, which is too much only for a sender that always has more to send.
    #[test]
    fn losses_shrink_the_window_of_a_sender_that_waits_and_not_of_one_that_has_sent_all() {
        let window = |waits: bool| {
            let mut connection = connection();
            connection.pacer.on_sent(1 << 40);
            if waits {
                connection.say(WORD);
            }
            for round in 0..256 {
                let first = connection.recovery.next_number();
                for _ in 0..20 {
                    let sent = Sent { at: now(), bytes: 29, contents: Contents::new() };
                    connection.recovery.on_sent(Some(sent));
                }
                connection.handle(now(), &sealed(round, &acknowledged(first + 1..first + 20)));
                assert_eq!(packet(&mut connection, now()), NOTHING);
            }
            connection.stats().window
        };
        assert_eq!([true, false].map(window), [16_800, 24_000]);
    }

    /// There is a place for 2,048 packets.
    #[test]
    fn what_a_packet_carried_that_there_is_no_place_for_any_more_is_sent_again() {
        let config = Config { window: 1 << 16, ..Config::new(FORMAT) };
        let mut connection = Connection::plaintext(now(), HERE, ConnectionId(20), config);
        connection.publish(None, value(1));
        assert_eq!(packet(&mut connection, now()), ["value"]);
        let again = (1..3000).find(|_| {
            connection.ping();
            packet(&mut connection, now()).contains(&"value")
        });
        assert_eq!(again, Some(2049));
    }
}
