//! Links over WebSockets: the conformance suite, and admission.

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use trimaran_transport::conformance::{
    ARM, Joined, Overhead, PANEL, finished, greeting, points, pose, send_frame,
};
use trimaran_transport::ws::{ForeignOrigin, WsOptions};
use trimaran_transport::{
    ConnectError, Endpoint, HandshakeError, Lane, LinkConfig, Options, SendError, SessionId, TcpOptions,
    sleep_until, until,
};

use crate::common::{Listener, connect, introduce, last_failure, net, soon};

const OVERHEAD: Overhead = Overhead { header_bytes: 4, handshake: 4, coded: true };

fn web_sockets() -> Joined {
    // Buffers smaller than the tests' amounts.
    let small = Some(64 * 1024);
    let tcp = TcpOptions::default().with_send_buffer(small).with_recv_buffer(small);
    Joined::at("ws://127.0.0.1:0/robot", Options::default().with_tcp(tcp), OVERHEAD)
}

trimaran_transport::conformance!(web_sockets());

const AT: &str = "ws://127.0.0.1:0/plant/link?token=7";

async fn listen(options: &Options) -> (Listener, Endpoint) {
    let listener = Listener::bind(&net(), &AT.parse().unwrap(), greeting(ARM), options).await.unwrap();
    let at = listener.local_endpoint().clone();
    (listener, at)
}

fn host(at: &Endpoint) -> String {
    let Endpoint::Ws(at) = at else { panic!("{at}") };
    at.at.to_string()
}

/// Asks for a WebSocket as a browser does; returns the answer's status.
async fn status(at: &Endpoint, path: &str, headers: &str) -> u16 {
    let host = host(at);
    let mut stream = TcpStream::connect(&host).await.unwrap();
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{headers}\r\n"
    );
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).await.unwrap();
    str::from_utf8(&answer).unwrap().strip_prefix("HTTP/1.1 ").unwrap().parse().unwrap()
}

#[tokio::test]
async fn the_path_is_part_of_the_address() {
    let (mut listener, at) = listen(&Options::default()).await;
    assert!(at.to_string().ends_with("/plant/link?token=7"), "{at}");
    let net = net();
    let options = Options::default();
    let (panel, arm) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &options, soon(&net)), listener.accept(soon(&net)),);
    let (mut panel, mut arm) = (panel.unwrap(), arm.unwrap());
    panel.latest_tx.publish(pose(4)).unwrap();
    assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(4));

    for path in ["/", "/plant/link", "/plant/link?token=8", "/plant/link?token=7&more"] {
        assert_eq!(status(&at, path, "").await, 404, "{path}");
    }
    let elsewhere: Endpoint = format!("ws://{}/plant", host(&at)).parse().unwrap();
    let briefly = net.now().after(Duration::from_millis(200));
    let refused = connect(&net, &elsewhere, greeting(PANEL), &options, briefly).await;
    let Err(ConnectError::Deadline { last, .. }) = refused else { panic!("{refused:?}") };
    let why = std::error::Error::source(&last).unwrap().to_string();
    assert!(why.contains("404"), "{why}");
}

#[tokio::test]
async fn a_page_from_elsewhere_gets_no_link_unless_it_is_allowed() {
    let allow_origins = vec!["https://plant.example".parse().unwrap()];
    let options = Options::default().with_ws(WsOptions::default().with_allow_origins(allow_origins));
    let (mut listener, at) = listen(&options).await;
    let path = "/plant/link?token=7";
    let own = format!("Origin: http://{}\r\n", host(&at));
    for headers in ["", &own, "Origin: https://plant.example\r\n"] {
        assert_eq!(status(&at, path, headers).await, 101, "{headers}");
    }
    assert_eq!(status(&at, path, "Origin: http://evil.example\r\n").await, 403);
    let failure = loop {
        match last_failure(&mut listener).await {
            // The admitted pages have gone without a close.
            HandshakeError::Io(e) if e.kind() == std::io::ErrorKind::PermissionDenied => break e,
            _ => {}
        }
    };
    let why = failure.get_ref().unwrap().downcast_ref::<ForeignOrigin>().unwrap();
    assert_eq!(why.origin, "http://evil.example");
}

