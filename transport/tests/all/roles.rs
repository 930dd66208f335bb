//! Keys are bound to roles: the key of one role is refused for another, and the listener goes on waiting for
//! the right one.

use trimaran_transport::conformance::{ARM, GRIPPER, PANEL, greeting};
use trimaran_transport::keys::{Keys, KnownPeer, PeerKey, Security, WrongRole};
use trimaran_transport::{CloseReason, Endpoint, Explanation, HandshakeError, Options, RecvError, Refusal};

use crate::common::page::Page;
use crate::common::{Link, Listener, connect, last_failure, net, obstacle, refusal, soon};

const ENDPOINTS: [&str; 2] = ["quic://127.0.0.1:0", "udp://127.0.0.1:0"];

fn keys(name: &str) -> Keys {
    Keys::generate(name.parse().unwrap()).unwrap()
}

/// A peer that has `keys` and knows those, each in its role.
fn knowing(keys: &Keys, peers: &[(&Keys, Option<&str>)]) -> Options {
    let known = |(peer, role): &(&Keys, Option<&str>)| {
        let keys = peer.public().clone();
        role.map_or_else(|| keys.clone().into(), |role| KnownPeer::in_role(keys.clone(), role))
    };
    let peers = peers.iter().map(known).collect();
    Options::default().with_security(Security { keys: keys.clone(), peers })
}

/// A panel that knows two machines, and the options of each.
struct Show {
    listener: Listener,
    at: Endpoint,
    first: Keys,
    second: Keys,
    panel: Keys,
}

impl Show {
    async fn at(endpoint: &str) -> Self {
        let [first, second, panel] = ["first", "second", "panel"].map(keys);
        let options = knowing(&panel, &[(&first, Some(ARM)), (&second, Some(GRIPPER))]);
        let endpoint = endpoint.parse().unwrap();
        let listener = Listener::bind(&net(), &endpoint, greeting(PANEL), &options).await.unwrap();
        let at = listener.local_endpoint().clone();
        Self { listener, at, first, second, panel }
    }

    /// The listener's refusal of a peer with these keys that claims this role.
    async fn claim(&self, keys: &Keys, role: &str) -> Refusal {
        let options = knowing(keys, &[(&self.panel, Some(PANEL))]);
        refusal(&net(), &self.at, greeting(role), &options).await
    }

    /// Both ends of a link with the machine of these keys.
    async fn joins(&mut self, keys: &Keys, role: &str) -> (Link, Link) {
        let options = knowing(keys, &[(&self.panel, Some(PANEL))]);
        let net = net();
        let (there, here) = tokio::join!(
            connect(&net, &self.at, greeting(role), &options, soon(&net)),
            self.listener.accept(soon(&net)),
        );
        let (there, here) = (there.unwrap(), here.unwrap());
        assert_eq!((&there.peer.hello, &here.peer.hello), (&greeting(PANEL), &greeting(role)));
        (there, here)
    }
}

fn key(endpoint: &Endpoint, keys: &Keys) -> PeerKey {
    match endpoint {
        Endpoint::Quic(_) => PeerKey::Quic(keys.public().quic.unwrap()),
        Endpoint::Udp(_) => PeerKey::Udp(keys.public().udp),
        other => panic!("{other}"),
    }
}

#[tokio::test]
async fn a_key_that_claims_another_role_is_refused_by_name_and_the_right_one_still_gets_in() {
    for endpoint in ENDPOINTS {
        let (page, logged) = Page::log();
        let mut show = Show::at(endpoint).await;
        let (first, second) = (show.first.clone(), show.second.clone());

        // It has come in its own role: a key is not valid for both.
        let its_own = show.joins(&second, GRIPPER).await;
        for _ in 0..3 {
            let refused = show.claim(&second, ARM).await;
            assert_eq!(
                refused,
                Refusal::Key { claimed: Explanation::new(ARM), known: Explanation::new(GRIPPER) },
                "{endpoint}"
            );
            let HandshakeError::WrongRole(claim) = last_failure(&mut show.listener).await else {
                panic!("{endpoint}")
            };
            let expected = WrongRole {
                name: "second".parse().unwrap(),
                key: key(&show.at, &second),
                claimed: ARM.to_owned(),
                known: GRIPPER.to_owned(),
            };
            assert_eq!(*claim, expected, "{endpoint}");
        }
        let said = format!(
            "key 'second' ({}) claims to be arm; this configuration knows it as gripper",
            key(&show.at, &second)
        );
        assert_eq!(page.lines(&[&said]), 1, "{endpoint}, once");
        drop(logged);

        let other = show.joins(&first, ARM).await;
        drop((its_own, other));
    }
}

/// The connecting side knows the listener, but not as a panel.
#[tokio::test]
async fn a_listener_that_claims_another_role_is_not_believed_and_learns_why() {
    for endpoint in ENDPOINTS {
        let mut show = Show::at(endpoint).await;
        let options = knowing(&show.first, &[(&show.panel, Some(GRIPPER))]);
        let net = net();
        let (cause, link) = tokio::join!(obstacle(&net, &show.at, greeting(ARM), &options), async {
            let mut link = show.listener.accept(soon(&net)).await.unwrap();
            link.frames_rx.recv().await
        });
        let HandshakeError::WrongRole(claim) = cause else { panic!("{endpoint}: {cause:?}") };
        assert_eq!((claim.claimed.as_str(), claim.known.as_str()), (PANEL, GRIPPER), "{endpoint}");
        assert_eq!(claim.name.as_str(), "panel", "{endpoint}");
        let Err(RecvError::Closed { reason, .. }) = link else { panic!("{endpoint}: {link:?}") };
        let expected = "its peer claims to be panel, with a key that is known as that of gripper";
        assert_eq!(
            (reason.code, reason.to_string()),
            (CloseReason::REFUSED, expected.to_owned()),
            "{endpoint}"
        );
        let first = show.first.clone();
        show.joins(&first, ARM).await;
    }
}

/// One machine may be known for two roles, and for any.
#[tokio::test]
async fn a_key_may_be_known_for_several_roles_or_for_any() {
    for endpoint in ENDPOINTS {
        for roles in [&[Some(ARM), Some(PANEL)][..], &[None]] {
            let [ours, theirs] = ["ours", "theirs"].map(keys);
            let known: Vec<_> = roles.iter().map(|role| (&theirs, *role)).collect();
            let options = knowing(&ours, &known);
            let wanted = endpoint.parse().unwrap();
            let mut listener = Listener::bind(&net(), &wanted, greeting(GRIPPER), &options).await.unwrap();
            let at = listener.local_endpoint().clone();
            for role in [ARM, PANEL] {
                let net = net();
                let theirs = knowing(&theirs, &[(&ours, None)]);
                let (there, here) = tokio::join!(
                    connect(&net, &at, greeting(role), &theirs, soon(&net)),
                    listener.accept(soon(&net)),
                );
                assert_eq!(there.unwrap().peer.hello, greeting(GRIPPER), "{endpoint}");
                assert_eq!(here.unwrap().peer.hello, greeting(role), "{endpoint}");
            }
        }
    }
}
