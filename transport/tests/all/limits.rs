//! Rate limits for peers and strangers.

use std::cell::Cell;
use std::time::Duration;

use trimaran_transport::conformance::{ARM, GRIPPER, Greeting, PANEL, command, greeting, send_frame};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{
    HandshakeError, Limits, LinkConfig, Options, ProtocolError, RecvError, Refusal, TooMany, sleep_until,
    until,
};

use crate::common::meeting::Meeting;
use crate::common::router::Router;
use crate::common::udp::{a_panel_gets_in, shared};
use crate::common::{Link, Listener, connect, last_failure, net, soon};

/// Options of peers that know each other over every transport.
fn trusting() -> Options {
    let keys = Keys::generate("both".parse().unwrap()).unwrap();
    let peers = vec![keys.public().clone().into()].into();
    shared(1).with_security(Security { keys, peers })
}

over_every_transport!(
    one_peer_more_than_there_may_be_is_told_that_it_is_busy_until_another_leaves,
    a_peer_that_floods_the_frames_lane_is_lost_for_it,
    a_peer_that_floods_the_messages_lane_is_lost_for_it,
);

async fn one_peer_more_than_there_may_be_is_told_that_it_is_busy_until_another_leaves(endpoint: &str) {
    let limits = Limits::default().with_peers(1);
    let options = Options::default().with_limits(limits);
    let Meeting { mut listener, at, panel, _folder, .. } = Meeting::at(endpoint, &options).await;
    let net = net();
    let enter = async |role, by| connect(&net, &at, greeting(role), &panel, by).await;
    let (there, here) = tokio::join!(enter(PANEL, soon(&net)), listener.accept(soon(&net)));
    // The last half of a link keeps its place like the whole link.
    let (there, Link { latest_rx, .. }) = (there.unwrap(), here.unwrap());
    let busy = tokio::select! {
        link = enter(GRIPPER, soon(&net)) => panic!("{link:?}"),
        busy = last_failure(&mut listener) => busy,
    };
    assert!(matches!(busy, HandshakeError::Refused(Refusal::Busy)), "{busy:?}");
    assert!(listener.turned_away().no_place > 0, "{:?}", listener.turned_away());
    drop((there, latest_rx));
    let (there, here) = tokio::join!(enter(GRIPPER, soon(&net)), listener.accept(soon(&net)));
    assert!(there.is_ok() && here.is_ok(), "{there:?} {here:?}");
}

/// Over datagrams a peer takes a slot only after its address is validated. One that stops then takes a slot,
/// and no more: it keeps out no later peer.
#[tokio::test]
async fn who_stops_within_a_handshake_makes_room_for_the_next() {
    // The common part of the first byte of a listener's retry: everything else from it is lost.
    for (endpoint, mask, question) in [("udp://127.0.0.1:0", 0x03, 0x02), ("quic://127.0.0.1:0", 0xf0, 0xf0)]
    {
        let hour = Duration::from_secs(3600);
        let link = LinkConfig::default().with_idle_timeout(hour).with_handshake_timeout(hour);
        let limits = Limits::default().with_handshakes(1);
        let options = trusting().with_limits(limits).with_link(link);
        let net = net();
        let wanted = endpoint.parse().unwrap();
        let mut listener = Listener::bind(&net, &wanted, greeting(ARM), &options).await.unwrap();
        let at = listener.local_endpoint().clone();
        let router = Router::before(&at).await;
        let lost = Cell::new(0);
        let meets = async {
            // The first one's answer is lost, and it has the only slot.
            while lost.get() == 0 {
                sleep_until(&*net, net.now().after(Duration::from_millis(1))).await;
            }
            a_panel_gets_in(&mut listener, &at, &options).await;
        };
        let met = tokio::select! {
            link = connect(&net, &router.at, greeting(PANEL), &options, soon(&net)) => panic!("{link:?}"),
            () = router.pass(&lost, |bytes, inwards| inwards || bytes[0] & mask == question) => unreachable!(),
            met = until(&*net, soon(&net), meets) => met,
        };
        assert_eq!(met, Some(()), "{endpoint}: the next one waits");
        assert!(listener.turned_away().no_room > 0, "{endpoint}: {:?}", listener.turned_away());
    }
}