/// Silent connections count within the limits of handshakes: a panel gets in at once.
#[tokio::test]
async fn those_who_never_ask_shut_nobody_out() {
    let (mut listener, at) = listen(&Options::default()).await;
    let mut silent = Vec::new();
    for i in 0..200 {
        let mut stream = TcpStream::connect(host(&at)).await.unwrap();
        if i % 2 == 0 {
            let _turned_away = stream.write_all(b"GET /plant/link HTTP/1.1\r\n").await;
        }
        silent.push(stream);
    }
    let (net, options) = (net(), Options::default());
    let (panel, arm) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &options, soon(&net)), listener.accept(soon(&net)),);
    assert!(panel.is_ok() && arm.is_ok(), "{panel:?} {arm:?}");
}

/// A WebSocket message that is invalid for a link, or too long, ends it.
#[tokio::test]
async fn text_and_long_messages_end_a_connection() {
    use futures_util::{SinkExt, StreamExt};
    use tokio_tungstenite::tungstenite::{Bytes, Message};
    let (_listener, at) = listen(&Options::default()).await;
    for message in [Message::text("hello"), Message::Binary(Bytes::from(vec![0x05; 64 * 1024 + 4]))] {
        let stream = TcpStream::connect(host(&at)).await.unwrap();
        let (mut socket, _) = tokio_tungstenite::client_async(at.to_string(), stream).await.unwrap();
        socket.send(message).await.unwrap();
        let net = net();
        tokio::select! {
            () = async { while let Some(Ok(_)) = socket.next().await {} } => {}
            () = sleep_until(&*net, net.now().after(Duration::from_secs(5))) => panic!("it goes on"),
        }
    }
}

/// Messages that cost work without data end the connection long before the handshake timeout.
#[tokio::test]
async fn what_brings_nothing_ends_a_connection() {
    use futures_util::{SinkExt, StreamExt};
    use tokio_tungstenite::tungstenite::{Bytes, Message};
    let (_listener, at) = listen(&Options::default()).await;
    let ends = async |message: Message, times: usize| {
        let stream = TcpStream::connect(host(&at)).await.unwrap();
        let (socket, _) = tokio_tungstenite::client_async(at.to_string(), stream).await.unwrap();
        let (mut sink, mut stream) = socket.split();
        let net = net();
        let sends = async {
            for _ in 0..times {
                if sink.send(message.clone()).await.is_err() {
                    break;
                }
            }
            std::future::pending::<()>().await;
        };
        tokio::select! {
            () = async { while let Some(Ok(_)) = stream.next().await {} } => true,
            () = sends => false,
            () = sleep_until(&*net, net.now().after(Duration::from_secs(2))) => false,
        }
    };
    assert!(ends(Message::Binary(Bytes::new()), 1).await);
    assert!(ends(Message::Ping(Bytes::new()), 200).await);
    assert!(!ends(Message::Ping(Bytes::new()), 50).await, "some pings are taken");
}

/// A reset at any point is an error, on every further call on the link.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_reset_at_any_moment_is_a_loss() {
    use futures_util::SinkExt;
    use tokio_tungstenite::tungstenite::Message as WsMessage;
    for round in 0..40 {
        let link = LinkConfig::default().with_idle_timeout(Duration::from_millis(200));
        let options = Options::default().with_link(link);
        let (mut listener, at) = listen(&options).await;
        let mut sockets = Vec::new();
        for lane in [Lane::Latest, Lane::Frames, Lane::Messages, Lane::Bulk] {
            let stream = TcpStream::connect(host(&at)).await.unwrap();
            stream.set_zero_linger().unwrap();
            let (mut socket, _) = tokio_tungstenite::client_async(at.to_string(), stream).await.unwrap();
            let mut bytes = bytes::BytesMut::new();
            introduce(&greeting(PANEL), SessionId(round), lane).encode(&mut bytes);
            socket.send(WsMessage::Binary(bytes.freeze())).await.unwrap();
            sockets.push(socket);
        }
        let net = net();
        let mut arm = listener.accept(soon(&net)).await.unwrap();
        let mut sockets = Some(sockets);
        for frame in 0..60 {
            if frame == round % 20 {
                sockets = None;
            }
            let _gone = arm.latest_tx.publish(pose(1));
            let _gone = send_frame(&mut arm.frames_tx, frame as u32, &points(2_000)).await;
            let _gone = until(&*net, net.now().after(Duration::from_millis(5)), arm.messages_rx.recv()).await;
        }
        drop(sockets);
        assert!(matches!(arm.latest_tx.publish(pose(1)), Err(SendError::Lost { .. })));
        let _gone = arm.close(finished()).await;
    }
}
