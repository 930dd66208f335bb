//! The codec as a whole: whatever is written is read, however it is split; whatever is read does no harm.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[allow(unreachable_pub, reason = "the fuzz targets share the file, and see it as public")]
#[path = "../../fuzz/src/checks.rs"]
mod checks;

use bytes::BytesMut;
use proptest::prelude::*;
use trimaran_proto::{
    BatchSize, Camera, Decoder, Delivery, DrawableId, FrameAssembler, FrameEvent, FrameMessage, FrameNumber,
    FrameOrderError, FrameOutcome, FrameStart, FrameViolation, FrameWriter, Goodbye, IdDecoder, IdEncoder,
    Identity, Lane, Message, Refusal, Role, SceneHash, SessionId,
};

prop_compose! {
    fn camera()(
        eye in prop::array::uniform3(-1e9..1e9f64),
        [x, y, z, w] in prop::array::uniform4(-1.0..1.0f64)
            .prop_filter("no direction", |q| q.iter().map(|c| c * c).sum::<f64>() > 0.01),
        tan in 1e-5..1e5f32,
        aspect in 1e-5..1e5f32,
        near in 1e-20..1e6f32,
        frame: u32,
    ) -> Camera {
        let length = (x * x + y * y + z * z + w * w).sqrt();
        Camera::new(eye, [x, y, z, w].map(|c| c / length), tan, aspect, near, FrameNumber(frame)).unwrap()
    }
}

fn control() -> impl Strategy<Value = Message> {
    let role = prop_oneof![Just(Role::SwitchA), Just(Role::SwitchB), Just(Role::Display)];
    let lane = prop_oneof![Just(Lane::Latest), Just(Lane::Frames)];
    let goodbye = prop_oneof![
        Just(Goodbye::Finished),
        Just(Goodbye::Interrupted),
        any::<String>().prop_map(|why| Goodbye::failed(&why)),
        any::<String>().prop_map(|how| Goodbye::device_failed(&how))
    ];
    let refusal = (any::<u128>(), any::<u128>())
        .prop_map(|(a, b)| Refusal::Scene { listener: SceneHash(a), connector: SceneHash(b) });
    prop_oneof![
        (role, any::<u128>(), any::<u64>(), lane).prop_map(|(role, scene, session, lane)| {
            let identity = Identity { role, scene: SceneHash(scene), settings: None };
            Message::Hello(identity.hello(SessionId(session), lane))
        }),
        goodbye.prop_map(Message::Goodbye),
        Just(Message::Alive),
        refusal.prop_map(Message::Refuse),
        camera().prop_map(Message::Camera),
    ]
}

/// The messages of one frame whose ids are pushed in these pieces.
fn frame(number: u32, camera: Camera, batch: BatchSize, pieces: &[Vec<u32>]) -> Vec<FrameMessage> {
    let mut writer = FrameWriter::new(batch);
    let mut messages = vec![writer.begin(FrameStart { frame: FrameNumber(number), camera }).unwrap()];
    for piece in pieces {
        let ids: Vec<DrawableId> = piece.iter().copied().map(DrawableId).collect();
        writer.push(&ids, |message| messages.push(message)).unwrap();
    }
    writer.finish(|message| messages.push(message)).unwrap();
    messages
}

/// Feeds `bytes` in pieces that end at `cuts`, and takes every message as soon as it is whole.
fn decode(bytes: &[u8], cuts: &[prop::sample::Index]) -> Vec<Message> {
    let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
    ends.push(bytes.len());
    ends.sort_unstable();
    let (mut decoder, mut from, mut messages) = (Decoder::new(), 0, Vec::new());
    for end in ends {
        decoder.push(&bytes[from..end]);
        from = end;
        messages.extend(std::iter::from_fn(|| decoder.next_message().unwrap()));
    }
    assert_eq!(decoder.pending(), 0);
    assert_eq!(decoder.position(), bytes.len() as u64);
    messages
}

fn pieces() -> impl Strategy<Value = Vec<Vec<u32>>> {
    prop::collection::vec(prop::collection::vec(any::<u32>(), 0..50), 0..8)
}

/// What is visible in a frame: mostly rising, often the same as in other frames.
fn visible() -> impl Strategy<Value = Vec<u32>> {
    let scattered = prop::collection::btree_set(prop_oneof![0..400u32, any::<u32>()], 0..300)
        .prop_map(|ids| ids.into_iter().collect::<Vec<_>>());
    let mostly = prop::collection::vec(prop::bool::weighted(0.9), 0..400)
        .prop_map(|shows| (0..).zip(shows).filter_map(|(id, shows)| shows.then_some(3 * id)).collect());
    prop_oneof![scattered, mostly, prop::collection::vec(any::<u32>(), 0..50)]
}

