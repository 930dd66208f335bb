//! The memory of a reader whose peer never ends a frame: no more than the frame may have, for any coding.
//! Alone in its program, whose allocator counts.
#![cfg(all(unix, feature = "inproc", feature = "quic", feature = "tcp", feature = "udp", feature = "unix"))]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::alloc::System;
use std::time::Duration;

use common::meeting::Meeting;
use common::{Link, connect, net, soon};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use tokio::sync::Mutex;
use trimaran_transport::conformance::{PANEL, greeting, receive, start};
use trimaran_transport::quic::QuicOptions;
use trimaran_transport::udp::UdpOptions;
use trimaran_transport::{
    BatchSize, Batching, FrameEvent, FrameNumber, FrameOrderError, FrameViolation, LinkConfig, Options,
    ProtocolError, RecvError, SendError,
};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The most points of a frame: as many as a batch, so that every excess batch is whole.
const MOST: u32 = 16_384;
/// How many batches of so many points the peer sends in its second frame.
const BATCHES: usize = 1000;
/// How many bytes may be in flight in either direction over quic and udp.
const WINDOW: usize = 256 << 10;
/// The memory for the points of a frame at a reader that gathers them.
const FRAME: usize = 4 * MOST as usize;

const ENDPOINTS: [&str; 5] =
    ["inproc:bound", "unix:", "tcp://127.0.0.1:0", "udp://127.0.0.1:0", "quic://127.0.0.1:0"];

/// Only one test at a time counts.
static ALONE: Mutex<()> = Mutex::const_new(());

fn held() -> usize {
    let stats = ALLOCATOR.stats();
    stats.bytes_allocated.saturating_sub(stats.bytes_deallocated)
}

fn options(coded: bool, max_frame: u32) -> Options {
    // So that a wait in vain ends soon.
    let timeout = Duration::from_millis(300);
    let batching = Batching { size: BatchSize::MAX, coded };
    let link = LinkConfig::default().with_timeout(timeout).with_batching(batching).with_max_frame(max_frame);
    Options::default()
        .with_link(link)
        .with_quic(QuicOptions::default().with_window(WINDOW as u32))
        .with_udp(UdpOptions::default().with_window(WINDOW as u32).with_send_buffer(WINDOW))
}

/// A link whose near end takes so many points a frame, and whose far end may send any number. The near end
/// listens, or else connects.
async fn joined(endpoint: &str, coded: bool, listens: bool) -> (Link, Link, Meeting) {
    let (near, far) = (options(coded, MOST), options(coded, u32::MAX));
    let (at_listener, at_connector) = if listens { (near, far) } else { (far, near) };
    let mut meeting = Meeting::at(endpoint, &at_listener).await;
    let connector = at_connector.with_security(meeting.panel.security.clone());
    let net = net();
    let (there, here) = tokio::join!(
        connect(&net, &meeting.at, greeting(PANEL), &connector, soon(&net)),
        meeting.listener.accept(soon(&net)),
    );
    let (there, here) = (there.unwrap(), here.unwrap());
    if listens { (here, there, meeting) } else { (there, here, meeting) }
}

/// A whole frame, and then one that never ends, until all is sent or the path is full.
async fn lie(far: &mut Link, points: &[u32]) {
    let frames = &mut far.frames_tx;
    let said = async {
        frames.begin(start(0)).await?;
        frames.push(points).await?;
        frames.finish().await?;
        frames.begin(start(1)).await?;
        for _ in 0..BATCHES {
            frames.push(points).await?;
        }
        Ok(())
    };
    let said = said.await;
    assert!(matches!(said, Ok(()) | Err(SendError::Stalled { .. })), "{said:?}");
}

/// The result of reading: the error, the most points and bytes held, and the bytes of the batches.
struct Read {
    end: RecvError,
    gathered: usize,
    most: usize,
    wire: u64,
}

/// Gathers frames like a panel, until that fails.
async fn gather(near: &mut Link, before: usize) -> Read {
    let (mut points, mut most) = (Vec::new(), 0);
    loop {
        let event = near.frames_rx.recv().await;
        most = most.max(held().saturating_sub(before));
        match event {
            Ok(FrameEvent::Begin(_)) => points.clear(),
            Ok(FrameEvent::Batch(batch)) => {
                points.extend(batch.iter());
            }
            Ok(_) => {}
            Err(end) => {
                let wire = near.stats.read().received.batches.bytes;
                return Read { end, gathered: points.len(), most, wire };
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_without_an_end_ends_the_link_at_the_first_id_too_many() {
    let _alone = ALONE.lock().await;
    let points: Vec<_> = (0..MOST).collect();
    for endpoint in ENDPOINTS {
        for coded in [true, false] {
            for listens in [true, false] {
                let (mut near, mut far, _meeting) = joined(endpoint, coded, listens).await;
                // Measured after the liar's own data and the data in flight are there.
                lie(&mut far, &points).await;
                let before = held();
                let read = gather(&mut near, before).await;
                let Read { end, gathered, most, wire } = read;
                println!("{endpoint} coded {coded}: {wire} bytes of points, {most} bytes held");
                let RecvError::Protocol { cause, .. } = &end else { panic!("{endpoint}: {end:?}") };
                match cause {
                    ProtocolError::Frame(FrameViolation::Beyond { frame: FrameNumber(1), most: MOST }) => {}
                    ProtocolError::Coded(fault) if fault.to_string().contains("more than 16384 points") => {}
                    other => panic!("{endpoint}: {other:?}"),
                }
                assert_eq!(
                    gathered, MOST as usize,
                    "{endpoint}: the batch too many was not given to the reader"
                );
                // The points of the frame and of the one before, to which changes refer, and the reader's own
                // buffers.
                assert!(most < 8 * FRAME, "{endpoint} coded {coded}: {most} bytes");
            }
        }
    }
}

#[tokio::test]
async fn who_would_send_more_points_than_a_frame_may_have_is_told_before_they_leave() {
    let _alone = ALONE.lock().await;
    let (mut near, mut far, _meeting) = joined("tcp://127.0.0.1:0", false, true).await;
    let points: Vec<_> = (0..MOST).collect();
    near.frames_tx.begin(start(0)).await.unwrap();
    near.frames_tx.push(&points).await.unwrap();
    let refused = near.frames_tx.push(&points[..1]).await.unwrap_err();
    let SendError::Order { cause: FrameOrderError::TooMany { most: MOST, .. }, .. } = refused else {
        panic!("{refused:?}")
    };
    near.frames_tx.finish().await.unwrap();
    assert_eq!(receive(&mut far.frames_rx).await.unwrap().points, points, "the frame is as good as before");
}
