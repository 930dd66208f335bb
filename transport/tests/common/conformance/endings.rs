//! How links end: goodbyes and deaths.

use std::time::Duration;

use trimaran_proto::{FrameEvent, FrameNumber, FrameStats, Goodbye, Role};
use trimaran_transport::{Link, Loss, RecvError, SendError, sleep_until};

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
    // Who leaves second finds nobody, and that is no error.
    display.goodbye(Goodbye::Finished).await.unwrap();
}

/// More than may be under way at once.
pub(crate) async fn what_was_sent_before_a_link_is_dropped_arrives(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    let send = async {
        a.frames_tx.begin(start(0)).await.unwrap();
        a.frames_tx.push(&ids(50_000)).await.unwrap();
        a.frames_tx.finish().await.unwrap();
        a.latest_tx.publish(camera(1)).unwrap();
        drop(a);
    };
    let ((), got) = tokio::join!(send, receive(&mut display.frames_rx));
    assert_eq!(got.unwrap().ids, ids(50_000));
    assert_eq!(display.latest_rx.latest().await.unwrap(), camera(1));
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

/// One side of a frame at a time: whoever dies behind whichever step, the other gets all that was before it,
/// and then knows.
pub(crate) async fn death_behind_every_step_of_a_frame_is_a_loss(pairs: &impl Pairs) {
    const STEPS: usize = 5;
    for steps in 0..=STEPS {
        let (mut a, mut display) = pairs.pair(batches_of(10)).await;
        walk(&mut a, steps).await.unwrap();
        drop(a);
        let mut got = 0;
        let lost = loop {
            match display.frames_rx.recv().await {
                Ok(_) => got += 1,
                Err(error) => break error,
            }
        };
        assert_eq!(got, steps, "a message a step");
        assert!(matches!(lost, RecvError::Lost { cause: Loss::Closed, .. }), "{steps} steps: {lost:?}");
        assert!(matches!(display.latest_rx.latest().await, Err(RecvError::Lost { .. })), "{steps} steps");
    }
    for steps in 0..=STEPS {
        let (mut a, mut display) = pairs.pair(batches_of(10)).await;
        let net = pairs.net();
        let die = async {
            for _ in 0..steps {
                display.frames_rx.recv().await.unwrap();
            }
            drop(display);
        };
        let send = async {
            walk(&mut a, STEPS).await?;
            for frame in 1.. {
                a.frames_tx.begin(start(frame)).await?;
                a.frames_tx.finish().await?;
                sleep_until(&*net, net.now().after(Duration::from_millis(1))).await;
            }
            Ok(())
        };
        let ((), sent) = tokio::join!(die, send);
        assert!(matches!(sent, Err(SendError::Lost { .. })), "{steps} steps: {sent:?}");
    }
}

/// The first steps of a frame and what belongs to it.
async fn walk(a: &mut Link, steps: usize) -> Result<(), SendError> {
    for step in 0..steps {
        match step {
            0 => a.frames_tx.begin(start(0)).await?,
            1 | 2 => a.frames_tx.push(&ids(10)).await?,
            3 => drop(a.frames_tx.finish().await?),
            _ => a.frames_tx.stats(&FrameStats { frame: FrameNumber(0), ..FrameStats::default() }).await?,
        }
    }
    Ok(())
}