fn frame_of(frame: FrameNumber, batch: BatchSize, ids: &[u32]) -> Vec<FrameMessage> {
    let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 1.0, 0.1, frame).unwrap();
    self::frame(frame.0, camera, batch, &[ids.to_vec()])
}

fn batch() -> impl Strategy<Value = BatchSize> {
    prop_oneof![1u32..20, Just(256), Just(16_384)].prop_map(|ids| BatchSize::new(ids).unwrap())
}

proptest! {
    #[test]
    fn a_camera_keeps_every_bit(camera in camera()) {
        prop_assert_eq!(Camera::from_bytes(&camera.to_bytes()), Ok(camera));
        prop_assert_eq!(camera.to_bytes().len(), 72);
    }

    #[test]
    fn any_72_bytes_are_a_camera_or_an_error(bytes in prop::array::uniform32(any::<u8>()), tail in prop::array::uniform32(any::<u8>())) {
        let all: Vec<u8> = bytes.iter().chain(&tail).chain(&bytes).copied().take(72).collect();
        let all: [u8; 72] = all.try_into().unwrap();
        if let Ok(camera) = Camera::from_bytes(&all) {
            prop_assert_eq!(camera.to_bytes(), all);
        }
    }

    #[test]
    fn messages_survive_any_split(
        messages in prop::collection::vec(control(), 0..8),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..30),
    ) {
        let mut out = BytesMut::new();
        messages.iter().for_each(|message| message.encode(&mut out));
        prop_assert_eq!(decode(&out, &cuts), messages);
    }

    #[test]
    fn a_frame_survives_any_split_and_any_pushes(
        camera in camera(),
        batch in batch(),
        pieces in pieces(),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..30),
    ) {
        let sent = frame(3, camera, batch, &pieces);
        let mut out = BytesMut::new();
        sent.iter().for_each(|message| Message::Frame(message.clone()).encode(&mut out));
        let mut assembler = FrameAssembler::new(u32::MAX);
        let (mut ids, mut outcome) = (Vec::new(), None);
        for message in decode(&out, &cuts) {
            let Message::Frame(message) = message else { panic!("{message:?}") };
            match assembler.take(message).unwrap() {
                FrameEvent::Begin(start) => prop_assert_eq!(start.camera, camera),
                FrameEvent::Ids(batch_read) => {
                    prop_assert!(batch_read.count() <= batch.ids());
                    ids.extend(batch_read.iter().map(|id| id.0));
                }
                FrameEvent::End(end) => outcome = Some(end),
                FrameEvent::Stats(_) => panic!("no stats were sent"),
            }
        }
        prop_assert_eq!(&ids, &pieces.concat());
        let complete = matches!(outcome, Some(FrameOutcome::Complete(end)) if end.ids as usize == ids.len());
        prop_assert!(complete, "{:?}", outcome);
    }

    #[test]
    fn a_lost_batch_is_known_to_be_lost(camera in camera(), batch in batch(), pieces in pieces(), which: prop::sample::Index) {
        let mut messages = frame(0, camera, batch, &pieces);
        prop_assume!(messages.len() > 2);
        let lost = messages.remove(1 + which.index(messages.len() - 2));
        let FrameMessage::Ids(lost) = lost else { panic!("{lost:?}") };
        let expected = pieces.concat().len() as u32;
        let mut assembler = FrameAssembler::new(u32::MAX);
        let last = messages.into_iter().map(|message| assembler.take(message).unwrap()).last();
        let received = expected - lost.count() as u32;
        let incomplete = FrameOutcome::Incomplete { frame: FrameNumber(0), expected, received };
        prop_assert_eq!(last, Some(FrameEvent::End(incomplete)));
    }

    #[test]
    fn swapped_batches_are_found_out(camera in camera(), mut ids in prop::collection::hash_set(any::<u32>(), 2..40)) {
        let ids: Vec<u32> = ids.drain().collect();
        let mut messages = frame(0, camera, BatchSize::new(1).unwrap(), &[ids]);
        messages.swap(1, 2);
        let mut assembler = FrameAssembler::new(u32::MAX);
        let last = messages.into_iter().map(|message| assembler.take(message)).last();
        let found_out = matches!(last, Some(Err(FrameViolation::Hash { .. })));
        prop_assert!(found_out, "{:?}", last);
    }

    #[test]
    fn frames_survive_as_changes(
        frames in prop::collection::vec((visible(), batch()), 1..12),
        lossy: bool,
        lost in prop::collection::vec(any::<prop::sample::Index>(), 0..4),
    ) {
        let delivery = if lossy { Delivery::Lossy } else { Delivery::Ordered };
        let (mut encoder, mut decoder, mut assembler) = (IdEncoder::new(delivery), IdDecoder::new(u32::MAX), FrameAssembler::new(u32::MAX));
        let lost: Vec<usize> = lost.iter().map(|index| index.index(frames.len())).collect();
        for (number, (ids, batch)) in frames.into_iter().enumerate() {
            let frame = FrameNumber(number as u32);
            let mut got = Vec::new();
            for message in frame_of(frame, batch, &ids) {
                // Lossy lanes lose a batch now and then.
                let gone = lossy && lost.contains(&number) && matches!(message, FrameMessage::Ids(_));
                let sent = encoder.encode(message);
                if gone {
                    continue;
                }
                let read = match sent {
                    Message::Coded(coded) => decoder.coded(&coded).unwrap(),
                    Message::Frame(message) => decoder.plain(message),
                    other => panic!("{other:?}"),
                };
                match assembler.take(read).unwrap() {
                    FrameEvent::Ids(batch) => got.extend(batch.iter().map(|id| id.0)),
                    FrameEvent::End(FrameOutcome::Complete(_)) => {
                        prop_assert_eq!(&got, &ids);
                        encoder.confirm(frame);
                    }
                    _ => {}
                }
            }
        }
    }

    #[test]
    fn changes_are_never_longer_than_plain(before in visible(), now in visible()) {
        let (mut encoder, mut bytes) = (IdEncoder::new(Delivery::Ordered), 0);
        for (number, ids) in [(0, &before), (1, &now)] {
            bytes = 0;
            for message in frame_of(FrameNumber(number), BatchSize::default(), ids) {
                bytes += match encoder.encode(message) {
                    Message::Coded(coded) => coded.as_bytes().len(),
                    Message::Frame(FrameMessage::Ids(batch)) => batch.as_bytes().len(),
                    _ => 0,
                };
            }
        }
        prop_assert!(bytes <= 4 * now.len());
    }

    #[test]
    fn garbage_does_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        checks::decode(&bytes);
        checks::frames(&bytes);
        checks::changes(&bytes);
    }

    #[test]
    fn a_broken_stream_does_no_harm(
        messages in prop::collection::vec(control(), 1..6),
        broken in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let mut out = BytesMut::new();
        messages.iter().for_each(|message| message.encode(&mut out));
        for (at, byte) in broken {
            let at = at.index(out.len());
            out[at] = byte;
        }
        checks::decode(&out);
    }
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus");
    let mut replayed = 0;
    for (target, check) in
        [("decode", checks::decode as fn(&[u8])), ("frames", checks::frames), ("changes", checks::changes)]
    {
        for entry in std::fs::read_dir(format!("{corpus}/{target}")).unwrap() {
            check(&std::fs::read(entry.unwrap().path()).unwrap());
            replayed += 1;
        }
    }
    assert!(replayed >= 20, "only {replayed} inputs: is the corpus there?");
}

