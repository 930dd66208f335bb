//! Cameras and ids as bytes: written data reads back, and invalid data does no harm.

#[allow(unreachable_pub, reason = "the fuzz targets share the file, and see it as public")]
#[path = "../../../fuzz/src/walkthrough.rs"]
mod walkthrough;

use proptest::prelude::*;
use trimaran_proto::{
    BatchSize, Camera, DrawableId, FrameNumber, IdBatch, IdDecoder, IdEncoder, ViewVersion,
};
use trimaran_wire::{
    BatchDecoder, BatchEncoder, Delivery, Fixed, FrameAssembler, FrameEnd, FrameMessage, FrameOutcome,
    FrameStep, FrameWriter, to_bytes,
};

prop_compose! {
    fn camera()(
        eye in prop::array::uniform3(-1e9..1e9f64),
        [x, y, z, w] in prop::array::uniform4(-1.0..1.0f64)
            .prop_filter("no direction", |q| q.iter().map(|c| c * c).sum::<f64>() > 0.01),
        tan in 1e-5..1e5f32,
        view: u32,
        near in 1e-20..1e6f32,
        frame: u32,
    ) -> Camera {
        let length = (x * x + y * y + z * z + w * w).sqrt();
        Camera::new(eye, [x, y, z, w].map(|c| c / length), tan, near, FrameNumber(frame))
            .unwrap()
            .in_view(ViewVersion(view))
    }
}

/// The visible ids of a frame: mostly rising, often the same as in other frames.
fn visible() -> impl Strategy<Value = Vec<u32>> {
    let scattered = prop::collection::btree_set(prop_oneof![0..400u32, any::<u32>()], 0..300)
        .prop_map(|ids| ids.into_iter().collect::<Vec<_>>());
    let mostly = prop::collection::vec(prop::bool::weighted(0.9), 0..400)
        .prop_map(|shows| (0..).zip(shows).filter_map(|(id, shows)| shows.then_some(3 * id)).collect());
    prop_oneof![scattered, mostly, prop::collection::vec(any::<u32>(), 0..50)]
}

/// The batches of one frame of these ids, and its end.
fn frame_of(frame: FrameNumber, batch: BatchSize, ids: &[u32]) -> (Vec<IdBatch>, FrameEnd) {
    let mut writer = FrameWriter::new(batch);
    let mut batches = Vec::new();
    let ids: Vec<DrawableId> = ids.iter().copied().map(DrawableId).collect();
    let mut take = |message| {
        if let FrameMessage::Batch(bytes) = message {
            batches.push(IdBatch::new(bytes).unwrap());
        }
    };
    writer.begin(frame).unwrap();
    writer.push(&ids, &mut take).unwrap();
    let end = writer.finish(&mut take).unwrap();
    (batches, end)
}

fn batch() -> impl Strategy<Value = BatchSize> {
    prop_oneof![1u32..20, Just(256), Just(16_384)].prop_map(|ids| BatchSize::new(ids).unwrap())
}

#[test]
fn a_camera_says_what_its_72_bytes_hold() {
    let (eye, orientation) = ([1.5, -2.5, 3.5], [0.5, -0.5, -0.5, 0.5]);
    let camera = Camera::new(eye, orientation, 0.75, 0.25, FrameNumber(6)).unwrap();
    assert_eq!((camera.eye(), camera.orientation()), (eye, orientation));
    assert_eq!((camera.tan_half_fov_y(), camera.near()), (0.75, 0.25));
    let other = camera.in_view(ViewVersion(7)).for_frame(FrameNumber(8));
    assert_eq!([(camera.view().0, camera.frame().0), (other.view().0, other.frame().0)], [(0, 6), (7, 8)]);
    let numbers = eye.into_iter().chain(orientation).flat_map(f64::to_le_bytes);
    let rest = [0.75f32.to_bits(), 7, 0.25f32.to_bits(), 8].into_iter().flat_map(u32::to_le_bytes);
    assert_eq!(other.to_bytes()[..], numbers.chain(rest).collect::<Vec<_>>());
}

