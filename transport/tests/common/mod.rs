//! Code shared by the transport tests: peers and how they connect.
#![allow(dead_code, unused_imports, unused_macros, reason = "each test program uses a part")]

#[cfg(feature = "quic")]
pub(crate) mod forged;
#[cfg(feature = "keys")]
#[macro_use]
pub(crate) mod meeting;
pub(crate) mod page;
pub(crate) mod ports;
pub(crate) mod router;
#[cfg(feature = "udp")]
pub(crate) mod udp;

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use trimaran_transport::conformance::{ARM, Greeting, PANEL, Robot, greeting, meet};
use trimaran_transport::{
    AcceptError, AttemptError, ConnectError, Endpoint, HandshakeError, Instant, Lane, LinkConfig, Net,
    Options, Protocol, ProtocolName, Refusal, Rejection, SessionId, TokioNet, WireVersion, WireVersions,
};
use trimaran_wire::{Accept, ChannelList, Format, Hello, Message};

pub(crate) type Link = trimaran_transport::Link<Robot>;
pub(crate) type Listener = trimaran_transport::Listener<Robot>;

/// As [`trimaran_transport::connect`].
pub(crate) async fn connect(
    net: &Arc<dyn Net>,
    at: &Endpoint,
    who: Greeting,
    options: &Options,
    deadline: Instant,
) -> Result<Link, ConnectError> {
    trimaran_transport::connect(net, at, who, options, deadline).await
}

pub(crate) fn net() -> Arc<dyn Net> {
    Arc::new(TokioNet::current().unwrap())
}

pub(crate) fn soon(net: &Arc<dyn Net>) -> Instant {
    net.now().after(Duration::from_secs(60))
}

/// The sizes of the peers' values.
pub(crate) fn format() -> Format {
    Format::of::<Robot>()
}

/// A peer's hello as bytes.
pub(crate) fn hello_bytes(who: &Greeting) -> Bytes {
    postcard::to_stdvec(who).unwrap().into()
}

/// The first message of a connecting peer.
pub(crate) fn introduce(who: &Greeting, session: SessionId, lane: Lane) -> Message {
    let protocol = ProtocolName::new(Robot::NAME);
    let (idle_timeout, application) = (LinkConfig::default().idle_timeout.into(), hello_bytes(who));
    let (versions, channels) = (WireVersions::SUPPORTED, ChannelList::default());
    Message::Hello(Hello { versions, protocol, session, lane, idle_timeout, channels, application })
}

/// The answer of the listening peer.
pub(crate) fn answer() -> Message {
    let (idle_timeout, application) =
        (LinkConfig::default().idle_timeout.into(), hello_bytes(&greeting(ARM)));
    Message::Accept(Accept { version: WireVersion::CURRENT, idle_timeout, application })
}

/// A listener's refusal of a peer with another map.
pub(crate) fn other_map(listener: u64, connector: u64) -> Refusal {
    let why = format!("the listener has map {listener:#x}, the connecting peer map {connector:#x}");
    Refusal::Rejected(Rejection::new(1, &why))
}

/// A link over the transport of `endpoint`, by a listener and a connector: the arm's end first, then the
/// panel's.
pub(crate) async fn joined(endpoint: &str, options: &Options) -> (Link, Link) {
    let net = net();
    let endpoint: Endpoint = endpoint.parse().unwrap();
    let mut listener = Listener::bind(&net, &endpoint, greeting(ARM), options).await.unwrap();
    let there = listener.local_endpoint().clone();
    let (there, here) = tokio::join!(
        connect(&net, &there, greeting(PANEL), options, soon(&net)),
        listener.accept(soon(&net)),
    );
    (here.unwrap(), there.unwrap())
}

/// Links of any protocols over the transport of `endpoint`, for the suite.
pub(crate) async fn met<P: Protocol, Q: Protocol>(
    endpoint: &str,
    options: &Options,
    hellos: (P::Hello, Q::Hello),
    within: Duration,
) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
    let (net, endpoint) = (net(), endpoint.parse().unwrap());
    meet([&net, &net], &endpoint, [options, options], hellos, within, Clone::clone).await
}

/// The error of a link of `who` to `at` at the connecting side: how its attempts end once the other side has
/// had time to answer one.
pub(crate) async fn obstacle(
    net: &Arc<dyn Net>,
    at: &Endpoint,
    who: Greeting,
    options: &Options,
) -> HandshakeError {
    obstacle_of::<Robot>(net, at, who, options).await
}

/// The same, for any protocol.
pub(crate) async fn obstacle_of<P: Protocol>(
    net: &Arc<dyn Net>,
    at: &Endpoint,
    who: P::Hello,
    options: &Options,
) -> HandshakeError {
    let soon = soon(net);
    // The first wait that is long enough here.
    for wait in (0..).map(|doubled| Duration::from_millis(50) * 2_u32.pow(doubled)) {
        assert!(net.now() < soon, "no answer from {at}");
        let error = trimaran_transport::connect::<P>(net, at, who.clone(), options, net.now().after(wait))
            .await
            .unwrap_err();
        assert!(error.may_pass(), "{error:?}");
        match error {
            ConnectError::Deadline { last: AttemptError::Handshake { cause, .. }, .. } => match cause {
                HandshakeError::Closed | HandshakeError::Io(_) | HandshakeError::Unanswered => {}
                known => return known,
            },
            ConnectError::Deadline { last: AttemptError::TimedOut, .. } => {}
            other => panic!("{other:?}"),
        }
    }
    unreachable!()
}

/// The text with which `at` refuses `who`.
pub(crate) async fn refusal(net: &Arc<dyn Net>, at: &Endpoint, who: Greeting, options: &Options) -> Refusal {
    match obstacle(net, at, who, options).await {
        HandshakeError::Refused(refusal) => refusal,
        other => panic!("{other:?}"),
    }
}

/// The last failure of a connection to `listener` before it became a link, once there is one.
pub(crate) async fn last_failure(listener: &mut Listener) -> HandshakeError {
    let net = net();
    loop {
        match listener.accept(net.now()).await {
            Err(AcceptError::Deadline { last: Some(failure), .. }) => return failure,
            Err(AcceptError::Deadline { last: None, .. }) => tokio::task::yield_now().await,
            other => panic!("{other:?}"),
        }
    }
}
