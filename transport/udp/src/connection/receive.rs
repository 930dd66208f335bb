//! Arriving packets, and the acknowledgements in them.

use std::time::Duration;

use trimaran_net::Instant;

use super::units::Units;
use super::{Closed, Connection};
use crate::chunk::{Asks, CLOSE, Chunk};
use crate::packet::{ConnectionId, Packet, ResetToken};
use crate::peer_path::Arrival;
use crate::recovery::{Content, Verdict};
use crate::reset::same;
use crate::wire::Reader;

/// This many packets that fail to open end a connection: with more an attacker could forge one (RFC 9001,
/// section 6.6, for ChaCha20-Poly1305).
const FORGED: u64 = 1 << 36;

impl Connection {
    /// Takes a datagram for this connection. Packets that fail to open, are repeated, or belong elsewhere are
    /// ignored.
    pub fn handle(&mut self, now: Instant, datagram: &[u8]) {
        self.receive(now, None, datagram);
    }

    pub(super) fn receive(&mut self, now: Instant, arrival: Option<Arrival>, datagram: &[u8]) {
        let (to, number, sealed) = match Packet::parse(datagram) {
            Ok(Packet::Data { to, number, sealed }) => (to, number, sealed),
            Ok(Packet::Reset { unknown, token }) => return self.reset(unknown, token),
            _ => return,
        };
        let over = matches!(self.closed, Some(Closed::Peer | Closed::Forged));
        if to != self.here || over || !self.acks.is_new(number) {
            return;
        }
        let mut plain = std::mem::take(&mut self.plain);
        if self.keys.open(to, number, sealed, &mut plain) {
            self.last_received = now;
            self.received += 1;
            self.received_bytes += datagram.len() as u64;
            self.confirmed = true;
            if let Some(answered) = self.answered.take() {
                self.guess_round_trip(now.since(answered));
            }
            self.locate(now, arrival, self.acks.is_newest(number));
            if self.closed.is_some() {
                // The close was lost, unless this one crossed it: two ends that answer each other's close
                // would never stop.
                self.close_due = plain != [CLOSE];
                self.acks.on_received(now, number, Asks::Nothing, self.config.ack_delay);
                self.plain = plain;
                return;
            }
            match self.take_chunks(now, arrival, &plain) {
                Ok(Some(asks)) => self.acks.on_received(now, number, asks, self.config.ack_delay),
                Ok(None) => self.acks.on_refused(number),
                Err(why) => self.end(why),
            }
        } else {
            self.forged += 1;
            if self.forged >= FORGED {
                self.end(Closed::Forged);
            }
        }
        self.plain = plain;
    }

    /// Takes a reset, if it is about this connection and its sender knows the token.
    fn reset(&mut self, unknown: ConnectionId, token: &ResetToken) {
        if unknown == self.there && self.reset_token.is_some_and(|expected| same(&expected, token)) {
            self.end(Closed::Reset);
        }
    }

