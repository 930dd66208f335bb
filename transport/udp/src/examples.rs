//! This crate writes and reads the worked examples of WIRE.md.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[allow(dead_code, reason = "this crate has no messages to check")]
#[path = "../../wire/tests/all/examples/mod.rs"]
mod page;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_wire::{ChannelNumber, CloseReason, FrameMessage, FrameNumber, Message};
use xxhash_rust::xxh3::xxh3_64;

use crate::chunk::{Chunk, GivenUp, Tail, UnitLane};
use crate::connection::{BULK_WINDOW, Closed, Config, Connection, MESSAGES_WINDOW};
use crate::cookie::TokenKey;
use crate::handshake::{Acceptor, Connecting, Handled, Progress, Security};
use crate::inbox::{Inbox, Received};
use crate::keys::Keys;
use crate::packet::{ConnectionId, MIN_DATAGRAM, Packet, VERSION, data_header};
use crate::ranges::RangeSet;
use crate::repair::{Block, protect};
use crate::reset::ResetKey;
use crate::samples::{FORMAT, FORMAT_WITH_CHANNELS, encoded, value};
use crate::wire::Reader;

const WIRE: &str = include_str!("../WIRE.md");
const HERE: ConnectionId = ConnectionId(10);
const THERE: ConnectionId = ConnectionId(20);
const SECRET: [u8; 32] = [7; 32];
const PSK: [u8; 32] = [9; 32];
const PORT: u16 = 7400;

fn examples() -> BTreeMap<&'static str, Vec<u8>> {
    page::examples_of(WIRE)
}

#[track_caller]
fn assert_example(name: &str, bytes: &[u8]) {
    let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x} ")).collect::<String>();
    assert_eq!(hex(bytes), hex(examples().get(name).map_or(&[], Vec::as_slice)), "the example {name}");
}

fn inbox() -> Inbox {
    Inbox::new(UnitLane::Frames, FORMAT, config().batch, config().window)
}

fn now() -> Instant {
    Instant::from_nanos(1_000_000_000)
}

fn address() -> SocketAddr {
    SocketAddr::from(([192, 0, 2, 1], 4000))
}

fn numbers() -> RangeSet {
    let mut numbers = RangeSet::default();
    numbers.insert(3..5);
    numbers.insert(8..11);
    numbers
}

fn config() -> Config {
    Config::new(FORMAT)
}

/// A frame of two items, up to its end, in messages.
fn messages(batch: FrameMessage) -> Vec<u8> {
    let begin = FrameMessage::Begin { frame: FrameNumber(7), header: value(7) };
    [begin, batch].into_iter().flat_map(|message| encoded(&Message::Frame(message))).collect()
}

/// A frame of two items.
fn unit() -> Vec<u8> {
    let items = [1u32.to_le_bytes(), 258u32.to_le_bytes()].concat();
    let mut unit = messages(FrameMessage::Batch(items.into()));
    // Its batches have no headers.
    unit.drain(80..84);
    unit
}

/// The frame of two items, given up before the last one was sent.
fn given_up(hash: u64) -> GivenUp {
    GivenUp { length: 88, sent: 84, hash, coded: None }
}

/// The same frame, coded and given up.
fn coded_given_up(hash: u64) -> GivenUp {
    GivenUp { length: 90, sent: 90, hash, coded: Some(2) }
}

/// The same frame with a coded batch.
fn coded_unit() -> Vec<u8> {
    [&[0x24][..], &messages(FrameMessage::Coded(CODED.into()))].concat()
}

/// Two items in some application's shorter form.
const CODED: &[u8] = &[2, 1, 0, 2, 1];

