//! Hostile peers over byte streams, TCP and Unix alike: they lie about lengths, come in crowds, and die at
//! every step.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::BytesMut;
use tempfile::TempDir;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UnixListener, UnixStream};
use trimaran_transport::conformance::{ARM, Greeting, MAP, PANEL, greeting};
use trimaran_transport::{
    DecodeFault, Endpoint, HandshakeError, Kind, Lane, Limits, LinkConfig, Options, ProtocolError, RecvError,
    Refusal, SessionId, WireVersion, WireVersions, until,
};
use trimaran_wire::{Decoder, Message};

use crate::common::{
    Link, Listener, answer, connect, format, introduce, last_failure, net, other_map, refusal, soon,
};

/// Runs a case over each transport.
macro_rules! over_tcp_and_unix {
    ($($case:ident),+ $(,)?) => {
        $(mod $case {
            #[tokio::test]
            async fn tcp() {
                super::cases::$case("tcp://127.0.0.1:0").await;
            }

            #[tokio::test]
            async fn unix() {
                let folder = tempfile::tempdir().unwrap();
                super::cases::$case(&super::socket_in(&folder)).await;
            }
        })+
    };
}

over_tcp_and_unix!(
    a_lie_in_every_length_field_ends_the_lane,
    ten_thousand_half_open_handshakes_shut_nobody_out,
    a_peer_that_died_may_come_back,
    a_connector_may_die_at_every_byte_of_its_handshake,
    a_listener_may_die_at_every_step_of_the_handshake,
    a_refusal_is_the_reason_though_nobody_stayed_to_hear_it,
    who_is_turned_away_at_once_learns_why,
    another_version_is_refused_in_words_that_it_can_read,
    a_listener_of_another_version_is_understood,
);

fn socket_in(folder: &TempDir) -> String {
    format!("unix:{}", folder.path().join("a.sock").display())
}

trait Duplex: AsyncRead + AsyncWrite + Unpin + Send {}

impl<T: AsyncRead + AsyncWrite + Unpin + Send> Duplex for T {}

async fn dial(endpoint: &Endpoint) -> Box<dyn Duplex> {
    match endpoint {
        Endpoint::Tcp(at) => Box::new(TcpStream::connect(at.to_string()).await.unwrap()),
        Endpoint::Unix(path) => Box::new(UnixStream::connect(path.as_path()).await.unwrap()),
        other => panic!("{other}"),
    }
}

/// A listener that is not a peer.
enum Bare {
    Tcp(TcpListener),
    Unix(UnixListener),
}

impl Bare {
    async fn bind(endpoint: &str) -> (Self, Endpoint) {
        match endpoint.parse().unwrap() {
            Endpoint::Tcp(at) => {
                let listener = TcpListener::bind(at.to_string()).await.unwrap();
                let at = Endpoint::Tcp(listener.local_addr().unwrap().into());
                (Self::Tcp(listener), at)
            }
            Endpoint::Unix(path) => {
                (Self::Unix(UnixListener::bind(path.as_path()).unwrap()), Endpoint::Unix(path))
            }
            other => panic!("{other}"),
        }
    }

    async fn accept(&self) -> Box<dyn Duplex> {
        match self {
            Self::Tcp(listener) => Box::new(listener.accept().await.unwrap().0),
            Self::Unix(listener) => Box::new(listener.accept().await.unwrap().0),
        }
    }
}

async fn listen(endpoint: &str, options: &Options) -> (Listener, Endpoint) {
    let endpoint = endpoint.parse().unwrap();
    let listener = Listener::bind(&net(), &endpoint, greeting(ARM), options).await.unwrap();
    let endpoint = listener.local_endpoint().clone();
    (listener, endpoint)
}

fn bytes(message: &Message) -> BytesMut {
    let mut out = BytesMut::new();
    message.encode(&mut out);
    out
}

fn hello(session: u64, lane: Lane) -> BytesMut {
    bytes(&introduce(&greeting(PANEL), SessionId(session), lane))
}

fn accept() -> BytesMut {
    bytes(&answer())
}

