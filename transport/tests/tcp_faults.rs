//! Strangers, liars and the dead, over real sockets: what they do ends in a typed error at the peer that meets them.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::BytesMut;
use common::{camera, identity, ids, last_failure, net, receive, soon, start};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use trimaran_proto::{
    Accept, DecodeFault, Decoder, FrameEnd, FrameEvent, FrameMessage, FrameNumber, FrameOutcome,
    FrameViolation, Kind, Lane, Message, ProtocolVersion, Refusal, Role, SessionId,
};
use trimaran_transport::{
    AttemptError, ConnectError, Endpoint, FrameReceiver, HandshakeError, Limits, Link, Listener, Loss, Net,
    Options, ProtocolError, RecvError, connect, until,
};

const SESSION: SessionId = SessionId(0x1234);

fn quick() -> Options {
    Options { handshake: Duration::from_millis(200), ..Options::default() }
}

async fn listener(net: &Arc<dyn Net>, options: &Options) -> (Listener, SocketAddr) {
    let listener =
        Listener::bind(net, &"tcp://127.0.0.1:0".parse().unwrap(), identity(Role::SwitchA), options)
            .await
            .unwrap();
    let Endpoint::Tcp(at) = listener.local_endpoint() else { panic!("no TCP") };
    let address = at.to_string().parse().unwrap();
    (listener, address)
}

fn bytes(messages: &[Message]) -> BytesMut {
    let mut out = BytesMut::new();
    messages.iter().for_each(|message| message.encode(&mut out));
    out
}

fn hello(lane: Lane) -> Message {
    Message::Hello(identity(Role::Display).hello(SESSION, lane))
}

/// A connection to `address` on which `message` was said.
async fn dial(address: SocketAddr, message: &Message) -> TcpStream {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(&bytes(std::slice::from_ref(message))).await.unwrap();
    stream
}

/// Everything that comes until the end of the stream.
async fn answers(stream: &mut TcpStream) -> Vec<Message> {
    let mut decoder = Decoder::new();
    // A reset is as good an end as any.
    while stream.read_buf(decoder.buffer(1024)).await.is_ok_and(|n| n > 0) {}
    std::iter::from_fn(|| decoder.next_message().unwrap()).collect()
}

/// The next message that comes, if one does.
async fn next(stream: &mut TcpStream, decoder: &mut Decoder) -> Option<Message> {
    loop {
        if let Some(message) = decoder.next_message().unwrap() {
            return Some(message);
        }
        stream.read_buf(decoder.buffer(1024)).await.ok().filter(|n| *n > 0)?;
    }
}

/// A display that is made of bare sockets, and the link that switch A has to it.
async fn raw_display() -> (Link, TcpStream, TcpStream) {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let mut frames = TcpStream::connect(address).await.unwrap();
    let mut latest = TcpStream::connect(address).await.unwrap();
    frames.write_all(&bytes(&[hello(Lane::Frames)])).await.unwrap();
    latest.write_all(&bytes(&[hello(Lane::Latest)])).await.unwrap();
    let link = listener.accept(soon(&net)).await.unwrap();
    // Read, lest closing with unread data resets the connection.
    let mut accept = vec![0; bytes(&[Message::Accept(Accept { identity: identity(Role::SwitchA) })]).len()];
    frames.read_exact(&mut accept).await.unwrap();
    latest.read_exact(&mut accept).await.unwrap();
    (link, frames, latest)
}

fn violation(error: RecvError) -> FrameViolation {
    match error {
        RecvError::Protocol { peer: Role::Display, cause: ProtocolError::Frame(violation) } => violation,
        other => panic!("{other:?}"),
    }
}

fn fault(error: RecvError) -> DecodeFault {
    match error {
        RecvError::Protocol { peer: Role::Display, cause: ProtocolError::Decode(error) } => error.fault,
        other => panic!("{other:?}"),
    }
}

async fn error(rx: &mut FrameReceiver) -> RecvError {
    loop {
        if let Err(error) = rx.recv().await {
            return error;
        }
    }
}

#[tokio::test]
async fn a_display_of_bare_sockets_is_a_display() {
    let (mut link, mut frames, mut latest) = raw_display().await;
    latest.write_all(&bytes(&[Message::Camera(camera(1)), Message::Camera(camera(2))])).await.unwrap();
    assert_eq!(link.latest_rx.latest().await.unwrap(), camera(2));
    let begin = bytes(&[Message::Frame(FrameMessage::Begin(start(0)))]);
    for byte in begin {
        frames.write_all(&[byte]).await.unwrap();
        tokio::task::yield_now().await;
    }
    assert_eq!(link.frames_rx.recv().await.unwrap(), FrameEvent::Begin(start(0)));
}

