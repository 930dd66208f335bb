//! What peers and strangers may ask for in a second, and what becomes of more.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod common;

use std::time::Duration;

use common::udp::{a_display_gets_in, shared};
use common::{identity, joined, net, start};
use trimaran_proto::{Identity, Role, SceneHash};
use trimaran_transport::{Limits, LinkConfig, Listener, Options, ProtocolError, RecvError, TooMany, connect};

/// An address that shakes hands too often is not even heard; others are.
#[tokio::test]
async fn handshakes_beyond_the_limit_of_a_second_are_turned_away_and_counted() {
    for endpoint in ["udp://127.0.0.1:0", "tcp://127.0.0.1:0"] {
        let limits = Limits { handshakes_per_s_per_address: 2, ..Limits::default() };
        let options = Options { limits, handshake: Duration::from_millis(300), ..shared(1) };
        let net = net();
        let mut listener =
            Listener::bind(&net, &endpoint.parse().unwrap(), identity(Role::SwitchA), &options)
                .await
                .unwrap();
        let at = listener.local_endpoint().clone();
        // Refused for their scene, so that each connection is one handshake of the second.
        let other = Identity { scene: SceneHash(7), ..identity(Role::Display) };
        let begun = net.now();
        while listener.turned_away().from_address == 0 {
            assert!(
                net.now().since(begun) < Duration::from_secs(20),
                "{endpoint}: {:?}",
                listener.turned_away()
            );
            let soon = net.now().after(Duration::from_millis(500));
            let _refused = connect(&net, &at, other, &options, soon).await;
        }
        a_display_gets_in(&mut listener, &at, &options).await;
        assert_eq!(listener.turned_away().in_all, 0, "{endpoint}");
    }
}

#[tokio::test]
async fn a_peer_that_floods_the_lane_is_lost_for_it() {
    let link = LinkConfig { messages_per_s: 200, ..LinkConfig::default() };
    let options = Options { link, ..shared(1) };
    for endpoint in ["udp://127.0.0.1:0", "tcp://127.0.0.1:0"] {
        let (mut a, mut display) = joined(endpoint, &options).await;
        let flood = async {
            for frame in 0..1000 {
                let sent = async {
                    a.frames_tx.begin(start(frame)).await?;
                    a.frames_tx.finish().await
                };
                if sent.await.is_err() {
                    break;
                }
            }
        };
        let read = async {
            loop {
                if let Err(e) = display.frames_rx.recv().await {
                    break e;
                }
            }
        };
        let (_, error) = tokio::join!(flood, read);
        let RecvError::Protocol { cause: ProtocolError::TooMany(TooMany::Messages(200)), .. } = error else {
            panic!("{endpoint}: {error:?}")
        };
        assert_eq!((display.stats.read().floods, a.stats.read().floods), (1, 0), "{endpoint}");
    }
}
