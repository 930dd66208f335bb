//! Which of two things is sent first: it takes exact times to see.

use std::time::Duration;

use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_transport::LinkConfig;
use trimaran_transport::conformance::{Pairs, command, points, pose, receive, send_frame, start};

/// A frame of so many points takes 160 ms over the [narrow line](narrow).
const LONG: u32 = 50_000;

/// A line over which frames queue at their sender.
pub(crate) fn narrow() -> LinkModel {
    LinkModel::clean(Rate::new(10_000_000), Duration::from_millis(2))
}

/// Of two frames that are sent at once, the older one has the line for itself.
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

/// A value and a message that are sent behind a frame are there long before all of the frame is.
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
