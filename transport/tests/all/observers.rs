//! Attackers that see packets, forge packets or hold a listener's address for a moment: a peer retries, and
//! connects afterwards.

use std::cell::Cell;
use std::time::Duration;

use trimaran_transport::conformance::{ARM, Greeting, PANEL, greeting};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{Endpoint, HandshakeError, LinkConfig, Options, Refusal};

use crate::common::forged::{Forgery, Initial};
use crate::common::meeting::Meeting;
use crate::common::router::Router;
use crate::common::{Link, Listener, connect, last_failure, net, soon};

over_every_transport!(a_listener_of_another_map_is_waited_out);

/// Listens at `at` as `who` once the present listener has gone.
async fn bind_when_free(at: &Endpoint, who: Greeting, options: &Options) -> Listener {
    loop {
        match Listener::bind(&net(), at, who.clone(), options).await {
            Err(error) if error.may_pass() => tokio::task::yield_now().await,
            listener => return listener.unwrap(),
        }
    }
}

async fn a_listener_of_another_map_is_waited_out(endpoint: &str) {
    let Meeting { listener, at, panel, ours, _folder } = Meeting::at(endpoint, &Options::default()).await;
    drop(listener);
    let net = net();
    let other = Greeting { map: 0xdead, ..greeting(ARM) };
    let mut stranger = bind_when_free(&at, other, &ours).await;
    let waits = async {
        let known = last_failure(&mut stranger).await;
        assert!(matches!(known, HandshakeError::Refused(Refusal::Rejected(_))), "{known:?}");
        drop(stranger);
        bind_when_free(&at, greeting(ARM), &ours).await.accept(soon(&net)).await
    };
    let (there, here) = tokio::join!(connect(&net, &at, greeting(PANEL), &panel, soon(&net)), waits);
    assert!(there.is_ok() && here.is_ok(), "{there:?} {here:?}");
}

/// The stranger has keys that the panel does not know, or does not know the panel's.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_listener_whose_keys_do_not_fit_is_waited_out() {
    for knows_us in [true, false] {
        let Meeting { listener, at, panel, ours, _folder } =
            Meeting::at("quic://127.0.0.1:0", &Options::default()).await;
        drop(listener);
        let keys = Keys::generate("stranger".parse().unwrap()).unwrap();
        let security = ours.security.clone().unwrap();
        let security = match knows_us {
            true => Security { keys, ..security },
            false => Security { peers: vec![keys.public().clone().into()].into(), ..security },
        };
        let strange = ours.clone().with_security(Some(security));
        let mut stranger = bind_when_free(&at, greeting(ARM), &strange).await;
        let net = net();
        let waits = async {
            last_failure(&mut stranger).await;
            drop(stranger);
            bind_when_free(&at, greeting(ARM), &ours).await.accept(soon(&net)).await
        };
        let (there, here) = tokio::join!(connect(&net, &at, greeting(PANEL), &panel, soon(&net)), waits);
        assert!(there.is_ok() && here.is_ok(), "{knows_us}: {there:?} {here:?}");
    }
}

/// An attacker on the path sees the first packets of a handshake and forges an answer before the listener's
/// arrives.
async fn gets_in_in_spite_of(forgery: Forgery) -> (Link, Link) {
    // An attempt misled by a forgery ends with this.
    let link = LinkConfig::default().with_handshake_timeout(Duration::from_millis(500));
    let options = Options::default().with_link(link);
    let Meeting { mut listener, at, panel, .. } = Meeting::at("quic://127.0.0.1:0", &options).await;
    let router = Router::before(&at).await;
    let (forged, mut attempts) = (Cell::new(0), Vec::new());
    let observed = router.pass_and_forge(&forged, |datagram| {
        let initial = Initial::parse(datagram)?;
        let known = attempts.contains(&initial.source);
        if !known {
            attempts.push(initial.source.clone());
        }
        (attempts.len() <= 2 && !known).then(|| initial.forge(forgery))
    });
    let net = net();
    let links = tokio::select! {
        links = async {
            tokio::join!(
                connect(&net, &router.at, greeting(PANEL), &panel, soon(&net)),
                listener.accept(soon(&net)),
            )
        } => (links.0.unwrap(), links.1.unwrap()),
        () = observed => unreachable!(),
    };
    assert!(forged.get() > 0, "{forgery:?}: nothing was forged");
    links
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn forged_packets_end_no_attempt_to_connect_over_quic() {
    for forgery in Forgery::ALL {
        let (there, here) = gets_in_in_spite_of(forgery).await;
        assert_eq!(there.peer.session, here.peer.session, "{forgery:?}");
    }
}
