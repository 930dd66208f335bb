//! What arrives: packets, and what acknowledgements say of those that left.

use std::time::Duration;

use trimaran_proto::{Camera, Instant};

use super::{Closed, Connection};
use crate::chunk::{Asks, CLOSE, Chunk};
use crate::packet::Packet;
use crate::recovery::{Content, Verdict};
use crate::whereabouts::Arrival;
use crate::wire::Reader;

impl Connection {
    /// Takes a datagram for this connection. What does not open, came before, or belongs elsewhere is ignored.
    pub fn handle(&mut self, now: Instant, datagram: &[u8]) {
        self.receive(now, None, datagram);
    }

    pub(super) fn receive(&mut self, now: Instant, arrival: Option<Arrival>, datagram: &[u8]) {
        let Ok(Packet::Data { to, number, sealed }) = Packet::parse(datagram) else { return };
        if to != self.here || self.closed == Some(Closed::Peer) || !self.acks.is_new(number) {
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
                // The close was lost, unless this one crossed it: two ends that answer each other's would never stop.
                self.close_due = plain != [CLOSE];
                self.acks.on_received(now, number, Asks::Nothing, self.config.ack_delay);
                self.plain = plain;
                return;
            }
            match self.take_chunks(now, arrival, &plain) {
                Ok(Some(asks)) => self.acks.on_received(now, number, asks, self.config.ack_delay),
                Ok(None) => {}
                Err(why) => self.end(why),
            }
        }
        self.plain = plain;
    }

    /// Says what acknowledgement the packet asks for; nothing if it must not get one, for not all of it could be taken.
    fn take_chunks(
        &mut self,
        now: Instant,
        arrival: Option<Arrival>,
        plain: &[u8],
    ) -> Result<Option<Asks>, Closed> {
        let mut reader = Reader::new(plain);
        let (mut asks, mut taken) = (Asks::Nothing, true);
        while !reader.is_empty() {
            let chunk = Chunk::read(&mut reader)?;
            asks = asks.max(chunk.asks());
            match chunk {
                Chunk::Pad | Chunk::Ping => {}
                Chunk::Challenge { .. } | Chunk::Response { .. } => {
                    self.take_path_chunk(now, arrival, &chunk);
                }
                Chunk::Ack { delay_us, numbers } => {
                    let delay = Duration::from_micros(delay_us);
                    let verdict =
                        self.recovery.on_ack(now, &numbers, delay).map_err(|_| Closed::NeverSent)?;
                    self.judge(now, verdict);
                }
                Chunk::Credit { bytes, units } => self.outbox.allow(bytes, units),
                Chunk::Close => return Err(Closed::Peer),
                Chunk::Camera { number, camera } => {
                    let camera = Camera::from_bytes(&camera).map_err(|_| Closed::Camera)?;
                    self.cameras_in.put(number, camera);
                }
                Chunk::LastCamera { number, goodbye } => {
                    self.cameras_in.put_end(number, goodbye).map_err(|_| Closed::Camera)?;
                }
                Chunk::Unread => {
                    self.unheard = true;
                    self.outbox.drop_all();
                }
                Chunk::Part { unit, offset, tail, data } => self.inbox.put(unit, offset, tail, data)?,
                Chunk::GiveUp { unit, about, head } => self.inbox.give_up(unit, about, head)?,
                Chunk::Repair { unit, block, hash, index, data } => {
                    taken &= self.inbox.put_repair(unit, block, hash, index, data)?;
                }
            }
        }
        if self.unread {
            self.credit_due |= self.inbox.discard();
        }
        Ok(taken.then_some(asks))
    }

    pub(super) fn judge(&mut self, now: Instant, mut verdict: Verdict) {
        for content in verdict.lost {
            match content {
                Content::Part { unit, range, ended } => self.outbox.on_loss(unit, range, ended),
                Content::Camera { number } => self.cameras_out.on_camera_lost(number),
                Content::LastCamera => self.cameras_out.on_end_lost(),
                Content::Credit => self.credit_due = true,
                Content::Unread => self.unread_due = true,
                Content::GiveUp { unit } => self.outbox.on_give_up_loss(unit),
                Content::Repair { unit, offset, index } => self.outbox.on_repair_loss(unit, offset, index),
                Content::Probe { size } => self.mtu.on_lost(now, size),
            }
        }
        for content in verdict.arrived.drain(..) {
            match content {
                Content::Part { unit, range, ended } => self.outbox.on_ack(unit, range, ended),
                Content::Camera { number } => self.cameras_out.on_camera_arrived(number),
                Content::LastCamera => self.cameras_out.on_end_arrived(),
                Content::GiveUp { unit } => self.outbox.on_give_up_ack(unit),
                Content::Probe { size } => {
                    self.mtu.on_arrived(now, size);
                    self.resize();
                }
                Content::Repair { unit, offset, index } => self.outbox.on_repair_ack(unit, offset, index),
                Content::Credit | Content::Unread => {}
            }
        }
        self.recovery.reuse(verdict.arrived);
    }
}
