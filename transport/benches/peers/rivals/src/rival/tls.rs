//! Keys and certificates of QUIC endpoints for one run.

use std::sync::Arc;

use anyhow::Result;
use quinn::{ClientConfig, ServerConfig, TransportConfig};
use rustls::RootCertStore;
use rustls::pki_types::PrivatePkcs8KeyDer;

/// The name in the certificate.
pub(super) const NAME: &str = "sender";

/// A server and a client that trusts it. Ed25519 signatures have the same length each time, so a seed gives
/// the same run.
pub(super) fn pair(transport: &Arc<TransportConfig>) -> Result<(ServerConfig, ClientConfig)> {
    let key = rcgen::KeyPair::generate_for(&rcgen::PKCS_ED25519)?;
    let certificate = rcgen::CertificateParams::new([NAME.into()])?.self_signed(&key)?.der().clone();
    let mut roots = RootCertStore::empty();
    roots.add(certificate.clone())?;
    let key = PrivatePkcs8KeyDer::from(key.serialize_der()).into();
    let mut server = ServerConfig::with_single_cert(vec![certificate], key)?;
    server.transport_config(Arc::clone(transport));
    let mut client = ClientConfig::with_root_certificates(roots.into())?;
    client.transport_config(Arc::clone(transport));
    Ok((server, client))
}
