//! Slow receivers, silence, deadlines, and waits that are dropped.

use std::time::Duration;

use trimaran_proto::{FrameEvent, Goodbye, Role};
use trimaran_transport::{LinkConfig, RecvError, SendError, sleep_until, until};

use super::{Pairs, batches_of, patient};
use crate::common::{camera, ids, next_camera, receive, start};

pub(crate) async fn a_slow_receiver_holds_the_sender_back(pairs: &impl Pairs) {
    let config = LinkConfig { patience: Duration::from_millis(200), ..batches_of(16_384) };
    let (mut a, display) = pairs.pair(config).await;
    a.frames_tx.begin(start(0)).await.unwrap();
    let batch = ids(16_384);
    let mut taken = 0;
    let error = loop {
        match a.frames_tx.push(&batch).await {
            Ok(()) => taken += batch.len() * 4,
            Err(error) => break error,
        }
        assert!(taken < 64 << 20, "64 MiB taken and nobody reads");
    };
    assert!(matches!(error, SendError::Stalled { peer: Role::Display, .. }), "{error}");
    drop(display);
}

pub(crate) async fn a_receiver_that_catches_up_gets_everything(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(LinkConfig { max_frame: 16 << 20, ..batches_of(16_384) }).await;
    let all = ids(16 << 20);
    let writer = async {
        a.frames_tx.begin(start(0)).await.unwrap();
        a.frames_tx.push(&all).await.unwrap();
        a.frames_tx.finish().await.unwrap();
    };
    let net = pairs.net();
    let reader = async {
        sleep_until(&*net, net.now().after(Duration::from_millis(50))).await;
        receive(&mut display.frames_rx).await.unwrap()
    };
    let ((), got) = tokio::join!(writer, reader);
    assert!(got.ids == all, "64 MiB of ids");
}

/// A role's thread may be busy with its GPU for longer than the patience of the link.
pub(crate) async fn a_busy_receiver_is_no_dead_peer(pairs: &impl Pairs) {
    let config = LinkConfig { patience: Duration::from_millis(100), ..LinkConfig::default() };
    let (mut a, mut display) = pairs.pair(config).await;
    let runtime = tokio::runtime::Handle::current();
    let reader = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(400));
        let got = runtime.block_on(receive(&mut display.frames_rx)).unwrap();
        std::thread::sleep(Duration::from_millis(400));
        runtime.block_on(async { display.latest_tx.publish(camera(1)).unwrap() });
        (got, display)
    });
    a.frames_tx.begin(start(0)).await.unwrap();
    // Few enough that nobody waits for room.
    a.frames_tx.push(&ids(1000)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    assert_eq!(next_camera(&mut a.latest_rx).await.unwrap(), camera(1));
    let (got, _display) = tokio::task::spawn_blocking(|| reader.join().unwrap()).await.unwrap();
    assert_eq!(got.ids, ids(1000));
}

pub(crate) async fn silence_ends_in_an_error(pairs: &impl Pairs) {
    let patience = Duration::from_millis(50);
    let (mut a, mut display) = pairs.pair(LinkConfig { patience, ..LinkConfig::default() }).await;
    let frames = a.frames_rx.recv().await;
    let latest = a.latest_rx.latest().await;
    let silent =
        |e: &RecvError| matches!(e, RecvError::Silent { peer: Role::Display, waited } if *waited == patience);
    assert!(frames.as_ref().is_err_and(silent), "{frames:?}");
    assert!(latest.as_ref().is_err_and(silent), "{latest:?}");
    display.latest_tx.publish(camera(3)).unwrap();
    assert_eq!(next_camera(&mut a.latest_rx).await.unwrap(), camera(3), "the caller may go on waiting");
}

pub(crate) async fn a_deadline_leaves_the_link_usable(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    let net = pairs.net();
    for frame in 0..3 {
        let by = net.now().after(Duration::from_millis(10));
        let missed = display.frames_rx.recv_by(by).await;
        assert!(matches!(missed, Err(RecvError::Deadline { peer: Role::SwitchA })), "{missed:?}");
        a.frames_tx.begin(start(frame)).await.unwrap();
        a.frames_tx.push(&ids(300)).await.unwrap();
        a.frames_tx.finish().await.unwrap();
        assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(300));
    }
}

pub(crate) async fn polling_takes_what_is_there(pairs: &impl Pairs) {
    // More batches than a runtime lets a task take in one go.
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    let net = pairs.net();
    assert!(matches!(display.frames_rx.try_recv(), Ok(None)));
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(2000)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    let mut got = Vec::new();
    loop {
        match display.frames_rx.try_recv().unwrap() {
            Some(FrameEvent::Ids(batch)) => got.extend(batch.iter()),
            Some(FrameEvent::End(_)) => break,
            Some(FrameEvent::Begin(_) | FrameEvent::Stats(_)) => {}
            None => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
        }
    }
    assert_eq!(got, ids(2000));
    let poll = async {
        loop {
            match display.frames_rx.try_recv() {
                Ok(None) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
                ended => break ended,
            }
        }
    };
    let (_left, ended) = tokio::join!(a.goodbye(Goodbye::Finished), poll);
    assert!(matches!(ended, Err(RecvError::Goodbye { .. })), "{ended:?}");
}

/// Who polls without ever yielding is shown all that comes, however much: the runtime's budget of a task is
/// not for it.
pub(crate) async fn polling_without_a_pause_sees_everything(pairs: &impl Pairs) {
    // More reads than a runtime lets a task make in one go, each of a frame that is sent when the one before
    // it was read.
    const FRAMES: u32 = 300;
    let (mut a, mut display) = pairs.pair(patient()).await;
    let (next, wanted) = std::sync::mpsc::channel();
    let runtime = tokio::runtime::Handle::current();
    let sender = std::thread::spawn(move || {
        for frame in wanted {
            runtime.block_on(async {
                a.frames_tx.begin(start(frame)).await.unwrap();
                a.frames_tx.finish().await.unwrap();
            });
        }
        a
    });
    let net = pairs.net();
    let deadline = net.now().after(Duration::from_secs(60));
    for frame in 0..FRAMES {
        next.send(frame).unwrap();
        while !matches!(display.frames_rx.try_recv().unwrap(), Some(FrameEvent::End(_))) {
            assert!(net.now() < deadline, "frame {frame} is not seen");
            std::thread::yield_now();
        }
    }
    drop(next);
    sender.join().unwrap();
}

pub(crate) async fn dropping_a_wait_loses_nothing(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(100)).await;
    let all = ids(50_000);
    let writer = async {
        a.frames_tx.begin(start(0)).await.unwrap();
        for part in all.chunks(333) {
            a.frames_tx.push(part).await.unwrap();
            tokio::task::yield_now().await;
        }
        a.frames_tx.finish().await.unwrap();
    };
    let net = pairs.net();
    let reader = async {
        let mut got = Vec::new();
        loop {
            // Every other wait is dropped as soon as it would have to wait.
            let event = match until(&*net, net.now(), display.frames_rx.recv()).await {
                Some(event) => event,
                None => display.frames_rx.recv().await,
            };
            match event.unwrap() {
                FrameEvent::Ids(batch) => got.extend(batch.iter()),
                FrameEvent::End(_) => return got,
                FrameEvent::Begin(_) | FrameEvent::Stats(_) => {}
            }
        }
    };
    let ((), got) = tokio::join!(writer, reader);
    assert_eq!(got, all);
}
