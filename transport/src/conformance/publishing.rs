//! One publisher of frames, several subscribers.

use std::num::NonZeroUsize;

use tokio::sync::oneshot;

use super::pairs::Pairs;
use super::robot::Robot;
use super::talk::{batches_of, patient, points, receive, send_frame, start};
use crate::{
    Batching, FrameNumber, FrameReceiver, KeepLast, Left, LinkConfig, Published, Publisher, RecvError,
    SharedFrames, SubscriberId, SubscriberStats, WhenBehind,
};

/// Publishes this frame of points.
async fn publish(publisher: &mut Publisher<Robot>, frame: u32, points: &[u32]) -> Published {
    publisher.publish(start(frame), points).await.unwrap()
}

/// Reads frames up to this one, with the content that `points` gives. Returns their numbers.
async fn read_to(frames: &mut FrameReceiver<Robot>, last: u32, points: impl Fn(u32) -> Vec<u32>) -> Vec<u32> {
    let mut numbers = Vec::new();
    while numbers.last() != Some(&last) {
        let got = receive(frames).await.unwrap();
        let number = got.start.frame.0;
        assert_eq!(got.start, start(number));
        assert!(got.points == points(number), "frame {number}");
        numbers.push(number);
    }
    numbers
}

fn stats(publisher: &Publisher<Robot>, id: SubscriberId) -> SubscriberStats {
    publisher.subscribers().find(|(known, _)| *known == id).unwrap().1
}

/// Of three subscribers one reads everything, one reads nothing until the end, and one never reads.
pub async fn a_slow_subscriber_holds_up_no_other(pairs: &impl Pairs) {
    // 24 MB, more than any transport holds.
    const FRAMES: u32 = 100;
    let config = patient();
    let mut publisher = Publisher::new(&pairs.net(), &config);
    let (quick_arm, mut quick) = pairs.pair(config).await;
    let (slow_arm, mut slow) = pairs.pair(config).await;
    let (idle_arm, mut idle) = pairs.pair(config).await;
    let quick_id = publisher.subscribe(quick_arm.frames_tx, WhenBehind::Wait);
    let slow_id = publisher.subscribe(slow_arm.frames_tx, WhenBehind::Skip);
    let idle_id = publisher.subscribe(idle_arm.frames_tx, WhenBehind::Disconnect);
    let all = points(60_000);
    let publishes = async {
        let mut left = Vec::new();
        for frame in 0..FRAMES {
            left.extend(publish(&mut publisher, frame, &all).await.left);
        }
        left
    };
    let (left, numbers) = tokio::join!(publishes, read_to(&mut quick.frames_rx, FRAMES - 1, |_| all.clone()));
    assert!(numbers.into_iter().eq(0..FRAMES), "one that waits gets every frame");
    assert!(matches!(left[..], [(id, Left::Behind)] if id == idle_id), "{left:?}");
    drop((idle_arm.latest_tx, idle_arm.latest_rx, idle_arm.frames_rx, idle_arm.messages_tx));
    drop((idle_arm.messages_rx, idle_arm.bulk));
    assert!(matches!(idle.frames_rx.drain().await, RecvError::Lost { .. }));
    assert_eq!(stats(&publisher, quick_id).sent, u64::from(FRAMES));

    // It may just have taken all that it was offered; more fills its link.
    let mut frames = FRAMES;
    while !stats(&publisher, slow_id).is_behind {
        assert!(frames < 2 * FRAMES, "its link takes all of them");
        let last = frames;
        tokio::join!(
            publish(&mut publisher, last, &all),
            read_to(&mut quick.frames_rx, last, |_| all.clone())
        );
        frames += 1;
    }
    let numbers = read_to(&mut slow.frames_rx, frames - 1, |_| all.clone()).await;
    assert!(numbers.is_sorted() && numbers.len() < frames as usize, "{numbers:?}");
    let SubscriberStats { sent, skipped, .. } = stats(&publisher, slow_id);
    assert_eq!((sent, sent + skipped), (numbers.len() as u64, u64::from(frames)));
}

/// A subscriber gets the last frame when it comes, and the next ones; it can take its half of the link back.
pub async fn who_subscribes_late_gets_the_last_frame(pairs: &impl Pairs) {
    let config = patient();
    let mut publisher = Publisher::new(&pairs.net(), &config);
    for frame in 0..3 {
        publish(&mut publisher, frame, &points(frame)).await;
    }
    let (mut arm, mut panel) = pairs.pair(config).await;
    let id = publisher.subscribe(arm.frames_tx, WhenBehind::Wait);
    assert_eq!(read_to(&mut panel.frames_rx, 2, points).await, [2]);
    publish(&mut publisher, 7, &points(7)).await;
    assert_eq!(read_to(&mut panel.frames_rx, 7, points).await, [7]);
    arm.frames_tx = publisher.unsubscribe(id).await.unwrap();
    assert!(publisher.unsubscribe(id).await.is_none());
    assert_eq!(publisher.subscribers().len(), 0);
    send_frame(&mut arm.frames_tx, 8, &points(8)).await.unwrap();
    assert_eq!(read_to(&mut panel.frames_rx, 8, points).await, [8]);
}