#[tokio::test]
async fn another_version_is_refused_in_words_that_it_can_read() {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let mut stranger = TcpStream::connect(address).await.unwrap();
    // A later version: the first six bytes of its hello are as ever, the rest may be anything.
    stranger.write_all(&[0x01, 9, 0, 0, b'T', b'R', b'I', b'M', 0x07, 0x01, 0xff, 0xff, 0xff]).await.unwrap();
    let mut answer = Vec::new();
    stranger.read_to_end(&mut answer).await.unwrap();
    assert_eq!(answer[0], Kind::Refuse.code());
    assert_eq!(answer[4..6], [1, 0], "the listener's version comes first");
    let mut decoder = Decoder::new();
    decoder.push(&answer);
    let expected = Refusal::Version { listener: ProtocolVersion(1), connector: ProtocolVersion(0x0107) };
    assert_eq!(decoder.next_message(), Ok(Some(Message::Refuse(expected))));
    let failure = last_failure(&mut listener).await;
    assert!(matches!(failure, HandshakeError::Refused(known) if known == expected), "{failure:?}");
}

#[tokio::test]
async fn a_listener_of_another_version_is_understood() {
    let net = net();
    let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = Endpoint::Tcp(server.local_addr().unwrap().into());
    let serve = async {
        let (mut frames, _) = server.accept().await.unwrap();
        let (_latest, _) = server.accept().await.unwrap();
        frames.read_exact(&mut [0; 8]).await.unwrap();
        frames.write_all(&[0x03, 4, 0, 0, 0x07, 0x00, 0xff, 0xff]).await.unwrap();
        frames.read_to_end(&mut Vec::new()).await.ok();
    };
    let options = Options::default();
    let (error, ()) =
        tokio::join!(connect(&net, &address, identity(Role::Display), &options, soon(&net)), serve);
    let Err(ConnectError::Refused { refusal, .. }) = error else { panic!("{error:?}") };
    assert_eq!(refusal, Refusal::Version { listener: ProtocolVersion(7), connector: ProtocolVersion(1) });
}

#[tokio::test]
async fn strangers_hold_up_nobody() {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let mut strangers = Vec::new();
    for greeting in
        [&b"GET / HTTP/1.1\r\n\r\n"[..], b"\x16\x03\x01\x02\x00", b"\x01\x20\x00\x00SSH-", b"\x01\x05", b""]
    {
        let mut stranger = TcpStream::connect(address).await.unwrap();
        stranger.write_all(greeting).await.unwrap();
        strangers.push(stranger);
    }
    let options = Options::default();
    let address = Endpoint::Tcp(address.into());
    let (there, here) = tokio::join!(
        connect(&net, &address, identity(Role::Display), &options, soon(&net)),
        listener.accept(soon(&net)),
    );
    assert_eq!(
        (there.unwrap().peer.identity.role, here.unwrap().peer.identity.role),
        (Role::SwitchA, Role::Display)
    );
}

#[tokio::test]
async fn whoever_stops_in_the_middle_of_the_handshake_is_dropped() {
    let net = net();
    let (mut listener, address) = listener(&net, &quick()).await;
    let mut half = TcpStream::connect(address).await.unwrap();
    half.write_all(&bytes(&[hello(Lane::Frames)])[..7]).await.unwrap();
    assert_eq!(until(&*net, soon(&net), answers(&mut half)).await.unwrap(), []);
    let failure = last_failure(&mut listener).await;
    assert!(matches!(failure, HandshakeError::TimedOut), "{failure:?}");
}

#[tokio::test]
async fn one_lane_alone_is_refused_in_time() {
    let net = net();
    let (_listener, address) = listener(&net, &quick()).await;
    let mut half = TcpStream::connect(address).await.unwrap();
    half.write_all(&bytes(&[hello(Lane::Frames)])).await.unwrap();
    let answers = until(&*net, soon(&net), answers(&mut half)).await.unwrap();
    assert_eq!(answers, [Message::Refuse(Refusal::Unpaired { session: SESSION })]);
}

