//! The latest lane: only the newest value counts.

use std::time::Duration;

use super::pairs::Pairs;
use super::talk::patient;
use super::talk::{PANEL, pose};
use crate::RecvError;

/// A reader sees ever newer values, and the last one in the end.
pub async fn the_newest_value_wins(pairs: &impl Pairs) {
    const LAST: u32 = 1000;
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    for frame in 0..=LAST {
        panel.latest_tx.publish(pose(frame)).unwrap();
    }
    let mut newest = None;
    while newest != Some(LAST) {
        let read = arm.latest_rx.latest().await.unwrap();
        assert!(newest < Some(read.number), "{newest:?} was read before {}", read.number);
        assert_eq!(read, pose(read.number));
        newest = Some(read.number);
    }
    assert_eq!(arm.latest_rx.try_latest().unwrap(), None);
}

/// Unread values replace each other: a sender neither waits nor sends all of them.
pub async fn publishing_never_waits(pairs: &impl Pairs) {
    // 8 MB, more than a connection buffers.
    const LAST: u32 = 200_000;
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    for frame in 0..=LAST {
        panel.latest_tx.publish(pose(frame)).unwrap();
    }
    let mut reads = 0;
    loop {
        reads += 1;
        if arm.latest_rx.latest().await.unwrap() == pose(LAST) {
            break;
        }
    }
    assert!(reads < LAST / 10, "{reads} reads");
    let sent = panel.stats.read().sent.latest.messages;
    assert!(sent <= u64::from(LAST) + 1, "{sent} sent");
}

/// A value is read once, unless it is published again.
pub async fn a_value_is_read_once(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    assert_eq!(arm.latest_rx.try_latest().unwrap(), None);
    panel.latest_tx.publish(pose(7)).unwrap();
    assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(7));
    assert_eq!(arm.latest_rx.try_latest().unwrap(), None);
    let net = pairs.net();
    let by = net.now().after(Duration::from_millis(30));
    let again = arm.latest_rx.latest_by(by).await;
    assert!(matches!(again, Err(RecvError::Deadline { ref peer }) if peer.as_str() == PANEL), "{again:?}");
    panel.latest_tx.publish(pose(7)).unwrap();
    assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(7), "published again, read again");
}
