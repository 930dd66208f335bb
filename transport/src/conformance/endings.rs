//! How links end: closes and deaths.

use std::time::Duration;

use super::pairs::Pairs;
use super::robot::Robot;
use super::talk::{ARM, block, command, finished, points, pose, receive, send_frame, start};
use super::talk::{batches_of, patient};
use crate::{
    CloseReason, FrameEvent, FrameNumber, Link, LinkConfig, Loss, RecvError, SendError, sleep_until, until,
};

/// Everything sent before a close arrives before it, and the close on each lane, on every call.
pub async fn close_comes_after_everything(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    arm.latest_tx.publish(pose(1)).unwrap();
    send_frame(&mut arm.frames_tx, 0, &points(5)).await.unwrap();
    arm.close(CloseReason::new(2, "out of memory")).await.unwrap();

    assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(5));
    let said = |e: RecvError| match e {
        RecvError::Closed { peer, reason } if peer.as_str() == ARM => reason,
        other => panic!("{other:?}"),
    };
    for _ in 0..2 {
        assert_eq!(said(panel.frames_rx.recv().await.unwrap_err()), CloseReason::new(2, "out of memory"));
    }
    assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(1));
    for _ in 0..2 {
        assert_eq!(said(panel.latest_rx.latest().await.unwrap_err()), CloseReason::new(2, "out of memory"));
    }
    assert_eq!(said(panel.latest_rx.try_latest().unwrap_err()), CloseReason::new(2, "out of memory"));
    assert_eq!(said(panel.messages_rx.recv().await.unwrap_err()), CloseReason::new(2, "out of memory"));
    assert_eq!(
        said(panel.bulk.as_mut().unwrap().rx.recv().await.unwrap_err()),
        CloseReason::new(2, "out of memory")
    );
    // The second close finds nobody, and that is no error.
    panel.close(finished()).await.unwrap();
}

/// Everything sent before a link is dropped arrives, even more than may be in flight at once.
pub async fn what_was_sent_before_a_link_is_dropped_arrives(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let send = async {
        send_frame(&mut arm.frames_tx, 0, &points(50_000)).await.unwrap();
        arm.latest_tx.publish(pose(1)).unwrap();
        drop(arm);
    };
    let ((), got) = tokio::join!(send, receive(&mut panel.frames_rx));
    assert_eq!(got.unwrap().points, points(50_000));
    assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(1));
}

/// A peer that drops its link within a frame is lost, and the frame stays open.
pub async fn death_within_a_frame_is_no_close(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
    arm.frames_tx.begin(start(0)).await.unwrap();
    arm.frames_tx.push(&points(25)).await.unwrap();
    drop(arm);
    let mut got = 0;
    let error = loop {
        match panel.frames_rx.recv().await {
            Ok(FrameEvent::Begin(_)) => {}
            Ok(FrameEvent::Batch(batch)) => got += batch.count(),
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error,
        }
    };
    assert_eq!(got, 20, "what was sent before is received");
    assert!(
        matches!(error, RecvError::Lost { ref peer, cause: Loss::Closed } if peer.as_str() == ARM),
        "{error:?}"
    );
    assert_eq!(panel.frames_rx.open_frame(), Some(FrameNumber(0)));
    let latest = panel.latest_rx.latest().await;
    assert!(matches!(latest, Err(RecvError::Lost { ref peer, .. }) if peer.as_str() == ARM), "{latest:?}");
    let messages = panel.messages_rx.recv().await;
    assert!(
        matches!(messages, Err(RecvError::Lost { ref peer, .. }) if peer.as_str() == ARM),
        "{messages:?}"
    );
    let blocks = panel.bulk.as_mut().unwrap().rx.recv().await;
    assert!(matches!(blocks, Err(RecvError::Lost { ref peer, .. }) if peer.as_str() == ARM), "{blocks:?}");
}

/// Sending to a peer that has dropped its link fails, on either lane.
pub async fn a_dead_receiver_fails_the_sender(pairs: &impl Pairs) {
    let (arm, mut panel) = pairs.pair(patient()).await;
    panel.frames_tx.begin(start(0)).await.unwrap();
    drop(arm.frames_rx);
    drop(arm.frames_tx);
    let net = pairs.net();
    let error = loop {
        match panel.frames_tx.push(&points(1000)).await {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { ref peer, .. } if peer.as_str() == ARM), "{error:?}");
    drop((arm.latest_rx, arm.latest_tx, arm.messages_rx, arm.messages_tx, arm.bulk));
    let error = loop {
        match panel.latest_tx.publish(pose(1)) {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { ref peer, .. } if peer.as_str() == ARM), "{error:?}");
}

