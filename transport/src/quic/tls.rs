//! TLS 1.3 between peers that know each other by fingerprint: both show a certificate, and there is no plaintext mode.

use std::sync::{Arc, Mutex, PoisonError};

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
use thiserror::Error;

use crate::keys::{Fingerprint, Keys, PublicKeys};

/// The protocol's name in the TLS handshake (ALPN, RFC 7301); its number is the version of the wire.
pub(crate) const ALPN: &[u8] = b"trimaran/1";

/// A peer whose certificate is none of those that this side knows.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "the peer's certificate is {presented}, but {} expected: if it is the right peer, add its fingerprint to the peers",
    expectation(.expected)
)]
pub struct UnknownPeer {
    /// Those that this side knows.
    pub expected: Vec<Fingerprint>,
    /// The one that was shown.
    pub presented: Fingerprint,
}

fn expectation(expected: &[Fingerprint]) -> String {
    match expected {
        [] => "none is".to_owned(),
        [one] => format!("{one} is"),
        many => format!("one of {many:?} is"),
    }
}

/// Lets in whoever shows one of these certificates and proves to hold its key; one for each handshake.
///
/// Names, issuers and dates in a certificate are not looked at: the fingerprint says more than all of them. The proof, the
/// signature over the handshake, is checked by the provider, as for any certificate.
#[derive(Debug)]
pub(crate) struct Doorman {
    expected: Vec<Fingerprint>,
    algorithms: WebPkiSupportedAlgorithms,
    turned_away: Mutex<Option<UnknownPeer>>,
}

impl Doorman {
    pub(crate) fn new(peers: &[PublicKeys]) -> Arc<Self> {
        let algorithms = ring::default_provider().signature_verification_algorithms;
        Arc::new(Self {
            expected: peers.iter().map(|peer| peer.quic).collect(),
            algorithms,
            turned_away: Mutex::default(),
        })
    }

    /// Whom it turned away.
    pub(crate) fn turned_away(&self) -> Option<UnknownPeer> {
        self.turned_away.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn check(&self, certificate: &CertificateDer<'_>) -> Result<(), Error> {
        let presented = Fingerprint::of(certificate);
        if self.expected.contains(&presented) {
            return Ok(());
        }
        let unknown = UnknownPeer { expected: self.expected.clone(), presented };
        *self.turned_away.lock().unwrap_or_else(PoisonError::into_inner) = Some(unknown.clone());
        Err(CertificateError::Other(OtherError(Arc::new(unknown))).into())
    }
}

/// What both kinds of verifier do with a proof: TLS 1.3 signatures only, checked by the provider.
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

impl ServerCertVerifier for Doorman {
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

impl ClientCertVerifier for Doorman {
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

/// How the peer that connects does its TLS. No session is resumed: each handshake shows and checks both certificates.
pub(crate) fn client(keys: &Keys, doorman: &Arc<Doorman>) -> Result<ClientConfig, Error> {
    let mut config = ClientConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&TLS13])?
        .dangerous() // rustls' word for a verifier of one's own
        .with_custom_certificate_verifier(Arc::<Doorman>::clone(doorman))
        .with_client_cert_resolver(Arc::new(SingleCertAndKey::from(Arc::clone(&keys.certified))));
    config.alpn_protocols = vec![ALPN.to_vec()];
    config.resumption = Resumption::disabled();
    Ok(config)
}

/// How the peer that listens does its TLS.
pub(crate) fn server(keys: &Keys, doorman: &Arc<Doorman>) -> Result<ServerConfig, Error> {
    let mut config = ServerConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&TLS13])?
        .with_client_cert_verifier(Arc::<Doorman>::clone(doorman))
        .with_cert_resolver(Arc::new(SingleCertAndKey::from(Arc::clone(&keys.certified))));
    config.alpn_protocols = vec![ALPN.to_vec()];
    config.session_storage = Arc::new(NoServerSessionStorage {});
    config.send_tls13_tickets = 0;
    Ok(config)
}