const LANES: [Lane; 4] = [Lane::Frames, Lane::Latest, Lane::Messages, Lane::Bulk];

/// A panel of bare streams in the order of [`LANES`], and the listener's link with it.
async fn raw_panel(listener: &mut Listener, at: &Endpoint, session: u64) -> (Link, [Box<dyn Duplex>; 4]) {
    let mut lanes = [dial(at).await, dial(at).await, dial(at).await, dial(at).await];
    for (stream, lane) in lanes.iter_mut().zip(LANES) {
        stream.write_all(&hello(session, lane)).await.unwrap();
    }
    (listener.accept(soon(&net())).await.unwrap(), lanes)
}

/// A panel connects, is admitted, and leaves.
async fn a_panel_gets_in(listener: &mut Listener, at: &Endpoint) {
    let (net, options) = (net(), Options::default());
    let (there, here) =
        tokio::join!(connect(&net, at, greeting(PANEL), &options, soon(&net)), listener.accept(soon(&net)),);
    assert_eq!(there.unwrap().peer.hello, greeting(ARM));
    assert_eq!(here.unwrap().peer.hello, greeting(PANEL));
}

fn length_of(error: &RecvError) -> Option<(Kind, usize)> {
    match error {
        RecvError::Protocol { cause: ProtocolError::Decode(e), .. } => match e.fault {
            DecodeFault::Length { kind, length, .. } => Some((kind, length)),
            _ => None,
        },
        _ => None,
    }
}

mod cases {
    use super::*;

    pub(super) async fn a_lie_in_every_length_field_ends_the_lane(endpoint: &str) {
        const MOST: usize = 0xff_ffff;
        let (mut listener, at) = listen(endpoint, &Options::default()).await;
        let kinds: Vec<Kind> = (0..=u8::MAX).filter_map(Kind::from_code).collect();
        assert!(kinds.len() > 8, "{kinds:?}");
        for (session, kind) in (1..).zip(kinds) {
            let header = [kind.code(), 0xff, 0xff, 0xff];
            let (mut link, mut lanes) = raw_panel(&mut listener, &at, session).await;
            for stream in &mut lanes {
                stream.write_all(&header).await.unwrap();
            }
            let on_frames = link.frames_rx.recv().await.unwrap_err();
            let on_latest = link.latest_rx.latest().await.unwrap_err();
            let on_messages = link.messages_rx.recv().await.unwrap_err();
            let on_bulk = link.bulk.as_mut().unwrap().rx.recv().await.unwrap_err();
            for error in [on_frames, on_latest, on_messages, on_bulk] {
                assert_eq!(length_of(&error), Some((kind, MOST)), "{error:?}");
            }
            drop(link);

            let mut stranger = dial(&at).await;
            stranger.write_all(&header).await.unwrap();
            let failure = last_failure(&mut listener).await;
            let HandshakeError::Decode(e) = failure else { panic!("{kind:?}: {failure:?}") };
            assert!(matches!(e.fault, DecodeFault::Length { kind: said, .. } if said == kind), "{e:?}");
        }
        a_panel_gets_in(&mut listener, &at).await;
    }

    pub(super) async fn ten_thousand_half_open_handshakes_shut_nobody_out(endpoint: &str) {
        const ROOM: usize = 4;
        // None of them ends by itself, and none is refused for its number.
        let link = LinkConfig::default().with_handshake_timeout(Duration::from_secs(3600));
        let (handshakes_per_s, handshakes_per_s_per_address) = (u32::MAX, u32::MAX);
        let limits = Limits::default()
            .with_handshakes(ROOM)
            .with_handshakes_per_s(handshakes_per_s)
            .with_handshakes_per_s_per_address(handshakes_per_s_per_address);
        let (mut listener, at) =
            listen(endpoint, &Options::default().with_limits(limits).with_link(link)).await;
        let (net, busy) = (net(), bytes(&Message::Refuse(Refusal::Busy)));
        let mut inside = VecDeque::new();
        for session in 0..10_000 {
            let mut half = dial(&at).await;
            half.write_all(&hello(session, Lane::Frames)[..7]).await.unwrap();
            inside.push_back(half);
            if inside.len() > ROOM {
                let (mut oldest, mut answer) = (inside.pop_front().unwrap(), Vec::new());
                let read = until(&*net, soon(&net), oldest.read_to_end(&mut answer)).await;
                // Its data is unread: over TCP the end may be a reset that overtakes the answer.
                assert!(read.is_some(), "number {session} has not made room for itself");
                assert!(answer.is_empty() || answer == busy, "{answer:?}");
            }
        }
        a_panel_gets_in(&mut listener, &at).await;
        assert_eq!(listener.turned_away().from_address + listener.turned_away().in_all, 0);
        drop(inside);
    }