/// Coded frames reach those that have every frame, and those that come late.
pub async fn published_frames_are_coded_for_whoever_can_read_them(pairs: &impl Pairs) {
    const FRAMES: u32 = 60;
    const POINTS: u32 = 10_000;
    // Frames alike: a few points change from one to the next.
    let content = |frame: u32| {
        let mut all = points(POINTS);
        all[frame as usize..frame as usize + 3].fill(frame);
        all
    };
    let plain = batches_of(1000);
    let config = LinkConfig { batching: Batching { coded: true, ..plain.batching }, ..plain };
    let net = pairs.net();
    let mut publisher = Publisher::new(&net, &config);
    let mut readers = Vec::new();
    for frame in 0..FRAMES {
        if frame % 7 == 0 {
            let (arm, mut panel) = pairs.pair(config).await;
            publisher.subscribe(arm.frames_tx, WhenBehind::Wait);
            let (done, reader) = oneshot::channel();
            net.spawn(Box::pin(async move {
                let numbers = read_to(&mut panel.frames_rx, FRAMES - 1, content).await;
                let _ = done.send((numbers, panel.stats.read().received.batches.bytes));
            }));
            readers.push((frame.saturating_sub(1), reader));
        }
        let published = publish(&mut publisher, frame, &content(frame)).await;
        assert!(published.left.is_empty(), "{published:?}");
    }
    for (first, reader) in readers {
        let (numbers, bytes) = reader.await.unwrap();
        assert!(numbers.into_iter().eq(first..FRAMES), "from {first}");
        // At most 16 frames and the one before came plain.
        let plainly = u64::from(FRAMES - first) * u64::from(POINTS) * 4;
        if FRAMES - first > 40 {
            assert_eq!(bytes < plainly / 2, pairs.overhead().coded, "{bytes} of {plainly} bytes");
        }
    }
}

/// Two links send the same frames, under numbers of their own and between frames of their own. One of them
/// leaves out some.
pub async fn links_send_shared_frames_between_their_own(pairs: &impl Pairs) {
    const FRAMES: u32 = 60;
    const POINTS: u32 = 3_000;
    let plain = batches_of(1000);
    let config = LinkConfig { batching: Batching { coded: true, ..plain.batching }, ..plain };
    let mut shared = SharedFrames::new(&config);
    let (mut arm, mut panel) = pairs.pair(config).await;
    let (mut other_arm, mut other) = pairs.pair(config).await;
    let (mut number, mut other_number) = (0, 100);
    let content = |frame: u32| {
        let mut all = points(POINTS);
        all[frame as usize..frame as usize + 3].fill(frame);
        all
    };
    for frame in 0..FRAMES {
        let all = content(frame);
        if frame % 20 == 0 {
            send_frame(&mut arm.frames_tx, number, &all).await.unwrap();
            let own = receive(&mut panel.frames_rx).await.unwrap();
            assert!(own.start.frame.0 == number && own.points == all, "frame {frame}");
            number += 1;
        }
        let put = shared.put(start(frame), &all).unwrap();
        let links = [
            (&mut arm, &mut panel, &mut number, true),
            (&mut other_arm, &mut other, &mut other_number, frame < 20 || frame.is_multiple_of(3)),
        ];
        for (arm, panel, number, is_sent) in links {
            if is_sent {
                let end = arm.frames_tx.send_shared(&put, FrameNumber(*number)).await.unwrap();
                let got = receive(&mut panel.frames_rx).await.unwrap();
                assert_eq!((got.start.frame, got.end), (FrameNumber(*number), end));
                assert_eq!(got.start.header, start(frame).header, "frame {frame}");
                assert!(got.points == all, "frame {frame}");
                *number += 1;
            }
        }
    }
    // At least a third of the frames came coded.
    let plainly = u64::from(FRAMES + 3) * u64::from(POINTS) * 4;
    let bytes = panel.stats.read().received.batches.bytes;
    assert_eq!(bytes < 2 * plainly / 3, pairs.overhead().coded, "{bytes} of {plainly} bytes");
}

/// A subscriber whose peer is gone leaves with an error, and the others stay.
pub async fn a_dead_subscriber_leaves(pairs: &impl Pairs) {
    let config = patient();
    let mut publisher = Publisher::new(&pairs.net(), &config);
    let (arm, panel) = pairs.pair(config).await;
    let (other_arm, mut other) = pairs.pair(config).await;
    let id = publisher.subscribe(arm.frames_tx, WhenBehind::Wait);
    publisher.subscribe(other_arm.frames_tx, WhenBehind::Wait);
    other.frames_rx = other.frames_rx.keep_last(KeepLast { depth: NonZeroUsize::MIN, lifespan: None });
    drop((panel, arm.latest_tx, arm.latest_rx, arm.frames_rx));
    let mut left = Vec::new();
    let mut frame = 0;
    while left.is_empty() {
        left = publish(&mut publisher, frame, &points(10_000)).await.left;
        frame += 1;
    }
    assert!(matches!(left[..], [(gone, Left::Failed(_))] if gone == id), "{left:?}");
    publish(&mut publisher, frame, &points(5)).await;
    while other.frames_rx.frame().await.unwrap().start.frame.0 != frame {}
}
