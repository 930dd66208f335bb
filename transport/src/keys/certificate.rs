//! The key and the certificate of a peer over QUIC.

use std::sync::Arc;

use rcgen::{CertificateParams, KeyPair, PKCS_ED25519};
use ring::hmac;
use rustls::crypto::ring::sign::any_supported_type;
use rustls::pki_types::{CertificateDer, PrivatePkcs8KeyDer};
use rustls::sign::CertifiedKey;
use zeroize::Zeroize;

use super::file::{Der, KeysError};

/// The name in a certificate. It has no meaning: peers know each other by fingerprint.
const COMMON_NAME: &str = "trimaran";

/// The certificate and key by which this peer proves its identity over QUIC.
#[derive(Clone)]
pub(crate) struct QuicIdentity {
    pub(crate) certified: Arc<CertifiedKey>,
    resets: hmac::Key,
}

/// A new self-signed certificate, and its key.
///
/// It is Ed25519: its signatures have one length, so that a simulated handshake has the same packets every
/// time.
pub(super) fn generate() -> Result<(Der, Der), KeysError> {
    let failed = |e: rcgen::Error| KeysError::Make(e.into());
    let mut key = KeyPair::generate_for(&PKCS_ED25519).map_err(failed)?;
    let params = CertificateParams::new(vec![COMMON_NAME.to_owned()]).map_err(failed)?;
    let certificate = params.self_signed(&key).map_err(failed)?;
    let der = key.serialize_der().into();
    key.zeroize();
    Ok((certificate.der().to_vec().into(), der))
}

impl QuicIdentity {
    pub(super) fn new(certificate: &Der, key: &Der) -> Result<Self, KeysError> {
        let failed = |e: rustls::Error| KeysError::Mismatch(e.into());
        let resets = hmac::Key::new(hmac::HMAC_SHA256, key.as_ref());
        let certificate = CertificateDer::from(certificate.as_ref().to_vec());
        let key = PrivatePkcs8KeyDer::from(key.as_ref()).into();
        let certified = CertifiedKey::new(vec![certificate], any_supported_type(&key).map_err(failed)?);
        certified.keys_match().map_err(failed)?;
        Ok(Self { certified: Arc::new(certified), resets })
    }

    /// A secret of a QUIC listener at this port that stays the same when it is restarted.
    pub(crate) fn reset_secret(&self, port: u16) -> [u8; 32] {
        let mut of = hmac::Context::with_key(&self.resets);
        of.update(b"trimaran quic reset 1");
        of.update(&port.to_le_bytes());
        of.sign().as_ref().first_chunk().copied().unwrap_or_default()
    }
}
