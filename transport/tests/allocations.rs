//! What links allocate in steady state: nothing for a packet, a camera or a batch. Alone in its program,
//! whose allocator counts.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::alloc::System;

use common::{camera, ids, joined, start};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use trimaran_proto::{DrawableId, FrameEvent, FrameOutcome, IdCoding};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{FrameReceiver, Link, Options};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Cameras and frames before anything counts: buffers grow to the size that they need.
const WARM_UP: u32 = 40;
const CAMERAS: u32 = 1000;
const FRAMES: u32 = 100;
/// A batch at a time holds 256 of them: a frame is 16 batches, in 15 packets over UDP.
const IDS: u32 = 4000;

/// Sends cameras there and back.
async fn cameras(near: &mut Link, far: &mut Link, count: u32) {
    for number in 0..count {
        near.latest_tx.publish(camera(number)).unwrap();
        let there = far.latest_rx.latest().await.unwrap();
        far.latest_tx.publish(there).unwrap();
        assert_eq!(near.latest_rx.latest().await.unwrap(), camera(number));
    }
}

/// Sends frames, each until its last id is there.
async fn frames(near: &mut Link, far: &mut Link, numbers: std::ops::Range<u32>, ids: &[DrawableId]) {
    for number in numbers {
        let send = async {
            near.frames_tx.begin(start(number)).await.unwrap();
            near.frames_tx.push(ids).await.unwrap();
            near.frames_tx.finish().await.unwrap();
        };
        let ((), received) = tokio::join!(send, read(&mut far.frames_rx));
        assert_eq!(received, ids.len());
    }
}

/// How many ids the next frame has.
async fn read(frames: &mut FrameReceiver) -> usize {
    let mut count = 0;
    loop {
        match frames.recv().await.unwrap() {
            FrameEvent::Begin(_) => {}
            FrameEvent::Ids(batch) => count += batch.iter().count(),
            FrameEvent::End(FrameOutcome::Complete(_)) => return count,
            other => panic!("{other:?} in a frame"),
        }
    }
}

/// How often memory was asked for since `region` began.
fn asked(region: &Region<'_, System>) -> usize {
    let change = region.change();
    change.allocations + change.reallocations
}

#[tokio::test]
async fn in_steady_state_neither_cameras_nor_frames_allocate() {
    let mut options = Options {
        udp: UdpOptions { trust: Trust::SharedKey([9; 32].into()), ..UdpOptions::default() },
        ..Options::default()
    };
    options.link.coding = IdCoding::Plain;
    let ids = ids(IDS);
    for endpoint in ["tcp://127.0.0.1:0", "udp://127.0.0.1:0"] {
        let (mut near, mut far) = joined(endpoint, &options).await;
        cameras(&mut near, &mut far, WARM_UP).await;
        frames(&mut near, &mut far, 0..WARM_UP, &ids).await;

        let region = Region::new(ALLOCATOR);
        cameras(&mut near, &mut far, CAMERAS).await;
        let by_cameras = asked(&region);

        let region = Region::new(ALLOCATOR);
        frames(&mut near, &mut far, WARM_UP..WARM_UP + FRAMES, &ids).await;
        let by_frames = asked(&region);

        // Not none: where the machine stalls, packets are acknowledged in larger heaps than usual.
        assert!(
            by_cameras <= 10,
            "{endpoint}: {by_cameras} allocations for {CAMERAS} cameras there and back"
        );
        assert!(by_frames <= FRAMES as usize / 4, "{endpoint}: {by_frames} allocations for {FRAMES} frames");
    }
}
