//! Counts of a connection's packets, and the state of its path.

use std::time::Duration;

use super::Connection;
use super::units::Units;
use crate::outbox::Outbox;

/// Packets and the path as seen by one end: counts since it was made, and the present state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PathStats {
    /// Packets sent, with any contents.
    pub sent: u64,
    /// Their bytes, without the headers of UDP and IP.
    pub sent_bytes: u64,
    /// Packets of the peer that arrived, without duplicates.
    pub received: u64,
    /// Their bytes, without the headers of UDP and IP.
    pub received_bytes: u64,
    /// Packets for this connection that failed to open: damaged on the path, or forged.
    pub forged: u64,
    /// Packets that were sent and found lost. Probes for larger datagrams are not counted.
    pub lost: u64,
    /// Parts of frames, messages and blocks that were retransmitted.
    pub repeated: u64,
    /// Repair shards that were sent.
    pub repair_sent: u64,
    /// Frames of the peer that are complete only because of repair.
    pub frames_repaired: u64,
    /// Frames sent from here that were given up, because they could not arrive in time.
    pub frames_given_up: u64,
    /// Probes sent because nothing was acknowledged for a timeout.
    pub probes: u64,
    /// The largest datagram known to arrive, bytes.
    pub datagram_size: usize,
    /// The smoothed round-trip time; 100 ms before it is measured.
    pub round_trip: Duration,
    /// How many bytes may be in flight (the congestion window).
    pub window: usize,
    /// The bytes in flight.
    pub in_flight: usize,
    /// Whether the deadline of frames sent from here is shorter than the one-way delay
    /// ([`Connection::deadline_too_short`]).
    pub deadline_too_short: bool,
}

impl PathStats {
    /// The counts since `earlier`, and the present state.
    #[must_use]
    pub const fn since(&self, earlier: &Self) -> Self {
        Self {
            sent: self.sent.saturating_sub(earlier.sent),
            sent_bytes: self.sent_bytes.saturating_sub(earlier.sent_bytes),
            received: self.received.saturating_sub(earlier.received),
            received_bytes: self.received_bytes.saturating_sub(earlier.received_bytes),
            forged: self.forged.saturating_sub(earlier.forged),
            lost: self.lost.saturating_sub(earlier.lost),
            repeated: self.repeated.saturating_sub(earlier.repeated),
            repair_sent: self.repair_sent.saturating_sub(earlier.repair_sent),
            frames_repaired: self.frames_repaired.saturating_sub(earlier.frames_repaired),
            frames_given_up: self.frames_given_up.saturating_sub(earlier.frames_given_up),
            probes: self.probes.saturating_sub(earlier.probes),
            ..*self
        }
    }
}

/// The frames' deadline is shorter than the one-way delay: hardly any can arrive complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeadlineTooShort {
    /// The deadline of a frame ([`Config::frame_deadline`](crate::Config::frame_deadline)).
    pub deadline: Duration,
    /// The least one-way delay: half of the shortest round trip.
    pub way: Duration,
}

/// The most steps that a byte of the peer's packets costs ([`Connection::work`]).
pub const STEPS_PER_BYTE: u64 = 320;
/// The most steps that a packet costs beside its bytes: its contents are looked at once its arrival or loss
/// is known.
pub const STEPS_PER_PACKET: u64 = 64;

impl Connection {
    /// Whether the deadline of frames sent from here ends before anything can arrive; known once the path was
    /// measured.
    #[must_use]
    pub fn deadline_too_short(&self) -> Option<DeadlineTooShort> {
        let (deadline, way) = (self.frames.outbox.frame_deadline?, self.recovery.rtt.least_one_way()?);
        (way >= deadline).then_some(DeadlineTooShort { deadline, way })
    }

    /// The cost of the peer's packets so far, in steps: eight bytes copied, cleared or computed on, or one
    /// look-up. At most [`STEPS_PER_BYTE`] for each byte received and [`STEPS_PER_PACKET`] for each packet
    /// sent or received.
    #[must_use]
    pub fn work(&self) -> u64 {
        self.frame_lanes().map(Units::work).sum::<u64>()
            + self.messages.work()
            + self.bulk.work()
            + self.recovery.visited
    }

