//! The worked examples of WIRE.md are what this crate writes and reads.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod examples;

use std::collections::BTreeMap;

use bytes::{Bytes, BytesMut};
use trimaran_proto::{
    Accept, BatchSize, Camera, CameraNumber, CullCounts, Decoder, Delivery, DrawableId, EpsilonPx, FrameEnd,
    FrameMessage, FrameNumber, FrameStart, FrameStats, FrameWriter, Goodbye, HEADER_BYTES, Hello, IdBatch,
    IdCoding, IdEncoder, Identity, Kind, Lane, Message, NumberedCamera, PictureSize, Refusal, Role,
    SceneHash, SessionId, Settings, TesterKind,
};

const WIRE: &str = include_str!("../WIRE.md");

fn examples() -> BTreeMap<&'static str, Vec<u8>> {
    examples::examples_of(WIRE)
}

fn camera() -> Camera {
    Camera::new([1.0, 2.0, -3.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.25, FrameNumber(7)).unwrap()
}

fn display() -> Identity {
    let settings = Settings {
        size: PictureSize::new(1024, 768).unwrap(),
        epsilon: EpsilonPx::new(2.0).unwrap(),
        batch: BatchSize::new(256).unwrap(),
        coding: IdCoding::Changes,
        tester: TesterKind::Raster,
        lockstep: true,
        few_pixels: false,
        first: FrameNumber(0),
        frames: Some(200),
    };
    Identity { role: Role::Display, scene: SceneHash(0x1234), settings: Some(settings) }
}

fn switch() -> Identity {
    Identity { role: Role::SwitchA, scene: SceneHash(0x1234), settings: None }
}

/// The second frame of a lane of changes: 100 to 149 were visible, and 110, 120 to 122 no longer are; 200 and
/// 1000 are new.
fn coded() -> Message {
    let (mut writer, mut encoder) =
        (FrameWriter::new(BatchSize::default()), IdEncoder::new(Delivery::Ordered));
    let before: Vec<u32> = (100..150).collect();
    let now: Vec<u32> = (100..110).chain(111..120).chain(123..150).chain([200, 1000]).collect();
    let mut sent = Vec::new();
    for (frame, ids) in [(7, before), (9, now)] {
        let begin = writer.begin(FrameStart { frame: FrameNumber(frame), camera: camera() }).unwrap();
        sent = vec![encoder.encode(begin)];
        let ids: Vec<DrawableId> = ids.into_iter().map(DrawableId).collect();
        writer.push(&ids, |message| sent.push(encoder.encode(message))).unwrap();
        writer.finish(|message| sent.push(encoder.encode(message))).unwrap();
    }
    sent.swap_remove(1)
}

/// The messages that the examples spell out.
fn messages() -> Vec<(&'static str, Message)> {
    let ids = [1u32, 258].map(u32::to_le_bytes).concat();
    let frame = FrameNumber(9);
    let stats = FrameStats {
        frame,
        or_start_ns: 1,
        or_end_ns: 300,
        culling: CullCounts { visited: 5, emitted: 2, ..CullCounts::default() },
        ..FrameStats::default()
    };
    let hello = Hello { identity: display(), session: SessionId(5), lane: Lane::Latest };
    let refusal = Refusal::Scene { listener: SceneHash(0x1234), connector: SceneHash(0x81) };
    let end = FrameEnd { frame, ids: 2, hash: xxhash_rust::xxh3::xxh3_64(&ids) };
    let frames = [
        ("begin", FrameMessage::Begin(FrameStart { frame, camera: camera() })),
        ("ids", FrameMessage::Ids(IdBatch::new(Bytes::from(ids)).unwrap())),
        ("end", FrameMessage::End(end)),
        ("stats", FrameMessage::Stats(stats)),
    ];
    let mut messages = vec![
        ("hello", Message::Hello(hello)),
        ("accept", Message::Accept(Accept { identity: switch() })),
        ("refuse", Message::Refuse(refusal)),
        ("goodbye", Message::Goodbye(Goodbye::failed("no GPU"))),
        ("sign-of-life", Message::Alive),
        ("camera", Message::Camera(camera())),
        ("numbered-camera", Message::Numbered(NumberedCamera { number: CameraNumber(5), camera: camera() })),
    ];
    messages.extend(frames.map(|(name, message)| (name, Message::Frame(message))));
    messages.push(("coded-ids", coded()));
    messages
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x} ")).collect()
}

#[test]
fn every_kind_of_message_has_an_example() {
    let kinds: Vec<Kind> = messages().iter().map(|(_, message)| message.kind()).collect();
    assert_eq!(kinds, Kind::ALL);
    let written = examples();
    for (name, message) in messages() {
        let mut out = BytesMut::new();
        message.encode(&mut out);
        assert_eq!(hex(&out), hex(written.get(name).map_or(&[], Vec::as_slice)), "the example {name}");
    }
    assert_eq!(written.len(), messages().len() + 2, "and the empty frame, and another version's hello");
}

#[test]
fn every_example_reads_back() {
    let written = examples();
    for (name, message) in messages() {
        let mut decoder = Decoder::new();
        decoder.push(&written[name]);
        assert_eq!(decoder.next_message(), Ok(Some(message)), "the example {name}");
        assert_eq!(decoder.pending(), 0);
    }
}

#[test]
fn the_empty_frame_is_begin_and_end() {
    let mut writer = FrameWriter::new(BatchSize::default());
    let mut out = BytesMut::new();
    Message::Frame(writer.begin(FrameStart { frame: FrameNumber(9), camera: camera() }).unwrap())
        .encode(&mut out);
    out.clear();
    writer.push(&[] as &[DrawableId], |_| panic!("no batch")).unwrap();
    writer.finish(|message| Message::Frame(message).encode(&mut out)).unwrap();
    assert_eq!(hex(&out), hex(&examples()["empty-end"]));
}

#[test]
fn another_versions_hello_says_which() {
    let mut decoder = Decoder::new();
    decoder.push(&examples()["hello-2"]);
    let error = decoder.next_message().unwrap_err().to_string();
    assert!(error.contains("the peer speaks version 2 of the protocol, this one version 1"), "{error}");
}

#[test]
fn the_tables_of_codes_and_lengths_are_the_crates() {
    for kind in Kind::ALL {
        let (min, max) = kind.lengths().into_inner();
        let lengths = if min == max { format!("{min}") } else { format!("{min} to {max}") };
        let row = format!("| `{:#04x}` | {kind} | {lengths} |", kind.code());
        assert!(WIRE.contains(&row), "no row {row:?}");
    }
    assert!(WIRE.contains(&format!("{HEADER_BYTES}-byte header")));
}
