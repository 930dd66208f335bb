//! Strangers in a handshake, at either end of it.

use std::net::SocketAddr;
use std::time::Duration;

use super::{SESSION, bytes, hello, listener};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use trimaran_transport::conformance::{ARM, GRIPPER, MAP, PANEL, greeting};
use trimaran_transport::{
    AttemptError, ConnectError, DecodeFault, Endpoint, HandshakeError, Lane, Limits, LinkConfig, Options,
    Refusal, WireVersion, WireVersions, until,
};
use trimaran_wire::{Decoder, Message};

use crate::common::{Listener, answer, connect, format, introduce, last_failure, net, other_map, soon};

fn quick() -> Options {
    Options::default().with_link(LinkConfig::default().with_handshake_timeout(Duration::from_millis(200)))
}

/// A connection to `address` on which `message` was sent.
async fn dial(address: SocketAddr, message: &Message) -> TcpStream {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(&bytes(std::slice::from_ref(message))).await.unwrap();
    stream
}

/// Everything that arrives until the end of the stream.
async fn answers(stream: &mut TcpStream) -> Vec<Message> {
    let mut decoder = Decoder::new(format());
    // A reset is a valid end, too.
    while stream.read_buf(decoder.buffer(1024)).await.is_ok_and(|n| n > 0) {}
    std::iter::from_fn(|| decoder.next_message().unwrap()).collect()
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
async fn fewer_lanes_than_four_are_refused_in_time() {
    let net = net();
    let (_listener, address) = listener(&net, &quick()).await;
    for lanes in
        [&[Lane::Frames][..], &[Lane::Messages, Lane::Latest], &[Lane::Frames, Lane::Bulk, Lane::Latest]]
    {
        let mut streams = Vec::new();
        for lane in lanes {
            streams.push(dial(address, &hello(*lane)).await);
        }
        for mut stream in streams {
            let answers = until(&*net, soon(&net), answers(&mut stream)).await.unwrap();
            assert_eq!(answers, [Message::Refuse(Refusal::Unpaired { session: SESSION })]);
        }
    }
}

/// Another machine, or the same one after a moment, may have another map, release or room: so no refusal is
/// final.
#[tokio::test]
async fn whatever_a_listener_refuses_for_is_tried_again() {
    let net = net();
    let versions = (WireVersions::only(WireVersion(7)), WireVersions::SUPPORTED);
    for refusal in [
        Refusal::Busy,
        Refusal::Unpaired { session: SESSION },
        other_map(1, MAP),
        Refusal::Version { listener: versions.0, connector: versions.1 },
        Refusal::Session { session: SESSION, lane: Lane::Frames },
    ] {
        let stranger = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = stranger.local_addr().unwrap();
        let endpoint = Endpoint::Tcp(address.into());
        let options = Options::default();
        let refuse = async {
            // The connections of the first attempt.
            for _ in 0..4 {
                let (mut stream, _) = stranger.accept().await.unwrap();
                stream.write_all(&bytes(&[Message::Refuse(refusal.clone())])).await.ok();
            }
            drop(stranger);
            let mut listener = Listener::bind(&net, &endpoint, greeting(ARM), &options).await.unwrap();
            listener.accept(soon(&net)).await
        };
        let (there, here) =
            tokio::join!(connect(&net, &endpoint, greeting(PANEL), &options, soon(&net)), refuse);
        assert!(there.is_ok() && here.is_ok(), "{refusal:?}: {there:?} {here:?}");
    }
}

#[tokio::test]
async fn the_same_lane_twice_is_refused_and_the_right_one_still_welcome() {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let frames = hello(Lane::Frames);
    let (mut one, mut two) = (dial(address, &frames).await, dial(address, &frames).await);
    // The last one read is the one too many.
    let (refused, mut frames) = tokio::select! {
        refused = answers(&mut one) => (refused, two),
        refused = answers(&mut two) => (refused, one),
    };
    let refusal = |lane| [Message::Refuse(Refusal::Session { session: SESSION, lane })];
    assert_eq!(refused, refusal(Lane::Frames));
    let other_role = introduce(&greeting(GRIPPER), SESSION, Lane::Latest);
    assert_eq!(answers(&mut dial(address, &other_role).await).await, refusal(Lane::Latest));
    let Message::Hello(mut other_version) = hello(Lane::Latest) else { panic!("no hello") };
    other_version.versions = WireVersions::only(WireVersion::LOWEST);
    let other_version = Message::Hello(other_version);
    assert_eq!(answers(&mut dial(address, &other_version).await).await, refusal(Lane::Latest));
    let mut latest = dial(address, &hello(Lane::Latest)).await;
    let mut messages = dial(address, &hello(Lane::Messages)).await;
    let mut bulk = dial(address, &hello(Lane::Bulk)).await;
    assert_eq!(listener.accept(soon(&net)).await.unwrap().peer.session, SESSION);
    let mut accept = vec![0; bytes(&[answer()]).len()];
    frames.read_exact(&mut accept).await.unwrap();
    latest.read_exact(&mut accept).await.unwrap();
    messages.read_exact(&mut accept).await.unwrap();
    bulk.read_exact(&mut accept).await.unwrap();
}

#[tokio::test]
async fn a_crowd_makes_room_for_who_comes_later_and_is_told_so() {
    let net = net();
    // Open handshakes stay until they are refused.
    let handshake_timeout = Duration::from_secs(3600);
    let limits = Limits::default().with_handshakes(5);
    let options = Options::default()
        .with_limits(limits)
        .with_link(LinkConfig::default().with_handshake_timeout(handshake_timeout));
    let (mut listener, address) = listener(&net, &options).await;
    let mut crowd = Vec::new();
    for _ in 0..5 {
        crowd.push(TcpStream::connect(address).await.unwrap());
    }
    // Connections are accepted in the order in which they came, and each takes its slot at once.
    let endpoint = Endpoint::Tcp(address.into());
    let (there, here) = tokio::join!(
        connect(&net, &endpoint, greeting(PANEL), &options, soon(&net)),
        listener.accept(soon(&net))
    );
    assert!(there.is_ok() && here.is_ok(), "{there:?} {here:?}");
    for oldest in &mut crowd[..4] {
        assert_eq!(answers(oldest).await, [Message::Refuse(Refusal::Busy)]);
    }
    assert_eq!(listener.turned_away().no_room, 4);
}

/// A server that answers once with nonsense, and then not at all.
async fn no_peer(server: TcpListener) {
    let mut connections = Vec::new();
    loop {
        let (mut connection, _) = server.accept().await.unwrap();
        if connections.len() < 4 {
            connection.write_all(b"220 smtp ready\r\n").await.ok();
        }
        connections.push(connection);
    }
}

#[tokio::test]
async fn a_server_that_is_no_peer_is_named_as_the_cause_though_the_deadline_cuts_a_later_attempt_short() {
    let net = net();
    let options =
        Options::default().with_link(LinkConfig::default().with_handshake_timeout(Duration::from_secs(3600)));
    // The first wait that is long enough here for a second attempt.
    for wait in (0..).map(|doubled| Duration::from_millis(100) * 2_u32.pow(doubled)) {
        let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = Endpoint::Tcp(server.local_addr().unwrap().into());
        let error = tokio::select! {
            error = connect(&net, &address, greeting(PANEL), &options, net.now().after(wait)) => error.unwrap_err(),
            () = no_peer(server) => unreachable!(),
        };
        let ConnectError::Deadline { attempts, last, .. } = error else { panic!("{error:?}") };
        if attempts == 1 {
            continue;
        }
        let AttemptError::Handshake { cause: HandshakeError::Decode(e), .. } = last else {
            panic!("{last:?}")
        };
        assert_eq!((attempts, e.fault), (2, DecodeFault::UnknownKind { code: b'2' }));
        break;
    }
}
