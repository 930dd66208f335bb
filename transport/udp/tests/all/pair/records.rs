//! The lanes of messages and of blocks beside frames: everything arrives in order, with any losses and slow
//! readers.

use std::time::Duration;

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_udp::{Config, Connection, Received, UnitLane};
use trimaran_wire::{CloseReason, MAX_MESSAGE};

use super::network::{CLEAN, Network, ONE_WAY, Pair};
use super::talk::{DEADLINE, RELIABLE, Reader, Sender, items};

const MESSAGES: UnitLane = UnitLane::Messages;
const BULK: UnitLane = UnitLane::Bulk;

/// The longest message each eleventh time, and short ones between.
fn message(number: u32) -> Bytes {
    let length = if number % 11 == 10 { MAX_MESSAGE } else { 4 + number as usize % 200 };
    number.to_le_bytes().into_iter().cycle().take(length).collect()
}

/// Sends messages or blocks from number `next` on, as long as there is room and up to `count`; then closes.
fn say(end: &mut Connection, lane: UnitLane, next: &mut u32, count: u32) {
    while *next <= count && end.is_writable(lane) {
        if *next == count {
            end.end_lane(lane, CloseReason::new(0, "over"));
        } else if lane == BULK {
            end.carry(message(*next));
        } else {
            end.say(message(*next));
        }
        *next += 1;
    }
}

/// An end's reading of the lane: the number of messages, each the expected one, and whether the close
/// followed.
#[derive(Default)]
struct Read {
    messages: u32,
    closed: bool,
}

impl Read {
    fn read(&mut self, end: &mut Connection, lane: UnitLane) {
        while let Some(item) = end.recv(lane) {
            assert!(!self.closed, "nothing comes after the end");
            match item {
                Received::Message(bytes) | Received::Block(bytes) => {
                    assert_eq!(bytes, message(self.messages));
                    self.messages += 1;
                }
                Received::Closed(_) => self.closed = true,
                other => panic!("{other:?}"),
            }
        }
    }
}

/// Both ends send `count` messages or blocks and a close, while the first one sends frames, sixty a second.
/// Returns how many of these were incomplete.
fn converse(network: Network, config: Config, lane: UnitLane, count: u32, frame: &[u32]) -> usize {
    let mut pair = Pair::new(network, config);
    let (mut sender, mut reader) = (Sender::new(config), Reader::default());
    let (mut said, mut read) = ([0; 2], <[Read; 2]>::default());
    let late = Instant::from_nanos(0).after(Duration::from_secs(600));
    let (mut frames, mut due) = (0, Instant::from_nanos(0));
    while read.iter().any(|read| !read.closed) {
        if pair.now >= due && pair.ends[0].is_writable(UnitLane::Frames) {
            sender.send(&mut pair.ends[0], frames, frame);
            (frames, due) = (frames + 1, pair.now.after(Duration::from_micros(16_667)));
        }
        for (end, said) in pair.ends.iter_mut().zip(&mut said) {
            say(end, lane, said, count);
        }
        assert!(pair.step_until(if due > pair.now { due } else { late }, late), "stuck at {:?}", pair.now);
        assert_eq!((pair.ends[0].closed(), pair.ends[1].closed()), (None, None));
        for (end, read) in pair.ends.iter_mut().zip(&mut read) {
            read.read(end, lane);
        }
        reader.read(&mut pair.ends[1]);
    }
    assert_eq!(read.map(|read| read.messages), [count; 2]);
    reader.gaps.len()
}

#[test]
fn messages_and_blocks_arrive_both_ways_in_order_beside_frames() {
    for lane in [MESSAGES, BULK] {
        assert_eq!(converse(CLEAN, RELIABLE, lane, 2000, &items(4000)), 0);
    }
}

/// Frames are given up by the dozen, messages and blocks never.
#[test]
fn every_message_and_block_arrives_once_where_a_third_is_lost_and_frames_have_a_deadline() {
    let lossy = Network { loss: 300, twice: 50, late: 100, ..CLEAN };
    for lane in [MESSAGES, BULK] {
        // Long frames leave blocks nothing of such a network, because blocks go last.
        let frame = if lane == BULK { 100 } else { 1000 };
        let gaps = converse(lossy, DEADLINE, lane, 300, &items(frame));
        assert!(gaps > 10, "only {gaps} frames with gaps: the network loses too little");
    }
}

