//! The memory that strangers and peers take on this side: no more than configured. Alone in its program,
//! whose allocator counts.
#![cfg(all(unix, feature = "quic", feature = "tcp", feature = "udp", feature = "unix", feature = "ws"))]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::alloc::System;
use std::time::Duration;

use common::meeting::Meeting;
use common::{Link, connect, net, soon};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpStream, UdpSocket, UnixStream};
use tokio::sync::Mutex;
use trimaran_transport::conformance::{PANEL, greeting, points, pose, start};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::quic::QuicOptions;
use trimaran_transport::udp::UdpOptions;
use trimaran_transport::{Endpoint, Limits, LinkConfig, Options, SendError, sleep_until};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const KIB: usize = 1 << 10;
/// QUIC last: its connections are remembered for a while, and memory freed meanwhile would hide what another
/// takes.
const ENDPOINTS: [&str; 5] =
    ["tcp://127.0.0.1:0", "unix:", "ws://127.0.0.1:0", "udp://127.0.0.1:0", "quic://127.0.0.1:0"];

/// Only one test at a time counts.
static ALONE: Mutex<()> = Mutex::const_new(());

/// The bytes allocated by this program.
fn held() -> usize {
    let stats = ALLOCATOR.stats();
    stats.bytes_allocated.saturating_sub(stats.bytes_deallocated)
}

async fn joined(meeting: &mut Meeting) -> (Link, Link) {
    let net = net();
    let (there, here) = tokio::join!(
        connect(&net, &meeting.at, greeting(PANEL), &meeting.panel, soon(&net)),
        meeting.listener.accept(soon(&net)),
    );
    (there.unwrap(), here.unwrap())
}

/// Time for the other side to receive.
async fn a_moment() {
    let net = net();
    sleep_until(&*net, net.now().after(Duration::from_millis(50))).await;
}

/// A stranger.
enum Stranger {
    Tcp(TcpStream),
    Unix(UnixStream),
    /// With a WebSocket, or a request for one.
    Ws(TcpStream),
    /// With a first packet as genuine as a stranger's can be: its keys are unknown.
    Datagrams {
        socket: UdpSocket,
        to: String,
        first: Vec<u8>,
    },
}

impl Stranger {
    async fn at(endpoint: &Endpoint, options: &Options) -> Self {
        match endpoint {
            Endpoint::Tcp(at) => Self::Tcp(TcpStream::connect(at.to_string()).await.unwrap()),
            Endpoint::Unix(path) => Self::Unix(UnixStream::connect(path.as_path()).await.unwrap()),
            Endpoint::Ws(at) => {
                let stream = TcpStream::connect(at.at.to_string()).await.unwrap();
                let wish = "GET / HTTP/1.1\r\nHost: here\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
                            Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
                drop(stream.try_write(wish.as_bytes()));
                Self::Ws(stream)
            }
            Endpoint::Quic(at) => Self::of_datagrams("quic", at.to_string(), options).await,
            Endpoint::Udp(at) => Self::of_datagrams("udp", at.at.to_string(), options).await,
            other => panic!("{other}"),
        }
    }

    async fn of_datagrams(transport: &str, to: String, options: &Options) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let lure = format!("{transport}://{}", socket.local_addr().unwrap()).parse().unwrap();
        let (net, mut first) = (net(), vec![0; 2000]);
        let length = tokio::select! {
            link = connect(&net, &lure, greeting(PANEL), options, soon(&net)) => panic!("{link:?}"),
            received = socket.recv(&mut first) => received.unwrap(),
        };
        first.truncate(length);
        Self::Datagrams { socket, to, first }
    }

    /// Announces the longest message there is to the listener, or begins a handshake.
    async fn speak(&mut self) {
        let greedy = [&[0x21, 0x00, 0x00, 0x01][..], &vec![7; 64 * KIB]].concat();
        // A refused stranger may be unable to send more.
        match self {
            Self::Tcp(stream) => drop(stream.write_all(&greedy[..]).await),
            Self::Unix(stream) => drop(stream.try_write(&greedy)),
            Self::Ws(stream) => drop(stream.write_all(&in_a_web_socket(&greedy)).await),
            Self::Datagrams { socket, to, first } => drop(socket.send_to(first, &*to).await.unwrap()),
        }
    }

    /// Begins a handshake, and sends no more of it.
    async fn begin(&mut self) {
        // A hello of 30 bytes begins.
        let hello = [0x01, 30, 0, 0, b'T', b'R'];
        match self {
            Self::Tcp(stream) => drop(stream.try_write(&hello)),
            Self::Unix(stream) => drop(stream.try_write(&hello)),
            Self::Ws(stream) => drop(stream.try_write(&in_a_web_socket(&hello))),
            Self::Datagrams { .. } => self.speak().await,
        }
    }
}