/// An address that shakes hands too often is ignored; others are not.
#[tokio::test]
async fn handshakes_beyond_the_limit_of_a_second_are_turned_away_and_counted() {
    for endpoint in ["udp://127.0.0.1:0", "tcp://127.0.0.1:0", "quic://127.0.0.1:0"] {
        let limits = Limits::default().with_handshakes_per_s_per_address(4);
        let options = trusting()
            .with_limits(limits)
            .with_link(LinkConfig::default().with_handshake_timeout(Duration::from_millis(300)));
        let net = net();
        let mut listener =
            Listener::bind(&net, &endpoint.parse().unwrap(), greeting(ARM), &options).await.unwrap();
        let at = listener.local_endpoint().clone();
        // Refused for their map, so that each connection is one handshake of the second.
        let other = Greeting { map: 7, ..greeting(PANEL) };
        let soon = soon(&net);
        while listener.turned_away().from_address == 0 {
            assert!(net.now() < soon, "{endpoint}: {:?}", listener.turned_away());
            let by = net.now().after(Duration::from_millis(500));
            // At once, so that they begin within a second however slow the machine is.
            let refused = || connect(&net, &at, other.clone(), &options, by);
            let _refused = tokio::join!(refused(), refused(), refused(), refused(), refused());
        }
        a_panel_gets_in(&mut listener, &at, &options).await;
        assert_eq!(listener.turned_away().in_all, 0, "{endpoint}");
    }
}

/// Two links with a listener whose peers may send 200 messages a second.
async fn with_few_messages(endpoint: &str) -> (Link, Link) {
    let link = LinkConfig::default().with_messages_per_s(200);
    let Meeting { mut listener, at, panel, _folder, .. } =
        Meeting::at(endpoint, &Options::default().with_link(link)).await;
    let net = net();
    let (there, here) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &panel, soon(&net)), listener.accept(soon(&net)));
    (there.unwrap(), here.unwrap())
}

/// The flood lasts until its reader fails, whether it ends then or not.
async fn lost_for_it(read: impl Future<Output = RecvError>, flood: impl Future<Output = ()>) {
    let error = tokio::select! {
        biased;
        error = read => error,
        () = flood => panic!("the reader gave up"),
    };
    let RecvError::Protocol { cause: ProtocolError::TooMany(TooMany::Messages(200)), .. } = error else {
        panic!("{error:?}")
    };
}

async fn a_peer_that_floods_the_frames_lane_is_lost_for_it(endpoint: &str) {
    let (mut panel, mut arm) = with_few_messages(endpoint).await;
    let flood = async {
        let mut frame = 0;
        while send_frame(&mut arm.frames_tx, frame, &[]).await.is_ok() {
            frame += 1;
        }
    };
    let read = async {
        loop {
            if let Err(e) = panel.frames_rx.recv().await {
                break e;
            }
        }
    };
    lost_for_it(read, flood).await;
    assert_eq!((panel.stats.read().floods, arm.stats.read().floods), (1, 0));
}

async fn a_peer_that_floods_the_messages_lane_is_lost_for_it(endpoint: &str) {
    let (mut panel, mut arm) = with_few_messages(endpoint).await;
    let flood = async { while arm.messages_tx.send(&command(1)).await.is_ok() {} };
    let read = async {
        loop {
            if let Err(e) = panel.messages_rx.recv().await {
                break e;
            }
        }
    };
    lost_for_it(read, flood).await;
    assert_eq!((panel.stats.read().floods, arm.stats.read().floods), (1, 0));
}
