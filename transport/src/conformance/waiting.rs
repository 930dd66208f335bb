//! Slow receivers, quiet peers, deadlines, and waits that are dropped.

use std::num::NonZeroUsize;
use std::time::Duration;

use super::pairs::Pairs;
use super::talk::{ARM, PANEL, batches_of, command, finished, patient};
use super::talk::{points, pose, receive, send_frame, start};
use crate::{FrameEvent, KeepLast, LinkConfig, RecvError, SendError, Skipped, sleep_until, until};

/// A sender without a reader waits for room before it has sent 64 MiB, and no longer than its timeout.
pub async fn a_slow_receiver_holds_the_sender_back(pairs: &impl Pairs) {
    let config = LinkConfig { timeout: Duration::from_millis(200), ..batches_of(16_384) };
    let (mut arm, panel) = pairs.pair(config).await;
    arm.frames_tx.begin(start(0)).await.unwrap();
    let batch = points(16_384);
    let mut taken = 0;
    let error = loop {
        match arm.frames_tx.push(&batch).await {
            Ok(()) => taken += batch.len() * 4,
            Err(error) => break error,
        }
        assert!(taken < 64 << 20, "64 MiB taken and nobody reads");
    };
    assert!(matches!(error, SendError::Stalled { ref peer, .. } if peer.as_str() == PANEL), "{error}");
    drop(panel);
}

/// A frame larger than may be in flight at once arrives once it is read.
pub async fn a_receiver_that_catches_up_gets_everything(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(LinkConfig { max_frame: 16 << 20, ..batches_of(16_384) }).await;
    let all = points(16 << 20);
    let writer = async {
        send_frame(&mut arm.frames_tx, 0, &all).await.unwrap();
    };
    let net = pairs.net();
    let reader = async {
        sleep_until(&*net, net.now().after(Duration::from_millis(50))).await;
        receive(&mut panel.frames_rx).await.unwrap()
    };
    let ((), got) = tokio::join!(writer, reader);
    assert!(got.points == all, "64 MiB of points");
}

/// A reader of the newest frames neither holds up the peer nor sees old ones, however late it is.
pub async fn a_reader_of_the_newest_frames_holds_nobody_up(pairs: &impl Pairs) {
    // 24 MB, more than any transport holds.
    const FRAMES: u32 = 100;
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let depth = NonZeroUsize::new(2).unwrap();
    panel.frames_rx = panel.frames_rx.keep_last(KeepLast { depth, lifespan: None });
    let all = points(60_000);
    for frame in 0..FRAMES {
        send_frame(&mut arm.frames_tx, frame, &all).await.unwrap();
    }
    let (mut seen, mut last) = (0, None);
    while last != Some(FRAMES - 1) {
        let frame = panel.frames_rx.frame().await.unwrap();
        let number = frame.start.frame.0;
        let passed = u64::from(number - last.map_or(0, |last| last + 1));
        assert_eq!(frame.skipped, Skipped { replaced: passed, ..Skipped::default() });
        assert!(frame.items().eq(all.iter().copied()), "frame {number}");
        (seen, last) = (seen + 1, Some(number));
    }
    assert_eq!(panel.stats.read().skipped.replaced + seen, u64::from(FRAMES));
}

/// A reader's thread may be busy for longer than the timeout of the link.
pub async fn a_busy_receiver_is_no_dead_peer(pairs: &impl Pairs) {
    let config = LinkConfig { timeout: Duration::from_millis(100), ..LinkConfig::default() };
    let (mut arm, mut panel) = pairs.pair(config).await;
    let runtime = tokio::runtime::Handle::current();
    let reader = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(400));
        let got = runtime.block_on(receive(&mut panel.frames_rx)).unwrap();
        std::thread::sleep(Duration::from_millis(400));
        runtime.block_on(async { panel.latest_tx.publish(pose(1)).unwrap() });
        (got, panel)
    });
    arm.frames_tx.begin(start(0)).await.unwrap();
    // Few enough that no send waits for room.
    arm.frames_tx.push(&points(1000)).await.unwrap();
    arm.frames_tx.finish().await.unwrap();
    assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(1));
    let (got, _panel) = tokio::task::spawn_blocking(|| reader.join().unwrap()).await.unwrap();
    assert_eq!(got.points, points(1000));
}

