//! Values, headers and items of other sizes than in the other tests.

use std::time::Duration;

use proptest::prelude::*;
use trimaran_net::Instant;
use trimaran_udp::{Config, Received, UnitLane};
use trimaran_wire::{BatchSize, FixedBytes, Format, FrameEnd, FrameMessage, FrameNumber, MAX_FIXED};

use super::network::{Network, Pair, SEALED};
use super::talk::RELIABLE;

/// The most items of a frame.
const MOST: u32 = 300;

/// The item of that number: `size` bytes that differ from those of its neighbours.
fn item(number: u32, size: usize) -> impl Iterator<Item = u8> {
    number.wrapping_mul(2_654_435_761).to_be_bytes().into_iter().cycle().take(size)
}

/// Sends frames of so many items, one every 5 ms; returns how many items of each arrived. Those are whole and
/// in order, and each frame has its header and end.
fn came(network: Network, config: Config, counts: &[u32]) -> Vec<u32> {
    let size = config.format.item;
    let mut pair = Pair::new(network, config);
    let (header, mut came, mut next) = (FixedBytes::from_elem(3, config.format.header), Vec::new(), 0);
    for (frame, count) in (0..).zip(counts) {
        pair.ends[0].publish(None, FixedBytes::from_elem(frame as u8, config.format.latest));
        let begin = FrameMessage::Begin { frame: FrameNumber(frame), header: header.clone() };
        pair.ends[0].send(&begin);
        for first in (0..*count).step_by(config.batch.items()) {
            let numbers = first..(*count).min(first + config.batch.items() as u32);
            let bytes = numbers.flat_map(|number| item(number, size)).collect();
            pair.ends[0].send(&FrameMessage::Batch(bytes));
        }
        let end = FrameEnd { frame: FrameNumber(frame), items: *count, hash: 9 };
        pair.ends[0].send(&FrameMessage::End(end));
        let last = frame as usize + 1 == counts.len();
        let until =
            if last { Instant::from_nanos(u64::MAX) } else { pair.now.after(Duration::from_millis(5)) };
        while !(last && pair.ends[0].is_drained()) && pair.step(until) {
            assert_eq!((pair.ends[0].closed(), pair.ends[1].closed()), (None, None));
            while let Some(Received::Frame(message)) = pair.ends[1].recv(UnitLane::Frames) {
                match message {
                    FrameMessage::Begin { frame, header: came_with } => {
                        assert_eq!((frame.0 as usize, &came_with), (came.len(), &header));
                        came.push(0);
                        next = 0;
                    }
                    FrameMessage::Batch(bytes) => {
                        assert!(bytes.len() <= config.format.batch(config.batch));
                        for bytes in bytes.chunks(size) {
                            let found =
                                (next..MOST).find(|number| item(*number, size).eq(bytes.iter().copied()));
                            assert_ne!(found, None, "an item that was not sent, or out of order");
                            next = found.unwrap() + 1;
                            *came.last_mut().unwrap() += 1;
                        }
                    }
                    FrameMessage::End(end) => {
                        assert_eq!((end.items, end.hash), (counts[came.len() - 1], 9));
                    }
                    other => panic!("{other:?}"),
                }
            }
        }
    }
    assert_eq!(
        pair.ends[1].latest(None),
        Some(FixedBytes::from_elem(counts.len() as u8 - 1, config.format.latest))
    );
    came
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn items_of_any_size_come_whole_and_in_order_and_all_of_them_without_a_deadline(
        loss in 0u64..200, seed: u64, frame_deadline in prop::option::of(1u64..40),
        latest in prop::sample::select(vec![0, 5, MAX_FIXED]), header in prop::sample::select(vec![0, 8, MAX_FIXED]),
        size in prop::sample::select(vec![4, 5, 12, 100, 255, 256]), batch in prop::sample::select(vec![1, 7, 256]),
        counts in prop::collection::vec(0..MOST, 1..6),
    ) {
        let format = Format { latest, header, item: size, ..RELIABLE.format };
        let (frame_deadline, batch) = (frame_deadline.map(Duration::from_millis), BatchSize::new(batch).unwrap());
        let config = Config { format, frame_deadline, batch, ..RELIABLE };
        let came = came(Network { loss, seed, ..SEALED }, config, &counts);
        prop_assert_eq!(came.len(), counts.len());
        if frame_deadline.is_none() {
            prop_assert_eq!(came, counts);
        }
    }
}

/// A shard fills a packet for any size of item.
#[test]
fn large_items_take_no_more_packets_than_small_ones() {
    let packets = |item: usize| {
        let config = Config { format: Format { item, ..RELIABLE.format }, max_datagram: 1200, ..RELIABLE };
        let mut pair = Pair::new(SEALED, config);
        pair.ends[0]
            .send(&FrameMessage::Begin { frame: FrameNumber(0), header: FixedBytes::from_elem(3, 72) });
        pair.ends[0].send(&FrameMessage::Batch(vec![1; 51_200].into()));
        pair.ends[0].send(&FrameMessage::End(FrameEnd {
            frame: FrameNumber(0),
            items: 51_200 / item as u32,
            hash: 9,
        }));
        while !pair.ends[0].is_drained() {
            assert!(pair.step(pair.now.after(Duration::from_secs(1))));
        }
        pair.ends[0].stats().sent
    };
    assert_eq!([100, 256].map(packets), [packets(4); 2]);
}