/// Bytes as binary messages of at most 64 KiB, masked with zeros (RFC 6455, section 5.2).
fn in_a_web_socket(bytes: &[u8]) -> Vec<u8> {
    let message = |part: &[u8]| {
        let header = [&[0x82, 0xff][..], &(part.len() as u64).to_be_bytes(), &[0; 4]].concat();
        [&header, part].concat()
    };
    bytes.chunks(64 * KIB).flat_map(message).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn strangers_cost_no_more_than_the_handshakes_that_may_be_under_way() {
    const ROOM: usize = 8;
    /// The memory of one handshake: for QUIC, its TLS and its buffered data.
    const EACH: usize = 96 * KIB;
    let _alone = ALONE.lock().await;
    let hour = Duration::from_secs(3600);
    let limits = Limits::default()
        .with_handshakes(ROOM)
        .with_handshakes_per_s(1 << 20)
        .with_handshakes_per_s_per_address(1 << 20);
    let link = LinkConfig::default().with_idle_timeout(hour).with_handshake_timeout(hour);
    let options = Options::default().with_limits(limits).with_link(link);
    for endpoint in ENDPOINTS {
        let mut meeting = Meeting::at(endpoint, &options).await;
        drop(joined(&mut meeting).await);
        let keys = Keys::generate("nobody".parse().unwrap()).unwrap();
        let peers = meeting.panel.security.clone().unwrap().peers;
        let unknown = options.clone().with_security(Security { keys, peers });
        let is_stream = matches!(meeting.at, Endpoint::Tcp(_) | Endpoint::Unix(_) | Endpoint::Ws(_));
        let mut strangers = Vec::new();
        if !is_stream {
            for _ in 0..64 {
                strangers.push(Stranger::at(&meeting.at, &unknown).await);
            }
        }
        a_moment().await;
        let (before, mut most) = (held(), 0);
        for round in 0..20 {
            if is_stream {
                strangers.clear();
                for _ in 0..64 {
                    strangers.push(Stranger::at(&meeting.at, &unknown).await);
                }
            }
            for stranger in &mut strangers {
                if round % 2 == 0 { stranger.begin().await } else { stranger.speak().await }
            }
            a_moment().await;
            most = most.max(held().saturating_sub(before));
        }
        println!("{endpoint}: {most} bytes");
        assert!(most < ROOM * EACH, "{endpoint}: {most} bytes");
    }
}

/// Data sent to a peer that reads nothing is held at the sender and at the receiver, both in this program.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_peer_that_is_not_read_fills_the_windows_and_no_more() {
    const WINDOW: usize = 1024 * KIB;
    let _alone = ALONE.lock().await;
    let timeout = Duration::from_millis(300);
    let options = Options::default()
        .with_link(LinkConfig::default().with_timeout(timeout))
        .with_quic(QuicOptions::default().with_window(WINDOW as u32))
        .with_udp(UdpOptions::default().with_window(WINDOW as u32).with_send_buffer(WINDOW));
    for (endpoint, most) in
        ENDPOINTS.into_iter().zip([512 * KIB, 512 * KIB, 512 * KIB, 4 * WINDOW, 4 * WINDOW])
    {
        let mut meeting = Meeting::at(endpoint, &options).await;
        let (there, mut here) = joined(&mut meeting).await;
        let points = points(16_384);
        let before = held();
        for number in 0..10_000 {
            here.latest_tx.publish(pose(number)).unwrap();
        }
        a_moment().await;
        let by_poses = held().saturating_sub(before);
        here.frames_tx.begin(start(0)).await.unwrap();
        let stalled = loop {
            if let Err(e) = here.frames_tx.push(&points).await {
                break e;
            }
        };
        assert!(matches!(stalled, SendError::Stalled { .. }), "{endpoint}: {stalled:?}");
        let by_all = held().saturating_sub(before);
        println!("{endpoint}: {by_poses} bytes of poses, {by_all} of all");
        assert!(by_poses < 256 * KIB, "{endpoint}: {by_poses} bytes of poses");
        assert!(by_all < most, "{endpoint}: {by_all} bytes");
        drop(there);
    }
}
