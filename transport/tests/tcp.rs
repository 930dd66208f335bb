//! Links over TCP on the loopback interface: the conformance suite, and who gets a link.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::error::Error;
use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use common::conformance::Pairs;
use common::ports::unused_port;
use common::{SCENE, camera, identity, ids, joined, last_failure, net, receive, settings, soon, start};
use tokio::net::TcpSocket;
use trimaran_proto::{Identity, Refusal, Role, SceneHash};
use trimaran_transport::{
    AcceptError, AttemptError, ConnectError, Endpoint, HandshakeError, Link, LinkConfig, ListenError,
    Listener, Net, Options, PeerAddress, TcpOptions, connect, sleep_until,
};

struct Tcp;

impl Pairs for Tcp {
    const HEADER: u64 = 4;
    const HANDSHAKE: u64 = 2;

    async fn pair(&self, link: LinkConfig) -> (Link, Link) {
        // Buffers that the tests' amounts exceed.
        let tcp = TcpOptions {
            send_buffer: Some(64 * 1024),
            recv_buffer: Some(64 * 1024),
            ..TcpOptions::default()
        };
        joined("tcp://127.0.0.1:0", &Options { link, tcp, ..Options::default() }).await
    }
}

conformance!(Tcp);

async fn listener(net: &Arc<dyn Net>, identity: Identity, options: &Options) -> (Listener, Endpoint) {
    let listener =
        Listener::bind(net, &"tcp://127.0.0.1:0".parse().unwrap(), identity, options).await.unwrap();
    let address = listener.local_endpoint().clone();
    (listener, address)
}

