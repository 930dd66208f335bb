//! Connecting over QUIC.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;

use quinn::crypto::rustls::QuicClientConfig;
use quinn::{ClientConfig, Endpoint, EndpointConfig, ServerConfig};
use trimaran_wire::{Lane, Message};

use super::control::{Control, check_datagrams, explain};
use super::tls::{self, Verifier};
use super::{Quic, QuicOptions};
use crate::handshake::{Handshake, HandshakeError};
use crate::keys::Security;
use crate::lane_transport::Introduction;
use crate::parts::LinkParts;
use crate::transport::AttemptError;
use trimaran_net::Net;

/// TLS wants a name; peers know each other by fingerprint.
const SERVER_NAME: &str = "trimaran";

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
    let verifier = Verifier::new(peers);
    let crypto = tls::client(keys, &verifier, &application.protocol()).map_err(|e| failed(e.into()))?;
    let crypto = QuicClientConfig::try_from(crypto).map_err(|e| refused(io::Error::other(e)))?;
    let mut config = ClientConfig::new(Arc::new(crypto));
    config.transport_config(options.transport(link, &application.format()));
    let here: SocketAddr = match to {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let (endpoint, _) = endpoint(net, here, options, None).map_err(refused)?;
    let connecting =
        endpoint.connect_with(config, to, SERVER_NAME).map_err(|e| refused(io::Error::other(e)))?;
    let explained = |e| failed(explain(e, &verifier, keys.public().quic, application.protocol()));
    let connection = connecting.await.map_err(explained)?;
    let shake = async {
        check_datagrams(&connection, &application.format())?;
        let streams = connection.open_bi().await.map_err(|e| HandshakeError::Io(e.into()))?;
        let mut control = Control::new(connection.clone(), streams, application.format());
        control.send(&Message::Hello(application.introduce(session, Lane::Frames))).await?;
        let beside = control.open_beside().await?;
        let theirs = application.recognize(&control.recv_answer().await?)?;
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

/// quinn on a socket of `net`; returns the bound address.
pub(crate) fn endpoint(
    net: &Arc<dyn Net>,
    at: SocketAddr,
    options: &QuicOptions,
    server: Option<ServerConfig>,
) -> io::Result<(Endpoint, SocketAddr)> {
    let config = EndpointConfig::default();
    let endpoint = trimaran_net::quinn::endpoint(net, config, server, at, options.socket)?;
    let address = endpoint.local_addr()?;
    Ok((endpoint, address))
}