/// Nothing of an earlier block leaves while a frame or a message has data to send.
#[test]
fn a_block_goes_behind_all_of_a_frame_and_of_messages() {
    const COUNT: u32 = 50;
    let mut pair = Pair::new(CLEAN, RELIABLE);
    let (mut reader, mut said, mut heard) = (Reader::default(), 0, Read::default());
    pair.ends[0].carry(message(0));
    Sender::new(RELIABLE).send(&mut pair.ends[0], 0, &items(100_000));
    while pair.ends[1].recv(BULK).is_none() {
        say(&mut pair.ends[0], MESSAGES, &mut said, COUNT);
        assert!(pair.step(Instant::from_nanos(0).after(Duration::from_secs(60))), "stuck");
        reader.read(&mut pair.ends[1]);
        heard.read(&mut pair.ends[1], MESSAGES);
    }
    assert_eq!((reader.frames.len(), heard.messages), (1, COUNT), "the block came first");
}

/// Nobody reads frames, and their whole window is in flight.
#[test]
fn a_message_waits_for_no_frame_that_nobody_reads() {
    let config = Config { window: 64 << 10, send_buffer: 64 << 10, ..RELIABLE };
    let mut pair = Pair::new(CLEAN, config);
    Sender::new(config).send(&mut pair.ends[0], 0, &items(100_000));
    let settle = |pair: &mut Pair, wait| {
        let end = pair.now.after(wait);
        while pair.step_until(end, end) {}
    };
    settle(&mut pair, Duration::from_secs(1));
    pair.ends[0].say(message(0));
    settle(&mut pair, ONE_WAY);
    assert_eq!(pair.ends[1].recv(MESSAGES), Some(Received::Message(message(0))));
}

/// A message behind a frame of four megabytes leaves with one of the next two packets.
#[test]
fn a_message_overtakes_a_frame_on_its_way() {
    let mut pair = Pair::new(CLEAN, RELIABLE);
    Sender::new(RELIABLE).send(&mut pair.ends[0], 0, &items(1_000_000));
    for _ in 0..100 {
        assert!(pair.step(Instant::from_nanos(u64::MAX)));
    }
    let said_at = pair.now;
    pair.ends[0].say(message(0));
    while pair.ends[1].recv(MESSAGES).is_none() {
        assert!(pair.step(Instant::from_nanos(u64::MAX)));
    }
    assert!(pair.now.since(said_at) < 2 * ONE_WAY, "{:?}", pair.now.since(said_at));
}

/// If losses keep the window small, an endless sender of messages takes at most half of the packets.
#[test]
fn a_frame_goes_on_beside_messages_without_end() {
    let mut pair = Pair::new(Network { loss: 300, ..CLEAN }, RELIABLE);
    let (mut reader, mut said) = (Reader::default(), 0);
    say(&mut pair.ends[0], MESSAGES, &mut said, u32::MAX);
    Sender::new(RELIABLE).send(&mut pair.ends[0], 0, &items(100_000));
    while reader.frames.is_empty() {
        say(&mut pair.ends[0], MESSAGES, &mut said, u32::MAX);
        assert!(pair.step(Instant::from_nanos(u64::MAX)));
        reader.read(&mut pair.ends[1]);
        while pair.ends[1].recv(MESSAGES).is_some() {}
        assert!(pair.now < Instant::from_nanos(0).after(Duration::from_secs(60)), "the frame waits");
    }
}

/// A slow reader holds the sender up, and nothing is lost.
#[test]
fn a_sender_waits_for_a_reader_and_loses_nothing() {
    for lane in [MESSAGES, BULK] {
        let mut pair = Pair::new(CLEAN, RELIABLE);
        let (mut said, mut read) = (0, Read::default());
        let mut go_on = |pair: &mut Pair| {
            say(&mut pair.ends[0], lane, &mut said, 5000);
            pair.step(Instant::from_nanos(0).after(Duration::from_secs(60)));
            said
        };
        let waits = (0..200).map(|_| go_on(&mut pair)).last();
        let waits = waits.unwrap_or_default();
        assert!(waits < 500, "{waits} of {lane:?}, and nobody reads");
        while !read.closed {
            read.read(&mut pair.ends[1], lane);
            go_on(&mut pair);
        }
        assert_eq!(read.messages, 5000);
    }
}

#[test]
fn who_reads_no_more_stops_the_sender_of_that_lane_alone() {
    for lane in [MESSAGES, BULK] {
        let mut pair = Pair::new(CLEAN, RELIABLE);
        pair.ends[1].stop_reading(lane);
        say(&mut pair.ends[0], lane, &mut 0, 1);
        while pair.step(Instant::from_nanos(0).after(Duration::from_secs(1))) {}
        let stopped: Vec<_> =
            UnitLane::ALL.into_iter().filter(|lane| pair.ends[0].is_stopped(*lane)).collect();
        assert_eq!(stopped, [lane]);
    }
}
