//! TLS (RFC 8446) of the side that connects: `wss://`. The other side's certificate is always checked.

use std::io;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::version::TLS13;
use rustls::{ClientConfig, RootCertStore};
use thiserror::Error;
use tokio::io::{join, split};
use tokio_rustls::TlsConnector;
use trimaran_net::Stream;

use super::WsOptions;
use crate::Host;

/// The protocol above TLS (RFC 7301): WebSockets begin with HTTP/1.1.
const ALPN: &[u8] = b"http/1.1";

/// The configuration with the system's certificate authorities. They are many, so they are read once.
static SYSTEM: OnceLock<Arc<ClientConfig>> = OnceLock::new();

/// Why certificates cannot be checked.
#[derive(Debug, Error)]
enum AuthoritiesError {
    /// The file cannot be read.
    #[error("cannot read the certificate authorities of `ws.ca` in {file}", file = file.display())]
    Read {
        /// The file.
        file: PathBuf,
        #[source]
        cause: pem::Error,
    },
    /// The file has a certificate that cannot be used.
    #[error("the certificate authorities of `ws.ca` in {file} cannot be used", file = file.display())]
    Certificate {
        /// The file.
        file: PathBuf,
        #[source]
        cause: rustls::Error,
    },
    /// The file has no certificate.
    #[error("{file} of `ws.ca` has no certificate: give a PEM file of authorities", file = file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
    /// The system has none.
    #[error(
        "this system knows no certificate authorities: install them (Debian: ca-certificates), or name a file \
         of them in `ws.ca`"
    )]
    System,
    /// The library has no cipher for it.
    #[error("TLS 1.3 cannot be set up")]
    Ciphers(#[source] rustls::Error),
}

impl WsOptions {
    /// Encrypts a connection to `host` by TLS 1.3, and checks the host's certificate.
    ///
    /// # Errors
    /// If the certificate is not valid for `host`, or the connection fails. If this side has no certificate
    /// authorities to check with, with [`io::ErrorKind::Unsupported`].
    pub async fn encrypt(&self, host: &Host, stream: Stream) -> io::Result<Stream> {
        let name = match host {
            Host::V4(address) => ServerName::from(IpAddr::V4(*address)),
            Host::V6(address) => ServerName::from(IpAddr::V6(*address)),
            Host::Name(_) => ServerName::try_from(host.to_string()).map_err(io::Error::other)?,
        };
        let config = self.client().map_err(|why| io::Error::new(io::ErrorKind::Unsupported, why))?;
        let Stream { reader, writer, peer } = stream;
        let encrypted = TlsConnector::from(config).connect(name, join(reader, writer)).await?;
        let (reader, writer) = split(encrypted);
        Ok(Stream { reader: Box::new(reader), writer: Box::new(writer), peer })
    }

    fn client(&self) -> Result<Arc<ClientConfig>, AuthoritiesError> {
        match &self.ca {
            Some(file) => trusting(authorities(file)?),
            None => {
                if let Some(known) = SYSTEM.get() {
                    return Ok(Arc::clone(known));
                }
                let config = trusting(system_authorities()?)?;
                Ok(Arc::clone(SYSTEM.get_or_init(|| config)))
            }
        }
    }
}

/// The certificate authorities in a file (PEM).
fn authorities(file: &Path) -> Result<RootCertStore, AuthoritiesError> {
    let read = CertificateDer::pem_file_iter(file).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let certificates = read.map_err(|cause| AuthoritiesError::Read { file: file.to_owned(), cause })?;
    let mut roots = RootCertStore::empty();
    for certificate in certificates {
        roots
            .add(certificate)
            .map_err(|cause| AuthoritiesError::Certificate { file: file.to_owned(), cause })?;
    }
    if roots.is_empty() {
        return Err(AuthoritiesError::Empty { file: file.to_owned() });
    }
    Ok(roots)
}

/// The system's certificate authorities. One that cannot be read is no reason to refuse the others.
fn system_authorities() -> Result<RootCertStore, AuthoritiesError> {
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
    if roots.is_empty() { Err(AuthoritiesError::System) } else { Ok(roots) }
}

fn trusting(roots: RootCertStore) -> Result<Arc<ClientConfig>, AuthoritiesError> {
    let mut config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&TLS13])
        .map_err(AuthoritiesError::Ciphers)?
        .with_root_certificates(roots)
        .with_no_client_auth();
    config.alpn_protocols = vec![ALPN.to_vec()];
    Ok(Arc::new(config))
}
