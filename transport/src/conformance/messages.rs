//! The messages lane: order, completeness, backpressure, and that it and the other lanes leave each other
//! alone.

use std::pin::pin;
use std::time::Duration;

use trimaran_wire::MAX_MESSAGE;

use super::pairs::Pairs;
use super::robot::{Command, Robot};
use super::talk::{ARM, PANEL, finished, points, pose, receive, send_frame, start};
use super::talk::{batches_of, command, patient};
use crate::{LinkConfig, Loss, MessageReceiver, MessageSender, RecvError, SendError, sleep_until, until};

/// Says commands of these numbers, of all lengths.
async fn say(tx: &mut MessageSender<Robot>, numbers: std::ops::Range<u32>) {
    for number in numbers {
        tx.send(&command(number)).await.unwrap();
    }
}

async fn hear(rx: &mut MessageReceiver<Robot>, numbers: std::ops::Range<u32>) {
    for number in numbers {
        assert_eq!(rx.recv().await.unwrap(), command(number));
    }
}

/// Messages arrive, all of them and in order, in both directions, while a frame is open that nobody reads,
/// and values are read beside them.
pub async fn messages_arrive_in_order_beside_a_frame_that_nobody_reads(pairs: &impl Pairs) {
    const COUNT: u32 = 2000;
    let (mut arm, mut panel) = pairs.pair(LinkConfig { max_frame: 16 << 20, ..batches_of(16_384) }).await;
    let all = points(16 << 20);
    let frame = async {
        arm.frames_tx.begin(start(0)).await.unwrap();
        arm.frames_tx.push(&all).await.unwrap();
        panic!("64 MiB of points are taken, and nobody reads");
    };
    let talk = async {
        tokio::join!(
            say(&mut arm.messages_tx, 0..COUNT),
            hear(&mut arm.messages_rx, 0..COUNT),
            say(&mut panel.messages_tx, 0..COUNT),
            hear(&mut panel.messages_rx, 0..COUNT),
        );
        arm.latest_tx.publish(pose(1)).unwrap();
        assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(1));
    };
    tokio::select! {
        biased;
        () = talk => {}
        () = frame => {}
    }
}

/// Who sends more than its peer takes waits, and goes on when that reads: nothing is lost, and of the message
/// that was waited with in vain nothing is sent. Other lanes go on meanwhile.
pub async fn a_sender_of_messages_waits_for_its_receiver(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let net = pairs.net();
    let mut sent = 0;
    // Alike long, so that no shorter one finds the last room.
    let numbered = |number| Command { number, program: "x".repeat(10_000) };
    while until(&*net, net.now().after(Duration::from_millis(500)), arm.messages_tx.send(&numbered(sent)))
        .await
        .map(Result::unwrap)
        .is_some()
    {
        sent += 1;
        assert!(sent < 6400, "64 MB taken and nobody reads");
    }
    arm.latest_tx.publish(pose(1)).unwrap();
    assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(1));
    send_frame(&mut arm.frames_tx, 0, &points(1000)).await.unwrap();
    assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(1000));

    let last = sent + 100;
    let say = async {
        for number in sent..last {
            arm.messages_tx.send(&numbered(number)).await.unwrap();
        }
    };
    let hear = async {
        for number in 0..last {
            assert_eq!(panel.messages_rx.recv().await.unwrap().number, number);
        }
    };
    tokio::join!(say, hear);
}

/// Who takes no messages at all is given up by their sender when its timeout ends.
pub async fn a_sender_of_messages_waits_no_longer_than_its_timeout(pairs: &impl Pairs) {
    let config = LinkConfig { timeout: Duration::from_millis(200), ..LinkConfig::default() };
    let (mut arm, panel) = pairs.pair(config).await;
    let error = loop {
        if let Err(error) = arm.messages_tx.send(&command(10)).await {
            break error;
        }
    };
    assert!(matches!(error, SendError::Stalled { ref peer, .. } if peer.as_str() == PANEL), "{error:?}");
    drop(panel);
}

