//! The lanes of records, messages and blocks: order, completeness, backpressure, and independence from other
//! lanes.

use std::ops::Range;
use std::pin::pin;
use std::time::Duration;

use super::pairs::Pairs;
use super::record_lanes::{Bulk, Lane, Messages};
use super::talk::{ARM, PANEL, finished, points, pose, receive, send_frame, start};
use super::talk::{batches_of, patient};
use crate::{LinkConfig, Loss, RecvError, SendError, sleep_until, until};

/// Makes two cases of each: one of the messages lane, one of the bulk lane.
macro_rules! of_both_lanes {
    ($($case:ident: $(#[$doc:meta])* $messages:ident, $bulk:ident;)+) => {
        $(
            $(#[$doc])*
            pub async fn $messages(pairs: &impl Pairs) {
                $case::<Messages>(pairs).await;
            }

            $(#[$doc])*
            pub async fn $bulk(pairs: &impl Pairs) {
                $case::<Bulk>(pairs).await;
            }
        )+
    };
}

of_both_lanes! {
    beside_a_frame_that_nobody_reads:
        /// All records arrive in order, in both directions, while a frame is open that nobody reads, and
        /// values are read beside them.
        messages_arrive_in_order_beside_a_frame_that_nobody_reads,
        blocks_arrive_in_order_beside_a_frame_that_nobody_reads;
    a_sender_waits:
        /// A sender of more than its peer takes waits, and goes on when the peer reads. Nothing is lost, and
        /// nothing is sent of the record whose wait ended in vain. Other lanes go on meanwhile.
        a_sender_of_messages_waits_for_its_receiver,
        a_sender_of_blocks_waits_for_its_receiver;
    a_sender_gives_up:
        /// A sender gives up a peer that takes no records when its timeout ends.
        a_sender_of_messages_waits_no_longer_than_its_timeout,
        a_sender_of_blocks_waits_no_longer_than_its_timeout;
    before_the_close:
        /// Everything sent before a close arrives before it, and the close on every call.
        messages_arrive_before_the_close,
        blocks_arrive_before_the_close;
    before_a_drop:
        /// Everything sent before a link is dropped arrives, and then the loss of the peer.
        messages_arrive_before_a_link_is_dropped,
        blocks_arrive_before_a_link_is_dropped;
    a_dead_receiver:
        /// Sending records to a peer that no longer receives them fails.
        a_dead_receiver_of_messages_fails_the_sender,
        a_dead_receiver_of_blocks_fails_the_sender;
    too_long:
        /// A record that is too long is refused before any of it is sent, and the longest one arrives.
        a_message_that_is_too_long_is_refused,
        a_block_that_is_too_long_is_refused;
    nothing_to_say:
        /// A peer without records is not silent: a wait for its records goes on, beside frames, and gets the
        /// first one.
        a_peer_without_a_message_fails_nobody,
        a_peer_without_a_block_fails_nobody;
    dropped_waits:
        /// Waits that are dropped lose no record.
        dropping_a_wait_for_messages_loses_none,
        dropping_a_wait_for_blocks_loses_none;
    in_the_middle:
        /// Links close while both sides have sent more than their peers have taken. Data arrives before the
        /// close at a peer that reads, and nobody waits for one that does not.
        links_close_in_the_middle_of_messages,
        links_close_in_the_middle_of_blocks;
}

async fn say<L: Lane>(tx: &mut L::Tx, numbers: Range<u32>) {
    for number in numbers {
        L::send(tx, &L::record(number)).await.unwrap();
    }
}

async fn hear<L: Lane>(rx: &mut L::Rx, numbers: Range<u32>) {
    for number in numbers {
        assert_eq!(L::recv(rx, None).await.unwrap(), L::record(number));
    }
}

/// A record of this number among many. All are equally long, so that no shorter one fits the last room.
fn one_of_many<L: Lane>(number: u32) -> L::Record {
    L::of_length(number, 10_000)
}

/// Sends until that has to wait; returns how many it sent.
async fn fill<L: Lane>(tx: &mut L::Tx, pairs: &impl Pairs) -> u32 {
    let net = pairs.net();
    for sent in 0..6400 {
        let record = one_of_many::<L>(sent);
        let soon = net.now().after(Duration::from_millis(500));
        match until(&*net, soon, L::send(tx, &record)).await {
            Some(sent) => sent.unwrap(),
            None => return sent,
        }
    }
    panic!("64 MB taken and nobody reads");
}

async fn beside_a_frame_that_nobody_reads<L: Lane>(pairs: &impl Pairs) {
    const COUNT: u32 = 2000;
    let (mut arm, mut panel) = pairs.pair(LinkConfig { max_frame: 16 << 20, ..batches_of(16_384) }).await;
    let all = points(16 << 20);
    let (arm, panel) = (L::halves(&mut arm), L::halves(&mut panel));
    let frame = async {
        arm.frames_tx.begin(start(0)).await.unwrap();
        arm.frames_tx.push(&all).await.unwrap();
        panic!("64 MiB of points are taken, and nobody reads");
    };
    let talk = async {
        tokio::join!(
            say::<L>(arm.tx, 0..COUNT),
            hear::<L>(arm.rx, 0..COUNT),
            say::<L>(panel.tx, 0..COUNT),
            hear::<L>(panel.rx, 0..COUNT),
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

async fn a_sender_waits<L: Lane>(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let sent = fill::<L>(L::halves(&mut arm).tx, pairs).await;
    arm.latest_tx.publish(pose(1)).unwrap();
    assert_eq!(panel.latest_rx.latest().await.unwrap(), pose(1));
    send_frame(&mut arm.frames_tx, 0, &points(1000)).await.unwrap();
    assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(1000));
    say::<L::Other>(L::Other::halves(&mut arm).tx, 0..20).await;
    hear::<L::Other>(L::Other::halves(&mut panel).rx, 0..20).await;

    let last = sent + 100;
    let (tx, rx) = (L::halves(&mut arm).tx, L::halves(&mut panel).rx);
    let say = async {
        for number in sent..last {
            L::send(tx, &one_of_many::<L>(number)).await.unwrap();
        }
    };
    let hear = async {
        for number in 0..last {
            assert_eq!(L::recv(rx, None).await.unwrap(), one_of_many::<L>(number));
        }
    };
    tokio::join!(say, hear);
}

async fn a_sender_gives_up<L: Lane>(pairs: &impl Pairs) {
    let config = LinkConfig { timeout: Duration::from_millis(200), ..LinkConfig::default() };
    let (mut arm, panel) = pairs.pair(config).await;
    let tx = L::halves(&mut arm).tx;
    let error = loop {
        if let Err(error) = L::send(tx, &L::of_length(1, 16_000)).await {
            break error;
        }
    };
    assert!(matches!(error, SendError::Stalled { ref peer, .. } if peer.as_str() == PANEL), "{error:?}");
    drop(panel);
}

async fn before_the_close<L: Lane>(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    say::<L>(L::halves(&mut arm).tx, 0..20).await;
    let hear = async {
        let rx = L::halves(&mut panel).rx;
        hear::<L>(rx, 0..20).await;
        for _ in 0..2 {
            let closed = L::recv(rx, None).await;
            assert!(
                matches!(closed, Err(RecvError::Closed { ref peer, ref reason }) if peer.as_str() == ARM && *reason == finished()),
                "{closed:?}"
            );
        }
        assert!(matches!(L::try_recv(rx), Err(RecvError::Closed { .. })));
    };
    let (closed, ()) = tokio::join!(arm.close(finished()), hear);
    closed.unwrap();
    panel.close(finished()).await.unwrap();
}

async fn before_a_drop<L: Lane>(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    say::<L>(L::halves(&mut arm).tx, 0..20).await;
    drop(arm);
    let rx = L::halves(&mut panel).rx;
    hear::<L>(rx, 0..20).await;
    let lost = L::recv(rx, None).await;
    assert!(matches!(lost, Err(RecvError::Lost { cause: Loss::Closed, .. })), "{lost:?}");
}

async fn a_dead_receiver<L: Lane>(pairs: &impl Pairs) {
    let (arm, mut panel) = pairs.pair(patient()).await;
    let _rest = L::without(arm);
    let (net, tx) = (pairs.net(), L::halves(&mut panel).tx);
    let error = loop {
        match L::send(tx, &L::record(1)).await {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { ref peer, .. } if peer.as_str() == ARM), "{error:?}");
}

async fn too_long<L: Lane>(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let (tx, rx) = (L::halves(&mut arm).tx, L::halves(&mut panel).rx);
    let refused = L::send(tx, &L::of_length(1, L::MOST + 1)).await;
    assert!(matches!(refused, Err(SendError::TooLong { ref peer }) if peer.as_str() == PANEL), "{refused:?}");
    L::send(tx, &L::of_length(1, L::MOST)).await.unwrap();
    assert_eq!(L::recv(rx, None).await.unwrap(), L::of_length(1, L::MOST));
}

async fn nothing_to_say<L: Lane>(pairs: &impl Pairs) {
    let config = LinkConfig { timeout: Duration::from_millis(50), ..LinkConfig::default() };
    let (mut arm, mut panel) = pairs.pair(config).await;
    let net = pairs.net();
    let rx = L::halves(&mut panel).rx;
    assert!(matches!(L::try_recv(rx), Ok(None)));
    let late = L::recv(rx, Some(net.now().after(config.timeout * 5))).await;
    assert!(matches!(late, Err(RecvError::Deadline { .. })), "{late:?}");
    let (arm, panel) = (L::halves(&mut arm), L::halves(&mut panel));
    let mut first = pin!(L::recv(panel.rx, None));
    let mut frames = 0;
    let said = loop {
        tokio::select! {
            biased;
            said = &mut first => break said,
            got = receive(panel.frames_rx) => {
                assert_eq!(got.unwrap().points, points(100));
                frames += 1;
                if frames == 3 {
                    L::send(arm.tx, &L::record(7)).await.unwrap();
                }
            }
            () = async {
                send_frame(arm.frames_tx, frames, &points(100)).await.unwrap();
                std::future::pending::<()>().await;
            }, if frames < 3 => {}
        }
    };
    assert_eq!((said.unwrap(), frames), (L::record(7), 3));
}

async fn dropped_waits<L: Lane>(pairs: &impl Pairs) {
    const COUNT: u32 = 300;
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let net = pairs.net();
    let (tx, rx) = (L::halves(&mut arm).tx, L::halves(&mut panel).rx);
    let say = async {
        for number in 0..COUNT {
            L::send(tx, &L::record(number)).await.unwrap();
            tokio::task::yield_now().await;
        }
    };
    let hear = async {
        let mut next = 0;
        while next < COUNT {
            // Every other wait is dropped as soon as it would have to wait.
            let said = match until(&*net, net.now(), L::recv(rx, None)).await {
                Some(said) => said,
                None => L::recv(rx, None).await,
            };
            assert_eq!(said.unwrap(), L::record(next));
            next += 1;
        }
    };
    tokio::join!(say, hear);
}

async fn in_the_middle<L: Lane>(pairs: &impl Pairs) {
    let (mut arm, mut panel) = pairs.pair(patient()).await;
    let sent = fill::<L>(L::halves(&mut arm).tx, pairs).await;
    let hear = async {
        let rx = L::halves(&mut panel).rx;
        for number in 0..sent {
            assert_eq!(L::recv(rx, None).await.unwrap(), one_of_many::<L>(number));
        }
        let closed = L::recv(rx, None).await;
        assert!(matches!(closed, Err(RecvError::Closed { .. })), "{closed:?}");
        panel.close(finished()).await.unwrap();
    };
    let (closed, ()) = tokio::join!(arm.close(finished()), hear);
    closed.unwrap();

    let (mut arm, mut panel) = pairs.pair(patient()).await;
    fill::<L>(L::halves(&mut arm).tx, pairs).await;
    fill::<L>(L::halves(&mut panel).tx, pairs).await;
    let (one, other) = tokio::join!(arm.close(finished()), panel.close(finished()));
    assert!(one.is_ok() && other.is_ok(), "{one:?} {other:?}");
}
