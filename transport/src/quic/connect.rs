//! Connecting over QUIC.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use futures_util::stream::{FuturesUnordered, StreamExt};
use quinn::crypto::rustls::QuicClientConfig;
use quinn::{ClientConfig, Connecting, Connection, ConnectionError, Endpoint, EndpointConfig, ServerConfig};
use quinn_proto::HashedConnectionIdGenerator;
use ring::hmac;
use trimaran_wire::{Lane, Message};

use super::Quic;
use super::control::{Control, check_datagrams, explain};
use super::tls::{self, Verifier};
use crate::handshake::{Handshake, HandshakeError};
use crate::keys::{QuicIdentity, Security};
use crate::lane_transport::Introduction;
use crate::parts::LinkParts;
use crate::transport::AttemptError;
use crate::watched_socket::WatchedSocket;
use trimaran_net::{Net, UdpSocket, until};

/// TLS wants a name; peers know each other by fingerprint.
const SERVER_NAME: &str = "trimaran";

/// How often a listener that answers nothing is asked anew, and how many attempts there may be at once: as
/// many as a handshake's default time has room for.
const AGAIN: Duration = Duration::from_millis(200);
const ATTEMPTS: usize = 25;

/// One attempt.
pub(super) async fn attempt(
    net: &Arc<dyn Net>,
    at: &str,
    quic: &Quic,
    introduction: &Introduction<'_>,
) -> Result<LinkParts, AttemptError> {
    each_address(net, at, |to| introduce(net, to, quic, introduction)).await
}

/// Tries each address of a host once, until one answers: that answer is final.
async fn each_address<F: Future<Output = Result<LinkParts, AttemptError>>>(
    net: &Arc<dyn Net>,
    at: &str,
    introduce: impl Fn(SocketAddr) -> F,
) -> Result<LinkParts, AttemptError> {
    let mut last = AttemptError::NoAddress;
    for to in net.resolve(at).await.map_err(AttemptError::Resolve)? {
        match introduce(to).await {
            Err(e @ AttemptError::Connect { .. }) => last = e,
            done => return done,
        }
    }
    Err(last)
}

async fn introduce(
    net: &Arc<dyn Net>,
    to: SocketAddr,
    Quic { options, security }: &Quic,
    introduction: &Introduction<'_>,
) -> Result<LinkParts, AttemptError> {
    let Introduction { application, session, link, .. } = *introduction;
    let failed = |cause| AttemptError::Handshake { address: to.to_string(), cause };
    let refused = |cause| AttemptError::Connect { address: to.to_string(), cause };
    let security = security.as_ref().ok_or(HandshakeError::NoKeys).map_err(failed)?;
    let Security { keys, peers } = security;
    let verifier = Verifier::new(&peers.now());
    let crypto = tls::client(keys, &verifier, &application.protocol()).map_err(failed)?;
    let crypto = QuicClientConfig::try_from(crypto).map_err(|e| refused(io::Error::other(e)))?;
    let mut config = ClientConfig::new(Arc::new(crypto));
    config.transport_config(options.transport(link, &application.format()));
    let here: SocketAddr = match to {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = WatchedSocket::new(net.bind_udp(here, options.socket).map_err(refused)?, None);
    let own: Arc<dyn UdpSocket> = Arc::<WatchedSocket>::clone(&socket);
    let (endpoint, _) = endpoint(net, own, None).map_err(refused)?;
    let attempt = || {
        let begun = endpoint.connect_with(config.clone(), to, SERVER_NAME);
        begun.map_err(|e| refused(io::Error::other(e)))
    };
    let explained = |e| failed(explain(e, &verifier, keys, application.protocol()));
    let connection = dial(net, &socket, attempt).await?.map_err(explained)?;
    let shake = async {
        check_datagrams(&connection, &application.format())?;
        let streams = connection.open_bi().await.map_err(|e| HandshakeError::Io(e.into()))?;
        let mut control = Control::new(connection.clone(), streams, application.format());
        control.send(&Message::Hello(introduction.hello(Lane::Frames))).await?;
        let beside = control.open_beside().await?;
        let theirs = introduction.recognize(&control.recv_answer().await?)?;
        Ok::<_, HandshakeError>((control, beside, theirs))
    };
    // The listener judges our certificate after we have judged its own, so a refusal comes on an apparent
    // connection.
    let (control, beside, theirs) = shake.await.map_err(|e| match (e, connection.close_reason()) {
        (HandshakeError::Io(_), Some(reason)) => explained(reason),
        (e, _) => failed(e),
    })?;
    let judged = tls::key_of(&connection).ok_or(HandshakeError::Stranger);
    let judged = judged.and_then(|key| Ok(security.judge(key, theirs.role.as_deref())?));
    let parts = control.into_parts(net, theirs, (session, beside));
    Ok(LinkParts { doubt: judged.err(), ..parts })
}

/// quinn on a socket of `net`; returns the bound address. A listener that is restarted with the same keys and
/// port tells peers of earlier connections that it has lost them.
pub(crate) fn endpoint(
    net: &Arc<dyn Net>,
    socket: Arc<dyn UdpSocket>,
    server: Option<(ServerConfig, &QuicIdentity)>,
) -> io::Result<(Endpoint, SocketAddr)> {
    let address = socket.local_addr()?;
    let mut config = EndpointConfig::default();
    let server = server.map(|(server, identity)| {
        let secret = identity.reset_secret(address.port());
        // Ids from before a restart count as its own, so that they are answered with a reset.
        let ids = secret.first_chunk().copied().map(u64::from_le_bytes).unwrap_or_default();
        config
            .reset_key(Arc::new(hmac::Key::new(hmac::HMAC_SHA256, &secret)))
            .cid_generator(move || Box::new(HashedConnectionIdGenerator::from_key(ids)));
        server
    });
    Ok((trimaran_net::quinn::endpoint_on(net, config, server, socket)?, address))
}

/// Dials until one attempt is answered. While nothing at all comes, there are new attempts beside the first:
/// QUIC sends first packets again at ever longer intervals, and would find a listener late that has just been
/// started.
async fn dial(
    net: &Arc<dyn Net>,
    socket: &WatchedSocket,
    attempt: impl Fn() -> Result<Connecting, AttemptError>,
) -> Result<Result<Connection, ConnectionError>, AttemptError> {
    let mut attempts = FuturesUnordered::new();
    attempts.push(attempt()?);
    loop {
        let soon = net.now().after(AGAIN);
        match until(&**net, soon, attempts.next()).await {
            // A later attempt may yet be answered.
            Some(Some(Err(ConnectionError::TimedOut))) if !attempts.is_empty() => {}
            Some(Some(answered)) => return Ok(answered),
            _ if attempts.len() < ATTEMPTS && !socket.has_heard() => attempts.push(attempt()?),
            _ => {}
        }
    }
}
