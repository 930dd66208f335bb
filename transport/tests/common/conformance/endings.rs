//! How links end: goodbyes and deaths.

use std::time::Duration;

use trimaran_proto::{FrameEvent, FrameNumber, Goodbye, Role};
use trimaran_transport::{Loss, RecvError, SendError, sleep_until};

use super::{Pairs, batches_of, patient};
use crate::common::{camera, ids, receive, start};

pub(crate) async fn goodbye_comes_after_everything(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    a.latest_tx.publish(camera(1)).unwrap();
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(5)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    a.goodbye(Goodbye::failed("out of memory")).await.unwrap();

    assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(5));
    let said = |e: RecvError| match e {
        RecvError::Goodbye { peer: Role::SwitchA, reason } => reason,
        other => panic!("{other:?}"),
    };
    for _ in 0..2 {
        assert_eq!(said(display.frames_rx.recv().await.unwrap_err()), Goodbye::failed("out of memory"));
    }
    assert_eq!(display.latest_rx.latest().await.unwrap(), camera(1));
    for _ in 0..2 {
        assert_eq!(said(display.latest_rx.latest().await.unwrap_err()), Goodbye::failed("out of memory"));
    }
    assert_eq!(said(display.latest_rx.try_latest().unwrap_err()), Goodbye::failed("out of memory"));
}

pub(crate) async fn death_within_a_frame_is_no_goodbye(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(25)).await.unwrap();
    drop(a);
    let mut got = 0;
    let error = loop {
        match display.frames_rx.recv().await {
            Ok(FrameEvent::Begin(_)) => {}
            Ok(FrameEvent::Ids(batch)) => got += batch.count(),
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error,
        }
    };
    assert_eq!(got, 20, "what was sent before is received");
    assert!(matches!(error, RecvError::Lost { peer: Role::SwitchA, cause: Loss::Closed }), "{error:?}");
    assert_eq!(display.frames_rx.open_frame(), Some(FrameNumber(0)));
    let camera = display.latest_rx.latest().await;
    assert!(matches!(camera, Err(RecvError::Lost { peer: Role::SwitchA, .. })), "{camera:?}");
}

pub(crate) async fn a_dead_receiver_fails_the_sender(pairs: &impl Pairs) {
    let (a, mut display) = pairs.pair(patient()).await;
    display.frames_tx.begin(start(0)).await.unwrap();
    drop(a.frames_rx);
    drop(a.frames_tx);
    let net = pairs.net();
    let error = loop {
        match display.frames_tx.push(&ids(1000)).await {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { peer: Role::SwitchA, .. }), "{error:?}");
    drop((a.latest_rx, a.latest_tx));
    let error = loop {
        match display.latest_tx.publish(camera(1)) {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { peer: Role::SwitchA, .. }), "{error:?}");
}
