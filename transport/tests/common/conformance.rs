//! What every transport must do, whatever is below it. A transport joins by making pairs of links.

use std::sync::Arc;
use std::time::Duration;

use trimaran_proto::{
    BatchSize, DrawableId, FrameEvent, FrameNumber, FrameOrderError, Goodbye, IdCoding, Role,
};
use trimaran_transport::{
    Link, LinkConfig, LinkStats, Loss, Net, RecvError, SendError, Tally, Traffic, sleep_until, until,
};

use super::{camera, ids, net, receive, start};

/// Makes pairs of joined links: switch A first, the display at its other end.
pub(crate) trait Pairs {
    async fn pair(&self, config: LinkConfig) -> (Link, Link);
    /// The network whose time the links keep.
    fn net(&self) -> Arc<dyn Net> {
        net()
    }
    /// The bytes of a header.
    const HEADER: u64;
    /// Whether ids travel as changes where the peers agreed on that.
    const CODES: bool = true;
    /// How many messages a handshake takes in each direction.
    const HANDSHAKE: u64;
}

/// Makes a test of each case, for one transport.
#[macro_export]
macro_rules! conformance {
    ($pairs:expr => $($case:ident),+ $(,)?) => {
        $(
            #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
            async fn $case() {
                $crate::common::conformance::$case(&$pairs).await;
            }
        )+
    };
    ($pairs:expr) => {
        $crate::conformance!($pairs =>
            frames_of_every_size_arrive_in_order,
            batches_are_full_but_the_last,
            flush_sends_a_part_of_a_batch,
            the_newest_camera_wins,
            publishing_never_waits,
            a_camera_is_read_once,
            a_slow_receiver_holds_the_sender_back,
            a_receiver_that_catches_up_gets_everything,
            a_busy_receiver_is_no_dead_peer,
            silence_ends_in_an_error,
            a_deadline_leaves_the_link_usable,
            polling_takes_what_is_there,
            dropping_a_wait_loses_nothing,
            goodbye_comes_after_everything,
            death_within_a_frame_is_no_goodbye,
            a_dead_receiver_fails_the_sender,
            frames_in_the_wrong_order_are_refused,
            both_directions_at_once,
            every_byte_is_counted,
            frames_alike_cost_little_as_changes,
        );
    };
}

fn patient() -> LinkConfig {
    LinkConfig { patience: Duration::from_secs(60), ..LinkConfig::default() }
}

fn batches_of(ids: u32) -> LinkConfig {
    LinkConfig { batch: BatchSize::new(ids).unwrap(), ..patient() }
}

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

pub(crate) async fn a_slow_receiver_holds_the_sender_back(pairs: &impl Pairs) {
    let config = LinkConfig { patience: Duration::from_millis(200), ..batches_of(16_384) };
    let (mut a, display) = pairs.pair(config).await;
    a.frames_tx.begin(start(0)).await.unwrap();
    let batch = ids(16_384);
    let mut taken = 0;
    let error = loop {
        match a.frames_tx.push(&batch).await {
            Ok(()) => taken += batch.len() * 4,
            Err(error) => break error,
        }
        assert!(taken < 64 << 20, "64 MiB taken and nobody reads");
    };
    assert!(matches!(error, SendError::Stalled { peer: Role::Display, .. }), "{error}");
    drop(display);
}

pub(crate) async fn a_receiver_that_catches_up_gets_everything(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(16_384)).await;
    let all = ids(16 << 20);
    let writer = async {
        a.frames_tx.begin(start(0)).await.unwrap();
        a.frames_tx.push(&all).await.unwrap();
        a.frames_tx.finish().await.unwrap();
    };
    let net = pairs.net();
    let reader = async {
        sleep_until(&*net, net.now().after(Duration::from_millis(50))).await;
        receive(&mut display.frames_rx).await.unwrap()
    };
    let ((), got) = tokio::join!(writer, reader);
    assert!(got.ids == all, "64 MiB of ids");
}

/// A role's thread may be busy with its GPU for longer than the patience of the link.
pub(crate) async fn a_busy_receiver_is_no_dead_peer(pairs: &impl Pairs) {
    let config = LinkConfig { patience: Duration::from_millis(100), ..LinkConfig::default() };
    let (mut a, mut display) = pairs.pair(config).await;
    let runtime = tokio::runtime::Handle::current();
    let reader = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(400));
        let got = runtime.block_on(receive(&mut display.frames_rx)).unwrap();
        std::thread::sleep(Duration::from_millis(400));
        runtime.block_on(async { display.latest_tx.publish(camera(1)).unwrap() });
        (got, display)
    });
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(4000)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    let read = loop {
        match a.latest_rx.latest().await {
            Err(RecvError::Silent { peer: Role::Display, .. }) => {}
            other => break other,
        }
    };
    assert_eq!(read.unwrap(), camera(1));
    let (got, _display) = tokio::task::spawn_blocking(|| reader.join().unwrap()).await.unwrap();
    assert_eq!(got.ids, ids(4000));
}

pub(crate) async fn silence_ends_in_an_error(pairs: &impl Pairs) {
    let patience = Duration::from_millis(50);
    let (mut a, mut display) = pairs.pair(LinkConfig { patience, ..LinkConfig::default() }).await;
    let frames = a.frames_rx.recv().await;
    let latest = a.latest_rx.latest().await;
    let silent =
        |e: &RecvError| matches!(e, RecvError::Silent { peer: Role::Display, waited } if *waited == patience);
    assert!(frames.as_ref().is_err_and(silent), "{frames:?}");
    assert!(latest.as_ref().is_err_and(silent), "{latest:?}");
    display.latest_tx.publish(camera(3)).unwrap();
    assert_eq!(a.latest_rx.latest().await.unwrap(), camera(3), "the caller may go on waiting");
}

