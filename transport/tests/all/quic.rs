//! Links over QUIC on the loopback interface: the conformance suite, and admission of peers.

use std::sync::Arc;
use std::time::Duration;

use trimaran_transport::conformance::{ARM, Greeting, Overhead, PANEL, Pairs, greeting, meet, pose};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{
    AttemptError, ConnectError, Endpoint, HandshakeError, Limits, LinkConfig, ListenError, Net, Options,
    PeerAddress, Protocol, until,
};

use crate::common::{Link, Listener, connect, last_failure, net, obstacle, soon};

struct Quic;

impl Pairs for Quic {
    fn overhead(&self) -> Overhead {
        Overhead { header_bytes: 4, handshake: 1, coded: true }
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        link: LinkConfig,
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        let (net, endpoint) = (net(), "quic://127.0.0.1:0".parse().unwrap());
        let (ours, theirs) = acquainted(&Options::default().with_link(link));
        meet([&net, &net], &endpoint, [&ours, &theirs], hellos, within, Clone::clone).await
    }
}

trimaran_transport::conformance!(Quic);

/// Options of two peers that know each other.
fn acquainted(options: &Options) -> (Options, Options) {
    let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
    let (a, b) = (keys("a"), keys("b"));
    let with = |keys: &Keys, peer: &Keys| {
        let security =
            Some(Security { keys: keys.clone(), peers: vec![peer.public().clone().into()].into() });
        options.clone().with_security(security)
    };
    (with(&a, &b), with(&b, &a))
}

async fn pair(host: &str, options: &Options) -> (Link, Link) {
    let net = net();
    let (ours, theirs) = acquainted(options);
    let endpoint: Endpoint = format!("quic://{host}:0").parse().unwrap();
    let mut listener = Listener::bind(&net, &endpoint, greeting(ARM), &ours).await.unwrap();
    let endpoint = listener.local_endpoint().clone();
    let (there, here) = tokio::join!(
        connect(&net, &endpoint, greeting(PANEL), &theirs, soon(&net)),
        listener.accept(soon(&net)),
    );
    (here.unwrap(), there.unwrap())
}

async fn listener(net: &Arc<dyn Net>, options: &Options) -> (Listener, Endpoint) {
    let endpoint = "quic://127.0.0.1:0".parse().unwrap();
    let listener = Listener::bind(net, &endpoint, greeting(ARM), options).await.unwrap();
    let endpoint = listener.local_endpoint().clone();
    (listener, endpoint)
}

/// How a connection fails, at the connecting and at the listening side.
async fn failures(ours: &Options, theirs: &Options, who: Greeting) -> (HandshakeError, HandshakeError) {
    let net = net();
    let (mut listener, endpoint) = listener(&net, ours).await;
    (obstacle(&net, &endpoint, who, theirs).await, last_failure(&mut listener).await)
}

#[tokio::test]
async fn both_address_families_work_and_the_link_is_encrypted() {
    for host in ["127.0.0.1", "[::1]", "localhost"] {
        let (mut arm, mut panel) = pair(host, &Options::default()).await;
        assert!(arm.capabilities().encrypted && panel.capabilities().encrypted);
        assert!(matches!(arm.peer.address, PeerAddress::Quic(at) if at.ip().is_loopback()));
        assert_eq!(arm.peer.session, panel.peer.session);
        panel.latest_tx.publish(pose(4)).unwrap();
        assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(4));
    }
}

#[tokio::test]
async fn an_unknown_certificate_is_refused_by_either_side_with_both_fingerprints() {
    let (ours, theirs) = acquainted(&Options::default());
    let (_, stranger) = acquainted(&Options::default());
    let of = |options: &Options| options.security.clone().unwrap();
    let public = |options: &Options| of(options).keys.public().clone();
    let print = |options: &Options| public(options).quic.unwrap();

    // The listener knows the peer, the peer another listener.
    let security = Some(Security { peers: vec![public(&stranger).into()].into(), ..of(&theirs) });
    let confused = Options::default().with_security(security);
    let (error, _) = failures(&ours, &confused, greeting(PANEL)).await;
    let HandshakeError::UnknownPeer(unknown) = error else { panic!("{error:?}") };
    assert_eq!((&unknown.expected[..], unknown.presented), (&[print(&stranger)][..], print(&ours)));
    let message = unknown.to_string();
    assert!(message.contains(&print(&stranger).to_string()) && message.contains(&print(&ours).to_string()));

    // The peer knows the listener, the listener another peer.
    let security = Some(Security { peers: vec![public(&ours).into()].into(), ..of(&stranger) });
    let intruder = Options::default().with_security(security);
    let (error, known) = failures(&ours, &intruder, greeting(PANEL)).await;
    let HandshakeError::NotKnown { presented } = error else { panic!("{error:?}") };
    assert_eq!(presented, print(&stranger));
    let HandshakeError::UnknownPeer(unknown) = known else { panic!("{known:?}") };
    assert_eq!((&unknown.expected[..], unknown.presented), (&[print(&theirs)][..], print(&stranger)));
}

