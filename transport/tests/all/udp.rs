//! Links over datagrams on the loopback interface: the conformance suite, admission of peers, and traffic.

use std::sync::Arc;
use std::time::Duration;

use trimaran_transport::conformance::{
    ARM, Overhead, PANEL, Pairs, greeting, points, pose, receive, send_frame, start,
};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::udp::Trust;
use trimaran_transport::{
    AttemptError, BatchSize, Batching, ConnectError, Endpoint, FrameEvent, FrameNumber, FrameOutcome,
    HandshakeError, LinkConfig, Net, Options, PeerAddress, Protocol, sleep_until,
};

use crate::common::page::Page;
use crate::common::udp::{a_panel_gets_in, listener, shared, with};
use crate::common::{Listener, connect, joined, last_failure, met, net, soon};

struct Udp;

impl Pairs for Udp {
    fn overhead(&self) -> Overhead {
        Overhead { header_bytes: 0, handshake: 1, coded: true }
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        link: LinkConfig,
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        met("udp://127.0.0.1:0", &shared(9).with_link(link), hellos, within).await
    }
}

trimaran_transport::conformance!(Udp);

#[tokio::test]
async fn both_address_families_work_and_a_link_knows_whether_it_is_encrypted() {
    for host in ["127.0.0.1", "[::1]", "localhost"] {
        for (options, encrypted) in [(shared(1), true), (with(Trust::Plaintext), false)] {
            let (mut arm, mut panel) = joined(&format!("udp://{host}:0"), &options).await;
            for link in [&arm, &panel] {
                let says = link.capabilities();
                assert_eq!(
                    (says.encrypted, says.reliable, says.ordered, says.local),
                    (encrypted, true, true, false)
                );
                assert!(matches!(link.peer.address, PeerAddress::Udp(at) if at.ip().is_loopback()));
            }
            assert_eq!(arm.peer.session, panel.peer.session);
            panel.latest_tx.publish(pose(4)).unwrap();
            assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(4));
        }
    }
}

#[tokio::test]
async fn without_keys_there_is_no_udp() {
    let (net, options) = (net(), Options::default());
    let endpoint = "udp://127.0.0.1:1".parse().unwrap();
    let error = connect(&net, &endpoint, greeting(PANEL), &options, soon(&net)).await.unwrap_err();
    let ConnectError::Failed { cause: AttemptError::Handshake { cause, .. }, .. } = error else {
        panic!("{error:?}")
    };
    assert!(matches!(cause, HandshakeError::NoKeys), "{cause:?}");
    assert!(Listener::bind(&net, &endpoint, greeting(ARM), &options).await.is_err());
}

/// A stranger with these options never gets a link; returns the listener's error.
async fn a_stranger_knocks(listener: &mut Listener, at: &Endpoint, options: &Options) -> HandshakeError {
    let net = net();
    let known = tokio::select! {
        link = connect(&net, at, greeting(PANEL), options, soon(&net)) => panic!("{link:?}"),
        known = last_failure(listener) => known,
    };
    let shortly = net.now().after(Duration::from_millis(100));
    let error = connect(&net, at, greeting(PANEL), options, shortly).await.unwrap_err();
    assert!(matches!(error, ConnectError::Deadline { .. }), "{error:?}");
    known
}

#[tokio::test]
async fn another_key_gets_no_answer_and_the_listener_knows_why() {
    let (mut listener, endpoint) = listener(&shared(1)).await;
    for wrong in [shared(2), with(Trust::Plaintext)] {
        let known = a_stranger_knocks(&mut listener, &endpoint, &wrong).await;
        assert!(matches!(known, HandshakeError::Stranger), "{known:?}");
    }
    a_panel_gets_in(&mut listener, &endpoint, &shared(1)).await;
}

/// A peer that has `keys` and knows those.
fn knowing(keys: &Keys, peers: &[&Keys]) -> Options {
    let peers = peers.iter().map(|peer| peer.public().clone().into()).collect();
    Options::default().with_security(Security { keys: keys.clone(), peers })
}

#[tokio::test]
async fn pinned_peers_find_each_other_among_several_and_others_do_not_get_in() {
    let [a, b, c, d] = ["a", "b", "c", "d"].map(|name| Keys::generate(name.parse().unwrap()).unwrap());
    let (mut listener, at) = listener(&knowing(&a, &[&b, &c])).await;
    for options in [knowing(&b, &[&a]), knowing(&b, &[&c, &a]), knowing(&c, &[&a, &b, &d])] {
        a_panel_gets_in(&mut listener, &at, &options).await;
    }
    // A peer is a stranger if it expects another listener, or if the listener does not know it.
    for options in [knowing(&d, &[&a]), knowing(&b, &[&c, &d])] {
        let known = a_stranger_knocks(&mut listener, &at, &options).await;
        assert!(matches!(known, HandshakeError::Stranger), "{known:?}");
    }
    let net = net();
    let shortly = net.now().after(Duration::from_millis(100));
    let alone = connect(&net, &at, greeting(PANEL), &knowing(&b, &[]), shortly).await;
    assert!(matches!(alone, Err(ConnectError::Deadline { .. })), "{alone:?}");
}