proptest! {
    #[test]
    fn a_camera_keeps_every_bit(camera in camera()) {
        prop_assert_eq!(Camera::from_bytes(&camera.to_bytes()), Ok(camera));
        prop_assert_eq!(camera.to_bytes().len(), 72);
        let bytes = to_bytes(&camera);
        prop_assert_eq!(&bytes[..], camera.to_bytes());
        prop_assert_eq!(<Camera as Fixed>::read(&bytes), Ok(camera));
    }

    #[test]
    fn any_72_bytes_are_a_camera_or_an_error(
        bytes in prop::array::uniform32(any::<u8>()),
        tail in prop::array::uniform32(any::<u8>()),
    ) {
        let all: Vec<u8> = bytes.iter().chain(&tail).chain(&bytes).copied().take(72).collect();
        let all: [u8; 72] = all.try_into().unwrap();
        if let Ok(camera) = Camera::from_bytes(&all) {
            prop_assert_eq!(camera.to_bytes(), all);
        }
    }

    #[test]
    fn frames_survive_as_changes(
        frames in prop::collection::vec((visible(), batch()), 1..12),
        lossy: bool,
        lost in prop::collection::vec(any::<prop::sample::Index>(), 0..4),
    ) {
        let delivery = if lossy { Delivery::Lossy } else { Delivery::Ordered };
        let (mut encoder, mut decoder) = (IdEncoder::new(delivery), IdDecoder::new(u32::MAX));
        let mut assembler = FrameAssembler::new(u32::MAX);
        let lost: Vec<usize> = lost.iter().map(|index| index.index(frames.len())).collect();
        for (number, (ids, batch)) in frames.into_iter().enumerate() {
            let frame = FrameNumber(number as u32);
            // Lossy lanes lose the batches of a frame now and then.
            let gone = lossy && lost.contains(&number);
            let mut got = Vec::new();
            encoder.begin(frame);
            decoder.begin(frame);
            assembler.take(FrameStep::Begin(frame)).unwrap();
            let (batches, end) = frame_of(frame, batch, &ids);
            for plain in batches {
                let coded = encoder.encode(&plain);
                if gone {
                    continue;
                }
                let read = match coded {
                    Some(coded) => decoder.decode(&coded).unwrap(),
                    None => {
                        decoder.plain(&plain);
                        plain
                    }
                };
                let step = FrameStep::Batch { items: read.count(), bytes: read.as_bytes() };
                assembler.take(step).unwrap();
                got.extend(read.iter().map(|id| id.0));
            }
            encoder.end(&end);
            decoder.end(&end);
            match assembler.take(FrameStep::End(end)).unwrap() {
                Some(FrameOutcome::Complete(_)) => {
                    prop_assert_eq!(&got, &ids);
                    encoder.confirmed(frame);
                }
                _ => prop_assert!(gone),
            }
        }
    }

    #[test]
    fn changes_are_never_longer_than_plain(before in visible(), now in visible()) {
        let (mut encoder, mut bytes) = (IdEncoder::new(Delivery::Ordered), 0);
        for (number, ids) in [(0, &before), (1, &now)] {
            let frame = FrameNumber(number);
            let (batches, end) = frame_of(frame, BatchSize::default(), ids);
            encoder.begin(frame);
            bytes = batches
                .iter()
                .map(|batch| encoder.encode(batch).unwrap_or_else(|| batch.as_bytes().clone()).len())
                .sum();
            encoder.end(&end);
        }
        prop_assert!(bytes <= 4 * now.len());
    }

    #[test]
    fn garbage_does_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        walkthrough::decode(&bytes);
        walkthrough::changes(&bytes);
    }

    /// Every kind of message with contents of Trimaran's is read or refused.
    #[test]
    fn garbage_in_a_message_does_no_harm(
        kind in prop::sample::select(vec![0x01_u8, 0x02, 0x10, 0x20, 0x23, 0x24]),
        mut bytes in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        match kind {
            0x01 => drop(bytes.splice(..0, *b"TRIM\x01\x00\x00\x05\x00")),
            0x10 => bytes.resize(72, 0),
            0x20 => bytes.resize(76, 0),
            _ => {}
        }
        let header = u32::from(kind) | (bytes.len() as u32) << 8;
        walkthrough::decode(&[&header.to_le_bytes()[..], &bytes].concat());
    }
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus");
    let mut replayed = 0;
    for (target, check) in [("decode", walkthrough::decode as fn(&[u8])), ("changes", walkthrough::changes)] {
        for entry in std::fs::read_dir(format!("{corpus}/{target}")).unwrap() {
            check(&std::fs::read(entry.unwrap().path()).unwrap());
            replayed += 1;
        }
    }
    assert!(replayed >= 20, "only {replayed} inputs: is the corpus there?");
}