#[tokio::test]
async fn a_refusal_that_passes_is_tried_again_and_another_ends_it() {
    let net = net();
    for passing in [Refusal::Busy, Refusal::Unpaired { session: SESSION }] {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = Endpoint::Tcp(listener.local_addr().unwrap().into());
        let for_good = Refusal::RoleTaken { role: Role::Display };
        let refuse = async {
            let mut tries = Vec::new();
            loop {
                let (mut stream, _) = listener.accept().await.unwrap();
                let mut decoder = Decoder::new();
                let Some(Message::Hello(hello)) = next(&mut stream, &mut decoder).await else { continue };
                if !tries.contains(&hello.session) {
                    tries.push(hello.session);
                }
                let refusal = if tries.len() == 1 { passing } else { for_good };
                stream.write_all(&bytes(&[Message::Refuse(refusal)])).await.unwrap();
            }
        };
        let options = Options::default();
        let ended = tokio::select! {
            ended = connect(&net, &endpoint, identity(Role::Display), &options, soon(&net)) => ended,
            never = refuse => never,
        };
        let error = ended.unwrap_err();
        assert!(matches!(&error, ConnectError::Refused { refusal, .. } if *refusal == for_good), "{error:?}");
    }
}

#[tokio::test]
async fn the_same_lane_twice_is_refused_and_the_right_one_still_welcome() {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let frames = hello(Lane::Frames);
    let (mut one, mut two) = (dial(address, &frames).await, dial(address, &frames).await);
    // Whichever is read last is the one too many.
    let (refused, mut frames) = tokio::select! {
        refused = answers(&mut one) => (refused, two),
        refused = answers(&mut two) => (refused, one),
    };
    let refusal = |lane| [Message::Refuse(Refusal::Session { session: SESSION, lane })];
    assert_eq!(refused, refusal(Lane::Frames));
    let other_role = Message::Hello(identity(Role::SwitchB).hello(SESSION, Lane::Latest));
    assert_eq!(answers(&mut dial(address, &other_role).await).await, refusal(Lane::Latest));
    let mut latest = TcpStream::connect(address).await.unwrap();
    latest.write_all(&bytes(&[hello(Lane::Latest)])).await.unwrap();
    assert_eq!(listener.accept(soon(&net)).await.unwrap().peer.session, SESSION);
    let mut accept = vec![0; bytes(&[Message::Accept(Accept { identity: identity(Role::SwitchA) })]).len()];
    frames.read_exact(&mut accept).await.unwrap();
    latest.read_exact(&mut accept).await.unwrap();
}

#[tokio::test]
async fn a_crowd_is_turned_away_and_peers_get_through_after_it() {
    let net = net();
    let options = Options { limits: Limits { handshakes: 4, ..Limits::default() }, ..quick() };
    let (mut listener, address) = listener(&net, &options).await;
    let mut crowd = Vec::new();
    for _ in 0..4 {
        crowd.push(TcpStream::connect(address).await.unwrap());
    }
    // Connections are accepted in the order in which they came, and each takes its room at once.
    let mut late = TcpStream::connect(address).await.unwrap();
    assert_eq!(answers(&mut late).await, [Message::Refuse(Refusal::Busy)]);
    let address = Endpoint::Tcp(address.into());
    let (there, here) = tokio::join!(
        connect(&net, &address, identity(Role::Display), &options, soon(&net)),
        listener.accept(soon(&net)),
    );
    assert!(there.is_ok() && here.is_ok(), "busy is no reason to give up");
}

#[tokio::test]
async fn a_server_that_is_no_peer_is_named_as_the_cause() {
    let net = net();
    let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = Endpoint::Tcp(server.local_addr().unwrap().into());
    let serve = async {
        let mut connections = Vec::new();
        loop {
            let (mut connection, _) = server.accept().await.unwrap();
            connection.write_all(b"220 smtp ready\r\n").await.ok();
            connections.push(connection);
        }
    };
    let options = Options::default();
    let deadline = net.now().after(Duration::from_millis(100));
    let error = tokio::select! {
        error = connect(&net, &address, identity(Role::Display), &options, deadline) => error.unwrap_err(),
        () = serve => unreachable!(),
    };
    let ConnectError::Deadline {
        last: AttemptError::Handshake { cause: HandshakeError::Decode(e), .. }, ..
    } = error
    else {
        panic!("{error:?}")
    };
    assert_eq!(e.fault, DecodeFault::UnknownKind { code: b'2' });
}

#[tokio::test]
async fn a_lie_about_a_length_costs_nothing() {
    for (header, length) in
        [([0x21, 0xff, 0xff, 0xff], 0xff_ffff), ([0x21, 0x01, 0x00, 0x01], 65_537), ([0x22, 0, 0, 0], 0)]
    {
        let (mut link, mut frames, _latest) = raw_display().await;
        frames.write_all(&header).await.unwrap();
        let kind = Kind::from_code(header[0]).unwrap();
        for _ in 0..2 {
            assert_eq!(fault(error(&mut link.frames_rx).await), DecodeFault::Length { kind, length });
        }
    }
}

