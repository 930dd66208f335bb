//! Channels: lanes of their own types, none of which waits for another.

use std::time::Duration;

use trimaran_wire::{ChannelFormat, ChannelName, ChannelNumber, ChannelSizes, FramesOf, Refusal};

use super::pairs::Pairs;
use super::robot::{Pose, Robot};
use super::rover::{Crawler, Distance, OtherRover, Rover, Ticks};
use super::talk::{coded, finished, patient, points, pose, start, visible};
use crate::{
    AttemptError, ChannelError, ConnectError, FrameEvent, FrameNumber, FrameReceiver, FrameSender,
    FrameStart, HandshakeError, KeepLast, Link, LinkConfig, Protocol, Publisher, RecvError, WhenBehind,
    sleep_until,
};

type Front = FramesOf<(), u32>;
type Back = FramesOf<Ticks, Distance>;

/// Two rovers; `None` for a transport without channels, which says so.
async fn rovers(pairs: &impl Pairs) -> Option<(Link<Rover>, Link<Rover>)> {
    joined(pairs, patient()).await
}

async fn joined<P>(pairs: &impl Pairs, config: LinkConfig) -> Option<(Link<P>, Link<P>)>
where
    P: Protocol<Hello = String>,
{
    let hellos = ("here".to_owned(), "there".to_owned());
    match pairs.join::<P, P>(hellos, config, Duration::from_secs(60)).await {
        Ok(pair) => Some(pair),
        Err(ConnectError::Failed {
            cause: AttemptError::Handshake { cause: HandshakeError::NoChannels { needed, most, .. }, .. },
            ..
        }) => {
            assert_eq!((needed, most), (P::CHANNELS.len(), 0));
            None
        }
        Err(other) => panic!("{other:?}"),
    }
}

fn at<H>(frame: u32, header: H) -> FrameStart<H> {
    FrameStart { frame: FrameNumber(frame), header }
}

/// So many distances, each other than its neighbours.
fn distances(count: u32) -> Vec<Distance> {
    (0..count).map(|n| Distance([n as u8, (n >> 8) as u8, 7])).collect()
}

async fn send<P: Protocol>(tx: &mut FrameSender<P>, start: FrameStart<P::Header>, items: Vec<P::Item>) {
    tx.send(start, &items).await.unwrap();
}

async fn receive<P: Protocol>(rx: &mut FrameReceiver<P>, start: FrameStart<P::Header>, items: Vec<P::Item>)
where
    P::Item: PartialEq,
{
    let frame = rx.frame().await.unwrap();
    assert_eq!(frame.start, start);
    assert!(frame.items().eq(items.iter().copied()), "{} of {} items", frame.items().count(), items.len());
}

