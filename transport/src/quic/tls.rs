//! TLS 1.3 between peers that know each other by fingerprint: both show a certificate, and there is no
//! plaintext mode.

use parking_lot::Mutex;
use std::sync::Arc;

use rustls::client::Resumption;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, WebPkiSupportedAlgorithms, ring, verify_tls13_signature};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::NoServerSessionStorage;
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::sign::SingleCertAndKey;
use rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, DistinguishedName, Error, OtherError,
    PeerIncompatible, ServerConfig, SignatureScheme, version::TLS13,
};
use trimaran_wire::ProtocolName;

use crate::handshake::HandshakeError;
use crate::keys::{Fingerprint, Keys, KnownPeer, PeerKey, QuicIdentity, UnknownPeer};

/// Admits peers that show one of these certificates and prove to hold its key; one for each handshake.
///
/// Names, issuers and dates in a certificate are ignored: the fingerprint says more than all of them. The
/// proof, the signature over the handshake, is checked by the provider, as for any certificate.
#[derive(Debug)]
pub(crate) struct Verifier {
    expected: Vec<Fingerprint>,
    algorithms: WebPkiSupportedAlgorithms,
    turned_away: Mutex<Option<UnknownPeer>>,
}

impl Verifier {
    pub(crate) fn new(peers: &[KnownPeer]) -> Arc<Self> {
        let algorithms = ring::default_provider().signature_verification_algorithms;
        Arc::new(Self {
            expected: peers.iter().filter_map(|peer| peer.keys.quic).collect(),
            algorithms,
            turned_away: Mutex::default(),
        })
    }

    /// The peer that it refused.
    pub(crate) fn turned_away(&self) -> Option<UnknownPeer> {
        self.turned_away.lock().clone()
    }

    fn check(&self, certificate: &CertificateDer<'_>) -> Result<(), Error> {
        let presented = Fingerprint::of(certificate);
        if self.expected.contains(&presented) {
            return Ok(());
        }
        let unknown = UnknownPeer { expected: self.expected.clone(), presented };
        *self.turned_away.lock() = Some(unknown.clone());
        Err(CertificateError::Other(OtherError(Arc::new(unknown))).into())
    }
}

/// The key that the peer has proved to hold.
pub(super) fn key_of(connection: &quinn::Connection) -> Option<PeerKey> {
    let shown = connection.peer_identity()?.downcast::<Vec<CertificateDer<'static>>>().ok()?;
    shown.first().map(|certificate| PeerKey::Quic(Fingerprint::of(certificate)))
}

/// The proof in both kinds of verifier: TLS 1.3 signatures only, checked by the provider.
macro_rules! proofs {
    () => {
        fn verify_tls12_signature(
            &self,
            _message: &[u8],
            _certificate: &CertificateDer<'_>,
            _signature: &DigitallySignedStruct,
        ) -> Result<HandshakeSignatureValid, Error> {
            Err(PeerIncompatible::Tls13RequiredForQuic.into())
        }

        fn verify_tls13_signature(
            &self,
            message: &[u8],
            certificate: &CertificateDer<'_>,
            signature: &DigitallySignedStruct,
        ) -> Result<HandshakeSignatureValid, Error> {
            verify_tls13_signature(message, certificate, signature, &self.algorithms)
        }

        fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
            self.algorithms.supported_schemes()
        }
    };
}

impl ServerCertVerifier for Verifier {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _server_name: &ServerName<'_>,
        _ocsp_response: &[u8],
        _now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        self.check(end_entity).map(|()| ServerCertVerified::assertion())
    }

    proofs!();
}

impl ClientCertVerifier for Verifier {
    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        &[]
    }

    fn verify_client_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        self.check(end_entity).map(|()| ClientCertVerified::assertion())
    }

    proofs!();
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn identity(keys: &Keys) -> Result<&QuicIdentity, HandshakeError> {
    keys.quic().ok_or(HandshakeError::NoQuicKey)
}

/// The TLS configuration of the connecting peer. The application's protocol is its ALPN name (RFC 7301). No
/// session is resumed: each handshake shows and checks both certificates.
pub(crate) fn client(
    keys: &Keys,
    verifier: &Arc<Verifier>,
    protocol: &ProtocolName,
) -> Result<ClientConfig, HandshakeError> {
    let mut config = ClientConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&TLS13])
        .map_err(|e| HandshakeError::Tls(e.into()))?
        .dangerous() // rustls' word for a verifier of one's own
        .with_custom_certificate_verifier(Arc::<Verifier>::clone(verifier))
        .with_client_cert_resolver(Arc::new(SingleCertAndKey::from(Arc::clone(&identity(keys)?.certified))));
    config.alpn_protocols = vec![protocol.to_string().into_bytes()];
    config.resumption = Resumption::disabled();
    Ok(config)
}

