//! Links within one process.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use common::conformance::Pairs;
use common::{SCENE, identity, net, settings};
use trimaran_proto::{Identity, Refusal, Role, SceneHash};
use trimaran_transport::{Link, LinkConfig, PeerAddress, inproc};

struct Inproc;

impl Pairs for Inproc {
    const HEADER: u64 = 0;
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
