//! Links over datagrams, QUIC and this project's own, when the path loses packets, or changes under the
//! connection.

use std::cell::Cell;

use trimaran_transport::conformance::{ARM, PANEL, greeting, points, pose, receive, send_frame, start};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::quic::{Congestion, QuicOptions};
use trimaran_transport::{Options, until};

use crate::common::router::Router;
use crate::common::{Link, Listener, connect, net, soon};

/// Options of two peers that know each other.
fn acquainted(quic: QuicOptions) -> [Options; 2] {
    let keys = ["a", "b"].map(|name| Keys::generate(name.parse().unwrap()).unwrap());
    let [a, b] = keys.each_ref().map(|keys| keys.public().clone());
    let [ours, theirs] = keys;
    [(ours, b), (theirs, a)].map(|(keys, peer)| {
        let security = Some(Security { keys, peers: vec![peer.into()].into() });
        Options::default().with_security(security).with_quic(quic)
    })
}

/// Runs `talk` between two peers with a router between them that keeps packets by `keep`; returns how many it
/// lost.
async fn through_a_router(
    transport: &str,
    quic: QuicOptions,
    mut keep: impl FnMut() -> bool,
    talk: impl AsyncFn(&mut Link, &mut Link, &Router),
) -> u32 {
    let net = net();
    let [ours, theirs] = acquainted(quic);
    let endpoint = format!("{transport}://127.0.0.1:0").parse().unwrap();
    let mut listener = Listener::bind(&net, &endpoint, greeting(ARM), &ours).await.unwrap();
    let router = Router::before(listener.local_endpoint()).await;
    let lost = Cell::new(0);
    let session = async {
        let (there, here) = tokio::join!(
            connect(&net, &router.at, greeting(PANEL), &theirs, soon(&net)),
            listener.accept(soon(&net)),
        );
        let (mut here, mut there) = (here.unwrap(), there.unwrap());
        talk(&mut here, &mut there, &router).await;
    };
    tokio::select! {
        ended = until(&*net, soon(&net), session) => assert!(ended.is_some(), "it never came through"),
        () = router.pass(&lost, |_, _| keep()) => {}
    }
    lost.get()
}

/// The machine sends a frame of points and the panel poses; both get them.
async fn a_frame_and_poses(machine: &mut Link, panel: &mut Link, frame: u32, count: u32) {
    let send = async {
        send_frame(&mut machine.frames_tx, frame, &points(count)).await.unwrap();
    };
    for number in 0..10 {
        panel.latest_tx.publish(pose(frame * 10 + number)).unwrap();
    }
    let ((), got) = tokio::join!(send, receive(&mut panel.frames_rx));
    let got = got.unwrap();
    assert!(got.start == start(frame) && got.points == points(count), "frame {frame}");
    // Poses may be lost, but never the last one, and none comes before an older one.
    let mut last = None;
    while last != Some(frame * 10 + 9) {
        let seen = machine.latest_rx.latest().await.unwrap().number;
        assert!(last.is_none_or(|last| last < seen), "{seen} after {last:?}");
        last = Some(seen);
    }
}

#[tokio::test]
async fn frames_are_complete_and_the_last_pose_comes_whatever_is_lost() {
    let controls =
        [Congestion::Cubic, Congestion::Bbr, Congestion::NewReno].map(|congestion| ("quic", congestion));
    for (transport, congestion) in controls.into_iter().chain([("udp", Congestion::default())]) {
        // A fixed pattern without a period: about one packet in twelve is lost, in bursts now and then.
        let mut state = 7_u32;
        let keep = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            !(state >> 16).is_multiple_of(12)
        };
        let quic = QuicOptions::default().with_congestion(congestion);
        let lost = through_a_router(transport, quic, keep, async |machine, panel, _| {
            for frame in 0..8 {
                a_frame_and_poses(machine, panel, frame, 4000).await;
            }
        });
        assert!(lost.await > 5, "{transport}, {congestion:?}: the way lost next to nothing");
    }
}

/// Keeps talking while the router changes something each time.
async fn a_link_outlives(transport: &str, change: impl AsyncFn(&Router)) {
    let quic = QuicOptions::default();
    let lost = through_a_router(
        transport,
        quic,
        || true,
        async |machine, panel, router| {
            for frame in 0..4 {
                a_frame_and_poses(machine, panel, frame, 4000).await;
                change(router).await;
            }
        },
    );
    assert_eq!(lost.await, 0);
}

#[tokio::test]
async fn a_link_outlives_a_router_that_takes_another_address_towards_the_listener() {
    for transport in ["quic", "udp"] {
        a_link_outlives(transport, async |router| router.restart.notify_one()).await;
    }
}

/// QUIC's clients do not follow a listener that moves (RFC 9000, section 9).
#[tokio::test]
async fn a_link_over_datagrams_outlives_a_router_that_takes_another_address_towards_who_connects() {
    a_link_outlives("udp", async |router| router.turn.notify_one()).await;
    // One after the other: both at once would leave neither side at its known address.
    let turns = Cell::new(0);
    a_link_outlives("udp", async |router| {
        turns.set(turns.get() + 1);
        if turns.get() % 2 == 0 { &router.turn } else { &router.restart }.notify_one();
    })
    .await;
}
