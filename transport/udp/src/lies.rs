//! A peer with valid keys that lies in every field with a size, a count or a number.

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_wire::{FrameMessage, FrameNumber, MAX_BLOCK, MAX_MESSAGE, Message};

use crate::chunk::{Chunk, GivenUp, Tail, UnitLane};
use crate::connection::{Closed, Config, Connection};
use crate::inbox::LaneViolation;
use crate::keys::Keys;
use crate::packet::{ConnectionId, data_header};
use crate::ranges::RangeSet;
use crate::repair::Block;
use crate::samples::{FORMAT, encoded, value};
use crate::wire::Malformed;

const HERE: ConnectionId = ConnectionId(10);
const THERE: ConnectionId = ConnectionId(20);
/// The largest value of a field.
const MOST: u64 = u64::MAX;

fn now() -> Instant {
    Instant::from_nanos(1_000_000_000)
}

/// How a connection that receives `plain` ends, if it does.
fn told(plain: &[u8]) -> Option<Closed> {
    let mut connection = Connection::plaintext(now(), HERE, THERE, Config::new(FORMAT));
    let mut packet = Vec::from(data_header(HERE, 0));
    assert!(Keys::Plaintext.seal(HERE, 0, plain, &mut packet));
    connection.handle(now(), &packet);
    // It still answers, keeps its time and can be read.
    let (mut out, mut at) = (Vec::new(), now());
    for _ in 0..100 {
        while connection.poll_transmit(at, &mut out) {}
        for lane in UnitLane::ALL {
            while connection.recv(lane).is_some() {}
        }
        let Some(due) = connection.poll_timeout() else { break };
        at = at.max(due);
        connection.handle_timeout(at);
        if connection.closed().is_some_and(|why| matches!(why, Closed::Silent(_) | Closed::Deaf(_))) {
            return None;
        }
    }
    connection.closed().cloned()
}

fn lie(chunk: &Chunk<'_>) -> Option<Closed> {
    let mut plain = Vec::new();
    chunk.write(&mut plain);
    told(&plain)
}

fn lane(violation: LaneViolation) -> Option<Closed> {
    Some(Closed::Lane(violation))
}

#[test]
fn acknowledgements_of_what_was_never_sent_end_the_connection() {
    for number in [0, 1, 1 << 40, MOST - 1] {
        let mut numbers = RangeSet::default();
        numbers.insert(number..number + 1);
        for delay_us in [0, MOST] {
            let ack = Chunk::Ack { delay_us, numbers: numbers.clone() };
            assert_eq!(lie(&ack), Some(Closed::NeverSent), "{number}");
        }
    }
}

#[test]
fn places_beyond_what_was_allowed_end_the_connection() {
    let part = |unit, offset, tail| Chunk::Part { lane: UnitLane::Frames, unit, offset, tail, data: b"1234" };
    for (unit, offset) in [(0, MOST), (0, MOST - 3), (0, 1 << 40), (MOST, 0), (1 << 40, 0), (MOST, MOST)] {
        for tail in [Tail::More, Tail::Pause, Tail::End, Tail::Frame(MOST)] {
            let end = lie(&part(unit, offset, tail));
            assert_eq!(end, lane(LaneViolation::FlowControl), "unit {unit}, offset {offset}, {tail:?}");
        }
    }
    let whole = Block { offset: 0, length: 44, shard: 44, count: 1 };
    let repair = |unit, block, hash| {
        let data = vec![0; usize::from(whole.shard)];
        let mut plain = Vec::new();
        Chunk::Repair { lane: UnitLane::Frames, unit, block, hash, index: 0, data: &data }.write(&mut plain);
        told(&plain)
    };
    for hash in [None, Some(MOST)] {
        assert_eq!(repair(MOST, whole, hash), lane(LaneViolation::FlowControl));
        assert_eq!(repair(0, Block { offset: 1 << 40, ..whole }, hash), lane(LaneViolation::FlowControl));
        let malformed = Some(Closed::Malformed(Malformed::Range { what: "block" }));
        assert_eq!(repair(0, Block { offset: MOST, ..whole }, hash), malformed);
        assert_eq!(repair(0, Block { length: u32::MAX, ..whole }, hash), malformed);
        assert_eq!(repair(0, Block { length: 0, ..whole }, hash), malformed);
        assert_eq!(repair(0, Block { count: u8::MAX, ..whole }, hash), malformed);
        assert_eq!(repair(0, Block { shard: 0, ..whole }, hash), malformed);
    }
    for coded in [None, Some(MOST)] {
        for (unit, length, sent) in [(0, MOST, 0), (0, MOST, MOST), (MOST, 88, 84), (0, 1 << 40, 1 << 40)] {
            let about = GivenUp { length, sent, hash: 0, coded };
            let end = lie(&Chunk::GiveUp { lane: UnitLane::Frames, unit, about, head: &[] });
            assert!(matches!(end, Some(Closed::Lane(_))), "unit {unit}, length {length}, {coded:?}: {end:?}");
        }
    }
}

