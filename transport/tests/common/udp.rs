//! Peers over datagrams on the loopback interface.

use super::{Listener, connect, net, soon};
use trimaran_transport::conformance::{ARM, PANEL, greeting, pose};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Endpoint, Options};

pub(crate) fn with(trust: Trust) -> Options {
    Options::default().with_udp(UdpOptions::default().with_trust(trust))
}

/// Options of peers that share a key.
pub(crate) fn shared(key: u8) -> Options {
    with(Trust::SharedKey([key; 32].into()))
}

pub(crate) async fn listener(options: &Options) -> (Listener, Endpoint) {
    let endpoint = "udp://127.0.0.1:0".parse().unwrap();
    let listener = Listener::bind(&net(), &endpoint, greeting(ARM), options).await.unwrap();
    let endpoint = listener.local_endpoint().clone();
    (listener, endpoint)
}

pub(crate) fn address(endpoint: &Endpoint) -> String {
    let Endpoint::Udp(there) = endpoint else { panic!("{endpoint}") };
    there.at.to_string()
}

/// A panel connects, is admitted, and both ends talk.
pub(crate) async fn a_panel_gets_in(listener: &mut Listener, at: &Endpoint, options: &Options) {
    let net = net();
    let (there, here) =
        tokio::join!(connect(&net, at, greeting(PANEL), options, soon(&net)), listener.accept(soon(&net)),);
    let (mut there, mut here) = (there.unwrap(), here.unwrap());
    there.latest_tx.publish(pose(1)).unwrap();
    assert_eq!(here.latest_rx.latest().await.unwrap(), pose(1));
    here.latest_tx.publish(pose(2)).unwrap();
    assert_eq!(there.latest_rx.latest().await.unwrap(), pose(2));
}