    /// Returns the acknowledgement that the packet asks for; `None` if it must not get one, because not all
    /// of it could be taken.
    fn take_chunks(
        &mut self,
        now: Instant,
        arrival: Option<Arrival>,
        plain: &[u8],
    ) -> Result<Option<Asks>, Closed> {
        let mut reader = Reader::new(plain);
        let (mut asks, mut taken) = (Asks::Nothing, true);
        while !reader.is_empty() {
            let chunk = Chunk::read(&mut reader, &self.config.format)?;
            asks = asks.max(chunk.asks());
            match chunk {
                Chunk::Pad | Chunk::Ping => {}
                Chunk::Challenge { .. } | Chunk::Response { .. } => {
                    self.take_path_chunk(now, arrival, &chunk);
                }
                Chunk::Ack { delay_us, numbers } => {
                    let delay = Duration::from_micros(delay_us);
                    let in_flight = self.recovery.in_flight();
                    let verdict =
                        self.recovery.on_ack(now, &numbers, delay).map_err(|_| Closed::NeverSent)?;
                    if let Some((latest, least)) = self.recovery.rtt.latest_and_least() {
                        let acknowledged = in_flight.saturating_sub(self.recovery.in_flight());
                        self.scavenger.on_ack(now, acknowledged, in_flight, latest, least);
                    }
                    self.judge(now, verdict);
                }
                Chunk::MaxData { lane, bytes, units } => self.units_mut(lane).outbox.allow(bytes, units),
                Chunk::Close => return Err(Closed::Peer),
                Chunk::Latest { channel, number, value } => self.latest_in_mut(channel).put(number, value),
                Chunk::LastLatest { channel, number, close } => {
                    self.latest_in_mut(channel).put_end(number, close).map_err(|_| Closed::Reason)?;
                }
                Chunk::StopSending { lane } => self.units_mut(lane).on_stop(),
                Chunk::Part { lane, unit, offset, tail, data } => {
                    self.units_mut(lane).inbox.put(unit, offset, tail, data)?;
                }
                Chunk::GiveUp { lane, unit, about, head } => {
                    self.units_mut(lane).inbox.give_up(unit, about, head)?;
                }
                Chunk::Repair { lane, unit, block, hash, index, data } => {
                    taken &= self.units_mut(lane).inbox.put_repair(unit, block, hash, index, data)?;
                }
            }
        }
        self.frame_lanes_mut().for_each(Units::discard_unread);
        self.messages.discard_unread();
        self.bulk.discard_unread();
        Ok(taken.then_some(asks))
    }