#[test]
fn a_unit_on_the_wrong_lane_ends_the_connection() {
    let unit = encoded(&Message::Message(Bytes::from_static(b"stop")));
    let block = encoded(&Message::Block(Bytes::from_static(b"tile")));
    let begin = FrameMessage::Begin { frame: FrameNumber(0), header: value(0) };
    let begin = encoded(&Message::Frame(begin));
    let long = encoded(&Message::Message(vec![0; MAX_MESSAGE + 1].into()));
    let long_block = encoded(&Message::Block(vec![0; MAX_BLOCK + 1].into()));
    let part = |lane, data| Chunk::Part { lane, unit: 0, offset: 0, tail: Tail::End, data };
    for (right, data) in [(UnitLane::Messages, &unit), (UnitLane::Bulk, &block)] {
        assert_eq!(lie(&part(right, data)), None, "{right:?}");
    }
    for (wrong, data) in [
        (UnitLane::Frames, &unit),
        (UnitLane::Frames, &block),
        (UnitLane::Messages, &begin),
        (UnitLane::Messages, &block),
        (UnitLane::Bulk, &unit),
        (UnitLane::Bulk, &begin),
    ] {
        assert_eq!(lie(&part(wrong, data)), lane(LaneViolation::Unit), "{wrong:?}");
    }
    for end in [lie(&part(UnitLane::Messages, &long)), lie(&part(UnitLane::Bulk, &long_block))] {
        assert!(matches!(end, Some(Closed::Lane(LaneViolation::Decode(_)))), "{end:?}");
    }
    // These lanes have windows of their own.
    for own in [UnitLane::Messages, UnitLane::Bulk] {
        let end = lie(&Chunk::Part { lane: own, unit: 0, offset: 1 << 20, tail: Tail::More, data: b"1" });
        assert_eq!(end, lane(LaneViolation::FlowControl), "{own:?}");
    }
}

#[test]
fn lengths_beyond_the_packet_end_the_connection() {
    let lying = |chunk: Chunk<'_>, at: usize, bytes: &[u8]| {
        let mut plain = Vec::new();
        chunk.write(&mut plain);
        plain[at..at + bytes.len()].copy_from_slice(bytes);
        told(&plain)
    };
    let part = Chunk::Part { lane: UnitLane::Frames, unit: 0, offset: 0, tail: Tail::More, data: b"1234" };
    let about = GivenUp { length: 88, sent: 84, hash: 0, coded: None };
    let give_up = Chunk::GiveUp { lane: UnitLane::Frames, unit: 0, about, head: &[] };
    let last_value = Chunk::LastLatest { channel: None, number: 1, close: &[] };
    for end in [
        // Behind the code, unit and offset.
        lying(part, 3, &[0xff; 2]),
        // Behind the code, unit, length, sent and hash.
        lying(give_up, 12, &[0x7f]),
        lying(last_value, 2, &[0xff; 2]),
    ] {
        assert!(matches!(end, Some(Closed::Malformed(_))), "{end:?}");
    }
}

/// Only the liar itself is harmed.
#[test]
fn generous_max_data_and_high_numbers_of_values_are_taken_as_they_are() {
    assert_eq!(lie(&Chunk::MaxData { lane: UnitLane::Frames, bytes: MOST, units: MOST }), None);
    assert_eq!(lie(&Chunk::Latest { channel: None, number: MOST, value: &value(0) }), None);
    assert_eq!(lie(&Chunk::LastLatest { channel: None, number: MOST, close: &[] }), None);
    assert_eq!(
        lie(&Chunk::LastLatest { channel: None, number: MOST, close: &[0xff; 9] }),
        Some(Closed::Reason)
    );
}
