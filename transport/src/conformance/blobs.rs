//! Blobs on the bulk lane.

use std::time::Duration;

use bytes::Bytes;
use trimaran_wire::MAX_BLOCK;

use super::pairs::Pairs;
use crate::{BlobError, BlobEvent, BlobReceiver, Bulk, Link, LinkConfig, until};

const MOST: u64 = 6_000_000;
/// More than any transport holds between the two ends: QUIC keeps 32 MiB that are sent and not read.
const ENDLESS: usize = 48 << 20;

fn blob(length: usize) -> Bytes {
    (0..length).map(|at| (at % 251) as u8).collect()
}

/// The bytes of the next whole blob, and the parts before.
async fn whole(receiver: &mut BlobReceiver) -> (Bytes, Vec<BlobEvent>) {
    let mut parts = Vec::new();
    loop {
        match receiver.recv().await.unwrap() {
            BlobEvent::Whole(bytes) => return (bytes, parts),
            part => parts.push(part),
        }
    }
}

fn halves<P: trimaran_wire::Protocol>(link: &mut Link<P>) -> Bulk {
    link.bulk.take().unwrap()
}

/// Around the length of a block, and far beyond it. Both sides are told how far it is.
pub async fn blobs_of_any_length_arrive(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let (mut tx, mut rx) = (halves(&mut arm).tx.blobs(), halves(&mut panel).rx.blobs(MOST));
    for length in [0, 1, MAX_BLOCK - 9, MAX_BLOCK - 8, MAX_BLOCK, 2 * MAX_BLOCK - 10, MOST as usize] {
        let mut sent = Vec::new();
        let (done, (bytes, parts)) =
            tokio::join!(tx.send(blob(length), |bytes| sent.push(bytes)), whole(&mut rx));
        done.unwrap();
        assert!(bytes == blob(length), "{length} bytes");
        assert_eq!(sent.last(), Some(&(length as u64)));
        let received: Vec<_> = parts
            .iter()
            .map(|part| match part {
                BlobEvent::Progress { received, length: all } if *all == length as u64 => *received,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(received, sent[..sent.len() - 1], "{length} bytes");
    }
}

/// A blob that is given up halfway, and one that is too long, do no harm to the next.
pub async fn a_blob_can_be_cancelled_and_refused(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let (mut tx, rx) = (halves(&mut arm).tx.blobs(), halves(&mut panel).rx);
    let mut rx = rx.blobs(ENDLESS as u64);
    let net = pairs.net();
    // Nobody reads, so it cannot be sent to its end.
    let soon = net.now().after(Duration::from_millis(500));
    let cut = until(&*net, soon, tx.send(vec![7; ENDLESS].into(), |_| {})).await;
    assert!(cut.is_none(), "{cut:?}");
    let (done, (bytes, parts)) = tokio::join!(tx.send(blob(5), |_| {}), whole(&mut rx));
    done.unwrap();
    assert_eq!(bytes, blob(5));
    let Some(BlobEvent::Cancelled { received, length }) = parts.last() else { panic!("{parts:?}") };
    assert!(*length == ENDLESS as u64 && (1..*length).contains(received), "{received} of {length}");

    let mut rx = rx.into_blocks().blobs(MOST);
    let long = async {
        tx.send(blob(MOST as usize + 1), |_| {}).await.unwrap();
        tx.send(blob(7), |_| {}).await.unwrap();
    };
    let refuse = async {
        let refused = rx.recv().await;
        assert!(matches!(refused, Err(BlobError::TooLong { length, most: MOST }) if length == MOST + 1));
        rx.whole().await.unwrap()
    };
    let ((), bytes) = tokio::join!(long, refuse);
    assert_eq!(bytes, blob(7));

    // Blocks that are no blobs.
    let mut blocks = tx.into_blocks();
    for strange in [&[][..], &[9], &[1, 2], &[2], &[0, 1], &[0, 0, 0, 0, 0, 0, 0, 0, 0, 1]] {
        blocks.send(Bytes::copy_from_slice(strange)).await.unwrap();
        let refused = rx.recv().await;
        assert!(matches!(refused, Err(BlobError::Malformed)), "{strange:?}: {refused:?}");
    }
}