#[test]
fn every_chunk_has_an_example() {
    let (unit, coded) = (unit(), coded_unit());
    let hash = xxh3_64(&unit[80..]);
    let (value, close) = (value(7), encoded(&Message::Close(CloseReason::new(0, "over"))));
    let message = encoded(&Message::Message(Bytes::from_static(b"\x01\x04dock")));
    let block_message = encoded(&Message::Block(Bytes::from_static(b"map tile")));
    let cookie = TokenKey::new(SECRET).issue(now(), address(), HERE);
    let part = |unit, offset, tail, data| Chunk::Part { lane: UnitLane::Frames, unit, offset, tail, data };
    let whole = |lane, data| Chunk::Part { lane, unit: 0, offset: 0, tail: Tail::End, data };
    let block = Block { offset: 0, length: 88, shard: 44, count: 1 };
    let repair = protect(&unit, 44, 1);
    let chunks = [
        ("ping", Chunk::Ping),
        ("ack", Chunk::Ack { delay_us: 300, numbers: numbers() }),
        ("max-data", Chunk::MaxData { lane: UnitLane::Frames, bytes: 4 << 20, units: 1024 }),
        ("close", Chunk::Close),
        ("unread", Chunk::StopSending { lane: UnitLane::Frames }),
        ("max-data-messages", Chunk::MaxData { lane: UnitLane::Messages, bytes: 64 << 10, units: 1024 }),
        ("unread-messages", Chunk::StopSending { lane: UnitLane::Messages }),
        ("max-data-bulk", Chunk::MaxData { lane: UnitLane::Bulk, bytes: 64 << 10, units: 1024 }),
        ("unread-bulk", Chunk::StopSending { lane: UnitLane::Bulk }),
        ("challenge", Chunk::Challenge { cookie }),
        ("response", Chunk::Response { cookie }),
        ("last-value", Chunk::LastLatest { channel: None, number: 1, close: &close }),
        ("value", Chunk::Latest { channel: None, number: 1, value: &value }),
        ("part", part(0, 0, Tail::More, &unit[..80])),
        ("part-pause", part(0, 80, Tail::Pause, &unit[80..84])),
        ("part-frame", part(0, 84, Tail::Frame(hash), &unit[84..])),
        ("part-close", part(1, 0, Tail::End, &close)),
        ("part-gone", part(2, 0, Tail::End, &[])),
        ("pad", Chunk::Pad),
        ("give-up", Chunk::GiveUp { lane: UnitLane::Frames, unit: 0, about: given_up(hash), head: &[] }),
        ("part-coded", part(3, 0, Tail::Frame(hash), &coded)),
        (
            "give-up-coded",
            Chunk::GiveUp { lane: UnitLane::Frames, unit: 3, about: coded_given_up(hash), head: &unit[..80] },
        ),
        (
            "repair",
            Chunk::Repair {
                lane: UnitLane::Frames,
                unit: 0,
                block,
                hash: Some(hash),
                index: 0,
                data: &repair[0],
            },
        ),
        ("part-message", whole(UnitLane::Messages, &message)),
        ("part-block", whole(UnitLane::Bulk, &block_message)),
        (
            "channel",
            Chunk::MaxData { lane: UnitLane::Channel(ChannelNumber(1)), bytes: 4 << 20, units: 1024 },
        ),
    ];
    let mut inbox = inbox();
    for (name, chunk) in &chunks {
        let mut out = Vec::new();
        chunk.write(&mut out);
        assert_example(name, &out);
        let written = &examples()[name];
        let mut reader = Reader::new(written);
        let read = Chunk::read(&mut reader, &FORMAT_WITH_CHANNELS);
        assert_eq!(read.as_ref(), Ok(chunk), "the example {name}");
        assert!(reader.is_empty());
        for cut in 0..out.len() {
            let read = Chunk::read(&mut Reader::new(&out[..cut]), &FORMAT_WITH_CHANNELS);
            assert!(read.is_err(), "{cut} bytes of {name}");
        }
        if let Chunk::Part { lane: UnitLane::Frames, unit, offset, tail, data } = *chunk {
            inbox.put(unit, offset, tail, data).unwrap();
        }
    }
    let received: Vec<_> = std::iter::from_fn(|| inbox.take().unwrap()).collect();
    let [begin, _, end, Received::Closed(_), Received::Gone, coded @ ..] = &received[..] else {
        panic!("{received:?}")
    };
    let batch = Received::Frame(FrameMessage::Coded(CODED.into()));
    assert_eq!(coded, [begin.clone(), batch, end.clone()], "the same frame");
}

