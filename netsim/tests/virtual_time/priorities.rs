//! Which of two things is sent first: it takes exact times to see.

use std::time::Duration;

use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_transport::LinkConfig;

use crate::common::conformance::Pairs;
use crate::common::{camera, ids, receive, start};

/// A frame of so many ids takes 160 ms over the [narrow line](narrow).
const LONG: u32 = 50_000;

/// A line over which frames queue at their sender.
pub(crate) fn narrow() -> LinkModel {
    LinkModel::clean(Rate::new(10_000_000), Duration::from_millis(2))
}

/// Of two frames that are sent at once, the older one has the line for itself.
pub(crate) async fn an_older_frame_is_complete_first(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(LinkConfig::default()).await;
    let net = pairs.net();
    let begun = net.now();
    for frame in 0..2 {
        a.frames_tx.begin(start(frame)).await.unwrap();
        a.frames_tx.push(&ids(LONG)).await.unwrap();
        a.frames_tx.finish().await.unwrap();
    }
    assert!(net.now().since(begun) < Duration::from_millis(10), "both are under way");
    let mut ends = Vec::new();
    for frame in 0..2 {
        assert_eq!(receive(&mut display.frames_rx).await.unwrap().start, start(frame));
        ends.push(net.now().since(begun));
    }
    assert!(ends[0] * 3 < ends[1] * 2, "{ends:?}");
}

/// A camera that is published behind a frame is there long before all of the frame is.
pub(crate) async fn a_camera_goes_before_a_frame(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(LinkConfig::default()).await;
    let net = pairs.net();
    let begun = net.now();
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(LONG)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    a.latest_tx.publish(camera(7)).unwrap();
    let look = async {
        assert_eq!(display.latest_rx.latest().await.unwrap(), camera(7));
        net.now().since(begun)
    };
    let read = async {
        receive(&mut display.frames_rx).await.unwrap();
        net.now().since(begun)
    };
    let (seen, complete) = tokio::join!(look, read);
    assert!(seen * 4 < complete, "the camera after {seen:?}, the frame after {complete:?}");
}
