//! Channels: further lanes of values and of frames, each with sizes, an order and an end of its own.

use std::time::Duration;

use bytes::Bytes;
use trimaran_udp::{Config, Connection, LatestEnd, Received, UnitLane};
use trimaran_wire::{
    BatchSize, Channel, ChannelNumber, CloseReason, FixedBytes, Format, FrameEnd, FrameMessage, FrameNumber,
    Protocol,
};

use super::network::{CLEAN, Pair};
use super::talk::RELIABLE;

/// A coded batch has as many items as bytes.
#[derive(Debug, Clone, PartialEq)]
struct Words;

impl Protocol for Words {
    const NAME: &'static str = "words/1";
    type Hello = ();
    type Latest = ();
    type Header = u16;
    type Item = [u32; 3];
    type Message = ();

    fn count_coded(bytes: &[u8]) -> Option<usize> {
        Some(bytes.len())
    }
}

const CHANNELS: &[Channel] = &[
    Channel::frames::<u16, [u32; 3]>("plain"),
    Channel::frames_of::<Words>("coded"),
    Channel::latest::<u64>("value"),
];
const VALUES: Option<ChannelNumber> = Some(ChannelNumber(2));
/// The lanes of frames, with the bytes of their headers and items.
const LANES: [(UnitLane, usize, usize); 3] = [
    (UnitLane::Frames, 72, 4),
    (UnitLane::Channel(ChannelNumber(0)), 2, 12),
    (UnitLane::Channel(ChannelNumber(1)), 2, 12),
];

fn pair(coded: bool) -> Pair {
    let format = Format { channels: CHANNELS, ..RELIABLE.format };
    Pair::new(CLEAN, Config { format, coded, ..RELIABLE })
}

/// The messages of a frame of three items around these.
fn frame(number: u32, header: usize, batches: Vec<FrameMessage>) -> Vec<FrameMessage> {
    let frame = FrameNumber(number);
    let begin = FrameMessage::Begin { frame, header: FixedBytes::from_elem(number as u8, header) };
    let end = FrameMessage::End(FrameEnd { frame, items: 3, hash: 9 });
    [vec![begin], batches, vec![end]].concat()
}

fn batch(number: u32, bytes: usize) -> FrameMessage {
    FrameMessage::Batch(vec![number as u8; bytes].into())
}

/// Lets everything that the first end has sent arrive.
fn settle(pair: &mut Pair) {
    let end = pair.now.after(Duration::from_secs(10));
    while !pair.ends[0].is_drained() {
        assert!(pair.step(end), "stuck");
    }
    assert_eq!(pair.ends.each_ref().map(Connection::closed), [None, None]);
}

fn read(end: &mut Connection, lane: UnitLane) -> Vec<Received> {
    std::iter::from_fn(|| end.recv(lane)).collect()
}

#[test]
fn each_channel_has_lanes_of_its_own_up_to_their_ends() {
    let (mut pair, reason) = (pair(false), CloseReason::new(0, "over"));
    let state = |pair: &Pair| {
        let [sender, receiver] = &pair.ends;
        let frames = LANES.map(|(lane, ..)| (sender.is_lane_drained(lane), receiver.is_readable(lane)));
        (frames, sender.is_latest_drained(VALUES), receiver.is_latest_readable(VALUES))
    };
    pair.ends[1].set_batch(BatchSize::new(1).unwrap());
    for (number, (lane, header, item)) in (0..).zip(LANES) {
        for message in frame(number, header, vec![batch(number, 3 * item)]) {
            pair.ends[0].send_on(lane, &message);
        }
        pair.ends[0].gone(lane);
    }
    pair.ends[0].publish(VALUES, FixedBytes::from_elem(5, 8));
    pair.ends[0].end_latest(VALUES, Some(reason.clone()));
    assert_eq!(state(&pair), ([(false, false); 3], false, false));
    settle(&mut pair);
    assert_eq!(state(&pair), ([(true, true); 3], true, true));
    let receiver = &mut pair.ends[1];
    for (number, (lane, header, item)) in (0..).zip(LANES) {
        let expected = frame(number, header, vec![batch(number, item); 3]);
        let expected: Vec<_> = expected.into_iter().map(Received::Frame).chain([Received::Gone]).collect();
        assert_eq!(read(receiver, lane), expected);
    }
    assert_eq!((receiver.latest(None), receiver.latest_end(None)), (None, None));
    assert_eq!(receiver.latest(VALUES), Some(FixedBytes::from_elem(5, 8)));
    assert_eq!(receiver.latest_end(VALUES), Some(&LatestEnd::Closed(reason)));
    assert_eq!(state(&pair), ([(true, false); 3], true, true), "the end of values can be read again");
}

/// A coded batch is left out of a frame that is not to be coded.
#[test]
fn frames_of_a_channel_are_coded_if_its_declaration_and_the_connection_say_so() {
    for (first, then, coded) in [
        (false, None, [false; 3]),
        (true, None, [true, false, true]),
        (false, Some(true), [true, false, true]),
        (true, Some(false), [false; 3]),
    ] {
        let mut pair = pair(first);
        then.into_iter().for_each(|coded| pair.ends[0].set_coded(coded));
        let batch = FrameMessage::Coded(Bytes::from_static(&[0; 8]));
        for (lane, header, _) in LANES {
            for message in frame(0, header, vec![batch.clone()]) {
                pair.ends[0].send_on(lane, &message);
            }
        }
        settle(&mut pair);
        let came = LANES.map(|(lane, ..)| {
            let received = read(&mut pair.ends[1], lane);
            assert!(received.len() >= 2, "{received:?}");
            received.contains(&Received::Frame(batch.clone()))
        });
        assert_eq!(came, coded, "{first}, {then:?}");
    }
}
