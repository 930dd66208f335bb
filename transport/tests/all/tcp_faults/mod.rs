//! Strangers, lying and dying peers over real sockets: each ends in a typed error at the other peer.

mod handshake;
mod link;

use std::net::SocketAddr;
use std::sync::Arc;

use bytes::BytesMut;
use trimaran_transport::conformance::{ARM, PANEL, greeting};
use trimaran_transport::{Endpoint, Lane, Net, Options, SessionId};
use trimaran_wire::Message;

use crate::common::{Listener, introduce};

const SESSION: SessionId = SessionId(0x1234);

async fn listener(net: &Arc<dyn Net>, options: &Options) -> (Listener, SocketAddr) {
    let listener =
        Listener::bind(net, &"tcp://127.0.0.1:0".parse().unwrap(), greeting(ARM), options).await.unwrap();
    let Endpoint::Tcp(at) = listener.local_endpoint() else { panic!("no TCP") };
    let address = at.to_string().parse().unwrap();
    (listener, address)
}

fn bytes(messages: &[Message]) -> BytesMut {
    let mut out = BytesMut::new();
    messages.iter().for_each(|message| message.encode(&mut out));
    out
}

fn hello(lane: Lane) -> Message {
    introduce(&greeting(PANEL), SESSION, lane)
}