/// Tries to connect to a listener that must refuse; gives what both sides learn.
async fn refusal(listening: Identity, connecting: Identity) -> (Refusal, Refusal) {
    let (net, options) = (net(), Options::default());
    let (mut listener, address) = listener(&net, listening, &options).await;
    let refusal = common::refusal(&net, &address, connecting, &options).await;
    match last_failure(&mut listener).await {
        HandshakeError::Refused(known) => (refusal, known),
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn host_names_and_both_address_families_work() {
    for host in ["localhost", "127.0.0.1", "[::1]"] {
        let (mut a, display) = joined(&format!("tcp://{host}:0"), &Options::default()).await;
        assert_eq!(a.peer.identity, identity(Role::Display));
        assert_eq!(display.peer.identity, identity(Role::SwitchA));
        assert_eq!(a.peer.session, display.peer.session);
        let PeerAddress::Tcp(address) = a.peer.address else { panic!("{:?}", a.peer) };
        assert!(address.ip().is_loopback());
        let mut display = display;
        display.latest_tx.publish(camera(4)).unwrap();
        assert_eq!(a.latest_rx.latest().await.unwrap(), camera(4));
    }
}

#[tokio::test]
async fn the_connecting_side_may_start_first() {
    let (net, options) = (net(), Options::default());
    let address = format!("tcp://127.0.0.1:{}", unused_port()).parse().unwrap();
    let late = async {
        sleep_until(&*net, net.now().after(Duration::from_millis(300))).await;
        let mut listener = Listener::bind(&net, &address, identity(Role::SwitchB), &options).await.unwrap();
        listener.accept(soon(&net)).await.unwrap()
    };
    let early = connect(&net, &address, identity(Role::SwitchA), &options, soon(&net));
    let (early, late) = tokio::join!(early, late);
    assert_eq!(early.unwrap().peer.identity.role, Role::SwitchB);
    assert_eq!(late.peer.identity.role, Role::SwitchA);
}

#[tokio::test]
async fn settings_travel_in_the_hello_and_in_the_answer() {
    let display = Identity { settings: Some(settings(3)), ..identity(Role::Display) };
    for (listening, connecting) in [(display, identity(Role::SwitchA)), (identity(Role::SwitchA), display)] {
        let (net, options) = (net(), Options::default());
        let (mut listener, address) = listener(&net, listening, &options).await;
        let mut there = connect(&net, &address, connecting, &options, soon(&net)).await.unwrap();
        let mut here = listener.accept(soon(&net)).await.unwrap();
        assert_eq!((there.peer.identity, here.peer.identity), (listening, connecting));
        there.frames_tx.begin(start(0)).await.unwrap();
        there.frames_tx.push(&ids(7)).await.unwrap();
        there.frames_tx.finish().await.unwrap();
        assert_eq!(
            receive(&mut here.frames_rx).await.unwrap().batches,
            [3, 3, 1],
            "the display's batch size"
        );
    }
}

#[tokio::test]
async fn another_scene_is_refused_and_both_sides_know_both_scenes() {
    let other = SceneHash(0xdead);
    let connecting = Identity { scene: other, ..identity(Role::Display) };
    let expected = Refusal::Scene { listener: SCENE, connector: other };
    assert_eq!(refusal(identity(Role::SwitchA), connecting).await, (expected, expected));
}

#[tokio::test]
async fn other_settings_are_refused() {
    let (x, y) = (settings(10), settings(11));
    let listening = Identity { settings: Some(x), ..identity(Role::SwitchA) };
    let connecting = Identity { settings: Some(y), ..identity(Role::Display) };
    let expected = Refusal::Settings { listener: x, connector: y };
    assert_eq!(refusal(listening, connecting).await, (expected, expected));
}

#[tokio::test]
async fn the_listeners_own_role_is_refused() {
    let expected = Refusal::RoleTaken { role: Role::Display };
    assert_eq!(refusal(identity(Role::Display), identity(Role::Display)).await, (expected, expected));
}

#[tokio::test]
async fn a_role_is_taken_until_the_last_half_of_its_link_is_dropped() {
    let (net, options) = (net(), Options::default());
    let (mut listener, address) = listener(&net, identity(Role::SwitchA), &options).await;
    let first = connect(&net, &address, identity(Role::Display), &options, soon(&net)).await.unwrap();
    let Link { latest_rx, .. } = listener.accept(soon(&net)).await.unwrap();
    let refusal = common::refusal(&net, &address, identity(Role::Display), &options).await;
    assert_eq!(refusal, Refusal::RoleTaken { role: Role::Display });
    drop((first, latest_rx));
    connect(&net, &address, identity(Role::Display), &options, soon(&net)).await.unwrap();
}

#[tokio::test]
async fn nobody_there_ends_at_the_deadline_with_the_last_cause() {
    let (net, options) = (net(), Options::default());
    // Held, so that nobody else gets the port, and not listened on.
    let holder = TcpSocket::new_v4().unwrap();
    holder.bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let address = Endpoint::Tcp(holder.local_addr().unwrap().into());
    // The first wait that is long enough here for more than one attempt.
    for wait in (0..).map(|doubled| Duration::from_millis(100) * 2_u32.pow(doubled)) {
        let deadline = net.now().after(wait);
        let error = connect(&net, &address, identity(Role::Display), &options, deadline).await.unwrap_err();
        assert!(error.source().is_some());
        let ConnectError::Deadline { attempts, last, .. } = error else { panic!("{error:?}") };
        if attempts > 1 {
            let AttemptError::Connect { cause, .. } = last else { panic!("{last:?}") };
            assert_eq!(cause.kind(), ErrorKind::ConnectionRefused);
            break;
        }
    }
}

#[tokio::test]
async fn nobody_comes_ends_at_the_deadline() {
    let (net, options) = (net(), Options::default());
    let (mut listener, _) = listener(&net, identity(Role::SwitchA), &options).await;
    let accepted = listener.accept(net.now().after(Duration::from_millis(20))).await;
    assert!(matches!(accepted, Err(AcceptError::Deadline { last: None, .. })), "{accepted:?}");
}

#[tokio::test]
async fn a_port_in_use_says_so() {
    let (net, options) = (net(), Options::default());
    let (_holder, address) = listener(&net, identity(Role::SwitchA), &options).await;
    let error = Listener::bind(&net, &address, identity(Role::SwitchA), &options).await.unwrap_err();
    assert!(matches!(error, ListenError::InUse { .. }) && error.may_pass(), "{error:?}");
    assert!(error.to_string().contains(&address.to_string()), "{error}");
}
