//! Listening over QUIC: admission of peers, and limits for strangers.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use quinn::crypto::rustls::QuicServerConfig;
use quinn::{Endpoint, Incoming, ServerConfig};
use trimaran_wire::{Hello, Lane, Message, Refusal};

use super::connect::endpoint;
use super::control::{Control, check_datagrams, explain};
use super::tls::{self, Verifier};
use super::{Quic, QuicOptions};
use crate::PeerAddress;
use crate::acceptor::Acceptor;
use crate::handshake::{Handshake, HandshakeError};
use crate::keys::Security;
use crate::pending::Slot;
use crate::watched_socket::WatchedSocket;
use trimaran_net::until;

/// How many bytes an attempt may buffer before it is looked at.
const WAITING: u64 = 16 * 1024;

/// Listens, and receives peers until nobody accepts any more. Returns the address.
pub(super) fn listen(at: SocketAddr, quic: &Quic, acceptor: &Arc<Acceptor>) -> io::Result<SocketAddr> {
    let options = quic.options;
    let security = quic.security.clone().ok_or_else(|| io::Error::other(HandshakeError::NoKeys))?;
    let identity = security.keys.quic().ok_or_else(|| io::Error::other(HandshakeError::NoQuicKey))?;
    let (config, _) = server(acceptor, &security, &options).map_err(io::Error::other)?;
    let socket = acceptor.net.bind_udp(at, options.socket)?;
    let socket = WatchedSocket::new(socket, Some(acceptor.serving()));
    let (endpoint, address) = endpoint(&acceptor.net, socket, Some((config, identity)))?;
    acceptor.net.spawn(Box::pin(serve(Arc::clone(acceptor), security, options, endpoint)));
    Ok(address)
}

/// The configuration of one handshake, and its certificate verifier.
pub(super) fn server(
    acceptor: &Acceptor,
    security: &Security,
    options: &QuicOptions,
) -> Result<(ServerConfig, Arc<Verifier>), HandshakeError> {
    let verifier = Verifier::new(&security.peers.now());
    let crypto = tls::server(&security.keys, &verifier, &acceptor.application.protocol())?;
    let crypto = QuicServerConfig::try_from(crypto).map_err(|e| HandshakeError::Io(io::Error::other(e)))?;
    let mut config = ServerConfig::with_crypto(Arc::new(crypto));
    let handshakes = acceptor.limits().handshakes;
    config
        .transport_config(options.transport(&acceptor.link, &acceptor.application.format()))
        .max_incoming(handshakes)
        .incoming_buffer_size(WAITING)
        .incoming_buffer_size_total(WAITING * handshakes as u64);
    Ok((config, verifier))
}

async fn serve(acceptor: Arc<Acceptor>, security: Security, options: QuicOptions, endpoint: Endpoint) {
    loop {
        let incoming = tokio::select! {
            biased;
            () = acceptor.closed() => break,
            incoming = endpoint.accept() => incoming,
        };
        let Some(incoming) = incoming else { break };
        // Addresses are validated without state (RFC 9000, section 8.1.2): so nobody takes slots with spoofed
        // addresses, and forged packets cost a token each. It costs a peer one round trip of its handshake.
        if !incoming.remote_address_validated() {
            let _always_possible_then = incoming.retry();
            continue;
        }
        let from = PeerAddress::Quic(incoming.remote_address());
        if let Err(e) = acceptor.begin(&from) {
            acceptor.failed(&from, e);
            // Its first packet is sent again: it may be admitted then.
            incoming.ignore();
            continue;
        }
        let guest = Guest { slot: acceptor.slot(&from), acceptor: Arc::clone(&acceptor) };
        let security = security.clone();
        acceptor.net.spawn(Box::pin(async move { guest.receive(incoming, &security, &options).await }));
    }
    endpoint.set_server_config(None);
}

/// One handshake.
struct Guest {
    acceptor: Arc<Acceptor>,
    slot: Slot,
}

impl Guest {
    async fn receive(mut self, incoming: Incoming, security: &Security, options: &QuicOptions) {
        let address = incoming.remote_address();
        let acceptor = &self.acceptor;
        let deadline = acceptor.net.now().after(acceptor.link.handshake_timeout);
        let handshake = shake_hands(acceptor, incoming, security, options);
        let outcome = tokio::select! {
            biased;
            outcome = until(&*acceptor.net, deadline, handshake) => outcome.unwrap_or(Err(HandshakeError::TimedOut)),
            () = self.slot.revoked() => Err(HandshakeError::Refused(Refusal::Busy)),
        };
        if let Err(e) = outcome {
            acceptor.failed(&address, e);
        }
    }
}

