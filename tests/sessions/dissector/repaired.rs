//! Frames that lost packets and were repaired by FEC: the dissector rebuilds nothing, and says so.

use std::collections::BTreeSet;
use std::time::Duration;

use bytes::BufMut;
use trimaran_net::Instant;
use trimaran_proto::{BatchSize, Camera, DrawableId, FrameNumber, IdBatch, IdCoding, IdEncoder, Walkthrough};
use trimaran_udp::{
    Acceptor, Config, Connecting, Connection, ConnectionId, Handled, Progress, Received, Repair, Security,
    UnitLane,
};
use trimaran_wire::{
    BatchDecoder, BatchEncoder, Delivery, Format, FrameAssembler, FrameMessage, FrameOutcome, FrameStep,
    FrameWriter, Protocol, to_bytes,
};

use super::{between_two, capture, hello};

/// The ids of each frame, all of them new: it takes several packets, with any coding.
const IDS: u32 = 1500;

fn ids(frame: u32) -> impl Iterator<Item = DrawableId> {
    (0..IDS).map(move |id| DrawableId(1 + frame * 100_000_000 + id * id * 9))
}

/// Two ends without encryption, and their packets until the handshake is complete.
fn introduced(config: Config) -> ([Connection; 2], Vec<(usize, Vec<u8>)>) {
    let now = Instant::from_nanos(0);
    let mut hello = hello();
    hello.put_u8(0);
    let acceptor = Acceptor::new(Security::Plaintext, [3; 32], 7400).unwrap();
    let address = "127.0.0.1:7400".parse().unwrap();
    let connecting = Connecting::new(&Security::Plaintext, ConnectionId(1), &hello).unwrap();
    let (mut said, mut first, mut reply) = (Vec::new(), Vec::new(), Vec::new());
    connecting.initial(&mut first);
    let Handled::Reply = acceptor.handle(now, address, &first, &mut reply) else { panic!("no cookie") };
    said.extend([(0, first.clone()), (1, reply.clone())]);
    let Progress::Retry(connecting) = connecting.handle(now, &reply, config) else { panic!("no retry") };
    connecting.initial(&mut first);
    let Handled::Initial(initial) = acceptor.handle(now, address, &first, &mut reply) else {
        panic!("no initial")
    };
    let there = initial.take(now, ConnectionId(2), b"", config, &mut reply).unwrap();
    said.extend([(0, first.clone()), (1, reply.clone())]);
    let Progress::Taken(here, _) = connecting.handle(now, &reply, config) else { panic!("not taken") };
    ([*here, there], said)
}

fn send(
    end: &mut Connection,
    writer: &mut FrameWriter<DrawableId>,
    encoder: &mut Option<IdEncoder>,
    frame: FrameNumber,
) {
    let mut send = |message| {
        end.send(&match (message, encoder.as_mut()) {
            (FrameMessage::Batch(bytes), Some(encoder)) => {
                let shorter = encoder.encode(&IdBatch::new(bytes.clone()).unwrap());
                shorter.map_or(FrameMessage::Batch(bytes), FrameMessage::Coded)
            }
            (FrameMessage::Begin { frame, header }, Some(encoder)) => {
                encoder.begin(frame);
                FrameMessage::Begin { frame, header }
            }
            (FrameMessage::End(end), Some(encoder)) => {
                encoder.end(&end);
                FrameMessage::End(end)
            }
            (message, _) => message,
        });
    };
    writer.begin(frame).unwrap();
    send(FrameMessage::Begin { frame, header: to_bytes(&Camera::at_origin(frame)) });
    writer.push(&ids(frame.0).collect::<Vec<_>>(), &mut send).unwrap();
    writer.finish(&mut send).unwrap();
}

/// The result of the frame, if it is over.
fn receive(
    message: FrameMessage,
    decoder: &mut dyn BatchDecoder<DrawableId>,
    assembler: &mut FrameAssembler,
) -> Option<FrameOutcome> {
    let batch = match &message {
        FrameMessage::Batch(bytes) => IdBatch::new(bytes.clone()).ok(),
        FrameMessage::Coded(bytes) => Some(decoder.decode(bytes).unwrap()),
        _ => None,
    };
    let step = match (&message, &batch) {
        (FrameMessage::Begin { frame, .. }, _) => {
            decoder.begin(*frame);
            FrameStep::Begin(*frame)
        }
        (FrameMessage::End(end), _) => {
            decoder.end(end);
            FrameStep::End(*end)
        }
        (plain, Some(batch)) => {
            if matches!(plain, FrameMessage::Batch(_)) {
                decoder.plain(batch);
            }
            FrameStep::Batch { items: batch.count(), bytes: batch.as_bytes() }
        }
        other => panic!("{other:?}"),
    };
    assembler.take(step).unwrap()
}