/// Values and frames of each channel arrive as they were sent, in both directions.
pub async fn channels_of_each_kind_carry_their_own_types(pairs: &impl Pairs) {
    let Some((mut here, mut there)) = rovers(pairs).await else { return };
    let (mut odometry_tx, mut back_odometry_rx) = here.channels.latest::<Pose>("odometry").unwrap();
    let (mut back_odometry_tx, mut odometry_rx) = there.channels.latest::<Pose>("odometry").unwrap();
    let (mut imu_tx, _imu) = here.channels.latest::<Ticks>("imu").unwrap();
    let (_back_imu, mut imu_rx) = there.channels.latest::<Ticks>("imu").unwrap();
    odometry_tx.publish(pose(1)).unwrap();
    assert_eq!(odometry_rx.latest().await.unwrap(), pose(1));
    for tick in 0..=1000 {
        imu_tx.publish(Ticks(tick)).unwrap();
    }
    back_odometry_tx.publish(pose(2)).unwrap();
    here.latest_tx.publish(pose(3)).unwrap();
    let mut newest = Ticks(0);
    while newest != Ticks(1000) {
        let read = imu_rx.latest().await.unwrap();
        assert!(read.0 >= newest.0, "{read:?} after {newest:?}");
        newest = read;
    }
    assert_eq!(back_odometry_rx.latest().await.unwrap(), pose(2));
    assert_eq!(there.latest_rx.latest().await.unwrap(), pose(3));
    assert_eq!(odometry_rx.try_latest().unwrap(), None, "other values have not come again");

    let (mut front_tx, mut back_front_rx) = here.channels.frames::<(), u32>("front").unwrap();
    let (mut back_front_tx, mut front_rx) = there.channels.frames::<(), u32>("front").unwrap();
    let (mut back_tx, _back) = here.channels.frames::<Ticks, Distance>("back").unwrap();
    let (_back, mut back_rx) = there.channels.frames::<Ticks, Distance>("back").unwrap();
    let sizes = [0, 1, 255, 256, 257, 50_000];
    // In the same order: a lane's sender waits for its reader.
    let sends = async {
        for (frame, size) in (0..).zip(sizes) {
            send(&mut front_tx, at(frame, ()), points(size)).await;
            send(&mut here.frames_tx, at(frame + 7, ()), points(size + 1)).await;
            send(&mut back_tx, at(frame, Ticks(frame.into())), distances(size)).await;
            send(&mut back_front_tx, at(2 * frame, ()), points(size + 2)).await;
        }
    };
    let receives = async {
        for (frame, size) in (0..).zip(sizes) {
            receive(&mut front_rx, at(frame, ()), points(size)).await;
            receive(&mut there.frames_rx, at(frame + 7, ()), points(size + 1)).await;
            receive(&mut back_rx, at(frame, Ticks(frame.into())), distances(size)).await;
            receive(&mut back_front_rx, at(2 * frame, ()), points(size + 2)).await;
        }
    };
    tokio::join!(sends, receives);
}

/// Batches of a channel of another protocol are coded as that says, and those of other channels plain.
pub async fn a_channel_is_coded_as_its_declaration_says(pairs: &impl Pairs) {
    let Some((mut here, mut there)) = joined::<Crawler>(pairs, coded(256)).await else { return };
    // Its protocol is part of its type.
    let asked = there.channels.frames::<Pose, u32>("arm").unwrap_err();
    assert!(asked.to_string().contains("CHANNELS declares frames_of::<"), "{asked}");

    let ours = here.channels.frames_of::<Robot>("arm").unwrap();
    let theirs = there.channels.frames_of::<Robot>("arm").unwrap();
    let (mut front_tx, _rx) = here.channels.frames::<(), u32>("front").unwrap();
    let (_tx, mut front_rx) = there.channels.frames::<(), u32>("front").unwrap();
    let sent = |link: &Link<Crawler>| link.stats.read().sent.batches.bytes;
    for (mut tx, mut rx, link) in [(ours.0, theirs.1, &here), (theirs.0, ours.1, &there)] {
        for frame in 0..10 {
            send(&mut tx, start(frame), visible(frame)).await;
            receive(&mut rx, start(frame), visible(frame)).await;
        }
        let plain = 10 * 3960 * 4;
        let most = if pairs.overhead().coded { plain / 5 } else { plain };
        assert!(sent(link) <= most && sent(link) > 0, "{} bytes, plain {plain}", sent(link));
    }
    let before = sent(&here);
    send(&mut front_tx, at(0, ()), visible(0)).await;
    receive(&mut front_rx, at(0, ()), visible(0)).await;
    assert_eq!(sent(&here) - before, 3960 * 4);
}

