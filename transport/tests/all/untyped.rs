//! A side whose protocol is known only at run time, against one with types.

use bytes::Bytes;
use trimaran_transport::conformance::{ARM, PANEL, Robot, command, greeting, points, pose, receive, start};
use trimaran_transport::untyped::{Raw, RawValue, Untyped, UntypedHello};
use trimaran_transport::{
    ConnectError, Fixed, FrameNumber, FrameOrderError, FrameStart, Link, LinkConfig, Options, Protocol,
    ProtocolError, Publisher, RecvError, SendError, WhenBehind, inproc,
};

use crate::common::meeting::Meeting;
use crate::common::{hello_bytes, net, soon};

over_every_transport!(
    a_side_without_types_talks_to_one_with_types,
    a_publisher_without_types_reaches_one_with_types,
);

fn hello(latest: usize, item: usize) -> UntypedHello {
    UntypedHello::new(Robot::NAME, latest, 36, item, hello_bytes(&greeting(PANEL)).into()).unwrap()
}

/// A panel without types, and an arm that has them.
async fn meet(endpoint: &str, hello: UntypedHello) -> (Link<Untyped>, Link<Robot>, impl Sized) {
    let Meeting { mut listener, at, panel, _folder, .. } = Meeting::at(endpoint, &Options::default()).await;
    let net = net();
    let by = soon(&net);
    let (there, here) = tokio::join!(
        listener.accept(by),
        trimaran_transport::connect::<Untyped>(&net, &at, hello, &panel, by),
    );
    (here.unwrap(), there.unwrap(), (listener, _folder))
}

fn encoded(items: &[u32]) -> Vec<u8> {
    items.iter().flat_map(|item| item.to_le_bytes()).collect()
}

fn raw(number: u32) -> RawValue {
    RawValue(pose(number).to_bytes())
}

async fn a_side_without_types_talks_to_one_with_types(endpoint: &str) {
    let (mut panel, mut arm, _held) = meet(endpoint, hello(36, 4)).await;
    assert_eq!((arm.peer.hello.clone(), panel.peer.name.as_str()), (greeting(PANEL), ARM));
    panel.latest_tx.publish(raw(3)).unwrap();
    assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(3));
    arm.latest_tx.publish(pose(4)).unwrap();
    assert_eq!(panel.latest_rx.latest().await.unwrap(), raw(4));

    let (begin, bytes) = (
        FrameStart { frame: FrameNumber(7), header: RawValue(start(7).header.to_bytes()) },
        encoded(&points(1000)),
    );
    panel.frames_tx.begin(begin.clone()).await.unwrap();
    panel.frames_tx.push(&bytes[..400]).await.unwrap();
    let part = panel.frames_tx.push(&bytes[400..406]).await;
    let cause = FrameOrderError::Part { bytes: 6, item: 4 };
    assert!(matches!(part, Err(SendError::Order { cause: known, .. }) if known == cause), "{part:?}");
    panel.frames_tx.push(&bytes[400..]).await.unwrap();
    assert_eq!(panel.frames_tx.finish().await.unwrap().items, 1000);
    let frame = receive(&mut arm.frames_rx).await.unwrap();
    assert_eq!((frame.start, frame.points), (start(7), points(1000)));
    assert_eq!(panel.stats.read().sent.items, 1000);

    arm.frames_tx.begin(start(8)).await.unwrap();
    arm.frames_tx.push(&points(1000)).await.unwrap();
    arm.frames_tx.finish().await.unwrap();
    let frame = panel.frames_rx.frame().await.unwrap();
    assert_eq!((frame.end.items, frame.items().collect::<Vec<_>>()), (1000, bytes));
    assert_eq!(panel.stats.read().received.items, 1000);

    let message: Bytes = postcard::to_stdvec(&command(5)).unwrap().into();
    panel.messages_tx.send(&message.clone().into()).await.unwrap();
    assert_eq!(arm.messages_rx.recv().await.unwrap(), command(5));
    arm.messages_tx.send(&command(5)).await.unwrap();
    assert_eq!(panel.messages_rx.recv().await.unwrap(), Raw::from(message));
}

async fn a_publisher_without_types_reaches_one_with_types(endpoint: &str) {
    let (panel, mut arm, _held) = meet(endpoint, hello(36, 4)).await;
    let format = hello(36, 4).format();
    let mut publisher = Publisher::<Untyped>::of_format(&net(), &LinkConfig::default(), &format);
    publisher.subscribe(panel.frames_tx, WhenBehind::Wait);
    let begin = FrameStart { frame: FrameNumber(2), header: RawValue(start(2).header.to_bytes()) };
    let end = publisher.publish(begin, &encoded(&points(600))).await.unwrap().end;
    let frame = receive(&mut arm.frames_rx).await.unwrap();
    assert_eq!((end.items, frame.start, frame.points), (600, start(2), points(600)));
}

#[tokio::test]
async fn two_sides_without_types_meet_in_one_process() {
    let by = |item| hello(36, item);
    let config = LinkConfig::default().with_max_frame(50);
    let (mut one, mut other) = inproc::pair::<Untyped>(&net(), by(100), by(100), &config).unwrap();
    one.frames_tx.begin(FrameStart { frame: FrameNumber(0), header: raw(1) }).await.unwrap();
    one.frames_tx.push(&[5; 5000]).await.unwrap();
    let more = one.frames_tx.push(&[5; 100]).await;
    let cause = |error| matches!(error, Err(SendError::Order { cause: FrameOrderError::TooMany { .. }, .. }));
    assert!(cause(more));
    one.frames_tx.finish().await.unwrap();
    let frame = other.frames_rx.frame().await.unwrap();
    assert_eq!((frame.end.items, frame.items().count(), frame.start.header), (50, 5000, raw(1)));
    // Begin, header, end: as many bytes as if they were encoded.
    let sent = one.stats.read().sent;
    assert_eq!((sent.begin.bytes, sent.batches.bytes, sent.items), (40, 5000, 50));
}

#[tokio::test]
async fn other_protocols_without_types_are_refused_in_one_process() {
    let (net, options) = (net(), Options::default());
    let at = "inproc:untyped-protocols".parse().unwrap();
    let other = UntypedHello::new("other/1", 0, 0, 1, Raw::default()).unwrap();
    let _listener = trimaran_transport::Listener::<Untyped>::bind(&net, &at, other, &options).await.unwrap();
    let by = net.now().after(std::time::Duration::from_millis(50));
    let refused = trimaran_transport::connect::<Untyped>(&net, &at, hello(36, 4), &options, by).await;
    let Err(ConnectError::Deadline { last, .. }) = refused else { panic!("{refused:?}") };
    assert!(trimaran_transport::causes(&last).contains("speaks other/1"), "{last:?}");
}

#[tokio::test]
async fn values_of_another_size_break_the_protocol() {
    let (mut panel, mut arm, _held) = meet("tcp://127.0.0.1:0", hello(35, 4)).await;
    panel.latest_tx.publish(RawValue::from(&[0; 35][..])).unwrap();
    let end = arm.latest_rx.latest().await;
    assert!(matches!(end, Err(RecvError::Protocol { cause: ProtocolError::Decode(_), .. })), "{end:?}");
}
