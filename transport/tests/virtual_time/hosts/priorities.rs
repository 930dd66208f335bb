//! The order of sending between lanes, which needs exact times to see.

use std::time::Duration;

use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_transport::LinkConfig;
use trimaran_transport::conformance::{Pairs, Robot, command, points, pose, receive, send_frame, start};
use trimaran_transport::{BulkReceiver, BulkSender, Link, MAX_BLOCK, sleep_until};

/// A frame of so many points takes 160 ms over the [narrow line](narrow).
const LONG: u32 = 50_000;

/// A line over which frames queue at their sender.
pub(crate) fn narrow() -> LinkModel {
    LinkModel::clean(Rate::new(10_000_000), Duration::from_millis(2))
}

/// Of two frames sent at once, the older one has the line for itself.
pub(crate) async fn an_older_frame_is_complete_first(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let net = pairs.net();
    let begun = net.now();
    for frame in 0..2 {
        send_frame(&mut arm.frames_tx, frame, &points(LONG)).await.unwrap();
    }
    assert!(net.now().since(begun) < Duration::from_millis(10), "both are under way");
    let mut ends = Vec::new();
    for frame in 0..2 {
        assert_eq!(receive(&mut panel.frames_rx).await.unwrap().start, start(frame));
        ends.push(net.now().since(begun));
    }
    assert!(ends[0] * 3 < ends[1] * 2, "{ends:?}");
}

/// A value and a message sent behind a frame arrive long before all of the frame.
pub(crate) async fn a_value_and_a_message_go_before_a_frame(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let net = pairs.net();
    let begun = net.now();
    send_frame(&mut arm.frames_tx, 0, &points(LONG)).await.unwrap();
    arm.latest_tx.publish(pose(7)).unwrap();
    arm.messages_tx.send(&command(7)).await.unwrap();
    let look = async {
        assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(7));
        net.now().since(begun)
    };
    let hear = async {
        assert_eq!(panel.messages_rx.recv().await.unwrap(), command(7));
        net.now().since(begun)
    };
    let read = async {
        receive(&mut panel.frames_rx).await.unwrap();
        net.now().since(begun)
    };
    let (seen, heard, complete) = tokio::join!(look, hear, read);
    assert!(
        seen * 4 < complete && heard * 4 < complete,
        "the value after {seen:?}, the message after {heard:?}, the frame after {complete:?}"
    );
}

/// So many blocks take half a second over the [narrow line](narrow).
const BLOCKS: u32 = 40;

/// How long so many blocks take when nothing else is sent.
pub(crate) async fn blocks_alone(pairs: &impl Pairs) -> Duration {
    let (mut arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let begun = pairs.net().now();
    tokio::join!(
        send_blocks(&mut arm.bulk.as_mut().unwrap().tx, BLOCKS),
        take_blocks(&mut panel.bulk.as_mut().unwrap().rx, BLOCKS)
    );
    pairs.net().now().since(begun)
}

async fn send_blocks(tx: &mut BulkSender, count: u32) {
    for number in 0..count {
        tx.send(number.to_le_bytes().repeat(MAX_BLOCK / 4).into()).await.unwrap();
    }
}

async fn take_blocks(rx: &mut BulkReceiver, count: u32) {
    for number in 0..count {
        assert_eq!(rx.recv().await.unwrap()[..4], number.to_le_bytes());
    }
}

/// A frame, a value and a message sent behind blocks arrive long before all of the blocks.
pub(crate) async fn everything_goes_before_blocks(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let net = pairs.net();
    let begun = net.now();
    let blocks = async {
        tokio::join!(
            send_blocks(&mut arm.bulk.as_mut().unwrap().tx, BLOCKS),
            take_blocks(&mut panel.bulk.as_mut().unwrap().rx, BLOCKS)
        );
        net.now().since(begun)
    };
    let others = async {
        sleep_until(&*net, begun.after(Duration::from_millis(1))).await;
        send_frame(&mut arm.frames_tx, 0, &points(1000)).await.unwrap();
        arm.latest_tx.publish(pose(7)).unwrap();
        arm.messages_tx.send(&command(7)).await.unwrap();
        receive(&mut panel.frames_rx).await.unwrap();
        assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(7));
        assert_eq!(panel.messages_rx.recv().await.unwrap(), command(7));
        net.now().since(begun)
    };
    let (complete, there) = tokio::join!(blocks, others);
    assert!(there * 4 < complete, "the others after {there:?}, the blocks after {complete:?}");
}

/// The longest times of a frame and a message, sent together each 20 ms beside so many blocks at full speed.
pub(crate) async fn beside_blocks(pairs: &impl Pairs, blocks: u32) -> [Duration; 2] {
    let (arm, panel) = pairs.pair(LinkConfig::default()).await;
    let Link { bulk: blocks_out, mut frames_tx, mut messages_tx, latest_tx: _latest_tx, .. }: Link<Robot> =
        arm;
    let Link { bulk: blocks_in, mut frames_rx, mut messages_rx, latest_rx: _latest_rx, .. } = panel;
    let (mut blocks_out, mut blocks_in) = (blocks_out.unwrap(), blocks_in.unwrap());
    let (net, mut longest) = (pairs.net(), [Duration::ZERO; 2]);
    let begun = net.now();
    let measure = async {
        for number in 0..20 {
            let at = begun.after(Duration::from_millis(20) * number);
            sleep_until(&*net, at).await;
            send_frame(&mut frames_tx, number, &points(1000)).await.unwrap();
            messages_tx.send(&command(number + 11)).await.unwrap();
            let frame = async {
                assert_eq!(receive(&mut frames_rx).await.unwrap().start, start(number));
                net.now().since(at)
            };
            let message = async {
                assert_eq!(messages_rx.recv().await.unwrap(), command(number + 11));
                net.now().since(at)
            };
            let (frame, message) = tokio::join!(frame, message);
            longest = [longest[0].max(frame), longest[1].max(message)];
        }
    };
    tokio::join!(measure, send_blocks(&mut blocks_out.tx, blocks), take_blocks(&mut blocks_in.rx, blocks));
    longest
}