#[tokio::test]
async fn without_keys_there_is_no_quic() {
    let (net, options) = (net(), Options::default());
    let endpoint = "quic://127.0.0.1:1".parse().unwrap();
    let error = connect(&net, &endpoint, greeting(PANEL), &options, soon(&net)).await.unwrap_err();
    assert!(!error.may_pass(), "{error:?}");
    let ConnectError::Failed { cause: AttemptError::Handshake { cause, .. }, .. } = error else {
        panic!("{error:?}")
    };
    assert!(matches!(cause, HandshakeError::NoKeys), "{cause:?}");
    let error = Listener::bind(&net, &endpoint, greeting(ARM), &options).await.unwrap_err();
    assert!(matches!(error, ListenError::Given { .. }) && !error.may_pass(), "{error:?}");
}

/// Keys as a program makes them that has no QUIC.
fn for_datagrams_alone() -> Keys {
    let folder = tempfile::tempdir().unwrap();
    let made = Keys::generate("one".parse().unwrap()).unwrap().save(folder.path()).unwrap();
    let text = std::fs::read_to_string(&made.private).unwrap();
    let kept: String =
        text.lines().filter(|line| !line.starts_with("quic_")).flat_map(|line| [line, "\n"]).collect();
    std::fs::write(&made.private, kept).unwrap();
    Keys::read(&made.private).unwrap()
}

#[tokio::test]
async fn with_keys_for_datagrams_alone_there_is_no_quic() {
    let (net, (known, theirs)) = (net(), acquainted(&Options::default()));
    let security = Some(Security { keys: for_datagrams_alone(), ..known.security.clone().unwrap() });
    let options = Options::default().with_security(security);
    let endpoint = "quic://127.0.0.1:1".parse().unwrap();
    let error = connect(&net, &endpoint, greeting(PANEL), &options, soon(&net)).await.unwrap_err();
    assert!(!error.may_pass(), "{error:?}");
    let ConnectError::Failed { cause: AttemptError::Handshake { cause, .. }, .. } = error else {
        panic!("{error:?}")
    };
    assert!(matches!(cause, HandshakeError::NoQuicKey), "{cause:?}");
    let endpoint = "quic://127.0.0.1:0".parse().unwrap();
    let error = Listener::bind(&net, &endpoint, greeting(ARM), &options).await.unwrap_err();
    assert!(matches!(error, ListenError::Given { .. }) && !error.may_pass(), "{error:?}");

    // A listener that knows such a peer for datagrams has no place for it, and the others still get in.
    let peers = [
        vec![for_datagrams_alone().public().clone().into()],
        known.security.clone().unwrap().peers.now().to_vec(),
    ];
    let security = Some(Security { peers: peers.concat().into(), ..known.security.clone().unwrap() });
    let ours = known.with_security(security);
    let (mut listener, endpoint) = listener(&net, &ours).await;
    let (there, here) = tokio::join!(
        connect(&net, &endpoint, greeting(PANEL), &theirs, soon(&net)),
        listener.accept(soon(&net)),
    );
    assert_eq!((there.unwrap().peer.hello, here.unwrap().peer.hello), (greeting(ARM), greeting(PANEL)));
}

/// Genuine first packets, sent again and again without going further. Each of them is a handshake.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn ten_thousand_first_packets_of_twenty_handshakes_keep_no_peer_out() {
    let net = net();
    let limits = Limits::default().with_handshakes(8);
    // Open handshakes stay open for as long as the test runs.
    let hour = Duration::from_secs(3600);
    let link = LinkConfig::default().with_idle_timeout(hour).with_handshake_timeout(hour);
    let (ours, theirs) = acquainted(&Options::default().with_limits(limits).with_link(link));
    let (mut listener, endpoint) = listener(&net, &ours).await;
    let Endpoint::Quic(at) = &endpoint else { panic!("{endpoint}") };
    // Authentic first packets: a relay sees handshakes that go no further.
    let mut firsts = Vec::new();
    for _ in 0..20 {
        let relay = tokio::net::UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let lure: Endpoint = format!("quic://{}", relay.local_addr().unwrap()).parse().unwrap();
        let mut first = vec![0; 2000];
        let length = tokio::select! {
            _ = connect(&net, &lure, greeting(PANEL), &theirs, soon(&net)) => panic!("a link to a relay"),
            received = relay.recv(&mut first) => received.unwrap(),
        };
        first.truncate(length);
        // Its later packets are not passed on.
        firsts.push((relay, first));
    }
    for (relay, first) in firsts.iter().cycle().take(10_000) {
        relay.send_to(first, at.to_string()).await.unwrap();
    }
    let by = soon(&net);
    let (there, here) =
        tokio::join!(connect(&net, &endpoint, greeting(PANEL), &theirs, by), listener.accept(by));
    assert!(there.is_ok() && here.is_ok(), "{there:?} {here:?}");
}

#[tokio::test]
async fn the_last_pose_arrives_though_nothing_follows_it() {
    let net = net();
    let (mut arm, mut panel) = pair("127.0.0.1", &Options::default()).await;
    for frame in 0..50 {
        panel.latest_tx.publish(pose(frame)).unwrap();
    }
    let all = async { while arm.latest_rx.latest().await.unwrap() != pose(49) {} };
    assert_eq!(until(&*net, soon(&net), all).await, Some(()));
    // Its copy on the control stream is the same pose, and not read again.
    let again = arm.latest_rx.latest_by(net.now().after(Duration::from_millis(100))).await;
    assert!(again.is_err(), "{again:?}");
}