/// The TLS configuration of the listening peer.
pub(crate) fn server(
    keys: &Keys,
    verifier: &Arc<Verifier>,
    protocol: &ProtocolName,
) -> Result<ServerConfig, HandshakeError> {
    let mut config = ServerConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&TLS13])
        .map_err(|e| HandshakeError::Tls(e.into()))?
        .with_client_cert_verifier(Arc::<Verifier>::clone(verifier))
        .with_cert_resolver(Arc::new(SingleCertAndKey::from(Arc::clone(&identity(keys)?.certified))));
    config.alpn_protocols = vec![protocol.to_string().into_bytes()];
    config.session_storage = Arc::new(NoServerSessionStorage {});
    config.send_tls13_tickets = 0;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, SocketAddr};
    use std::time::Duration;

    use quinn::crypto::rustls::{QuicClientConfig, QuicServerConfig};
    use trimaran_wire::Protocol;

    use super::*;
    use crate::conformance::{ARM, PANEL, Robot, greeting};
    use crate::keys::Security;
    use crate::quic::QuicOptions;
    use crate::quic::connect::endpoint;
    use crate::{
        AcceptError, AttemptError, ConnectError, Endpoint, Listener, Net, Options, TokioNet, connect,
    };

    const OTHER: &[u8] = b"robot/0";
    const HERE: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

    fn ours() -> ProtocolName {
        ProtocolName::new(Robot::NAME)
    }

    fn net() -> Arc<dyn Net> {
        Arc::new(TokioNet::current().unwrap())
    }

    /// A peer of ours, and the keys of one that it knows, for another program.
    fn acquainted() -> (Options, Keys, Arc<Verifier>) {
        let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
        let (ours, theirs) = (keys("ours"), keys("theirs"));
        let verifier = Verifier::new(&[ours.public().clone().into()]);
        let security = Some(Security { keys: ours, peers: vec![theirs.public().clone().into()].into() });
        (Options { security, ..Options::default() }, theirs, verifier)
    }

    #[tokio::test]
    async fn a_listener_turns_another_protocol_away() {
        let (net, (options, theirs, verifier)) = (net(), acquainted());
        let at = Endpoint::Quic(HERE.into());
        let mut listener = Listener::<Robot>::bind(&net, &at, greeting(ARM), &options).await.unwrap();
        let Endpoint::Quic(at) = listener.local_endpoint() else { panic!("not QUIC") };
        let at = at.to_string().parse().unwrap();
        let mut crypto = client(&theirs, &verifier, &ours()).unwrap();
        crypto.alpn_protocols = vec![OTHER.to_vec()];
        let config = quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(crypto).unwrap()));
        let (other, _) =
            endpoint(&net, net.bind_udp(HERE, QuicOptions::default().socket).unwrap(), None).unwrap();
        assert!(other.connect_with(config, at, "trimaran").unwrap().await.is_err());
        let accepted = listener.accept(net.now().after(Duration::from_millis(500))).await;
        let Err(AcceptError::Deadline { last: Some(why), .. }) = accepted else { panic!("{accepted:?}") };
        assert!(matches!(why, HandshakeError::Alpn(_)), "{why:?}");
    }

    #[tokio::test]
    async fn a_listener_of_another_protocol_is_no_peer() {
        let (net, (options, theirs, verifier)) = (net(), acquainted());
        let mut crypto = server(&theirs, &verifier, &ours()).unwrap();
        crypto.alpn_protocols = vec![OTHER.to_vec()];
        let config = quinn::ServerConfig::with_crypto(Arc::new(QuicServerConfig::try_from(crypto).unwrap()));
        let (other, at) = endpoint(
            &net,
            net.bind_udp(HERE, QuicOptions::default().socket).unwrap(),
            Some((config, theirs.quic().unwrap())),
        )
        .unwrap();
        net.spawn(Box::pin(async move {
            while let Some(incoming) = other.accept().await {
                let _refused = incoming.await;
            }
        }));
        let at = Endpoint::Quic(at.into());
        // The first wait that is long enough here for an answer.
        for wait in (0..).map(|doubled| Duration::from_millis(50) * 2_u32.pow(doubled)) {
            let deadline = net.now().after(wait);
            let error = connect::<Robot>(&net, &at, greeting(PANEL), &options, deadline).await.unwrap_err();
            match error {
                ConnectError::Deadline { last: AttemptError::TimedOut, .. } => {}
                ConnectError::Deadline { last: AttemptError::Handshake { cause, .. }, .. } => {
                    assert!(matches!(cause, HandshakeError::Alpn(_)), "{cause:?}");
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