#[test]
fn the_examples_of_repair_and_of_giving_up_do_what_the_page_says() {
    let unit = unit();
    let read = |name: &str, inbox: &mut Inbox| match Chunk::read(&mut Reader::new(&examples()[name]), &FORMAT)
        .unwrap()
    {
        Chunk::Repair { lane: UnitLane::Frames, unit, block, hash, index, data } => {
            inbox.put_repair(unit, block, hash, index, data).map(|taken| assert!(taken))
        }
        Chunk::GiveUp { lane: UnitLane::Frames, unit, about, head } => inbox.give_up(unit, about, head),
        other => panic!("{other:?}"),
    };
    for (lost, name, items) in [(0..44, "repair", 2), (44..88, "repair", 2), (84..88, "give-up", 1)] {
        let mut inbox = inbox();
        inbox.put(0, 0, Tail::More, &unit[..lost.start]).unwrap();
        if lost.end < unit.len() {
            inbox.put(0, lost.end as u64, Tail::More, &unit[lost.end..]).unwrap();
        }
        read(name, &mut inbox).unwrap();
        let received: Vec<_> = std::iter::from_fn(|| inbox.take().unwrap()).collect();
        let [_, Received::Frame(FrameMessage::Batch(batch)), Received::Frame(FrameMessage::End(end))] =
            &received[..]
        else {
            panic!("{received:?}")
        };
        assert_eq!((batch.len() / 4, end.items, end.hash), (items, 2, xxh3_64(&unit[80..])), "{name}");
    }
}

#[test]
fn a_packet_in_the_clear_is_the_example() {
    let mut sender = Connection::plaintext(now(), HERE, THERE, config());
    sender.publish(None, value(7));
    let mut out = Vec::new();
    assert!(sender.poll_transmit(now(), &mut out));
    assert_example("data", &out);
    let mut reader = Connection::plaintext(now(), THERE, HERE, config());
    reader.handle(now(), &examples()["data"]);
    assert_eq!(reader.latest(None), Some(value(7)));
}

/// Everything before the zeros that fill an initial packet.
fn unfilled(packet: &[u8], length: usize) -> &[u8] {
    assert_eq!(packet.len(), MIN_DATAGRAM);
    assert!(packet[length..].iter().all(|byte| *byte == 0));
    &packet[..length]
}

#[test]
fn the_handshake_in_the_clear_is_the_examples() {
    let acceptor = Acceptor::new(Security::Plaintext, SECRET, PORT).unwrap();
    let connecting = Connecting::new(&Security::Plaintext, HERE, b"hello").unwrap();
    let (mut out, mut reply) = (Vec::new(), Vec::new());
    connecting.initial(&mut out);
    assert_example("initial", unfilled(&out, 20));
    assert!(matches!(acceptor.handle(now(), address(), &out, &mut reply), Handled::Reply));
    assert_example("retry", &reply);
    assert!(TokenKey::new(SECRET).accepts(now(), address(), HERE, reply[12..].try_into().unwrap()));
    let Progress::Retry(connecting) = connecting.handle(now(), &reply, config()) else { panic!("no retry") };
    connecting.initial(&mut out);
    assert_example("initial-with-cookie", unfilled(&out, 44));
    let initial = || match acceptor.handle(now(), address(), &out, &mut Vec::new()) {
        Handled::Initial(initial) => *initial,
        other => panic!("{other:?}"),
    };
    initial().take(now(), THERE, b"welcome", config(), &mut reply).unwrap();
    assert_example("answer", &reply);
    initial().refuse(b"no", &mut reply);
    assert_example("answer-no", &reply);
    let Progress::Taken(mut connection, _) = connecting.handle(now(), &examples()["answer"], config()) else {
        panic!("not taken")
    };
    // After a restart the listener knows no connection.
    let restarted = Acceptor::new(Security::Plaintext, [8; 32], PORT).unwrap();
    assert!(matches!(restarted.handle(now(), address(), &examples()["data"], &mut reply), Handled::Reply));
    assert_example("reset", &reply);
    connection.handle(now(), &reply);
    assert_eq!(connection.closed(), Some(&Closed::Reset));
}

