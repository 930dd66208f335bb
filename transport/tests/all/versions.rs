//! Two releases: peers of this version of the wire and of the one before are linked, over each transport,
//! whichever of them listens.

use bytes::{Bytes, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use trimaran_transport::conformance::{ARM, PANEL, command, greeting, pose, receive, send_frame};
use trimaran_transport::{
    Endpoint, HandshakeError, Lane, Options, RecvError, Refusal, SessionId, WireVersion, WireVersions,
};
use trimaran_wire::{Decoder, Hello, Message};

use crate::common::meeting::Meeting;
use crate::common::{Link, Listener, connect, format, last_failure, net, refusal, soon};

over_every_transport!(
    both_take_the_highest_version_in_common,
    without_a_version_in_common_both_ranges_are_named,
);

const BEFORE: WireVersions = WireVersions::only(WireVersion::LOWEST);
const NOW: WireVersions = WireVersions::SUPPORTED;
const LATER: WireVersions = WireVersions { highest: WireVersion(7), lowest: WireVersion(6) };

fn speaking(options: &Options, versions: WireVersions) -> Options {
    options.clone().with_link(options.link.with_versions(versions))
}

/// Sends something of each kind from the first to the second.
async fn talk(from: &mut Link, to: &mut Link) {
    let Link { latest_tx, frames_tx, messages_tx, bulk, .. } = from;
    latest_tx.publish(pose(3)).unwrap();
    send_frame(frames_tx, 4, &[1, 258]).await.unwrap();
    messages_tx.send(&command(5)).await.unwrap();
    bulk.as_mut().unwrap().tx.send(Bytes::from_static(b"map tile")).await.unwrap();
    assert_eq!(to.latest_rx.latest().await.unwrap(), pose(3));
    assert_eq!(receive(&mut to.frames_rx).await.unwrap().points, [1, 258]);
    assert_eq!(to.messages_rx.recv().await.unwrap(), command(5));
    assert_eq!(to.bulk.as_mut().unwrap().rx.recv().await.unwrap().as_ref(), b"map tile");
}

async fn both_take_the_highest_version_in_common(endpoint: &str) {
    for (listens, connects, version) in [
        (NOW, NOW, WireVersion::CURRENT),
        (NOW, BEFORE, WireVersion::LOWEST),
        (BEFORE, NOW, WireVersion::LOWEST),
        (BEFORE, BEFORE, WireVersion::LOWEST),
    ] {
        let Meeting { mut listener, at, panel, _folder, .. } =
            Meeting::at(endpoint, &speaking(&Options::default(), listens)).await;
        let (net, panel) = (net(), speaking(&panel, connects));
        let links = tokio::join!(
            connect(&net, &at, greeting(PANEL), &panel, soon(&net)),
            listener.accept(soon(&net))
        );
        let (mut there, mut here) = (links.0.unwrap(), links.1.unwrap());
        assert_eq!((there.peer.version, here.peer.version), (version, version), "{listens} and {connects}");
        talk(&mut there, &mut here).await;
        talk(&mut here, &mut there).await;
    }
}

async fn without_a_version_in_common_both_ranges_are_named(endpoint: &str) {
    let Meeting { mut listener, at, panel, _folder, .. } = Meeting::at(endpoint, &Options::default()).await;
    let expected = Refusal::Version { listener: NOW, connector: LATER };
    let told = refusal(&net(), &at, greeting(PANEL), &speaking(&panel, LATER)).await;
    assert_eq!(told, expected);
    let known = last_failure(&mut listener).await;
    assert!(matches!(&known, HandshakeError::Refused(known) if *known == expected), "{known:?}");
    let said = told.to_string();
    assert!(said.contains("speaks versions 4 to 5 of the wire"), "{said}");
    assert!(said.contains("the connecting peer versions 6 to 7: install the same release"), "{said}");
}

/// The bytes of peers of version 4: an arm that listens, and a panel that connects as session 7.
fn kept(name: &str) -> Vec<u8> {
    crate::examples::examples_of(include_str!("../version-4.md"))[name].clone()
}

const LANES: [(Lane, &str); 4] = [
    (Lane::Frames, "hello-frames"),
    (Lane::Latest, "hello-latest"),
    (Lane::Messages, "hello-messages"),
    (Lane::Bulk, "hello-bulk"),
];

/// Those of each side on a lane, behind the handshake.
fn kept_of(lane: Lane) -> Vec<u8> {
    kept(match lane {
        Lane::Frames => "frames",
        Lane::Latest => "latest",
        Lane::Messages => "messages",
        _ => "bulk",
    })
}

async fn hears_the_kept_messages(link: &mut Link) {
    assert_eq!(link.peer.version, WireVersion(4));
    assert_eq!(link.latest_rx.latest().await.unwrap(), pose(3));
    assert_eq!(receive(&mut link.frames_rx).await.unwrap().points, [1, 258]);
    let said = link.messages_rx.recv().await.unwrap();
    assert_eq!((said.number, said.program.as_str()), (7, "dock"));
    assert_eq!(link.bulk.as_mut().unwrap().rx.recv().await.unwrap().as_ref(), b"map tile");
    let end = link.messages_rx.recv().await;
    assert!(matches!(&end, Err(RecvError::Closed { reason, .. }) if reason.code == 3), "{end:?}");
}

#[tokio::test]
async fn a_panel_of_version_4_is_answered_as_it_was_then() {
    let net = net();
    let at = "tcp://127.0.0.1:0".parse().unwrap();
    let mut listener = Listener::bind(&net, &at, greeting(ARM), &Options::default()).await.unwrap();
    let Endpoint::Tcp(at) = listener.local_endpoint() else { panic!("no TCP") };
    let mut streams = Vec::new();
    for (lane, hello) in LANES {
        let mut stream = TcpStream::connect(at.to_string()).await.unwrap();
        stream.write_all(&[kept(hello), kept_of(lane)].concat()).await.unwrap();
        streams.push(stream);
    }
    let mut link = listener.accept(soon(&net)).await.unwrap();
    let accept = kept("accept");
    for stream in &mut streams {
        let mut answer = vec![0; accept.len()];
        stream.read_exact(&mut answer).await.unwrap();
        assert_eq!(answer, accept);
    }
    hears_the_kept_messages(&mut link).await;
}

/// Reads the one message that a connecting peer says first.
async fn first_message(stream: &mut TcpStream) -> Hello {
    let mut decoder = Decoder::new(format());
    loop {
        assert!(stream.read_buf(decoder.buffer(512)).await.unwrap() > 0);
        match decoder.next_message().unwrap() {
            Some(Message::Hello(hello)) => return hello,
            Some(other) => panic!("{other:?}"),
            None => {}
        }
    }
}

#[tokio::test]
async fn an_arm_of_version_4_hears_a_hello_as_it_was_then() {
    let net = net();
    let arm = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let at = Endpoint::Tcp(arm.local_addr().unwrap().into());
    let arm = async {
        for _ in LANES {
            let (mut stream, _) = arm.accept().await.unwrap();
            assert_eq!(first_message(&mut stream).await.versions, NOW);
            stream.write_all(&kept("refuse-5")).await.unwrap();
        }
        let mut streams = Vec::new();
        for _ in LANES {
            let (mut stream, _) = arm.accept().await.unwrap();
            let hello = first_message(&mut stream).await;
            let (_, name) = LANES.into_iter().find(|(lane, _)| *lane == hello.lane).unwrap();
            let mut said = BytesMut::new();
            let lane = hello.lane;
            Message::Hello(Hello { session: SessionId(7), ..hello }).encode(&mut said);
            assert_eq!(said, kept(name));
            stream.write_all(&[kept("accept"), kept_of(lane)].concat()).await.unwrap();
            streams.push(stream);
        }
        streams
    };
    let options = Options::default();
    let (link, _streams) = tokio::join!(connect(&net, &at, greeting(PANEL), &options, soon(&net)), arm);
    hears_the_kept_messages(&mut link.unwrap()).await;
}