    pub(super) async fn a_peer_that_died_may_come_back(endpoint: &str) {
        let (mut listener, at) = listen(endpoint, &Options::default()).await;
        for session in 1..4 {
            let (mut link, lanes) = raw_panel(&mut listener, &at, session).await;
            // The answers to its hellos are unread: over TCP the end is a reset.
            drop(lanes);
            let error = link.frames_rx.recv().await.unwrap_err();
            assert!(matches!(error, RecvError::Lost { .. }), "{error:?}");
        }
        a_panel_gets_in(&mut listener, &at).await;
    }

    pub(super) async fn a_refusal_is_the_reason_though_nobody_stayed_to_hear_it(endpoint: &str) {
        let (mut listener, at) = listen(endpoint, &Options::default()).await;
        let strange = Greeting { map: 0xdead, ..greeting(PANEL) };
        for session in 0..20 {
            let mut frames = dial(&at).await;
            let hello = introduce(&strange, SessionId(session), Lane::Frames);
            frames.write_all(&bytes(&hello)).await.unwrap();
            drop(frames);
            let failure = last_failure(&mut listener).await;
            assert!(matches!(failure, HandshakeError::Refused(Refusal::Rejected(_))), "{failure:?}");
        }
    }

    pub(super) async fn who_is_turned_away_at_once_learns_why(endpoint: &str) {
        let (bare, at) = Bare::bind(endpoint).await;
        let options = Options::default();
        let refused = bytes(&Message::Refuse(other_map(1, MAP)));
        let listener = async {
            loop {
                // A peer refused on one connection may have closed the others.
                let _told = bare.accept().await.write_all(&refused).await;
            }
        };
        let net = net();
        let known = tokio::select! {
            known = refusal(&net, &at, greeting(PANEL), &options) => known,
            () = listener => unreachable!(),
        };
        assert_eq!(known, other_map(1, MAP));
    }

    pub(super) async fn another_version_is_refused_in_words_that_it_can_read(endpoint: &str) {
        let (mut listener, at) = listen(endpoint, &Options::default()).await;
        let mut stranger = dial(&at).await;
        // A later version: the first eight bytes of its hello are fixed, the rest may be anything.
        let hello = [0x01, 9, 0, 0, b'T', b'R', b'I', b'M', 0x07, 0x01, 0x06, 0x01, 0xff];
        stranger.write_all(&hello).await.unwrap();
        let mut answer = Vec::new();
        stranger.read_to_end(&mut answer).await.unwrap();
        assert_eq!(answer[0], Kind::Refuse.code());
        assert_eq!(answer[4..6], WireVersion::LOWEST.0.to_le_bytes(), "the listener's lowest comes first");
        let mut decoder = Decoder::new(format());
        decoder.push(&answer);
        let connector = WireVersions { highest: WireVersion(0x0107), lowest: WireVersion(0x0106) };
        let expected = Refusal::Version { listener: WireVersions::SUPPORTED, connector };
        assert_eq!(decoder.next_message(), Ok(Some(Message::Refuse(expected.clone()))));
        let failure = last_failure(&mut listener).await;
        assert!(matches!(&failure, HandshakeError::Refused(known) if *known == expected), "{failure:?}");
        a_panel_gets_in(&mut listener, &at).await;
    }