/// The Noise state of one side, with a public ephemeral key, built without this crate's code.
fn noise(ephemeral: [u8; 32], initiates: bool) -> snow::HandshakeState {
    let prologue = b"trimaran/udp/4\x0a\x00\x00\x00";
    let builder = snow::Builder::new("Noise_NNpsk0_25519_ChaChaPoly_BLAKE2s".parse().unwrap())
        .prologue(prologue)
        .unwrap()
        .psk(0, &PSK)
        .unwrap()
        .fixed_ephemeral_key_for_testing_only(&ephemeral);
    if initiates { builder.build_initiator() } else { builder.build_responder() }.unwrap()
}

fn with_room<E>(room: usize, write: impl FnOnce(&mut [u8]) -> Result<usize, E>) -> Vec<u8> {
    let mut out = vec![0; room];
    let length = write(&mut out).unwrap_or_default();
    out.truncate(length);
    out
}

#[test]
fn the_handshake_with_a_shared_key_is_the_examples() {
    let (mut here, mut there) = (noise([1; 32], true), noise([2; 32], false));
    let message = with_room(100, |out| here.write_message(b"hello", out));
    let cookie = &TokenKey::new(SECRET).issue(now(), address(), HERE);
    let mut out = Vec::new();
    Packet::Initial { version: VERSION, from: HERE, cookie: Some(cookie), noise: &message }.write(&mut out);
    assert_example("initial-shared", unfilled(&out, 39 + message.len()));

    // An acceptor without the fixed keys reads the example.
    let mut example = examples()["initial-shared"].clone();
    example.resize(MIN_DATAGRAM, 0);
    let acceptor = Acceptor::new(Security::PreShared(PSK.into()), SECRET, PORT).unwrap();
    match acceptor.handle(now(), address(), &example, &mut Vec::new()) {
        Handled::Initial(initial) => assert_eq!((initial.from, &initial.hello[..]), (HERE, &b"hello"[..])),
        other => panic!("{other:?}"),
    }

    with_room(100, |out| there.read_message(&message, out));
    let token = ResetKey::new(&PSK, PORT).token(THERE);
    let payload = [&[1][..], &THERE.0.to_le_bytes(), &token, b"welcome"].concat();
    let message = with_room(100, |out| there.write_message(&payload, out));
    Packet::Answer { version: VERSION, to: HERE, noise: &message }.write(&mut out);
    assert_example("answer-shared", &out);
    assert_eq!(with_room(100, |out| here.read_message(&message, out)), payload);

    let keys =
        |state: snow::HandshakeState| Keys::Noise(Box::new(state.into_stateless_transport_mode().unwrap()));
    let mut ping = Vec::from(data_header(THERE, 0));
    assert!(keys(here).seal(THERE, 0, &[1], &mut ping));
    assert_example("data-shared", &ping);
    let later = now().after(Duration::from_millis(1));
    let mut listener = Connection::new(now(), THERE, HERE, config(), keys(there));
    listener.handle(now(), &examples()["data-shared"]);
    assert!(listener.poll_transmit(later, &mut out), "the ping of the example is acknowledged");
}

#[test]
fn the_page_says_what_the_constants_are() {
    let page = WIRE.split_whitespace().collect::<Vec<_>>().join(" ");
    for fact in [
        format!("at least {MIN_DATAGRAM} bytes"),
        format!("at most {} bytes of hello", crate::MAX_HELLO),
        format!("at most {} ranges", crate::chunk::ACK_RANGES),
        format!("the first {} units", Inbox::initial_units()),
        format!("{MESSAGES_WINDOW} bytes of messages"),
        format!("{BULK_WINDOW} bytes of blocks"),
        format!("at most {} *shards*", crate::repair::BLOCK),
        format!("1 to {}", crate::repair::MOST),
        format!(
            "{} or {} bytes",
            crate::chunk::unit_head(&FORMAT, false),
            crate::chunk::unit_head(&FORMAT, true)
        ),
    ] {
        assert!(page.contains(&fact), "{fact:?}");
    }
    assert_eq!(examples().len(), 36, "every example is checked by a test here");
}