/// A channel that nobody reads stops its own sender, and nothing else.
pub async fn a_channel_that_nobody_reads_holds_up_no_other(pairs: &impl Pairs) {
    let Some((mut here, mut there)) = rovers(pairs).await else { return };
    let (mut front_tx, _rx) = here.channels.frames::<(), u32>("front").unwrap();
    let (mut back_tx, _rx) = here.channels.frames::<Ticks, Distance>("back").unwrap();
    let (_tx, mut back_rx) = there.channels.frames::<Ticks, Distance>("back").unwrap();
    let (mut imu_tx, _rx) = here.channels.latest::<Ticks>("imu").unwrap();
    let (_tx, mut imu_rx) = there.channels.latest::<Ticks>("imu").unwrap();
    // More than any transport holds.
    let flood = async {
        for frame in 0..300 {
            send(&mut front_tx, at(frame, ()), points(100_000)).await;
        }
    };
    let talk = async {
        for number in 0..50 {
            tokio::join!(
                send(&mut back_tx, at(number, Ticks(5)), distances(20_000)),
                receive(&mut back_rx, at(number, Ticks(5)), distances(20_000)),
            );
            tokio::join!(
                send(&mut here.frames_tx, at(number, ()), points(20_000)),
                receive(&mut there.frames_rx, at(number, ()), points(20_000)),
            );
            imu_tx.publish(Ticks(number.into())).unwrap();
            while imu_rx.latest().await.unwrap() != Ticks(number.into()) {}
        }
    };
    tokio::select! {
        biased;
        () = flood => panic!("120 MB were sent to nobody"),
        () = talk => {}
    }
}

/// A frame that has begun on one channel waits for its end alone.
pub async fn an_open_frame_holds_up_no_other_channel(pairs: &impl Pairs) {
    let Some((mut here, mut there)) = rovers(pairs).await else { return };
    let (mut front_tx, _rx) = here.channels.frames::<(), u32>("front").unwrap();
    let (_tx, mut front_rx) = there.channels.frames::<(), u32>("front").unwrap();
    let (mut back_tx, _rx) = here.channels.frames::<Ticks, Distance>("back").unwrap();
    let (_tx, mut back_rx) = there.channels.frames::<Ticks, Distance>("back").unwrap();
    front_tx.begin(at(9, ())).await.unwrap();
    front_tx.push(&points(1000)).await.unwrap();
    front_tx.flush().await.unwrap();
    for frame in 0..20 {
        tokio::join!(
            send(&mut back_tx, at(frame, Ticks(1)), distances(3000)),
            receive(&mut back_rx, at(frame, Ticks(1)), distances(3000)),
        );
    }
    assert!(matches!(front_rx.recv().await.unwrap(), FrameEvent::Begin(start) if start == at(9, ())));
    front_tx.finish().await.unwrap();
    let mut items = 0;
    while let FrameEvent::Batch(batch) = front_rx.recv().await.unwrap() {
        items += batch.count();
    }
    assert_eq!(items, 1000);
}

/// Each channel has its own publisher, its own subscribers and its own newest frames.
pub async fn a_channel_is_published_and_its_newest_frames_are_kept(pairs: &impl Pairs) {
    let Some((mut here, mut there)) = rovers(pairs).await else { return };
    let config = patient();
    let (mut front, mut back) =
        (Publisher::<Front>::new(&pairs.net(), &config), Publisher::<Back>::new(&pairs.net(), &config));
    front.subscribe(here.channels.frames("front").unwrap().0, WhenBehind::Skip);
    back.subscribe(here.channels.frames("back").unwrap().0, WhenBehind::Wait);
    let (_tx, front_rx) = there.channels.frames::<(), u32>("front").unwrap();
    let (_tx, mut back_rx) = there.channels.frames::<Ticks, Distance>("back").unwrap();
    let mut front_rx = front_rx.keep_last(KeepLast::default());
    for frame in 0..50 {
        front.publish(at(frame, ()), &points(30_000)).await.unwrap();
        back.publish(at(frame, Ticks(2)), &distances(10)).await.unwrap();
        receive(&mut back_rx, at(frame, Ticks(2)), distances(10)).await;
    }
    let mut last = None;
    while last != Some(49) {
        let frame = front_rx.frame().await.unwrap();
        assert!(last < Some(frame.start.frame.0) && frame.items().eq(points(30_000)));
        last = Some(frame.start.frame.0);
    }
}