/// A peer may die after any step of a frame: the other gets everything before it, and then an error.
pub async fn death_behind_every_step_of_a_frame_is_a_loss(pairs: &impl Pairs) {
    const STEPS: usize = 4;
    for steps in 0..=STEPS {
        let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
        walk(&mut arm, steps).await.unwrap();
        drop(arm);
        let mut got = 0;
        let lost = loop {
            match panel.frames_rx.recv().await {
                Ok(_) => got += 1,
                Err(error) => break error,
            }
        };
        assert_eq!(got, steps, "a message a step");
        assert!(matches!(lost, RecvError::Lost { cause: Loss::Closed, .. }), "{steps} steps: {lost:?}");
        assert!(matches!(panel.latest_rx.latest().await, Err(RecvError::Lost { .. })), "{steps} steps");
    }
    for steps in 0..=STEPS {
        let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
        let net = pairs.net();
        let die = async {
            for _ in 0..steps {
                panel.frames_rx.recv().await.unwrap();
            }
            drop(panel);
        };
        let send = async {
            walk(&mut arm, STEPS).await?;
            for frame in 1.. {
                arm.frames_tx.begin(start(frame)).await?;
                arm.frames_tx.finish().await?;
                sleep_until(&*net, net.now().after(Duration::from_millis(1))).await;
            }
            Ok(())
        };
        let ((), sent) = tokio::join!(die, send);
        assert!(matches!(sent, Err(SendError::Lost { .. })), "{steps} steps: {sent:?}");
    }
}

/// A peer may leave anything unread when it goes. Every call on the link still returns, however often:
/// errors, and no panic.
pub async fn a_link_whose_peer_is_gone_can_still_be_used(pairs: &impl Pairs) {
    for unread in [0, 200, 20_000] {
        // Keep-alives are sent to nobody, too.
        let config = LinkConfig { idle_timeout: Duration::from_millis(400), ..batches_of(10) };
        let (arm, mut panel) = pairs.pair(config).await;
        let net = pairs.net();
        let soon = || net.now().after(Duration::from_millis(20));
        let mut bulk = panel.bulk.take().unwrap();
        if unread > 0 {
            panel.latest_tx.publish(pose(1)).unwrap();
            panel.messages_tx.send(&command(1)).await.unwrap();
            bulk.tx.send(block(1)).await.unwrap();
            let _full = until(&*net, soon(), send_frame(&mut panel.frames_tx, 0, &points(unread))).await;
        }
        drop(arm);
        for frame in 1..40 {
            let _gone = panel.latest_tx.publish(pose(frame));
            let _gone = until(&*net, soon(), send_frame(&mut panel.frames_tx, frame, &points(30))).await;
            let _gone = until(&*net, soon(), panel.frames_tx.flush()).await;
            let _gone = until(&*net, soon(), panel.messages_tx.send(&command(frame))).await;
            let _gone = until(&*net, soon(), bulk.tx.send(block(frame))).await;
            let _gone = panel.latest_rx.try_latest();
            let _gone = panel.frames_rx.try_recv();
            let _gone = panel.messages_rx.try_recv();
            let _gone = bulk.rx.try_recv();
            sleep_until(&*net, net.now().after(Duration::from_millis(20))).await;
        }
        for _ in 0..3 {
            let lost = panel.frames_rx.recv().await;
            assert!(matches!(lost, Err(RecvError::Lost { .. })), "{unread} unread: {lost:?}");
            let lost = panel.latest_rx.latest().await;
            assert!(matches!(lost, Err(RecvError::Lost { .. })), "{unread} unread: {lost:?}");
            let lost = panel.messages_rx.recv().await;
            assert!(matches!(lost, Err(RecvError::Lost { .. })), "{unread} unread: {lost:?}");
            let lost = bulk.rx.recv().await;
            assert!(matches!(lost, Err(RecvError::Lost { .. })), "{unread} unread: {lost:?}");
            let lost = panel.latest_tx.publish(pose(1));
            assert!(matches!(lost, Err(SendError::Lost { .. })), "{unread} unread: {lost:?}");
            let lost = panel.messages_tx.send(&command(1)).await;
            assert!(matches!(lost, Err(SendError::Lost { .. })), "{unread} unread: {lost:?}");
            let lost = bulk.tx.send(block(1)).await;
            assert!(matches!(lost, Err(SendError::Lost { .. })), "{unread} unread: {lost:?}");
        }
        panel.bulk = Some(bulk);
        let _nobody = panel.close(finished()).await;
    }
}

/// The first steps of a frame and of its lane.
async fn walk(arm: &mut Link<Robot>, steps: usize) -> Result<(), SendError> {
    for step in 0..steps {
        match step {
            0 => arm.frames_tx.begin(start(0)).await?,
            1 | 2 => arm.frames_tx.push(&points(10)).await?,
            _ => drop(arm.frames_tx.finish().await?),
        }
    }
    Ok(())
}
