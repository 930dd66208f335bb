//! Links over pipes whose other end is alive or hangs.

#![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

use tokio::io::{AsyncReadExt, DuplexStream, duplex, split};
use trimaran_wire::{Format, Kind, Lane, SessionId};

use crate::application::Side;
use crate::conformance::{ARM, PANEL, Robot, finished, greeting, points, receive, send_frame, start};
use crate::stats::Counters;
use crate::stream::handshake::{Connection, Lanes};
use crate::tcp::Tcp;
use crate::transport::Capabilities;
use crate::{LinkConfig, Loss, RecvError, SendError, TcpOptions, TokioNet};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;
use trimaran_net::{Net, Stream, StreamPeer, sleep_until};

type Link = crate::Link<Robot>;

const IDLE_TIMEOUT: Duration = Duration::from_secs(20);
const PEER: StreamPeer = StreamPeer::Tcp(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 1));

fn net() -> Arc<dyn Net> {
    Arc::new(TokioNet::current().unwrap())
}

fn link(net: &Arc<dyn Net>, [latest, frames, messages, bulk]: [DuplexStream; 4], timeout: Duration) -> Link {
    let counters = Counters::framed();
    let connection = |stream| {
        let (reader, writer) = split(stream);
        let stream = Stream { reader: Box::new(reader), writer: Box::new(writer), peer: PEER };
        Connection::new(stream, &Tcp(TcpOptions::default()), Format::of::<Robot>(), &counters)
    };
    let config = LinkConfig { timeout, idle_timeout: IDLE_TIMEOUT, ..LinkConfig::default() };
    let application = Side::<Robot>::of(greeting(ARM)).unwrap();
    let panel = Side::<Robot>::of(greeting(PANEL)).unwrap();
    let peer = application.recognize(panel.hello()).unwrap();
    let lanes = Lanes {
        latest: connection(latest),
        frames: connection(frames),
        messages: connection(messages),
        bulk: connection(bulk),
        channels: Vec::new(),
        capabilities: Capabilities { reliable: true, ordered: true, encrypted: false, local: false },
    };
    let parts = lanes.into_parts(net, config.idle_timeout, peer, SessionId(1));
    parts.into_link(net, &config, &application.format()).unwrap()
}

/// Both ends of a pipe of `room` bytes for each lane.
fn pipes(room: usize) -> ([DuplexStream; 4], [DuplexStream; 4]) {
    let [(a, w), (b, x), (c, y), (d, z)] = [duplex(room), duplex(room), duplex(room), duplex(room)];
    ([a, b, c, d], [w, x, y, z])
}

/// Two links over pipes of `room` bytes.
fn pair(net: &Arc<dyn Net>, room: usize, timeout: Duration) -> (Link, Link) {
    let (here, there) = pipes(room);
    (link(net, here, timeout), link(net, there, timeout))
}

#[tokio::test(start_paused = true)]
async fn a_peer_with_nothing_to_say_lives() {
    let net = net();
    let (mut here, there) = pair(&net, 4096, IDLE_TIMEOUT);
    for lane in [Lane::Frames, Lane::Latest, Lane::Messages, Lane::Bulk] {
        let by = net.now().after(IDLE_TIMEOUT * 20);
        let quiet = match lane {
            Lane::Frames => here.frames_rx.recv_by(by).await.unwrap_err(),
            Lane::Latest => here.latest_rx.latest_by(by).await.unwrap_err(),
            Lane::Messages => here.messages_rx.recv_by(by).await.unwrap_err(),
            _ => here.bulk.as_mut().unwrap().rx.recv_by(by).await.unwrap_err(),
        };
        assert!(matches!(quiet, RecvError::Deadline { .. }), "{quiet:?}");
        assert!(net.now() >= by);
    }
    // Four in each idle timeout, on each lane.
    assert!((1200..=1300).contains(&there.stats.read().sent.control.messages));
}

#[tokio::test(start_paused = true)]
async fn a_peer_that_hangs_is_lost_when_the_idle_timeout_is_over() {
    let net = net();
    let (here, _hangs) = pipes(4096);
    let mut here = link(&net, here, IDLE_TIMEOUT * 10);
    for lane in [Lane::Frames, Lane::Latest, Lane::Messages, Lane::Bulk] {
        let since = net.now();
        let lost = match lane {
            Lane::Frames => here.frames_rx.recv().await.unwrap_err(),
            Lane::Latest => here.latest_rx.latest().await.unwrap_err(),
            Lane::Messages => here.messages_rx.recv().await.unwrap_err(),
            _ => here.bulk.as_mut().unwrap().rx.recv().await.unwrap_err(),
        };
        assert!(matches!(lost, RecvError::Lost { cause: Loss::Silent, .. }), "{lost:?}");
        assert_eq!(net.now().since(since).as_secs(), IDLE_TIMEOUT.as_secs());
    }
}