/// Both ends count, whether the ids come in one batch or in many.
#[test]
fn a_frame_of_more_ids_than_it_may_have_is_refused_at_both_ends() {
    let ids = |range: std::ops::Range<u32>| range.map(DrawableId).collect::<Vec<_>>();
    let number = FrameNumber(3);
    let start = FrameStart { frame: number, camera: Camera::at_origin(number) };
    for batch in [1, 3, 16_384] {
        let mut writer = FrameWriter::new(BatchSize::new(batch).unwrap()).of_at_most(10);
        let mut sent = vec![writer.begin(start).unwrap()];
        writer.push(&ids(0..8), |message| sent.push(message)).unwrap();
        let one_too_many = writer.push(&ids(8..11), |_| panic!("nothing of it is sent"));
        assert_eq!(one_too_many, Err(FrameOrderError::TooMany { frame: number, most: 10 }));
        writer.push(&ids(8..10), |message| sent.push(message)).unwrap();
        writer.finish(|message| sent.push(message)).unwrap();

        let taken = |most| {
            let mut assembler = FrameAssembler::new(most);
            sent.iter().cloned().try_fold(None, |_, message| assembler.take(message).map(Some))
        };
        assert!(matches!(taken(10), Ok(Some(FrameEvent::End(FrameOutcome::Complete(_))))), "{batch}");
        assert_eq!(taken(9), Err(FrameViolation::Beyond { frame: number, most: 9 }), "{batch}");
    }
}