/// A close reaches every channel that was not taken out, and each half that was closes by itself.
pub async fn channels_close_with_their_link_or_by_themselves(pairs: &impl Pairs) {
    let Some((mut here, mut there)) = rovers(pairs).await else { return };
    let (front_tx, front_rx) = here.channels.frames::<(), u32>("front").unwrap();
    let (far_front_tx, mut far_front_rx) = there.channels.frames::<(), u32>("front").unwrap();
    let closed = |end: RecvError| matches!(end, RecvError::Closed { reason, .. } if reason == finished());
    let (said, heard) = tokio::join!(front_tx.close(finished()), far_front_rx.recv());
    assert!(said.is_ok() && closed(heard.unwrap_err()));
    let (_tx, mut odometry_rx) = there.channels.latest::<Pose>("odometry").unwrap();
    let (_tx, mut back_rx) = there.channels.frames::<Ticks, Distance>("back").unwrap();
    drop((front_rx, far_front_tx));
    let hears = async {
        assert!(closed(odometry_rx.latest().await.unwrap_err()));
        assert!(closed(back_rx.recv().await.unwrap_err()));
    };
    let (said, ()) = tokio::join!(here.close(finished()), hears);
    said.unwrap();
}

/// A link that is dropped takes its channels with it.
pub async fn a_dead_peer_is_lost_on_every_channel(pairs: &impl Pairs) {
    let Some((mut here, there)) = rovers(pairs).await else { return };
    let (mut front_tx, mut front_rx) = here.channels.frames::<(), u32>("front").unwrap();
    let (mut imu_tx, mut imu_rx) = here.channels.latest::<Ticks>("imu").unwrap();
    drop(there);
    assert!(matches!(front_rx.recv().await, Err(RecvError::Lost { .. })));
    assert!(matches!(imu_rx.latest().await, Err(RecvError::Lost { .. })));
    for frame in 0.. {
        if front_tx.begin(at(frame, ())).await.is_err() || front_tx.finish().await.is_err() {
            break;
        }
    }
    let net = pairs.net();
    while imu_tx.publish(Ticks(0)).is_ok() {
        sleep_until(&*net, net.now().after(Duration::from_millis(1))).await;
    }
}

/// Peers of the same protocol with other channels get the first that differs.
pub async fn channels_that_differ_are_refused_by_name(pairs: &impl Pairs) {
    if rovers(pairs).await.is_none() {
        return;
    }
    let back = |item| {
        let sizes = ChannelSizes::Frames { header: 8, item };
        Some(ChannelFormat { name: ChannelName::new("back"), sizes })
    };
    let expected = Refusal::Channel { number: ChannelNumber(3), listener: back(3), connector: back(4) };
    // The first wait that is long enough here.
    for wait in (2..).map(|doubled| Duration::from_millis(50) * 2_u32.pow(doubled)) {
        let hellos = ("here".to_owned(), "there".to_owned());
        let error = pairs.join::<Rover, OtherRover>(hellos, patient(), wait).await.unwrap_err();
        if let Some(refusal) = error.refusal() {
            assert_eq!(*refusal, expected);
            let said = refusal.to_string();
            assert!(
                said.contains("channel 3") && said.contains("`back`") && said.contains("install"),
                "{said}"
            );
            return;
        }
        assert!(wait < Duration::from_secs(60), "{error:?}");
    }
}

/// Halves of another name or of other types are not given, nor the same twice.
pub async fn a_channel_of_another_name_or_type_is_an_error(pairs: &impl Pairs) {
    let Some((mut here, _there)) = rovers(pairs).await else { return };
    let unknown = here.channels.latest::<Ticks>("lidar").unwrap_err();
    assert!(matches!(&unknown, ChannelError::Unknown { name, .. } if name == "lidar"), "{unknown:?}");
    let said = unknown.to_string();
    for name in ["odometry", "imu", "front", "back"] {
        assert!(said.contains(&format!("(\"{name}\")")), "{said}");
    }
    let kind = here.channels.latest::<Ticks>("front").unwrap_err();
    assert!(kind.to_string().contains("frames::<(), u32>"), "{kind}");
    let types = here.channels.frames::<(), Distance>("front").unwrap_err();
    assert!(matches!(&types, ChannelError::Types { name, .. } if name == "front"), "{types:?}");
    here.channels.frames::<(), u32>("front").unwrap();
    let twice = here.channels.frames::<(), u32>("front").unwrap_err();
    assert_eq!(twice, ChannelError::Taken { name: "front".to_owned() });
}