/// Three frames with repair; packet number `lost` of the second one is lost. Returns the capture without it,
/// and how many bytes were lost; the receiver has all three.
fn three_frames(coding: IdCoding, lost: usize) -> (Vec<(usize, Vec<u8>)>, usize) {
    let coded = coding == IdCoding::Changes;
    let format = Format::of::<Walkthrough>();
    let config = Config { repair: Repair::On, repair_percent: 100, coded, ..Config::new(format) };
    let (mut ends, mut captured) = introduced(config);
    let mut writer = FrameWriter::new(BatchSize::new(100).unwrap());
    let mut encoder = coded.then(|| IdEncoder::new(Delivery::Ordered));
    let (mut assembler, mut decoder) =
        (FrameAssembler::new(u32::MAX), Walkthrough::decoder(u32::MAX).unwrap());
    let (mut now, mut whole, mut bytes) = (Instant::from_nanos(0), 0, 0);
    let mut out = Vec::new();
    for frame in 0..3 {
        send(&mut ends[0], &mut writer, &mut encoder, FrameNumber(frame));
        let mut number = 0;
        for _ in 0..50 {
            now = now.after(Duration::from_millis(1));
            for from in 0..2 {
                while ends[from].poll_transmit(now, &mut out) {
                    number += usize::from(from == 0);
                    if (from, frame, number) == (0, 1, lost) {
                        bytes = out.len();
                        continue;
                    }
                    captured.push((from, out.clone()));
                    ends[1 - from].handle(now, &out);
                }
                if ends[from].poll_timeout().is_some_and(|due| due <= now) {
                    ends[from].handle_timeout(now);
                }
            }
        }
        while let Some(received) = ends[1].recv(UnitLane::Frames) {
            let Received::Frame(message) = received else { panic!("{received:?}") };
            let outcome = receive(message, &mut *decoder, &mut assembler);
            whole += usize::from(matches!(outcome, Some(FrameOutcome::Complete(_))));
        }
    }
    assert_eq!((whole, ends[1].stats().frames_repaired, ends[0].stats().repeated), (3, 1, 0));
    (captured, bytes)
}

#[test]
fn what_came_by_repair_is_said_to_be_missing_and_nothing_is_made_up() {
    let Some(capture) = capture() else { return };
    let sent: BTreeSet<u32> = (0..3).flat_map(ids).map(|id| id.0).collect();
    for coding in [IdCoding::Plain, IdCoding::Changes] {
        for lost in [1, 2] {
            let (packets, bytes) = three_frames(coding, lost);
            std::fs::write(capture.path(), between_two(&packets)).unwrap();
            capture.is_sound();
            let fields = ["trimaran_udp.unit", "trimaran_udp.repair.unseen", "_ws.expert.message"];
            let missing = capture.read("trimaran_udp.not_rebuilt", fields);
            assert!(!missing.is_empty(), "{coding:?}, {lost}");
            for [unit, unseen, said] in &missing {
                assert!(unit.iter().all(|unit| unit == "1"), "{missing:?}");
                let lacks: usize = unseen[0].parse().unwrap();
                // The packet's header and the part's own fields do not belong to the frame.
                assert!((bytes - 60..bytes).contains(&lacks), "{lacks} of {bytes}");
                assert!(said.concat().contains(&format!("not rebuilt: {lacks} bytes of unit 1")), "{said:?}");
            }
            let read: Vec<u32> = capture
                .read("trimaran.id", ["trimaran.id"])
                .into_iter()
                .flat_map(|[ids]| ids)
                .map(|id| id.parse().unwrap())
                .collect();
            assert!(read.iter().all(|id| sent.contains(id)), "{coding:?}, {lost}: ids that nobody sent");
            let of = |frame| read.iter().filter(|id| ids(frame).any(|sent| sent.0 == **id)).count();
            assert_eq!(of(0), IDS as usize, "{coding:?}, {lost}");
            assert!(of(1) < IDS as usize, "{coding:?}, {lost}");
            if coding == IdCoding::Plain {
                assert!(of(1) > 0 && of(2) == IDS as usize, "{lost}: {} and {}", of(1), of(2));
            }
        }
    }
}
