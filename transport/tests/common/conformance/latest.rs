//! Cameras: the newest counts.

use std::time::Duration;

use trimaran_proto::Role;
use trimaran_transport::RecvError;

use super::{Pairs, patient};
use crate::common::camera;

pub(crate) async fn the_newest_camera_wins(pairs: &impl Pairs) {
    const LAST: u32 = 1000;
    let (mut a, mut display) = pairs.pair(patient()).await;
    for frame in 0..=LAST {
        display.latest_tx.publish(camera(frame)).unwrap();
    }
    let mut newest = None;
    while newest != Some(LAST) {
        let read = a.latest_rx.latest().await.unwrap();
        assert!(newest < Some(read.frame().0), "{newest:?} was read before {}", read.frame());
        assert_eq!(read, camera(read.frame().0));
        newest = Some(read.frame().0);
    }
    assert_eq!(a.latest_rx.try_latest().unwrap(), None);
}

pub(crate) async fn publishing_never_waits(pairs: &impl Pairs) {
    // 15 MB, more than the buffers of any of the tests' connections.
    const LAST: u32 = 200_000;
    let (mut a, mut display) = pairs.pair(patient()).await;
    for frame in 0..=LAST {
        display.latest_tx.publish(camera(frame)).unwrap();
    }
    let mut reads = 0;
    loop {
        reads += 1;
        if a.latest_rx.latest().await.unwrap() == camera(LAST) {
            break;
        }
    }
    assert!(reads < LAST / 10, "{reads} reads");
    let sent = display.stats.read().sent.camera.messages;
    assert!(sent <= u64::from(LAST) + 1, "{sent} sent");
}

pub(crate) async fn a_camera_is_read_once(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    assert_eq!(a.latest_rx.try_latest().unwrap(), None);
    display.latest_tx.publish(camera(7)).unwrap();
    assert_eq!(a.latest_rx.latest().await.unwrap(), camera(7));
    assert_eq!(a.latest_rx.try_latest().unwrap(), None);
    let net = pairs.net();
    let by = net.now().after(Duration::from_millis(30));
    let again = a.latest_rx.latest_by(by).await;
    assert!(matches!(again, Err(RecvError::Deadline { peer: Role::Display })), "{again:?}");
    display.latest_tx.publish(camera(7)).unwrap();
    assert_eq!(a.latest_rx.latest().await.unwrap(), camera(7), "published again, read again");
}
