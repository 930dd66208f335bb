//! The frames lane: order, completeness, batches, bytes.

use super::pairs::{Overhead, Pairs};
use super::robot::{Pose, Robot};
use super::talk::{PANEL, block, command, points, pose, receive, send_frame, start, visible};
use super::talk::{batches_of, coded, patient};
use crate::{
    Fixed, FrameEvent, FrameNumber, FrameOrderError, Link, LinkConfig, LinkStats, SendError, Tally, Traffic,
    until,
};

/// Frames of no points and of many arrive as they were sent, in any batch size, plain and coded.
pub async fn frames_of_every_size_arrive_in_order(pairs: &impl Pairs) {
    let configs = |batch| [(batch, batches_of(batch)), (batch, coded(batch))];
    for (batch, config) in [1, 10, 256, 16_384].into_iter().flat_map(configs) {
        let (mut arm, mut panel) = pairs.pair(config).await;
        let sizes = [0, 1, batch - 1, batch, batch + 1, 4000, 200_000];
        let reader = async {
            for (frame, size) in sizes.into_iter().enumerate() {
                let got = receive(&mut panel.frames_rx).await.unwrap();
                assert_eq!(got.start, start(frame as u32));
                assert_eq!(got.points, points(size), "{config:?}");
                assert_eq!((got.end.frame, got.end.items), (FrameNumber(frame as u32), size));
            }
        };
        let writer = async {
            for (frame, size) in sizes.into_iter().enumerate() {
                arm.frames_tx.begin(start(frame as u32)).await.unwrap();
                for part in points(size).chunks(999) {
                    arm.frames_tx.push(part).await.unwrap();
                }
                assert_eq!(arm.frames_tx.finish().await.unwrap().items, size);
            }
        };
        tokio::join!(reader, writer);
    }
}

/// A frame of one call arrives whole, even if the call is given up. One with too many points is not begun.
pub async fn a_whole_frame_is_sent_by_one_call(pairs: &impl Pairs) {
    const MOST: u32 = 100_000;
    let config = LinkConfig { max_frame: MOST, ..coded(256) };
    let ((mut arm, mut panel), net) = (pairs.pair(config).await, pairs.net());
    let writer = async {
        let refused = arm.frames_tx.send(start(0), &points(MOST + 1)).await;
        let Err(SendError::Order { cause, .. }) = refused else { panic!("{refused:?}") };
        assert_eq!(cause, FrameOrderError::TooMany { frame: FrameNumber(0), most: MOST });
        assert_eq!(arm.frames_tx.send(start(0), &points(MOST)).await.unwrap().items, MOST);
        let _given_up = until(&*net, net.now(), arm.frames_tx.send(start(1), &points(MOST))).await;
        assert_eq!(arm.frames_tx.send(start(2), &[]).await.unwrap().items, 0);
    };
    let reader = async {
        for (frame, size) in [(0, MOST), (1, MOST), (2, 0)] {
            let got = receive(&mut panel.frames_rx).await.unwrap();
            assert_eq!((got.start, got.end.items), (start(frame), size));
            assert!(got.points == points(size));
        }
    };
    tokio::join!(writer, reader);
}

/// The batches do not depend on how points were pushed.
pub async fn batches_are_full_but_the_last(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
    arm.frames_tx.begin(start(0)).await.unwrap();
    for part in points(47).chunks(7) {
        arm.frames_tx.push(part).await.unwrap();
    }
    arm.frames_tx.finish().await.unwrap();
    let got = receive(&mut panel.frames_rx).await.unwrap();
    assert_eq!(got.batches, [10, 10, 10, 10, 7]);
}

/// Points that wait for a full batch leave on a flush.
pub async fn flush_sends_a_part_of_a_batch(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
    arm.frames_tx.begin(start(0)).await.unwrap();
    arm.frames_tx.push(&points(3)).await.unwrap();
    arm.frames_tx.flush().await.unwrap();
    arm.frames_tx.flush().await.unwrap();
    assert!(matches!(panel.frames_rx.recv().await.unwrap(), FrameEvent::Begin(_)));
    let FrameEvent::Batch(batch) = panel.frames_rx.recv().await.unwrap() else { panic!("no batch") };
    assert_eq!(batch.iter().collect::<Vec<_>>(), points(3));
    assert_eq!(panel.frames_rx.open_frame(), Some(FrameNumber(0)));
    arm.frames_tx.push(&points(1)).await.unwrap();
    assert_eq!(arm.frames_tx.finish().await.unwrap().items, 4);
}