#[tokio::test]
async fn garbage_after_the_handshake_is_an_error() {
    let (mut link, mut frames, mut latest) = raw_display().await;
    frames.write_all(&[0xee; 100]).await.unwrap();
    latest.write_all(&[0x99; 100]).await.unwrap();
    assert_eq!(fault(error(&mut link.frames_rx).await), DecodeFault::UnknownKind { code: 0xee });
    assert_eq!(fault(link.latest_rx.latest().await.unwrap_err()), DecodeFault::UnknownKind { code: 0x99 });
    assert_eq!(fault(link.latest_rx.try_latest().unwrap_err()), DecodeFault::UnknownKind { code: 0x99 });
}

#[tokio::test]
async fn messages_on_the_wrong_lane_are_errors() {
    let (mut link, mut frames, mut latest) = raw_display().await;
    frames.write_all(&bytes(&[Message::Camera(camera(0))])).await.unwrap();
    latest.write_all(&bytes(&[Message::Frame(FrameMessage::Begin(start(0)))])).await.unwrap();
    let misplaced = |error: RecvError| match error {
        RecvError::Protocol { cause: ProtocolError::Misplaced { kind, lane }, .. } => (kind, lane),
        other => panic!("{other:?}"),
    };
    assert_eq!(misplaced(error(&mut link.frames_rx).await), (Kind::Camera, Lane::Frames));
    assert_eq!(misplaced(link.latest_rx.latest().await.unwrap_err()), (Kind::Begin, Lane::Latest));
}

#[tokio::test]
async fn frames_that_break_the_rules_are_errors() {
    let (mut link, mut frames, _latest) = raw_display().await;
    let end = FrameEnd { frame: FrameNumber(0), ids: 0, hash: 1 };
    let begin = Message::Frame(FrameMessage::Begin(start(0)));
    frames.write_all(&bytes(&[begin, Message::Frame(FrameMessage::End(end))])).await.unwrap();
    let received = 0x2d06_8005_38d3_94c2;
    let expected = FrameViolation::Hash { frame: FrameNumber(0), announced: 1, received };
    assert_eq!(violation(error(&mut link.frames_rx).await), expected);
}

#[tokio::test]
async fn a_frame_with_missing_ids_says_how_many() {
    let (mut link, mut frames, _latest) = raw_display().await;
    let end = FrameEnd { frame: FrameNumber(0), ids: 9, hash: 1 };
    let begin = Message::Frame(FrameMessage::Begin(start(0)));
    frames.write_all(&bytes(&[begin, Message::Frame(FrameMessage::End(end))])).await.unwrap();
    link.frames_rx.recv().await.unwrap();
    let expected = FrameOutcome::Incomplete { frame: FrameNumber(0), expected: 9, received: 0 };
    assert_eq!(link.frames_rx.recv().await.unwrap(), FrameEvent::End(expected));
}

#[tokio::test]
async fn death_within_a_message_says_where() {
    let (mut link, mut frames, _latest) = raw_display().await;
    frames.write_all(&bytes(&[Message::Frame(FrameMessage::Begin(start(0)))])[..40]).await.unwrap();
    drop(frames);
    let error = error(&mut link.frames_rx).await;
    let RecvError::Lost { peer: Role::Display, cause: Loss::Cut { bytes: 40 } } = error else {
        panic!("{error:?}")
    };
}

#[tokio::test]
async fn a_reset_is_a_loss() {
    let (mut link, frames, _latest) = raw_display().await;
    // What a killed process with unread data looks like.
    frames.set_zero_linger().unwrap();
    drop(frames);
    let error = error(&mut link.frames_rx).await;
    assert!(matches!(error, RecvError::Lost { peer: Role::Display, cause: Loss::Io(_) }), "{error:?}");
}

#[tokio::test]
async fn goodbye_survives_unread_data() {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let (address, options) = (Endpoint::Tcp(address.into()), Options::default());
    let (there, here) = tokio::join!(
        connect(&net, &address, identity(Role::Display), &options, soon(&net)),
        listener.accept(soon(&net)),
    );
    let (there, mut here) = (there.unwrap(), here.unwrap());
    here.frames_tx.begin(start(0)).await.unwrap();
    here.frames_tx.push(&ids(1000)).await.unwrap();
    here.latest_tx.publish(camera(0)).unwrap();
    there.goodbye(trimaran_proto::Goodbye::Interrupted).await.unwrap();
    // What was said on one lane was said on both.
    let said = here.latest_rx.latest().await.unwrap_err();
    assert!(matches!(said, RecvError::Goodbye { .. }), "{said:?}");
    let error = receive(&mut here.frames_rx).await.unwrap_err();
    let reason = trimaran_proto::Goodbye::Interrupted;
    assert!(matches!(&error, RecvError::Goodbye { reason: said, .. } if *said == reason), "{error:?}");
}
