//! Frames: order, completeness, batches, bytes.

use trimaran_proto::{DrawableId, FrameEvent, FrameNumber, FrameOrderError, IdCoding, Role};
use trimaran_transport::{Link, LinkConfig, LinkStats, SendError, Tally, Traffic};

use super::{Pairs, batches_of, patient};
use crate::common::{camera, ids, receive, start};

pub(crate) async fn frames_of_every_size_arrive_in_order(pairs: &impl Pairs) {
    for batch in [1, 10, 256, 16_384] {
        let (mut a, mut display) = pairs.pair(batches_of(batch)).await;
        let sizes = [0, 1, batch - 1, batch, batch + 1, 4000, 200_000];
        let reader = async {
            for (frame, size) in sizes.into_iter().enumerate() {
                let got = receive(&mut display.frames_rx).await.unwrap();
                assert_eq!(got.start, start(frame as u32));
                assert_eq!(got.ids, ids(size), "batch {batch}");
                assert_eq!((got.end.frame, got.end.ids), (FrameNumber(frame as u32), size));
            }
        };
        let writer = async {
            for (frame, size) in sizes.into_iter().enumerate() {
                a.frames_tx.begin(start(frame as u32)).await.unwrap();
                for part in ids(size).chunks(999) {
                    a.frames_tx.push(part).await.unwrap();
                }
                assert_eq!(a.frames_tx.finish().await.unwrap().ids, size);
            }
        };
        tokio::join!(reader, writer);
    }
}

pub(crate) async fn batches_are_full_but_the_last(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    a.frames_tx.begin(start(0)).await.unwrap();
    for part in ids(47).chunks(7) {
        a.frames_tx.push(part).await.unwrap();
    }
    a.frames_tx.finish().await.unwrap();
    let got = receive(&mut display.frames_rx).await.unwrap();
    assert_eq!(got.batches, [10, 10, 10, 10, 7]);
}

pub(crate) async fn flush_sends_a_part_of_a_batch(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(3)).await.unwrap();
    a.frames_tx.flush().await.unwrap();
    a.frames_tx.flush().await.unwrap();
    assert!(matches!(display.frames_rx.recv().await.unwrap(), FrameEvent::Begin(_)));
    let FrameEvent::Ids(batch) = display.frames_rx.recv().await.unwrap() else { panic!("no ids") };
    assert_eq!(batch.iter().collect::<Vec<_>>(), ids(3));
    assert_eq!(display.frames_rx.open_frame(), Some(FrameNumber(0)));
    a.frames_tx.push(&ids(1)).await.unwrap();
    assert_eq!(a.frames_tx.finish().await.unwrap().ids, 4);
}

pub(crate) async fn frames_in_the_wrong_order_are_refused(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    let order = |result: Result<(), SendError>| match result {
        Err(SendError::Order { peer: Role::Display, cause }) => cause,
        other => panic!("{other:?}"),
    };
    assert_eq!(order(a.frames_tx.push(&[DrawableId(1)]).await), FrameOrderError::NoneOpen);
    assert_eq!(order(a.frames_tx.finish().await.map(|_| ())), FrameOrderError::NoneOpen);
    a.frames_tx.begin(start(5)).await.unwrap();
    let (open, wanted) = (FrameNumber(5), FrameNumber(6));
    assert_eq!(order(a.frames_tx.begin(start(6)).await), FrameOrderError::StillOpen { open, wanted });
    a.frames_tx.finish().await.unwrap();
    let not_rising = FrameOrderError::NotRising { last: FrameNumber(5), wanted: FrameNumber(5) };
    assert_eq!(order(a.frames_tx.begin(start(5)).await), not_rising);
    assert_eq!(receive(&mut display.frames_rx).await.unwrap().end.frame, FrameNumber(5));
}

pub(crate) async fn both_directions_at_once(pairs: &impl Pairs) {
    async fn talk(mut link: Link) -> Link {
        let Link { frames_tx, frames_rx, .. } = &mut link;
        let send = async {
            for frame in 0..20 {
                frames_tx.begin(start(frame)).await.unwrap();
                frames_tx.push(&ids(10_000)).await.unwrap();
                frames_tx.finish().await.unwrap();
            }
        };
        let receive = async {
            for _ in 0..20 {
                assert_eq!(receive(frames_rx).await.unwrap().ids.len(), 10_000);
            }
        };
        tokio::join!(send, receive);
        link
    }
    let (a, display) = pairs.pair(patient()).await;
    let _ends = tokio::join!(talk(a), talk(display));
}

pub(crate) async fn every_byte_is_counted<P: Pairs>(pairs: &P) {
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    let before: LinkStats = a.stats.read();
    assert_eq!(before.sent.control.messages, P::HANDSHAKE);
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(25)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    a.latest_tx.publish(camera(0)).unwrap();
    receive(&mut display.frames_rx).await.unwrap();
    display.latest_rx.latest().await.unwrap();

    let sent = (a.stats.read() - before).sent;
    assert_eq!(sent.begin, Tally { messages: 1, bytes: 76 });
    assert_eq!(sent.ids, Tally { messages: 3, bytes: 100 });
    assert_eq!(sent.id_count, 25);
    assert_eq!(sent.end, Tally { messages: 1, bytes: 16 });
    assert_eq!(sent.camera, Tally { messages: 1, bytes: 72 });
    assert_eq!(sent.control, Tally::default());
    assert_eq!(sent.header_bytes, 6 * P::HEADER);
    assert_eq!(sent.total_bytes(), 76 + 100 + 16 + 72 + 6 * P::HEADER);
    let received = display.stats.read().received;
    assert_eq!((received.begin, received.ids), (sent.begin, sent.ids));
    assert_eq!((received.end, received.camera), (sent.end, sent.camera));
    assert_eq!(received.control.messages, P::HANDSHAKE);
    assert_eq!(received.control, a.stats.read().sent.control);
}

pub(crate) async fn frames_alike_cost_little_as_changes<P: Pairs>(pairs: &P) {
    let (mut a, mut display) = pairs.pair(LinkConfig { coding: IdCoding::Changes, ..batches_of(256) }).await;
    // Of 4,000 drawables, others are hidden in each frame.
    let visible = |frame: u32| -> Vec<DrawableId> {
        (0..4000).filter(|id| !(id + 3 * frame).is_multiple_of(100)).map(|id| DrawableId(5 * id)).collect()
    };
    let mut first = Traffic::default();
    for frame in 0..10 {
        a.frames_tx.begin(start(frame)).await.unwrap();
        a.frames_tx.push(&visible(frame)).await.unwrap();
        a.frames_tx.finish().await.unwrap();
        assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, visible(frame));
        if frame == 0 {
            first = a.stats.read().sent;
        }
    }
    let sent = a.stats.read().sent - first;
    assert_eq!(sent.id_count, 9 * 3960);
    if P::CODES {
        // 40 ids come and 40 go: 3 bytes for each, and some for each of the 16 batches.
        assert!(sent.ids.bytes < 9 * (80 * 3 + 16 * 6), "{:?}", sent.ids);
    } else {
        assert_eq!(sent.ids.bytes, 4 * sent.id_count);
    }
    let received = display.stats.read().received;
    assert_eq!(received.id_count, 10 * 3960);
    assert_eq!(received.ids.bytes, sent.ids.bytes + first.ids.bytes);
}