async fn shake_hands(
    acceptor: &Acceptor,
    incoming: Incoming,
    security: &Security,
    options: &QuicOptions,
) -> Result<(), HandshakeError> {
    let (config, verifier) = server(acceptor, security, options)?;
    let Acceptor { net, application, .. } = acceptor;
    let explained = |e| explain(e, &verifier, &security.keys, application.protocol());
    let connection = incoming.accept_with(Arc::new(config)).map_err(explained)?.await.map_err(explained)?;
    check_datagrams(&connection, &application.format())?;
    let key = tls::key_of(&connection).ok_or(HandshakeError::Stranger)?;
    let streams = connection.accept_bi().await.map_err(explained)?;
    let mut control = Control::new(connection, streams, application.format());
    let hello = control.recv_hello().await?;
    let Hello { session, lane, .. } = hello;
    let entered = match lane {
        Lane::Frames => acceptor.identify(&hello).and_then(|theirs| {
            security.judge(key, theirs.role.as_deref())?;
            acceptor.enter(&hello).map_err(HandshakeError::Refused)
        }),
        Lane::Latest | Lane::Messages | Lane::Bulk | Lane::Channel(_) => {
            Err(HandshakeError::Refused(Refusal::Session { session, lane }))
        }
    };
    match entered {
        Ok((peer, place)) => {
            let beside = control.accept_beside().await?;
            control.send(&Message::Accept(acceptor.answer(&peer))).await?;
            let parts = control.into_parts(net, peer, (session, beside));
            acceptor.hand_out(parts.holding(place)).await;
            Ok(())
        }
        Err(error) => {
            if let Some(refusal) = error.refusal() {
                control.refuse(refusal).await;
            }
            Err(error)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use quinn::ClientConfig;
    use quinn::crypto::rustls::QuicClientConfig;
    use tokio::sync::mpsc;
    use tokio::task::JoinSet;

    use super::*;
    use crate::application::Side;
    use crate::conformance::{ARM, Robot, greeting};
    use crate::keys::Keys;
    use crate::{Limits, LinkConfig, Options, TokioNet};
    use trimaran_net::Net;

    /// Links are not accepted here: at most the limit of handshakes wait, and one more gets in once another
    /// has gone.
    #[tokio::test]
    async fn no_more_wait_than_may_shake_hands() {
        const ROOM: usize = 2;
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let keys = Keys::generate("both".parse().unwrap()).unwrap();
        let security = Security { peers: vec![keys.public().clone().into()].into(), keys };
        let limits = Limits { handshakes: ROOM, ..Limits::default() };
        let link = LinkConfig { idle_timeout: Duration::from_secs(3600), ..LinkConfig::default() };
        let quic = QuicOptions { initial_rtt: Duration::from_millis(10), ..QuicOptions::default() };
        let options = Options { limits, link, quic, ..Options::default() };
        let application = Side::<Robot>::of(greeting(ARM)).unwrap();
        let (protocol, format) = (application.protocol(), application.format());
        let acceptor = Acceptor::new(
            &net,
            application,
            options.link,
            options.limits,
            mpsc::channel(1).0,
            &mpsc::channel(1).0,
        );
        let (config, _) = server(&acceptor, &security, &options.quic).unwrap();
        let loopback = "127.0.0.1:0".parse().unwrap();
        let (there, at) = endpoint(
            &net,
            net.bind_udp(loopback, options.quic.socket).unwrap(),
            Some((config, security.keys.quic().unwrap())),
        )
        .unwrap();

        let (here, _) = endpoint(&net, net.bind_udp(loopback, options.quic.socket).unwrap(), None).unwrap();
        let verifier = Verifier::new(&security.peers.now());
        let crypto = tls::client(&security.keys, &verifier, &protocol).unwrap();
        let mut config = ClientConfig::new(Arc::new(QuicClientConfig::try_from(crypto).unwrap()));
        config.transport_config(options.quic.transport(&options.link, &format));
        let mut attempts = JoinSet::new();
        for _ in 0..=ROOM {
            attempts.spawn(here.connect_with(config.clone(), at, "trimaran").unwrap().into_future());
        }
        let soon = net.now().after(Duration::from_secs(60));
        let mut waiting = Vec::new();
        for _ in 0..ROOM {
            waiting.push(until(&*net, soon, there.accept()).await.expect("there is room"));
        }
        // Its first packet is sent again and again meanwhile.
        let more = until(&*net, net.now().after(Duration::from_millis(500)), there.accept()).await;
        assert!(more.is_none(), "one more than may wait");
        drop(waiting.pop());
        assert!(until(&*net, soon, there.accept()).await.is_some(), "there is room again");
    }
}
