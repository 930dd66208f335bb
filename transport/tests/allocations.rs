//! Allocations of links in steady state: none for a packet, a pose or a batch. Alone in its program, whose
//! allocator counts.
#![cfg(all(feature = "inproc", feature = "tcp", feature = "udp"))]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::alloc::System;

use common::{Link, joined};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use trimaran_transport::conformance::{Robot, points, pose, send_frame};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{FrameEvent, FrameOutcome, FrameReceiver, Options};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Poses and frames before the measurement: buffers grow to their final size.
const WARM_UP: u32 = 40;
const POSES: u32 = 1000;
const FRAMES: u32 = 100;
/// A batch holds 256 of them: a frame is 16 batches, in 15 packets over UDP.
const POINTS: u32 = 4000;

/// Sends poses there and back.
async fn poses(near: &mut Link, far: &mut Link, count: u32) {
    for number in 0..count {
        near.latest_tx.publish(pose(number)).unwrap();
        let there = far.latest_rx.latest().await.unwrap();
        far.latest_tx.publish(there).unwrap();
        assert_eq!(near.latest_rx.latest().await.unwrap(), pose(number));
    }
}

/// Sends frames, each until its last point is there.
async fn frames(near: &mut Link, far: &mut Link, numbers: std::ops::Range<u32>, points: &[u32]) {
    for number in numbers {
        let send = async {
            send_frame(&mut near.frames_tx, number, points).await.unwrap();
        };
        let ((), received) = tokio::join!(send, read(&mut far.frames_rx));
        assert_eq!(received, points.len());
    }
}

/// The number of points in the next frame.
async fn read(frames: &mut FrameReceiver<Robot>) -> usize {
    let mut count = 0;
    loop {
        match frames.recv().await.unwrap() {
            FrameEvent::Begin(_) => {}
            FrameEvent::Batch(batch) => count += batch.iter().count(),
            FrameEvent::End(FrameOutcome::Complete(_)) => return count,
            other => panic!("{other:?} in a frame"),
        }
    }
}

/// The number of allocations since `region` began.
fn asked(region: &Region<'_, System>) -> usize {
    let change = region.change();
    change.allocations + change.reallocations
}

#[tokio::test]
async fn in_steady_state_neither_poses_nor_frames_allocate() {
    let options =
        Options::default().with_udp(UdpOptions::default().with_trust(Trust::SharedKey([9; 32].into())));
    let points = points(POINTS);
    for endpoint in ["tcp://127.0.0.1:0", "udp://127.0.0.1:0"] {
        let (mut near, mut far) = joined(endpoint, &options).await;
        poses(&mut near, &mut far, WARM_UP).await;
        frames(&mut near, &mut far, 0..WARM_UP, &points).await;

        let region = Region::new(ALLOCATOR);
        poses(&mut near, &mut far, POSES).await;
        let by_poses = asked(&region);

        let region = Region::new(ALLOCATOR);
        frames(&mut near, &mut far, WARM_UP..WARM_UP + FRAMES, &points).await;
        let by_frames = asked(&region);

        // Not none: if the machine stalls, packets are acknowledged in larger groups, and some are sent
        // again. One allocation for each pose or frame would be far more.
        assert!(
            by_poses <= POSES as usize / 10,
            "{endpoint}: {by_poses} allocations for {POSES} poses there and back"
        );
        assert!(by_frames <= FRAMES as usize / 2, "{endpoint}: {by_frames} allocations for {FRAMES} frames");
    }
}
