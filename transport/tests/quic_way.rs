//! Links over QUIC when the way between the peers loses packets, or changes under the connection.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::net::SocketAddr;

use common::{camera, identity, ids, net, receive, soon, start};
use tokio::net::UdpSocket;
use tokio::sync::Notify;
use trimaran_proto::Role;
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::quic::{Congestion, QuicOptions};
use trimaran_transport::{Endpoint, Link, Listener, Options, connect, until};

/// Passes datagrams on between a peer and a listener, as a router does that translates addresses.
struct Router {
    outside: UdpSocket,
    listener: SocketAddr,
    /// Rings when the router is to take another address towards the listener, as one does that was restarted.
    restart: Notify,
}

impl Router {
    async fn before(listener: &Endpoint) -> (Self, Endpoint) {
        let outside = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let Endpoint::Quic(at) = listener else { panic!("{listener}") };
        let endpoint = Endpoint::Quic(outside.local_addr().unwrap().into());
        let listener = at.to_string().parse().unwrap();
        (Self { outside, listener, restart: Notify::new() }, endpoint)
    }

    /// Passes on for ever what `keep` says; counts what it does not.
    async fn pass(&self, lost: &std::cell::Cell<u32>, mut keep: impl FnMut() -> bool) {
        let (mut inside, mut peer) = (self.inside().await, None);
        let (mut a, mut b) = (vec![0; 2000], vec![0; 2000]);
        loop {
            tokio::select! {
                () = self.restart.notified() => inside = self.inside().await,
                got = self.outside.recv_from(&mut a) => {
                    let (length, from) = got.unwrap();
                    peer = Some(from);
                    if keep() {
                        inside.send(&a[..length]).await.unwrap();
                    } else {
                        lost.set(lost.get() + 1);
                    }
                }
                got = inside.recv(&mut b) => {
                    let length = got.unwrap();
                    if keep() {
                        self.outside.send_to(&b[..length], peer.unwrap()).await.unwrap();
                    } else {
                        lost.set(lost.get() + 1);
                    }
                }
            }
        }
    }

    async fn inside(&self) -> UdpSocket {
        let inside = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        inside.connect(self.listener).await.unwrap();
        inside
    }
}

/// Options of two peers that know each other.
fn acquainted(quic: QuicOptions) -> [Options; 2] {
    let keys = ["a", "b"].map(|name| Keys::generate(name.parse().unwrap()).unwrap());
    let [a, b] = keys.each_ref().map(|keys| keys.public().clone());
    let [ours, theirs] = keys;
    [(ours, b), (theirs, a)].map(|(keys, peer)| {
        let security = Some(Security { keys, peers: vec![peer] });
        Options { security, quic, ..Options::default() }
    })
}

/// Runs `talk` between two peers with a router between them that keeps what `keep` says; gives how many it lost.
async fn through_a_router(
    quic: QuicOptions,
    keep: impl FnMut() -> bool,
    talk: impl AsyncFn(&mut Link, &mut Link, &Router),
) -> u32 {
    let net = net();
    let [ours, theirs] = acquainted(quic);
    let endpoint = "quic://127.0.0.1:0".parse().unwrap();
    let mut listener = Listener::bind(&net, &endpoint, identity(Role::SwitchA), &ours).await.unwrap();
    let (router, through) = Router::before(listener.local_endpoint()).await;
    let lost = std::cell::Cell::new(0);
    let session = async {
        let (there, here) = tokio::join!(
            connect(&net, &through, identity(Role::Display), &theirs, soon(&net)),
            listener.accept(soon(&net)),
        );
        let (mut here, mut there) = (here.unwrap(), there.unwrap());
        talk(&mut here, &mut there, &router).await;
    };
    tokio::select! {
        ended = until(&*net, soon(&net), session) => assert!(ended.is_some(), "it never came through"),
        () = router.pass(&lost, keep) => {}
    }
    lost.get()
}

/// The machine sends a frame of ids and the display cameras; both get them.
async fn a_frame_and_cameras(machine: &mut Link, display: &mut Link, frame: u32, count: u32) {
    let send = async {
        machine.frames_tx.begin(start(frame)).await.unwrap();
        machine.frames_tx.push(&ids(count)).await.unwrap();
        machine.frames_tx.finish().await.unwrap();
    };
    for number in 0..10 {
        display.latest_tx.publish(camera(frame * 10 + number)).unwrap();
    }
    let ((), got) = tokio::join!(send, receive(&mut display.frames_rx));
    let got = got.unwrap();
    assert!(got.start == start(frame) && got.ids == ids(count), "frame {frame}");
    // Cameras may be lost, but never the last one, and none comes before an older one.
    let mut last = None;
    while last != Some(frame * 10 + 9) {
        let seen = machine.latest_rx.latest().await.unwrap().frame().0;
        assert!(last.is_none_or(|last| last < seen), "{seen} after {last:?}");
        last = Some(seen);
    }
}

#[tokio::test]
async fn frames_are_complete_and_the_last_camera_comes_whatever_is_lost() {
    for congestion in Congestion::ALL {
        // A fixed pattern without a period: about one packet in twelve is lost, in bursts now and then.
        let mut state = 7_u32;
        let keep = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            !(state >> 16).is_multiple_of(12)
        };
        let quic = QuicOptions { congestion, ..QuicOptions::default() };
        let lost = through_a_router(quic, keep, async |machine, display, _| {
            for frame in 0..8 {
                a_frame_and_cameras(machine, display, frame, 4000).await;
            }
        });
        assert!(lost.await > 5, "{congestion:?}: the way lost next to nothing");
    }
}

#[tokio::test]
async fn a_link_outlives_a_router_that_takes_another_address() {
    let quic = QuicOptions::default();
    through_a_router(
        quic,
        || true,
        async |machine, display, router| {
            for frame in 0..4 {
                a_frame_and_cameras(machine, display, frame, 4000).await;
                router.restart.notify_one();
            }
        },
    )
    .await;
}
