//! Batches as changes: fewer bytes, and no frame spoilt by the loss of another.

use std::time::Duration;

use proptest::prelude::*;
use trimaran_udp::{Config, Connection, UnitLane};
use trimaran_wire::{BatchSize, FrameNumber};

use super::network::{CLEAN, Network, Pair, SEALED};
use super::talk::{DEADLINE, RELIABLE, Reader, Sender, converse};

/// Sixty frames a second.
const PAUSE: Duration = Duration::from_micros(16_667);

const fn as_changes(config: Config) -> Config {
    Config { coded: true, ..config }
}

/// A walk: each frame has lost some items of the one before and gained others; now and then all are new.
fn walk(frames: usize, size: u32, changed: u32, seed: u64) -> Vec<Vec<u32>> {
    let mut state = seed;
    let mut next = |below: u32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as u32) % below.max(1)
    };
    let mut items = std::collections::BTreeSet::new();
    (0..frames)
        .map(|frame| {
            if frame % 50 == 0 {
                items = (0..size).map(|item| item * 40 + next(40)).collect();
            }
            for _ in 0..changed {
                let lost = items.iter().nth(next(size) as usize).copied();
                lost.map(|item| items.remove(&item));
                items.insert(next(size * 40));
            }
            items.iter().copied().collect()
        })
        .collect()
}

#[test]
fn a_walk_takes_a_tenth_of_the_bytes_and_repeats_every_item() {
    let frames = walk(100, 4000, 20, 1);
    for config in [RELIABLE, DEADLINE] {
        let bytes = [config, as_changes(config)].map(|config| {
            let (pair, reader) = converse(SEALED, config, &frames, PAUSE);
            assert_eq!(reader.gaps, []);
            assert_eq!(reader.coded > 0, config.coded);
            pair.bytes[0]
        });
        assert!(bytes[1] * 10 <= bytes[0], "{bytes:?}");
    }
}

#[test]
fn with_deadlines_changes_refer_to_what_was_confirmed_whatever_else_was_lost() {
    let frames = walk(300, 500, 10, 2);
    let config =
        Config { repair_percent: 0, frame_deadline: Some(Duration::from_millis(17)), ..as_changes(RELIABLE) };
    let (pair, reader) = converse(Network { loss: 200, ..SEALED }, config, &frames, PAUSE);
    assert!(reader.gaps.len() > 40, "{} frames with gaps", reader.gaps.len());
    assert!(reader.coded > 40, "{} batches as changes", reader.coded);
    assert!(pair.ends[0].stats().frames_given_up as usize >= reader.gaps.len());
}

/// A frame sent before any acknowledgement has no reference.
#[test]
fn a_frame_is_confirmed_once_all_of_it_was_acknowledged() {
    let config = as_changes(DEADLINE);
    let mut pair = Pair::new(CLEAN, config);
    let (mut sender, mut reader) = (Sender::new(config), Reader::default());
    let items: Vec<u32> = (0..4000).map(|item| item * 1000).collect();
    sender.send(&mut pair.ends[0], 7, &items);
    assert_eq!(pair.ends[0].confirmed_frame(UnitLane::Frames), None);
    while !pair.ends[0].is_drained() {
        assert_eq!(pair.ends[0].confirmed_frame(UnitLane::Frames), None, "only a part has arrived");
        assert!(pair.step(pair.now.after(Duration::from_secs(1))));
    }
    assert_eq!(pair.ends[0].confirmed_frame(UnitLane::Frames), Some(FrameNumber(7)));
    let before = pair.bytes[0];
    sender.send(&mut pair.ends[0], 8, &items);
    while !pair.ends[0].is_drained() {
        assert!(pair.step(pair.now.after(Duration::from_secs(1))));
    }
    assert!(pair.bytes[0] - before < 300, "{} bytes for a frame without a change", pair.bytes[0] - before);
    reader.read(&mut pair.ends[1]);
    assert_eq!(reader.frames, [items.clone(), items]);
}

#[test]
fn a_frame_that_was_given_up_is_never_confirmed() {
    let config = Config { frame_deadline: Some(Duration::from_millis(8)), ..as_changes(RELIABLE) };
    let mut pair = Pair::new(Network { loss: 1000, ..CLEAN }, config);
    let mut sender = Sender::new(config);
    sender.send(&mut pair.ends[0], 0, &[1]);
    let until = pair.now.after(Duration::from_millis(50));
    while pair.step(until) {}
    pair.network.loss = 0;
    let mut reader = Reader::default();
    while !pair.ends[0].is_drained() {
        assert!(pair.step(pair.now.after(Duration::from_secs(10))));
        reader.read(&mut pair.ends[1]);
    }
    assert_eq!(
        (reader.gaps.as_slice(), pair.ends[0].confirmed_frame(UnitLane::Frames)),
        (&[(0, 1)][..], None)
    );
    assert_eq!(pair.ends.each_ref().map(Connection::closed), [None, None]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

    /// Every frame is exactly as sent or known to have gaps: [`converse`] compares, and each complete one has
    /// the hash of its end.
    #[test]
    fn no_frame_is_spoilt_by_another_ones_loss(
        loss in 0u64..400, twice in 0u64..200, late in 0u64..300, broken in 0u64..100,
        bursts in prop::sample::select(vec![0u64, 10]), sealed: bool, seed: u64, frame_deadline in prop::option::of(1u64..80), repair_percent in 0u8..40,
        mtu in 1200usize..1460, pause in 0u64..20, batch in prop::sample::select(vec![1, 7, 100, 1024, 16_384]),
        size in 0u32..3000, changed in 0u32..60, count in 1usize..40,
    ) {
        let network = Network { loss, twice, late, broken, bursts, sealed, seed, mtu };
        let config = Config {
            frame_deadline: frame_deadline.map(Duration::from_millis),
            repair_percent,
            batch: BatchSize::new(batch).unwrap(),
            ..as_changes(RELIABLE)
        };
        let frames = walk(count, size, changed, seed);
        let (pair, reader) = converse(network, config, &frames, Duration::from_millis(pause));
        prop_assert!(frame_deadline.is_some() || reader.gaps.is_empty());
        prop_assert!(pair.ends[0].is_drained());
    }
}