/// Sends until that fails; returns the error and the time.
async fn send_into(here: &mut Link, net: &Arc<dyn Net>) -> (SendError, Duration) {
    here.frames_tx.begin(start(0)).await.unwrap();
    let error = here.frames_tx.push(&points(100_000)).await.unwrap_err();
    (error, Duration::from_nanos(net.now().as_nanos()))
}

#[tokio::test(start_paused = true)]
async fn a_peer_that_hangs_is_lost_by_a_sender_when_the_idle_timeout_is_over() {
    let net = net();
    let (here, _hangs) = pipes(128);
    let mut here = link(&net, here, IDLE_TIMEOUT * 10);
    let (error, at) = send_into(&mut here, &net).await;
    assert!(matches!(error, SendError::Lost { cause: Loss::Silent, .. }), "{error:?}");
    assert_eq!(at.as_secs(), IDLE_TIMEOUT.as_secs());
}

#[tokio::test(start_paused = true)]
async fn a_peer_that_lives_and_takes_nothing_has_all_of_the_patience() {
    let net = net();
    let (mut here, _there) = pair(&net, 128, IDLE_TIMEOUT * 10);
    let (error, at) = send_into(&mut here, &net).await;
    assert!(matches!(error, SendError::Stalled { .. }), "{error:?}");
    assert_eq!(at.as_secs(), 10 * IDLE_TIMEOUT.as_secs());
}

#[tokio::test(start_paused = true)]
async fn two_that_send_to_each_other_and_do_not_read_have_all_of_the_patience() {
    let net = net();
    // Each side buffers some of the other's data to see whether it is alive, and then no more.
    let (mut here, mut there) = pair(&net, 64 * 1024, IDLE_TIMEOUT * 10);
    let (one, other) = tokio::join!(send_into(&mut here, &net), send_into(&mut there, &net));
    for (error, at) in [one, other] {
        assert!(matches!(error, SendError::Stalled { .. }), "{error:?}");
        assert!((200..=205).contains(&at.as_secs()), "{at:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn what_a_sender_found_in_its_wait_is_read_afterwards() {
    let net = net();
    let (mut here, there) = pair(&net, 128, IDLE_TIMEOUT * 2);
    let Link { frames_tx, frames_rx: _unread, latest_tx: _latest, .. } = there;
    frames_tx.close(finished()).await.unwrap();
    // The peer has left: nothing more comes, and it takes nothing.
    let (error, _) = send_into(&mut here, &net).await;
    assert!(matches!(error, SendError::Lost { .. }), "{error:?}");
    let left = here.frames_rx.recv().await.unwrap_err();
    assert!(matches!(left, RecvError::Closed { .. }), "{left:?}");
}

#[tokio::test(start_paused = true)]
async fn a_beat_never_comes_between_what_a_sender_who_waits_has_to_say() {
    let net = net();
    let (mut here, mut there) = pair(&net, 64, IDLE_TIMEOUT * 10);
    // In a task of its own, so that no other wake-up is taken for the sender's.
    net.spawn(Box::pin(async move {
        send_frame(&mut here.frames_tx, 0, &points(5000)).await.unwrap();
    }));
    // Many beats fall due while the sender waits for room, and none at this moment.
    let begins = IDLE_TIMEOUT * 5 + Duration::from_secs(1);
    sleep_until(&*net, net.now().after(begins)).await;
    let got = receive(&mut there.frames_rx).await.unwrap();
    assert!(got.points == points(5000));
    assert_eq!(net.now().as_nanos() / 1_000_000_000, begins.as_secs(), "a wake-up was lost to a beat");
}

#[tokio::test(start_paused = true)]
async fn nothing_follows_a_close() {
    let net = net();
    let (here, mut raw) = pipes(4096);
    let Link { latest_tx, latest_rx, frames_tx, frames_rx, messages_tx, messages_rx, bulk, .. } =
        link(&net, here, IDLE_TIMEOUT * 10);
    frames_tx.close(finished()).await.unwrap();
    latest_tx.close(finished()).await.unwrap();
    messages_tx.close(finished()).await.unwrap();
    let crate::Bulk { tx: bulk_tx, rx: bulk_rx } = bulk.unwrap();
    bulk_tx.close(finished()).await.unwrap();
    sleep_until(&*net, net.now().after(IDLE_TIMEOUT * 5)).await;
    drop((latest_rx, frames_rx, messages_rx, bulk_rx));
    for raw in &mut raw {
        let mut all = Vec::new();
        raw.read_to_end(&mut all).await.unwrap();
        // A header, a code, and a text with its length.
        let length = 4 + 1 + 1 + finished().why.as_str().len();
        assert_eq!((all[0], all.len()), (Kind::Close.code(), length), "{all:?}");
    }
}