    /// The counts of packets, and the state of the path.
    #[must_use]
    pub fn stats(&self) -> PathStats {
        let recovery = &self.recovery;
        let sent =
            |count: fn(&Outbox) -> u64| self.frame_lanes().map(|lane| count(&lane.outbox)).sum::<u64>();
        PathStats {
            sent: recovery.sent(),
            sent_bytes: self.sent_bytes,
            received: self.received,
            received_bytes: self.received_bytes,
            forged: self.forged,
            lost: recovery.lost_packets,
            repeated: sent(|frames| frames.repeated)
                + self.messages.outbox.repeated
                + self.bulk.outbox.repeated,
            repair_sent: sent(|frames| frames.repair_sent),
            frames_repaired: self.frame_lanes().map(|lane| lane.inbox.frames_repaired).sum(),
            frames_given_up: sent(|frames| frames.frames_given_up),
            probes: recovery.all_probes,
            datagram_size: self.mtu.known(),
            round_trip: recovery.rtt.smoothed(),
            window: recovery.window.window(),
            in_flight: recovery.in_flight(),
            deadline_too_short: self.deadline_too_short().is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use trimaran_wire::{FrameMessage, FrameNumber};

    use super::*;
    use crate::chunk::{Chunk, Tail, UnitLane};
    use crate::connection::tests::{acknowledged, connection, now, sealed};
    use crate::samples::value;

    #[test]
    fn counts_since_then_are_differences_and_the_state_is_that_of_now() {
        let counts = |one: u64| PathStats {
            sent: one,
            sent_bytes: 2 * one,
            received: 3 * one,
            received_bytes: 4 * one,
            forged: 5 * one,
            lost: 6 * one,
            repeated: 7 * one,
            repair_sent: 8 * one,
            frames_repaired: 9 * one,
            frames_given_up: 10 * one,
            probes: 11 * one,
            ..PathStats::default()
        };
        let before = PathStats { datagram_size: 1200, in_flight: 5, ..counts(4) };
        let after = PathStats { datagram_size: 1452, ..counts(10) };
        assert_eq!(after.since(&before), PathStats { datagram_size: 1452, ..counts(6) });
        assert_eq!(before.since(&after), PathStats { datagram_size: 1200, in_flight: 5, ..counts(0) });
    }

    #[test]
    fn what_is_received_costs_the_same_on_each_lane() {
        let work = UnitLane::ALL.map(|lane| {
            let mut connection = connection();
            let data = &[7; 80];
            let part = Chunk::Part { lane, unit: 0, offset: 0, tail: Tail::More, data };
            connection.handle(now(), &sealed(0, &part));
            connection.work()
        });
        assert!(work[0] >= 80 / 8 && work == [work[0]; 3], "{work:?}");
    }

    #[test]
    fn what_is_sent_again_counts_on_each_lane() {
        for lane in UnitLane::ALL {
            let (mut connection, mut out) = (connection(), Vec::new());
            match lane {
                UnitLane::Messages => connection.say(Bytes::from_static(b"stop")),
                UnitLane::Bulk => connection.carry(Bytes::from_static(b"tile")),
                _ => connection.send(&FrameMessage::Begin { frame: FrameNumber(0), header: value(0) }),
            }
            assert!(connection.poll_transmit(now(), &mut out));
            for _ in 0..3 {
                connection.ping();
                assert!(connection.poll_transmit(now(), &mut out));
            }
            connection.handle(now(), &sealed(0, &acknowledged(1..4)));
            assert_eq!((connection.stats().lost, connection.stats().repeated), (1, 0), "{lane:?}");
            assert!(connection.poll_transmit(now(), &mut out));
            assert_eq!((connection.stats().lost, connection.stats().repeated), (1, 1), "{lane:?}");
        }
    }
}