/// Without any time to arrive, only a frame's beginning and end do.
#[tokio::test]
async fn a_frame_that_is_given_up_says_how_many_points_are_missing() {
    let udp = shared(1).udp.with_deadline(Duration::ZERO);
    let options = shared(1).with_udp(udp);
    let (mut arm, mut panel) = joined("udp://127.0.0.1:0?mode=deadline", &options).await;
    assert!(!arm.capabilities().reliable && !panel.capabilities().reliable, "both sides know");
    for frame in 0..3 {
        send_frame(&mut arm.frames_tx, frame, &points(4000)).await.unwrap();
        assert_eq!(panel.frames_rx.recv().await.unwrap(), FrameEvent::Begin(start(frame)));
        let mut came = 0;
        let outcome = loop {
            match panel.frames_rx.recv().await.unwrap() {
                FrameEvent::Batch(batch) => came += batch.count() as u32,
                FrameEvent::End(outcome) => break outcome,
                other => panic!("{other:?}"),
            }
        };
        let frame = FrameNumber(frame);
        assert_eq!(outcome, FrameOutcome::Incomplete { frame, expected: 4000, received: came });
    }
}

/// Every path takes some time.
#[tokio::test]
async fn a_deadline_shorter_than_the_way_is_warned_of_once_a_link() {
    let (page, _logged) = Page::log();
    let warnings = || page.lines(&["WARN", "deadline=0ns"]);
    let udp = shared(1).udp.with_deadline(Duration::ZERO);
    let options = shared(1).with_udp(udp);
    for links in 1..=2 {
        let (mut arm, mut panel) = joined("udp://127.0.0.1:0?mode=deadline", &options).await;
        let mut since = 0;
        for frame in 0.. {
            arm.frames_tx.begin(start(frame)).await.unwrap();
            arm.frames_tx.finish().await.unwrap();
            while !matches!(panel.frames_rx.recv().await.unwrap(), FrameEvent::End(_)) {}
            // Three more frames after the warning do not bring another.
            since += u32::from(warnings() == links);
            if since > 3 {
                break;
            }
        }
        assert_eq!(warnings(), links);
    }
}

/// A frame may be lost there, so the reference is a frame that the peer has confirmed.
#[tokio::test]
async fn with_deadlines_points_travel_coded_against_a_frame_once_it_is_confirmed() {
    let net = net();
    let link = LinkConfig::default().with_batching(Batching { size: BatchSize::default(), coded: true });
    let udp = shared(1).udp.with_deadline(Duration::from_secs(10));
    let options = shared(1).with_link(link).with_udp(udp);
    let (mut arm, mut panel) = joined("udp://127.0.0.1:0?mode=deadline", &options).await;
    // Unordered: without a reference they travel plain.
    let visible = points(2000);
    let mut least = u64::MAX;
    for frame in 0..500 {
        let before = arm.stats.read();
        send_frame(&mut arm.frames_tx, frame, &visible).await.unwrap();
        let bytes = (arm.stats.read() - before).sent.batches.bytes;
        assert!(frame > 0 || bytes > 4000, "{bytes} bytes for the first frame: nothing is confirmed");
        assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, visible);
        least = least.min(bytes);
        if least < 100 {
            break;
        }
        // Time for the acknowledgement.
        sleep_until(&*net, net.now().after(Duration::from_millis(5))).await;
    }
    assert!(least < 100, "{least} bytes for a frame like the one before");
    assert_eq!(arm.stats.read().sent.batches, panel.stats.read().received.batches);
}

#[tokio::test]
async fn packets_are_counted_while_the_link_lives_and_after() {
    let (net, begun) = (net(), net().now());
    let (mut arm, mut panel) = joined("udp://127.0.0.1:0", &shared(1)).await;
    send_frame(&mut arm.frames_tx, 0, &points(50_000)).await.unwrap();
    assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(50_000));
    let [sent, received] = [&arm, &panel].map(|link| link.stats.read().path.unwrap());
    assert!((139..400).contains(&sent.sent) && sent.sent_bytes > 200_000, "{sent:?}");
    assert!(received.received_bytes > 200_000 && received.received <= sent.sent, "{received:?} of {sent:?}");
    assert!((1200..=1452).contains(&sent.datagram_size) && sent.window >= 12_000, "{sent:?}");
    let lasts = net.now().since(begun);
    assert!(sent.round_trip > Duration::ZERO && sent.round_trip <= lasts, "measured in {lasts:?}: {sent:?}");
    let stats = arm.stats.clone();
    let since = stats.read() - stats.read();
    assert_eq!(since.path.map(|path| (path.sent, path.datagram_size > 0)), Some((0, true)));
    drop((arm, panel));
    let last = stats.read().path.unwrap();
    assert!(last.sent >= sent.sent && last.sent_bytes >= sent.sent_bytes, "{last:?} after {sent:?}");
}

#[tokio::test]
async fn nobody_accepting_any_more_leaves_links_as_they_are() {
    let (net, options) = (net(), shared(1));
    let (mut listener, at) = listener(&options).await;
    let (there, here) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &options, soon(&net)), listener.accept(soon(&net)),);
    let (mut there, mut here) = (there.unwrap(), here.unwrap());
    drop(listener);
    for frame in 0..3 {
        send_frame(&mut here.frames_tx, frame, &points(5000)).await.unwrap();
        assert_eq!(receive(&mut there.frames_rx).await.unwrap().points, points(5000));
    }
    let _held: Arc<dyn Net> = net;
}
