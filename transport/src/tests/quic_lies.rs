//! An authenticated peer that lies in every length that it sends.

use std::net::SocketAddr;
use std::sync::Arc;

use bytes::Bytes;
use quinn::Connection;
use quinn::crypto::rustls::QuicClientConfig;
use trimaran_wire::{Fixed, Format, Message, Numbered};

use crate::application::{Application, Side};
use crate::conformance::{ARM, PANEL, Pose, Robot, greeting};
use crate::handshake::{Handshake, HandshakeError};
use crate::keys::{Keys, Security};
use crate::quic::QuicOptions;
use crate::quic::connect::endpoint;
use crate::quic::control::{Beside, Control};
use crate::quic::tls::{self, Verifier};
use crate::{
    AcceptError, DecodeFault, Endpoint, Kind, Lane, Link, LinkConfig, Listener, Net, Options, ProtocolError,
    RecvError, SessionId, TokioNet, connect,
};

const HERE: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 0);
const MOST: [u8; 3] = [0xff; 3];

/// The liar's side of the protocol.
fn panel() -> Arc<dyn Application> {
    Side::<Robot>::of(greeting(PANEL)).unwrap()
}

/// A listener, and the keys of a liar that is one of its peers.
struct Setting {
    net: Arc<dyn Net>,
    listener: Listener<Robot>,
    liar: Keys,
    listens: Keys,
    quinn: quinn::Endpoint,
}

impl Setting {
    async fn new() -> Self {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let [listens, liar] = ["listens", "lies"].map(|name| Keys::generate(name.parse().unwrap()).unwrap());
        let security =
            Some(Security { keys: listens.clone(), peers: vec![liar.public().clone().into()].into() });
        let options = Options { security, ..Options::default() };
        let at = Endpoint::Quic(HERE.into());
        let listener = Listener::bind(&net, &at, greeting(ARM), &options).await.unwrap();
        let (quinn, _) =
            endpoint(&net, net.bind_udp(HERE, QuicOptions::default().socket).unwrap(), None).unwrap();
        Self { net, listener, liar, listens, quinn }
    }

    async fn dial(&self) -> Connection {
        let Endpoint::Quic(at) = self.listener.local_endpoint() else { panic!("not QUIC") };
        let verifier = Verifier::new(&[self.listens.public().clone().into()]);
        let crypto = tls::client(&self.liar, &verifier, &panel().protocol()).unwrap();
        let config = quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(crypto).unwrap()));
        self.quinn.connect_with(config, at.to_string().parse().unwrap(), "trimaran").unwrap().await.unwrap()
    }

    /// A link, and the liar's end of it.
    async fn joined(&mut self, session: u64) -> (Link<Robot>, Connection, Control, Beside) {
        let connection = self.dial().await;
        let streams = connection.open_bi().await.unwrap();
        let mut control = Control::new(connection.clone(), streams, Format::of::<Robot>());
        let LinkConfig { versions, idle_timeout, .. } = LinkConfig::default();
        let hello = panel().introduce(versions, SessionId(session), Lane::Frames, idle_timeout.into());
        control.send(&Message::Hello(hello)).await.unwrap();
        let beside = control.open_beside().await.unwrap();
        let soon = self.net.now().after(std::time::Duration::from_secs(60));
        let link = self.listener.accept(soon).await.unwrap();
        control.recv_answer().await.unwrap();
        (link, connection, control, beside)
    }
}

fn kinds() -> Vec<Kind> {
    (0..=u8::MAX).filter_map(Kind::from_code).collect()
}

fn header(kind: Kind) -> [u8; 4] {
    [kind.code(), MOST[0], MOST[1], MOST[2]]
}

fn lied(error: &RecvError, said: Kind) -> bool {
    let RecvError::Protocol { cause: ProtocolError::Decode(e), .. } = error else { return false };
    matches!(e.fault, DecodeFault::Length { kind, length: 0xff_ffff, .. } if kind == said)
}

#[tokio::test]
async fn a_lie_in_every_length_of_the_handshake_is_named() {
    let mut setting = Setting::new().await;
    for kind in kinds() {
        let connection = setting.dial().await;
        let (mut send, _recv) = connection.open_bi().await.unwrap();
        send.write_all(&header(kind)).await.unwrap();
        let failure = loop {
            match setting.listener.accept(setting.net.now()).await {
                Err(AcceptError::Deadline { last: Some(failure), .. }) => break failure,
                Err(AcceptError::Deadline { last: None, .. }) => tokio::task::yield_now().await,
                other => panic!("{other:?}"),
            }
        };
        let HandshakeError::Decode(e) = failure else { panic!("{kind:?}: {failure:?}") };
        assert!(matches!(e.fault, DecodeFault::Length { kind: said, .. } if said == kind), "{e:?}");
    }
}

#[tokio::test]
async fn a_lie_in_every_length_of_a_lane_ends_it() {
    let mut setting = Setting::new().await;
    for (session, kind) in (1..).zip(kinds()) {
        let (mut link, connection, _control, beside) = setting.joined(session).await;
        let Beside { mut messages, mut bulk, .. } = beside;
        let mut stream = connection.open_uni().await.unwrap();
        stream.write_all(&header(kind)).await.unwrap();
        let error = link.frames_rx.recv().await.unwrap_err();
        assert!(lied(&error, kind), "{kind:?}: {error:?}");
        messages.0.write_all(&header(kind)).await.unwrap();
        let error = link.messages_rx.recv().await.unwrap_err();
        assert!(lied(&error, kind), "{kind:?}: {error:?}");
        bulk.0.write_all(&header(kind)).await.unwrap();
        let error = link.bulk.as_mut().unwrap().rx.recv().await.unwrap_err();
        assert!(lied(&error, kind), "{kind:?}: {error:?}");
    }
}

#[tokio::test]
async fn a_value_of_another_length_ends_the_lane() {
    let mut setting = Setting::new().await;
    let whole = Numbered::NUMBER_BYTES + Pose::SIZE;
    for (session, length) in (1..).zip([0, 1, whole - 1, whole + 1]) {
        let (mut link, connection, _control, _beside) = setting.joined(session).await;
        connection.send_datagram(Bytes::from(vec![0; length])).unwrap();
        let error = link.latest_rx.latest().await.unwrap_err();
        assert!(matches!(error, RecvError::Protocol { .. }), "{length} bytes: {error:?}");
    }
}

#[tokio::test]
async fn whoever_lied_may_come_back_with_the_truth() {
    let mut setting = Setting::new().await;
    let (link, connection, control, beside) = setting.joined(1).await;
    drop((link, connection, control, beside));
    let security = Some(Security {
        keys: setting.liar.clone(),
        peers: vec![setting.listens.public().clone().into()].into(),
    });
    let options = Options { security, ..Options::default() };
    let there = setting.listener.local_endpoint().clone();
    let soon = setting.net.now().after(std::time::Duration::from_secs(60));
    let link = connect::<Robot>(&setting.net, &there, greeting(PANEL), &options, soon).await;
    assert!(link.is_ok(), "{link:?}");
}
