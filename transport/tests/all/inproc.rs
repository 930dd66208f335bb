//! Links within one process.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use trimaran_transport::conformance::{
    ARM, Greeting, MAP, Overhead, PANEL, Pairs, Robot, greeting, points, pose, receive, send_frame,
};
use trimaran_transport::inproc;
use trimaran_transport::{
    AttemptError, BatchSize, ConnectError, Endpoint, HandshakeError, LinkConfig, ListenError, Options,
    PeerAddress, Protocol,
};

use crate::common::{Link, Listener, connect, joined, met, net, other_map, soon};

struct Inproc;

impl Pairs for Inproc {
    fn overhead(&self) -> Overhead {
        Overhead { header_bytes: 0, handshake: 0, coded: false }
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        link: LinkConfig,
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        static NAMES: AtomicU32 = AtomicU32::new(0);
        let at = format!("inproc:conformance-{}", NAMES.fetch_add(1, Ordering::Relaxed));
        met(&at, &Options::default().with_link(link), hellos, within).await
    }

    async fn pair(&self, config: LinkConfig) -> (Link, Link) {
        inproc::pair(&net(), greeting(ARM), greeting(PANEL), &config).unwrap()
    }
}

trimaran_transport::conformance!(Inproc);

#[tokio::test]
async fn peers_that_do_not_go_together_get_no_link() {
    let other = Greeting { map: 1, ..greeting(PANEL) };
    let refused = inproc::pair::<Robot>(&net(), greeting(ARM), other, &LinkConfig::default());
    let expected = other_map(MAP, 1);
    assert!(matches!(&refused, Err(HandshakeError::Refused(known)) if *known == expected), "{refused:?}");
}

#[tokio::test]
async fn each_end_knows_the_other_and_the_panels_batch_size() {
    let wants = Greeting { batch: BatchSize::new(3).ok(), ..greeting(PANEL) };
    let (mut arm, mut panel) =
        inproc::pair(&net(), greeting(ARM), wants.clone(), &LinkConfig::default()).unwrap();
    assert_eq!(arm.peer.hello, wants);
    assert_eq!(panel.peer.hello, greeting(ARM));
    assert_eq!(arm.peer.address, PeerAddress::InProcess);
    send_frame(&mut arm.frames_tx, 0, &points(7)).await.unwrap();
    assert_eq!(receive(&mut panel.frames_rx).await.unwrap().batches, [3, 3, 1]);
}

#[tokio::test]
async fn a_listener_is_found_by_name_and_its_name_is_free_when_it_is_gone() {
    let options = Options::default();
    for _ in 0..2 {
        let (mut arm, mut panel) = joined("inproc:found-by-name", &options).await;
        assert_eq!((&arm.peer.hello, &panel.peer.hello), (&greeting(PANEL), &greeting(ARM)));
        assert_eq!(arm.peer.session, panel.peer.session);
        assert!(arm.capabilities().local && arm.capabilities().ordered);
        panel.latest_tx.publish(pose(3)).unwrap();
        assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(3));
    }
}

#[tokio::test]
async fn a_name_belongs_to_one_listener() {
    let (net, options) = (net(), Options::default());
    let endpoint: Endpoint = "inproc:taken".parse().unwrap();
    let _holder = Listener::bind(&net, &endpoint, greeting(ARM), &options).await.unwrap();
    let error = Listener::bind(&net, &endpoint, greeting(ARM), &options).await.unwrap_err();
    assert!(matches!(&error, ListenError::InUse { endpoint: named } if *named == endpoint), "{error:?}");
}

#[tokio::test(start_paused = true)]
async fn nobody_under_a_name_ends_at_the_deadline() {
    let (net, options) = (net(), Options::default());
    let endpoint: Endpoint = "inproc:nobody".parse().unwrap();
    let error = connect(&net, &endpoint, greeting(PANEL), &options, soon(&net)).await.unwrap_err();
    let ConnectError::Deadline { attempts, last: AttemptError::Nobody { name }, .. } = error else {
        panic!("{error:?}")
    };
    // Pauses are a tenth of the time so far, from 100 ms to 2 s, each cut by up to a half at random: about 81
    // in a minute. Without randomness there would be 61.
    assert!((66..100).contains(&attempts), "{attempts} attempts");
    assert_eq!(name.as_str(), "nobody");
}