    pub(super) async fn a_listener_of_another_version_is_understood(endpoint: &str) {
        let (bare, at) = Bare::bind(endpoint).await;
        let serve = async {
            loop {
                let (mut frames, _beside) =
                    (bare.accept().await, [bare.accept().await, bare.accept().await, bare.accept().await]);
                // A peer whose time has run out is gone.
                if frames.read_exact(&mut [0; 8]).await.is_ok() {
                    frames.write_all(&[0x03, 4, 0, 0, 0x07, 0x00, 0xff, 0xff]).await.ok();
                    frames.read_to_end(&mut Vec::new()).await.ok();
                }
            }
        };
        let (net, options) = (net(), Options::default());
        let known = tokio::select! {
            known = refusal(&net, &at, greeting(PANEL), &options) => known,
            () = serve => unreachable!(),
        };
        let listener = WireVersions::only(WireVersion(7));
        assert_eq!(known, Refusal::Version { listener, connector: WireVersions::SUPPORTED });
    }

    pub(super) async fn a_connector_may_die_at_every_byte_of_its_handshake(endpoint: &str) {
        // A lane that waits for a dead one keeps its slot for a while.
        let limits = Limits::default().with_handshakes(1000);
        let (mut listener, at) = listen(endpoint, &Options::default().with_limits(limits)).await;
        let whole = hello(0, Lane::Frames).len();
        for step in 0..whole {
            let mut frames = dial(&at).await;
            frames.write_all(&hello(step as u64, Lane::Frames)[..step]).await.unwrap();
            drop(frames);
            let failure = last_failure(&mut listener).await;
            assert!(
                matches!(failure, HandshakeError::Closed | HandshakeError::Io(_)),
                "{step} bytes: {failure:?}"
            );
        }
        for step in 0..whole {
            let session = 1000 + step as u64;
            let mut lanes = [dial(&at).await, dial(&at).await, dial(&at).await, dial(&at).await];
            for (at, (stream, lane)) in lanes.iter_mut().zip(LANES).enumerate() {
                let length = if at + 1 < LANES.len() { whole } else { step };
                stream.write_all(&hello(session, lane)[..length]).await.unwrap();
            }
            drop(lanes);
            let failure = last_failure(&mut listener).await;
            assert!(
                matches!(failure, HandshakeError::Closed | HandshakeError::Io(_)),
                "{step} bytes of the last: {failure:?}"
            );
        }
        a_panel_gets_in(&mut listener, &at).await;
    }

    pub(super) async fn a_listener_may_die_at_every_step_of_the_handshake(endpoint: &str) {
        let (bare, at) = Bare::bind(endpoint).await;
        let (answer, hello) = (accept(), hello(0, Lane::Frames).len());
        let serve = async {
            // How much it reads of the hellos, and then of its own answers, before it dies.
            let (whole, half) = (answer.len(), answer.len() / 2);
            for (of_each, to_each) in [
                ([0; 4], [0; 4]),
                ([7, 0, 0, 0], [0; 4]),
                ([hello, 0, 0, 0], [0; 4]),
                ([hello, hello, 0, 0], [0; 4]),
                ([hello, hello, hello, 0], [0; 4]),
                ([hello; 4], [0; 4]),
                ([hello; 4], [half, 0, 0, 0]),
                ([hello; 4], [whole, 0, 0, 0]),
                ([hello; 4], [whole, half, 0, 0]),
                ([hello; 4], [whole, whole, half, 0]),
                ([hello; 4], [whole, whole, whole, half]),
                ([hello; 4], [whole; 4]),
            ] {
                let mut lanes =
                    [bare.accept().await, bare.accept().await, bare.accept().await, bare.accept().await];
                for (stream, length) in lanes.iter_mut().zip(of_each) {
                    stream.read_exact(&mut vec![0; length]).await.unwrap();
                }
                for (stream, length) in lanes.iter_mut().zip(to_each) {
                    stream.write_all(&answer[..length]).await.unwrap();
                }
            }
        };
        let (net, options) = (net(), Options::default());
        let connecting = connect(&net, &at, greeting(PANEL), &options, soon(&net));
        let (link, ()) = tokio::join!(connecting, serve);
        assert_eq!(link.unwrap().peer.hello, greeting(ARM));
    }
}