pub(crate) async fn a_deadline_leaves_the_link_usable(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    let net = pairs.net();
    for frame in 0..3 {
        let by = net.now().after(Duration::from_millis(10));
        let missed = display.frames_rx.recv_by(by).await;
        assert!(matches!(missed, Err(RecvError::Deadline { peer: Role::SwitchA })), "{missed:?}");
        a.frames_tx.begin(start(frame)).await.unwrap();
        a.frames_tx.push(&ids(300)).await.unwrap();
        a.frames_tx.finish().await.unwrap();
        assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(300));
    }
}

pub(crate) async fn polling_takes_what_is_there(pairs: &impl Pairs) {
    // More batches than a runtime lets a task take in one go.
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    let net = pairs.net();
    assert!(matches!(display.frames_rx.try_recv(), Ok(None)));
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(2000)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    let mut got = Vec::new();
    loop {
        match display.frames_rx.try_recv().unwrap() {
            Some(FrameEvent::Ids(batch)) => got.extend(batch.iter()),
            Some(FrameEvent::End(_)) => break,
            Some(FrameEvent::Begin(_) | FrameEvent::Stats(_)) => {}
            None => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
        }
    }
    assert_eq!(got, ids(2000));
    let poll = async {
        loop {
            match display.frames_rx.try_recv() {
                Ok(None) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
                ended => break ended,
            }
        }
    };
    let (_left, ended) = tokio::join!(a.goodbye(Goodbye::Finished), poll);
    assert!(matches!(ended, Err(RecvError::Goodbye { .. })), "{ended:?}");
}

pub(crate) async fn dropping_a_wait_loses_nothing(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(100)).await;
    let all = ids(50_000);
    let writer = async {
        a.frames_tx.begin(start(0)).await.unwrap();
        for part in all.chunks(333) {
            a.frames_tx.push(part).await.unwrap();
            tokio::task::yield_now().await;
        }
        a.frames_tx.finish().await.unwrap();
    };
    let net = pairs.net();
    let reader = async {
        let mut got = Vec::new();
        loop {
            // Every other wait is dropped as soon as it would have to wait.
            let event = match until(&*net, net.now(), display.frames_rx.recv()).await {
                Some(event) => event,
                None => display.frames_rx.recv().await,
            };
            match event.unwrap() {
                FrameEvent::Ids(batch) => got.extend(batch.iter()),
                FrameEvent::End(_) => return got,
                FrameEvent::Begin(_) | FrameEvent::Stats(_) => {}
            }
        }
    };
    let ((), got) = tokio::join!(writer, reader);
    assert_eq!(got, all);
}

pub(crate) async fn goodbye_comes_after_everything(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(patient()).await;
    a.latest_tx.publish(camera(1)).unwrap();
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(5)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    a.goodbye(Goodbye::failed("out of memory")).await.unwrap();

    assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(5));
    let said = |e: RecvError| match e {
        RecvError::Goodbye { peer: Role::SwitchA, reason } => reason,
        other => panic!("{other:?}"),
    };
    for _ in 0..2 {
        assert_eq!(said(display.frames_rx.recv().await.unwrap_err()), Goodbye::failed("out of memory"));
    }
    assert_eq!(display.latest_rx.latest().await.unwrap(), camera(1));
    for _ in 0..2 {
        assert_eq!(said(display.latest_rx.latest().await.unwrap_err()), Goodbye::failed("out of memory"));
    }
    assert_eq!(said(display.latest_rx.try_latest().unwrap_err()), Goodbye::failed("out of memory"));
}

pub(crate) async fn death_within_a_frame_is_no_goodbye(pairs: &impl Pairs) {
    let (mut a, mut display) = pairs.pair(batches_of(10)).await;
    a.frames_tx.begin(start(0)).await.unwrap();
    a.frames_tx.push(&ids(25)).await.unwrap();
    drop(a);
    let mut got = 0;
    let error = loop {
        match display.frames_rx.recv().await {
            Ok(FrameEvent::Begin(_)) => {}
            Ok(FrameEvent::Ids(batch)) => got += batch.count(),
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error,
        }
    };
    assert_eq!(got, 20, "what was sent before is received");
    assert!(matches!(error, RecvError::Lost { peer: Role::SwitchA, cause: Loss::Closed }), "{error:?}");
    assert_eq!(display.frames_rx.open_frame(), Some(FrameNumber(0)));
    let camera = display.latest_rx.latest().await;
    assert!(matches!(camera, Err(RecvError::Lost { peer: Role::SwitchA, .. })), "{camera:?}");
}

pub(crate) async fn a_dead_receiver_fails_the_sender(pairs: &impl Pairs) {
    let (a, mut display) = pairs.pair(patient()).await;
    display.frames_tx.begin(start(0)).await.unwrap();
    drop(a.frames_rx);
    drop(a.frames_tx);
    let net = pairs.net();
    let error = loop {
        match display.frames_tx.push(&ids(1000)).await {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { peer: Role::SwitchA, .. }), "{error:?}");
    drop((a.latest_rx, a.latest_tx));
    let error = loop {
        match display.latest_tx.publish(camera(1)) {
            Ok(()) => sleep_until(&*net, net.now().after(Duration::from_millis(1))).await,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, SendError::Lost { peer: Role::SwitchA, .. }), "{error:?}");
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