/// A wrong order of calls is an error, and the link stays usable.
pub async fn frames_in_the_wrong_order_are_refused(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let order = |result: Result<(), SendError>| match result {
        Err(SendError::Order { peer, cause }) if peer.as_str() == PANEL => cause,
        other => panic!("{other:?}"),
    };
    assert_eq!(order(arm.frames_tx.push(&[1]).await), FrameOrderError::NoneOpen);
    assert_eq!(order(arm.frames_tx.finish().await.map(|_| ())), FrameOrderError::NoneOpen);
    arm.frames_tx.begin(start(5)).await.unwrap();
    let (open, wanted) = (FrameNumber(5), FrameNumber(6));
    assert_eq!(order(arm.frames_tx.begin(start(6)).await), FrameOrderError::StillOpen { open, wanted });
    arm.frames_tx.finish().await.unwrap();
    let not_rising = FrameOrderError::NotRising { last: FrameNumber(5), wanted: FrameNumber(5) };
    assert_eq!(order(arm.frames_tx.begin(start(5)).await), not_rising);
    assert_eq!(receive(&mut panel.frames_rx).await.unwrap().end.frame, FrameNumber(5));
}

/// Neither direction waits for the other.
pub async fn both_directions_at_once(pairs: &impl Pairs) {
    async fn talk(mut link: Link<Robot>) -> Link<Robot> {
        let Link { frames_tx, frames_rx, .. } = &mut link;
        let send = async {
            for frame in 0..20 {
                send_frame(frames_tx, frame, &points(10_000)).await.unwrap();
            }
        };
        let receive = async {
            for _ in 0..20 {
                assert_eq!(receive(frames_rx).await.unwrap().points.len(), 10_000);
            }
        };
        tokio::join!(send, receive);
        link
    }
    let (arm, panel) = pairs.pair(patient()).await;
    let _ends = tokio::join!(talk(arm), talk(panel));
}

/// Both sides count the same messages and bytes, exactly those sent.
pub async fn every_byte_is_counted(pairs: &impl Pairs) {
    const POSE: u64 = Pose::SIZE as u64;
    let Overhead { header_bytes, handshake, .. } = pairs.overhead();
    let (mut arm, mut panel) = pairs.pair(batches_of(10)).await;
    let before: LinkStats = arm.stats.read();
    assert_eq!(before.sent.control.messages, handshake);
    send_frame(&mut arm.frames_tx, 0, &points(25)).await.unwrap();
    arm.latest_tx.publish(pose(0)).unwrap();
    receive(&mut panel.frames_rx).await.unwrap();
    panel.latest_rx.latest().await.unwrap();
    arm.messages_tx.send(&command(3)).await.unwrap();
    panel.messages_rx.recv().await.unwrap();
    arm.bulk.as_mut().unwrap().tx.send(block(3)).await.unwrap();
    panel.bulk.as_mut().unwrap().rx.recv().await.unwrap();

    let sent = (arm.stats.read() - before).sent;
    assert_eq!(sent.begin, Tally { messages: 1, bytes: 4 + POSE });
    assert_eq!(sent.batches, Tally { messages: 3, bytes: 100 });
    assert_eq!(sent.items, 25);
    assert_eq!(sent.end, Tally { messages: 1, bytes: 16 });
    assert_eq!(sent.latest, Tally { messages: 1, bytes: POSE });
    assert_eq!(sent.control, Tally::default());
    // A number, a length, three letters.
    assert_eq!(sent.messages, Tally { messages: 1, bytes: 5 });
    assert_eq!(sent.bulk, Tally { messages: 1, bytes: 3 });
    assert_eq!(sent.header_bytes, 8 * header_bytes);
    assert_eq!(sent.total_bytes(), 4 + POSE + 100 + 16 + POSE + 5 + 3 + 8 * header_bytes);
    let received = panel.stats.read().received;
    assert_eq!((received.begin, received.batches), (sent.begin, sent.batches));
    assert_eq!((received.end, received.latest), (sent.end, sent.latest));
    assert_eq!((received.messages, received.bulk), (sent.messages, sent.bulk));
    assert_eq!(received.control.messages, handshake);
    assert_eq!(received.control, arm.stats.read().sent.control);
}

/// For coded batches both sides count the coded bytes and the points they stand for.
pub async fn frames_alike_cost_little_when_coded(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(coded(256)).await;
    // Of 4,000 points, others are hidden in each frame.
    let mut first = Traffic::default();
    for frame in 0..10 {
        send_frame(&mut arm.frames_tx, frame, &visible(frame)).await.unwrap();
        assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, visible(frame));
        if frame == 0 {
            first = arm.stats.read().sent;
        }
    }
    let sent = arm.stats.read().sent - first;
    assert_eq!(sent.items, 9 * 3960);
    if pairs.overhead().coded {
        assert!(sent.batches.bytes < 9 * 3960 * 4 / 10, "{:?}", sent.batches);
    } else {
        assert_eq!(sent.batches.bytes, 4 * sent.items);
    }
    let received = panel.stats.read().received;
    assert_eq!(received.items, 10 * 3960);
    assert_eq!(received.batches.bytes, sent.batches.bytes + first.batches.bytes);
}
