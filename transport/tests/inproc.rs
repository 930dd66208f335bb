//! Links within one process.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use common::conformance::Pairs;
use common::{SCENE, identity, joined, net, settings, soon};
use trimaran_proto::{Identity, Refusal, Role, SceneHash};
use trimaran_transport::{
    AttemptError, ConnectError, Endpoint, Link, LinkConfig, ListenError, Listener, Options, PeerAddress,
    connect, inproc,
};

struct Inproc;

impl Pairs for Inproc {
    const HEADER: u64 = 0;
    const CODES: bool = false;
    const HANDSHAKE: u64 = 0;

    async fn pair(&self, config: LinkConfig) -> (Link, Link) {
        inproc::pair(&net(), identity(Role::SwitchA), identity(Role::Display), &config).unwrap()
    }
}

conformance!(Inproc);

#[tokio::test]
async fn peers_that_do_not_go_together_get_no_link() {
    let other = Identity { scene: SceneHash(1), ..identity(Role::Display) };
    let refused = inproc::pair(&net(), identity(Role::SwitchA), other, &LinkConfig::default());
    assert_eq!(refused.unwrap_err(), Refusal::Scene { listener: SCENE, connector: SceneHash(1) });
}

#[tokio::test]
async fn each_end_knows_the_other_and_the_displays_batch_size() {
    let display = Identity { settings: Some(settings(3)), ..identity(Role::Display) };
    let (mut a, mut d) =
        inproc::pair(&net(), identity(Role::SwitchA), display, &LinkConfig::default()).unwrap();
    assert_eq!(a.peer.identity, display);
    assert_eq!(d.peer.identity, identity(Role::SwitchA));
    assert_eq!(a.peer.address, PeerAddress::InProcess);
    a.frames_tx.begin(common::start(0)).await.unwrap();
    a.frames_tx.push(&common::ids(7)).await.unwrap();
    a.frames_tx.finish().await.unwrap();
    assert_eq!(common::receive(&mut d.frames_rx).await.unwrap().batches, [3, 3, 1]);
}

#[tokio::test]
async fn a_listener_is_found_by_name_and_its_name_is_free_when_it_is_gone() {
    let options = Options::default();
    for _ in 0..2 {
        let (mut a, mut display) = joined("inproc:found-by-name", &options).await;
        assert_eq!((a.peer.identity.role, display.peer.identity.role), (Role::Display, Role::SwitchA));
        assert_eq!(a.peer.session, display.peer.session);
        assert!(a.capabilities().local && a.capabilities().ordered);
        display.latest_tx.publish(common::camera(3)).unwrap();
        assert_eq!(a.latest_rx.latest().await.unwrap(), common::camera(3));
    }
}

#[tokio::test]
async fn a_name_belongs_to_one_listener() {
    let (net, options) = (net(), Options::default());
    let endpoint: Endpoint = "inproc:taken".parse().unwrap();
    let _holder = Listener::bind(&net, &endpoint, identity(Role::SwitchA), &options).await.unwrap();
    let error = Listener::bind(&net, &endpoint, identity(Role::SwitchA), &options).await.unwrap_err();
    assert!(matches!(&error, ListenError::InUse { endpoint: named } if *named == endpoint), "{error:?}");
}

#[tokio::test(start_paused = true)]
async fn nobody_under_a_name_ends_at_the_deadline() {
    let (net, options) = (net(), Options::default());
    let endpoint: Endpoint = "inproc:nobody".parse().unwrap();
    let error = connect(&net, &endpoint, identity(Role::Display), &options, soon(&net)).await.unwrap_err();
    let ConnectError::Deadline { attempts, last: AttemptError::Nobody { name }, .. } = error else {
        panic!("{error:?}")
    };
    // Pauses double from 100 ms to 2 s, each cut by up to a half at random: about 43 in a minute. Without
    // chance there would be 34.
    assert!((36..60).contains(&attempts), "{attempts} attempts");
    assert_eq!(name.as_str(), "nobody");
}

#[tokio::test]
async fn a_listener_within_the_process_refuses_as_any_other() {
    let (net, options) = (net(), Options::default());
    let endpoint: Endpoint = "inproc:picky".parse().unwrap();
    let _listener = Listener::bind(&net, &endpoint, identity(Role::SwitchA), &options).await.unwrap();
    let other = Identity { scene: SceneHash(1), ..identity(Role::Display) };
    let expected = Refusal::Scene { listener: SCENE, connector: SceneHash(1) };
    assert_eq!(common::refusal(&net, &endpoint, other, &options).await, expected);
}