/// A peer that has nothing to send for longer than the timeout of the link is not at fault.
pub async fn a_quiet_peer_is_no_dead_peer(pairs: &impl Pairs) {
    let timeout = Duration::from_millis(20);
    let (mut arm, mut panel) = pairs.pair(LinkConfig { timeout, ..LinkConfig::default() }).await;
    let net = pairs.net();
    let listen =
        async { tokio::join!(receive(&mut arm.frames_rx), arm.latest_rx.latest(), arm.messages_rx.recv()) };
    let speak = async {
        sleep_until(&*net, net.now().after(timeout * 10)).await;
        panel.latest_tx.publish(pose(3)).unwrap();
        panel.messages_tx.send(&command(4)).await.unwrap();
        send_frame(&mut panel.frames_tx, 0, &points(5)).await.unwrap();
    };
    let ((frame, value, message), ()) = tokio::join!(listen, speak);
    assert_eq!(frame.unwrap().points, points(5));
    assert_eq!((value.unwrap(), message.unwrap()), (pose(3), command(4)));
}

/// A deadline that passes costs nothing but that call.
pub async fn a_deadline_leaves_the_link_usable(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let net = pairs.net();
    for frame in 0..3 {
        let by = net.now().after(Duration::from_millis(10));
        let missed = panel.frames_rx.recv_by(by).await;
        assert!(
            matches!(missed, Err(RecvError::Deadline { ref peer }) if peer.as_str() == ARM),
            "{missed:?}"
        );
        send_frame(&mut arm.frames_tx, frame, &points(300)).await.unwrap();
        assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(300));
    }
}

/// Polling returns everything that arrives, and the end.
pub async fn polling_takes_what_is_there(pairs: &impl Pairs) {
    // More batches than a runtime lets a task take at once.
    let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
    let net = pairs.net();
    assert!(matches!(panel.frames_rx.try_recv(), Ok(None)));
    send_frame(&mut arm.frames_tx, 0, &points(2000)).await.unwrap();
    let mut got = Vec::new();
    loop {
        match panel.frames_rx.try_recv().unwrap() {
            Some(FrameEvent::Batch(batch)) => got.extend(batch.iter()),
            Some(FrameEvent::End(_)) => break,
            Some(FrameEvent::Begin(_)) => {}
            None => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
        }
    }
    assert_eq!(got, points(2000));
    let poll = async {
        loop {
            match panel.frames_rx.try_recv() {
                Ok(None) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
                ended => break ended,
            }
        }
    };
    let (_left, ended) = tokio::join!(arm.close(finished()), poll);
    assert!(matches!(ended, Err(RecvError::Closed { .. })), "{ended:?}");
}

/// Polling without ever yielding sees everything that arrives: the runtime's budget of a task does not limit
/// it.
pub async fn polling_without_a_pause_sees_everything(pairs: &impl Pairs) {
    // More reads than a runtime lets a task make at once. Each frame is sent when the one before was read.
    const FRAMES: u32 = 300;
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let (next, wanted) = std::sync::mpsc::channel();
    let runtime = tokio::runtime::Handle::current();
    let sender = std::thread::spawn(move || {
        for frame in wanted {
            runtime.block_on(async {
                arm.frames_tx.begin(start(frame)).await.unwrap();
                arm.frames_tx.finish().await.unwrap();
            });
        }
        arm
    });
    let net = pairs.net();
    let deadline = net.now().after(Duration::from_secs(60));
    for frame in 0..FRAMES {
        next.send(frame).unwrap();
        while !matches!(panel.frames_rx.try_recv().unwrap(), Some(FrameEvent::End(_))) {
            assert!(net.now() < deadline, "frame {frame} is not seen");
            std::thread::yield_now();
        }
    }
    drop(next);
    sender.join().unwrap();
}

/// Dropping a future while it waits loses nothing that arrives.
pub async fn dropping_a_wait_loses_nothing(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(batches_of(100)).await;
    let all = points(50_000);
    let writer = async {
        arm.frames_tx.begin(start(0)).await.unwrap();
        for part in all.chunks(333) {
            arm.frames_tx.push(part).await.unwrap();
            tokio::task::yield_now().await;
        }
        arm.frames_tx.finish().await.unwrap();
    };
    let net = pairs.net();
    let reader = async {
        let mut got = Vec::new();
        loop {
            // Every other wait is dropped as soon as it would have to wait.
            let event = match until(&*net, net.now(), panel.frames_rx.recv()).await {
                Some(event) => event,
                None => panel.frames_rx.recv().await,
            };
            match event.unwrap() {
                FrameEvent::Batch(batch) => got.extend(batch.iter()),
                FrameEvent::End(_) => return got,
                FrameEvent::Begin(_) => {}
            }
        }
    };
    let ((), got) = tokio::join!(writer, reader);
    assert_eq!(got, all);
}
