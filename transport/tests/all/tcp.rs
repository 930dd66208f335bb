//! Links over TCP on the loopback interface: the conformance suite, and admission of peers.

use std::error::Error;
use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpSocket;
use trimaran_transport::conformance::{
    ARM, Greeting, Overhead, PANEL, Pairs, greeting, points, pose, receive, send_frame,
};
use trimaran_transport::{
    AcceptError, AttemptError, BatchSize, ConnectError, Endpoint, HandshakeError, LinkConfig, ListenError,
    Net, Options, PeerAddress, Protocol, Refusal, Rejection, TcpOptions,
};

use crate::common::{Listener, connect, joined, last_failure, met, net, soon};

struct Tcp;

impl Pairs for Tcp {
    fn overhead(&self) -> Overhead {
        Overhead { header_bytes: 4, handshake: 4, coded: true }
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        link: LinkConfig,
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        // Buffers smaller than the tests' amounts.
        let tcp = TcpOptions::default().with_send_buffer(Some(64 * 1024)).with_recv_buffer(Some(64 * 1024));
        met("tcp://127.0.0.1:0", &Options::default().with_link(link).with_tcp(tcp), hellos, within).await
    }
}

trimaran_transport::conformance!(Tcp);

async fn listener(net: &Arc<dyn Net>, identity: Greeting, options: &Options) -> (Listener, Endpoint) {
    let listener =
        Listener::bind(net, &"tcp://127.0.0.1:0".parse().unwrap(), identity, options).await.unwrap();
    let address = listener.local_endpoint().clone();
    (listener, address)
}

/// Tries to connect to a listener that must refuse; returns the errors of both sides.
async fn refusal(listening: Greeting, connecting: Greeting) -> (Refusal, Refusal) {
    let (net, options) = (net(), Options::default());
    let (mut listener, address) = listener(&net, listening.clone(), &options).await;
    let refusal = crate::common::refusal(&net, &address, connecting, &options).await;
    match last_failure(&mut listener).await {
        HandshakeError::Refused(known) => (refusal, known),
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn host_names_and_both_address_families_work() {
    for host in ["localhost", "127.0.0.1", "[::1]"] {
        let (mut arm, panel) = joined(&format!("tcp://{host}:0"), &Options::default()).await;
        assert_eq!(arm.peer.hello, greeting(PANEL));
        assert_eq!(panel.peer.hello, greeting(ARM));
        assert_eq!(arm.peer.session, panel.peer.session);
        let PeerAddress::Tcp(address) = arm.peer.address else { panic!("{:?}", arm.peer) };
        assert!(address.ip().is_loopback());
        let mut panel = panel;
        panel.latest_tx.publish(pose(4)).unwrap();
        assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(4));
    }
}

#[tokio::test]
async fn what_the_peers_want_travels_in_the_hello_and_in_the_answer() {
    let panel = Greeting { batch: BatchSize::new(3).ok(), ..greeting(PANEL) };
    for (listening, connecting) in [(panel.clone(), greeting(ARM)), (greeting(ARM), panel)] {
        let (net, options) = (net(), Options::default());
        let (mut listener, address) = listener(&net, listening.clone(), &options).await;
        let mut there = connect(&net, &address, connecting.clone(), &options, soon(&net)).await.unwrap();
        let mut here = listener.accept(soon(&net)).await.unwrap();
        assert_eq!((there.peer.hello, here.peer.hello), (listening, connecting));
        send_frame(&mut there.frames_tx, 0, &points(7)).await.unwrap();
        assert_eq!(receive(&mut here.frames_rx).await.unwrap().batches, [3, 3, 1], "the panel's batch size");
    }
}

#[tokio::test]
async fn what_the_application_rejects_is_refused_and_both_sides_know_why() {
    let wanting = |role, points| Greeting { batch: BatchSize::new(points).ok(), ..greeting(role) };
    let rejection = Rejection::new(3, "the listener wants batches of 10, the connecting peer of 11");
    let expected = Refusal::Rejected(rejection);
    let known = refusal(wanting(ARM, 10), wanting(PANEL, 11)).await;
    assert_eq!(known, (expected.clone(), expected));
}

#[tokio::test]
async fn the_listeners_own_role_is_refused() {
    let expected = Refusal::Rejected(Rejection::new(2, "the listener is panel itself"));
    assert_eq!(refusal(greeting(PANEL), greeting(PANEL)).await, (expected.clone(), expected));
}

#[tokio::test]
async fn nobody_there_ends_at_the_deadline_with_the_last_cause() {
    let (net, options) = (net(), Options::default());
    // Held, so that nobody else gets the port, but not listening.
    let holder = TcpSocket::new_v4().unwrap();
    holder.bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let address = Endpoint::Tcp(holder.local_addr().unwrap().into());
    // The first wait that is long enough here for more than one attempt.
    for wait in (0..).map(|doubled| Duration::from_millis(100) * 2_u32.pow(doubled)) {
        let deadline = net.now().after(wait);
        let error = connect(&net, &address, greeting(PANEL), &options, deadline).await.unwrap_err();
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
    let (mut listener, _) = listener(&net, greeting(ARM), &options).await;
    let accepted = listener.accept(net.now().after(Duration::from_millis(20))).await;
    assert!(matches!(accepted, Err(AcceptError::Deadline { last: None, .. })), "{accepted:?}");
}

#[tokio::test]
async fn a_port_in_use_says_so() {
    let (net, options) = (net(), Options::default());
    let (_holder, address) = listener(&net, greeting(ARM), &options).await;
    let error = Listener::bind(&net, &address, greeting(ARM), &options).await.unwrap_err();
    assert!(matches!(error, ListenError::InUse { .. }) && error.may_pass(), "{error:?}");
    assert!(error.to_string().contains(&address.to_string()), "{error}");
}

#[cfg(feature = "udp")]
#[tokio::test]
async fn what_the_kernel_does_with_packets_is_not_told() {
    let (here, _there) = joined("tcp://127.0.0.1:0", &Options::default()).await;
    assert_eq!(here.stats.read().path, None);
}
