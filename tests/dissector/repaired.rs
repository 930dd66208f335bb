//! Frames that lost packets on their way and that repair made whole: the dissector rebuilds nothing, and says
//! so.

use std::collections::BTreeSet;
use std::time::Duration;

use bytes::{BufMut, BytesMut};
use trimaran_actors::{FrameEvent, FrameStart};
use trimaran_net::Instant;
use trimaran_proto::{
    BatchSize, Camera, DrawableId, FrameNumber, IdCoding, IdDecoder, IdEncoder, Identity, Role,
};
use trimaran_transport::{Delivery, FrameOutcome, Lane, SessionId};
use trimaran_udp::{
    Config, Connecting, Connection, ConnectionId, Door, Progress, Received, Reception, Repair, Security,
};
use trimaran_wire::{FrameAssembler, FrameWriter, Message};

use super::{SCENE, between_two, capture};

/// Of each frame so many ids, all of them new: it takes several packets, whichever way it is coded.
const IDS: u32 = 1500;

fn ids(frame: u32) -> impl Iterator<Item = DrawableId> {
    (0..IDS).map(move |id| DrawableId(1 + frame * 100_000_000 + id * id * 9))
}

/// Two ends in the clear, and what they said until they knew each other.
fn introduced(config: Config) -> ([Connection; 2], Vec<(usize, Vec<u8>)>) {
    let now = Instant::from_nanos(0);
    let mut hello = BytesMut::new();
    let identity = Identity { role: Role::SwitchA, scene: SCENE, settings: None };
    Message::Hello(identity.hello(SessionId(7), Lane::Frames)).encode(&mut hello);
    hello.put_u8(0);
    let door = Door::new(Security::Plaintext, [3; 32]).unwrap();
    let address = "127.0.0.1:7400".parse().unwrap();
    let connecting = Connecting::new(&Security::Plaintext, ConnectionId(1), &hello).unwrap();
    let (mut said, mut first, mut reply) = (Vec::new(), Vec::new(), Vec::new());
    connecting.initial(&mut first);
    let Reception::Reply = door.handle(now, address, &first, &mut reply) else { panic!("no cookie") };
    said.extend([(0, first.clone()), (1, reply.clone())]);
    let Progress::Retry(connecting) = connecting.handle(now, &reply, config) else { panic!("no retry") };
    connecting.initial(&mut first);
    let Reception::Knock(knock) = door.handle(now, address, &first, &mut reply) else { panic!("no knock") };
    let there = knock.take(now, ConnectionId(2), b"", config, &mut reply).unwrap();
    said.extend([(0, first.clone()), (1, reply.clone())]);
    let Progress::Taken(here, _) = connecting.handle(now, &reply, config) else { panic!("not taken") };
    ([*here, there], said)
}

fn send(end: &mut Connection, writer: &mut FrameWriter, encoder: &mut Option<IdEncoder>, frame: u32) {
    let mut send = |message| {
        let message = match encoder {
            Some(encoder) => encoder.encode(message),
            None => Message::Frame(message),
        };
        match message {
            Message::Coded(batch) => end.send_coded(batch),
            Message::Frame(message) => end.send(message),
            other => panic!("{other:?}"),
        }
    };
    let camera = Camera::at_origin(FrameNumber(frame));
    send(writer.begin(FrameStart { frame: FrameNumber(frame), header: camera }).unwrap());
    writer.push(&ids(frame).collect::<Vec<_>>(), &mut send).unwrap();
    writer.finish(&mut send).unwrap();
}

/// Three frames with repair, of the second of which the packet number `lost` gets lost. What was captured
/// behind the loss, and how many bytes got lost; the receiver has all three.
fn three_frames(coding: IdCoding, lost: usize) -> (Vec<(usize, Vec<u8>)>, usize) {
    let config = Config { repair: Repair::On, repair_percent: 100, coding, ..Config::default() };
    let (mut ends, mut captured) = introduced(config);
    let mut writer = FrameWriter::new(BatchSize::new(100).unwrap());
    let mut encoder = (coding == IdCoding::Changes).then(|| IdEncoder::new(Delivery::Ordered));
    let (mut assembler, mut decoder) = (FrameAssembler::new(u32::MAX), IdDecoder::new(u32::MAX));
    let (mut now, mut whole, mut bytes) = (Instant::from_nanos(0), 0, 0);
    let mut out = Vec::new();
    for frame in 0..3 {
        send(&mut ends[0], &mut writer, &mut encoder, frame);
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
        while let Some(received) = ends[1].recv() {
            let message = match received {
                Received::Frame(message) => decoder.plain(message),
                Received::Coded(batch) => decoder.coded(&batch).unwrap(),
                other => panic!("{other:?}"),
            };
            let event = assembler.take(message).unwrap();
            whole += usize::from(matches!(event, FrameEvent::End(FrameOutcome::Complete(_))));
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
                // The packet's header and the part's own fields are no bytes of the frame.
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