    pub(super) fn judge(&mut self, now: Instant, mut verdict: Verdict) {
        for content in verdict.lost {
            match content {
                Content::Part { lane, unit, range, ended } => {
                    self.units_mut(lane).outbox.on_loss(unit, range, ended);
                }
                Content::Latest { channel, number } => self.latest_out_mut(channel).on_value_lost(number),
                Content::LastLatest { channel } => self.latest_out_mut(channel).on_end_lost(),
                Content::MaxData { lane } => self.units_mut(lane).max_data_due = true,
                Content::StopSending { lane } => self.units_mut(lane).stop_sending_due = true,
                Content::GiveUp { lane, unit } => self.units_mut(lane).outbox.on_give_up_loss(unit),
                Content::Repair { lane, unit, offset, index } => {
                    self.units_mut(lane).outbox.on_repair_loss(unit, offset, index);
                }
                Content::Probe { size } => self.mtu.on_lost(now, size),
            }
        }
        for content in verdict.arrived.drain(..) {
            match content {
                Content::Part { lane, unit, range, ended } => {
                    self.units_mut(lane).outbox.on_ack(unit, range, ended);
                }
                Content::Latest { channel, number } => self.latest_out_mut(channel).on_value_arrived(number),
                Content::LastLatest { channel } => self.latest_out_mut(channel).on_end_arrived(),
                Content::GiveUp { lane, unit } => self.units_mut(lane).outbox.on_give_up_ack(unit),
                Content::Probe { size } => {
                    self.mtu.on_arrived(now, size);
                    self.resize();
                }
                Content::Repair { lane, unit, offset, index } => {
                    self.units_mut(lane).outbox.on_repair_ack(unit, offset, index);
                }
                Content::MaxData { .. } | Content::StopSending { .. } => {}
            }
        }
        self.recovery.reuse(verdict.arrived);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chunk::UnitLane;
    use crate::connection::tests::{HERE, acknowledged, connection, now, sealed};
    use crate::repair::Block;
    use crate::samples::FORMAT;

    #[test]
    fn forged_resets_end_nothing() {
        let (there, token) = (ConnectionId(20), [7; 16]);
        let mut connection = connection();
        let take = |connection: &mut Connection, unknown, token: &ResetToken| {
            let mut datagram = Vec::new();
            Packet::Reset { unknown, token }.write(&mut datagram);
            connection.handle(now(), &datagram);
        };
        take(&mut connection, there, &[0; 16]);
        assert_eq!(connection.closed(), None, "it has no token at all");
        connection.resets_with(token);
        for at in 0..token.len() {
            let mut forged = token;
            forged[at] ^= 1;
            take(&mut connection, there, &forged);
        }
        take(&mut connection, HERE, &token);
        connection.handle(now(), &[0xff; 27]);
        assert_eq!(connection.closed(), None);
        take(&mut connection, there, &token);
        assert_eq!(connection.closed(), Some(&Closed::Reset));
        let mut out = Vec::new();
        assert!(!connection.poll_transmit(now(), &mut out), "nobody is there to be told");
    }

    #[test]
    fn a_packet_that_there_was_no_place_for_is_taken_once_and_not_acknowledged() {
        let mut connection = connection();
        let data = [7; 100];
        for number in 0..257 {
            let block = Block { offset: number * 6400, length: 6400, shard: 100, count: 2 };
            let chunk =
                Chunk::Repair { lane: UnitLane::Frames, unit: 0, block, hash: None, index: 0, data: &data };
            connection.handle(now(), &sealed(number, &chunk));
        }
        let block = Block { offset: 0, length: 6400, shard: 100, count: 2 };
        let refused = sealed(
            257,
            &Chunk::Repair { lane: UnitLane::Frames, unit: 0, block, hash: None, index: 1, data: &data },
        );
        connection.handle(now(), &refused);
        assert_eq!((connection.stats().received, connection.acks.is_new(257)), (258, false));
        connection.handle(now().after(Duration::from_secs(1)), &refused);
        assert_eq!((connection.stats().received, connection.last_received), (258, now()), "a replay");
        let mut out = Vec::new();
        assert!(connection.poll_transmit(now().after(Duration::from_secs(1)), &mut out));
        let Ok(Packet::Data { sealed, .. }) = Packet::parse(&out) else { panic!("{out:?}") };
        let chunk = Chunk::read(&mut Reader::new(sealed), &FORMAT);
        let Ok(Chunk::Ack { numbers, .. }) = chunk else { panic!("{chunk:?}") };
        assert_eq!((numbers.len(), numbers.iter().next()), (1, Some(0..256)));
    }

    #[test]
    fn who_acknowledges_everything_without_having_received_it_is_let_go() {
        let mut connection = connection();
        connection.follow(([192, 0, 2, 1], 4000).into(), [7; 32]);
        let mut out = Vec::new();
        for _ in 0..100 {
            connection.ping();
            assert!(connection.poll_transmit(now(), &mut out));
        }
        assert!(connection.recovery.next_number() > connection.stats().sent, "no number was left out");
        let all = acknowledged(0..connection.recovery.next_number());
        connection.handle(now(), &sealed(0, &all));
        assert_eq!(connection.closed(), Some(&Closed::NeverSent));
    }

    #[test]
    fn too_many_packets_that_do_not_open_end_the_connection() {
        let mut connection = connection();
        connection.forged = FORGED - 2;
        let mut forged = sealed(0, &Chunk::Ping);
        forged[12] ^= 1;
        connection.handle(now(), &forged);
        assert_eq!((connection.closed(), connection.stats().forged), (None, FORGED - 1));
        connection.handle(now(), &sealed(0, &Chunk::Ping));
        assert_eq!(connection.stats().received, 1, "forgeries end nothing before");
        connection.handle(now(), &sealed(0, &Chunk::Ping));
        assert_eq!(connection.stats().forged, FORGED - 1, "a replay is no forgery");
        forged[0] = 4;
        connection.handle(now(), &forged);
        assert_eq!(connection.closed(), Some(&Closed::Forged));
        connection.handle(now(), &sealed(2, &Chunk::Ping));
        assert_eq!(connection.stats().received, 1, "nothing is opened any more");
    }
}