/// What was said before a close arrives before it, and the close as often as it is asked for.
pub async fn messages_arrive_before_the_close(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    say(&mut arm.messages_tx, 0..20).await;
    let hear = async {
        hear(&mut panel.messages_rx, 0..20).await;
        for _ in 0..2 {
            let closed = panel.messages_rx.recv().await;
            assert!(
                matches!(closed, Err(RecvError::Closed { ref peer, ref reason }) if peer.as_str() == ARM && *reason == finished()),
                "{closed:?}"
            );
        }
        assert!(matches!(panel.messages_rx.try_recv(), Err(RecvError::Closed { .. })));
    };
    let (closed, ()) = tokio::join!(arm.close(finished()), hear);
    closed.unwrap();
    panel.close(finished()).await.unwrap();
}

/// What was said before a link is dropped arrives, and then that the peer is lost.
pub async fn messages_arrive_before_a_link_is_dropped(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    say(&mut arm.messages_tx, 0..20).await;
    drop(arm);
    hear(&mut panel.messages_rx, 0..20).await;
    let lost = panel.messages_rx.recv().await;
    assert!(matches!(lost, Err(RecvError::Lost { cause: Loss::Closed, .. })), "{lost:?}");
}

/// Who sends messages to a peer that does not receive them any more learns it.
pub async fn a_dead_receiver_of_messages_fails_the_sender(pairs: &impl Pairs) {
    let (arm, mut panel) = pairs.pair(patient()).await;
    drop((arm.messages_rx, arm.messages_tx));
    let net = pairs.net();
    let error = loop {
        match panel.messages_tx.send(&command(1)).await {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { ref peer, .. } if peer.as_str() == ARM), "{error:?}");
}

/// A message that is too long is refused before anything of it travels, and the longest one arrives.
pub async fn a_message_that_is_too_long_is_refused(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    // A number of a byte, and a length of two.
    let of = |bytes: usize| Command { number: 1, program: "x".repeat(bytes - 3) };
    let refused = arm.messages_tx.send(&of(MAX_MESSAGE + 1)).await;
    assert!(matches!(refused, Err(SendError::TooLong { ref peer }) if peer.as_str() == PANEL), "{refused:?}");
    arm.messages_tx.send(&of(MAX_MESSAGE)).await.unwrap();
    assert_eq!(panel.messages_rx.recv().await.unwrap(), of(MAX_MESSAGE));
}

/// A peer with nothing to say is no silent one: who waits for its messages waits on, beside frames, and gets
/// the first one.
pub async fn a_peer_without_a_message_fails_nobody(pairs: &impl Pairs) {
    let config = LinkConfig { timeout: Duration::from_millis(50), ..LinkConfig::default() };
    let (mut arm, mut panel) = pairs.pair(config).await;
    let net = pairs.net();
    assert!(matches!(panel.messages_rx.try_recv(), Ok(None)));
    let late = panel.messages_rx.recv_by(net.now().after(config.timeout * 5)).await;
    assert!(matches!(late, Err(RecvError::Deadline { .. })), "{late:?}");
    let mut first = pin!(panel.messages_rx.recv());
    let mut frames = 0;
    let said = loop {
        tokio::select! {
            biased;
            said = &mut first => break said,
            got = receive(&mut panel.frames_rx) => {
                assert_eq!(got.unwrap().points, points(100));
                frames += 1;
                if frames == 3 {
                    arm.messages_tx.send(&command(7)).await.unwrap();
                }
            }
            () = async {
                send_frame(&mut arm.frames_tx, frames, &points(100)).await.unwrap();
                std::future::pending::<()>().await;
            }, if frames < 3 => {}
        }
    };
    assert_eq!((said.unwrap(), frames), (command(7), 3));
}

/// Waits that are dropped lose no message.
pub async fn dropping_a_wait_for_messages_loses_none(pairs: &impl Pairs) {
    const COUNT: u32 = 300;
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let net = pairs.net();
    let say = async {
        for number in 0..COUNT {
            arm.messages_tx.send(&command(number)).await.unwrap();
            tokio::task::yield_now().await;
        }
    };
    let hear = async {
        let mut next = 0;
        while next < COUNT {
            // Every other wait is dropped as soon as it would have to wait.
            let said = match until(&*net, net.now(), panel.messages_rx.recv()).await {
                Some(said) => said,
                None => panel.messages_rx.recv().await,
            };
            assert_eq!(said.unwrap(), command(next));
            next += 1;
        }
    };
    tokio::join!(say, hear);
}
