//! Links whose application parts do not fit.

use bytes::{Bytes, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use trimaran_transport::conformance::{ARM, PANEL, Pose, Robot, greeting, pose, start};
use trimaran_transport::{
    AttemptError, ConnectError, Endpoint, FrameStart, HandshakeError, Lane, ListenError, Options, Protocol,
    ProtocolError, ProtocolName, RecvError, Refusal, Rejection, SessionId,
};
use trimaran_wire::{ChannelList, Decoder, Hello, Message, WireVersions};

use crate::common::meeting::Meeting;
use crate::common::{Link, Listener, connect, format, last_failure, net, obstacle_of, soon};

/// Another application.
#[derive(Debug, Clone, PartialEq)]
struct Other;

impl Protocol for Other {
    const NAME: &'static str = "other/1";
    type Hello = String;
    type Latest = ();
    type Header = ();
    type Item = u32;
    type Message = String;
}

over_every_transport!(
    another_protocol_is_refused_by_name,
    a_value_that_is_none_ends_the_lane,
    a_header_that_is_none_ends_the_lane,
);

async fn another_protocol_is_refused_by_name(endpoint: &str) {
    let Meeting { at, panel, listener: _listener, _folder, .. } =
        Meeting::at(endpoint, &Options::default()).await;
    let cause = obstacle_of::<Other>(&net(), &at, "other".to_owned(), &panel).await;
    let (listener, connector) = (ProtocolName::new(Robot::NAME), ProtocolName::new(Other::NAME));
    match &cause {
        HandshakeError::Alpn(ours) if at.transport() == "quic" => assert_eq!(*ours, connector),
        HandshakeError::Refused(refusal) => assert_eq!(*refusal, Refusal::Protocol { listener, connector }),
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn another_protocol_of_this_process_is_refused_by_name() {
    another_protocol_is_refused_by_name("inproc:another-protocol").await;
}

/// Both ends of a link.
async fn meet(endpoint: &str) -> (Link, Link, impl Sized) {
    let Meeting { mut listener, at, panel, _folder, .. } = Meeting::at(endpoint, &Options::default()).await;
    let net = net();
    let (there, here) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &panel, soon(&net)), listener.accept(soon(&net)),);
    (here.unwrap(), there.unwrap(), (_folder, listener))
}

/// A pose that its receiver refuses.
fn nowhere() -> Pose {
    Pose { heading: f64::NAN, ..pose(1) }
}

fn is_value(error: &RecvError) -> bool {
    matches!(error, RecvError::Protocol { cause: ProtocolError::Value(_), .. })
}

async fn a_value_that_is_none_ends_the_lane(endpoint: &str) {
    let (mut arm, mut panel, _held) = meet(endpoint).await;
    panel.latest_tx.publish(nowhere()).unwrap();
    let error = arm.latest_rx.latest().await.unwrap_err();
    assert!(is_value(&error), "{error:?}");
}

async fn a_header_that_is_none_ends_the_lane(endpoint: &str) {
    let (mut arm, mut panel, _held) = meet(endpoint).await;
    let start = FrameStart { header: nowhere(), ..start(0) };
    arm.frames_tx.begin(start).await.unwrap();
    let error = panel.frames_rx.recv().await.unwrap_err();
    assert!(is_value(&error), "{error:?}");
}

#[tokio::test]
async fn a_hello_that_is_too_long_is_this_sides_own_fault() {
    let (net, options) = (net(), Options::default());
    let mut long = greeting(ARM);
    long.name = "x".repeat(200);
    let at = "tcp://127.0.0.1:0".parse().unwrap();
    let error = connect(&net, &at, long.clone(), &options, soon(&net)).await.unwrap_err();
    let ConnectError::Failed { cause: AttemptError::Handshake { cause, .. }, .. } = error else {
        panic!("{error:?}")
    };
    assert!(matches!(cause, HandshakeError::HelloTooLong(_)), "{cause:?}");
    let error = Listener::bind(&net, &at, long, &options).await.unwrap_err();
    assert!(matches!(error, ListenError::Given { .. }) && !error.may_pass(), "{error:?}");
}

/// The bytes of a value, encoded by postcard, with others behind it.
fn with_more(mut bytes: Vec<u8>) -> Bytes {
    bytes.push(0);
    bytes.into()
}

#[tokio::test]
async fn a_hello_that_cannot_be_read_is_refused() {
    let (net, options) = (net(), Options::default());
    let at = "tcp://127.0.0.1:0".parse().unwrap();
    let mut listener = Listener::bind(&net, &at, greeting(ARM), &options).await.unwrap();
    let Endpoint::Tcp(at) = listener.local_endpoint() else { panic!("no TCP") };
    for application in [Bytes::new(), with_more(postcard::to_stdvec(&greeting(PANEL)).unwrap())] {
        let protocol = ProtocolName::new(Robot::NAME);
        let idle_timeout = options.link.idle_timeout.into();
        let (session, lane, channels) = (SessionId(1), Lane::Frames, ChannelList::default());
        let versions = WireVersions::SUPPORTED;
        let hello = Hello { versions, protocol, session, lane, idle_timeout, channels, application };
        let mut said = BytesMut::new();
        Message::Hello(hello).encode(&mut said);
        let mut stranger = TcpStream::connect(at.to_string()).await.unwrap();
        stranger.write_all(&said).await.unwrap();
        let (mut answer, mut decoder) = (Vec::new(), Decoder::new(format()));
        stranger.read_to_end(&mut answer).await.unwrap();
        decoder.push(&answer);
        let refusal = Refusal::Rejected(Rejection::new(u16::MAX, "the application's hello is malformed"));
        assert_eq!(decoder.next_message().unwrap(), Some(Message::Refuse(refusal)));
    }
    let failure = last_failure(&mut listener).await;
    assert!(matches!(failure, HandshakeError::Refused(Refusal::Rejected(_))), "{failure:?}");
}
