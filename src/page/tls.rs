//! TLS (RFC 8446) of the page's server. Its certificate and key can be replaced while it serves.

use std::{
    fmt, io,
    path::{Path, PathBuf},
    sync::Arc,
};

use parking_lot::Mutex;
use rustls::{
    ServerConfig,
    crypto::ring,
    pki_types::{
        CertificateDer, PrivateKeyDer,
        pem::{self, PemObject},
    },
    version::TLS13,
};
use thiserror::Error;
use tokio::io::{join, split};
use tokio_rustls::TlsAcceptor;
use trimaran_net::Stream;

/// The protocol above TLS (RFC 7301).
const ALPN: &[u8] = b"http/1.1";

/// The files of a server's certificate (PEM).
#[derive(Debug, Clone)]
pub struct TlsFiles {
    /// The certificate, and behind it those that lead to an authority.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
}

/// Why a certificate cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TlsError {
    /// The certificate cannot be read.
    #[error("cannot read the certificate {file}: give a PEM file", file = file.display())]
    Certificate {
        /// The file.
        file: PathBuf,
        /// Why.
        #[source]
        cause: pem::Error,
    },
    /// The key cannot be read.
    #[error("cannot read the private key {file}: give a PEM file, not encrypted", file = file.display())]
    Key {
        /// The file.
        file: PathBuf,
        /// Why.
        #[source]
        cause: pem::Error,
    },
    /// They do not belong together, or are of a kind that is not supported.
    #[error(
        "the certificate {certificate} cannot be used with the private key {key}",
        certificate = certificate.display(),
        key = key.display()
    )]
    Pair {
        /// The certificate's file.
        certificate: PathBuf,
        /// The key's file.
        key: PathBuf,
        /// Why.
        #[source]
        cause: rustls::Error,
    },
}

/// The certificate of a server, with its key.
pub struct Tls {
    files: TlsFiles,
    present: Mutex<TlsAcceptor>,
}

impl Tls {
    /// The certificate in these files.
    ///
    /// # Errors
    /// If it cannot be used.
    pub fn read(files: TlsFiles) -> Result<Self, TlsError> {
        let present = Mutex::new(acceptor(&files)?);
        Ok(Self { files, present })
    }

    /// Reads the files again. Connections that are open stay.
    ///
    /// # Errors
    /// If the new certificate cannot be used: then the old one stays.
    pub(super) fn read_again(&self) -> Result<(), TlsError> {
        let new = acceptor(&self.files)?;
        *self.present.lock() = new;
        Ok(())
    }

    /// Makes a connection encrypted.
    pub(super) async fn accept(&self, Stream { reader, writer, peer }: Stream) -> io::Result<Stream> {
        let acceptor = self.present.lock().clone();
        let (reader, writer) = split(acceptor.accept(join(reader, writer)).await?);
        Ok(Stream { reader: Box::new(reader), writer: Box::new(writer), peer })
    }
}

impl fmt::Debug for Tls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tls").field("files", &self.files).finish_non_exhaustive()
    }
}

fn acceptor(TlsFiles { certificate, key }: &TlsFiles) -> Result<TlsAcceptor, TlsError> {
    let chain = certificates(certificate)
        .map_err(|cause| TlsError::Certificate { file: certificate.clone(), cause })?;
    let secret =
        PrivateKeyDer::from_pem_file(key).map_err(|cause| TlsError::Key { file: key.clone(), cause })?;
    let config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&TLS13])
        .and_then(|config| config.with_no_client_auth().with_single_cert(chain, secret));
    let mut config = config.map_err(|cause| TlsError::Pair {
        certificate: certificate.clone(),
        key: key.clone(),
        cause,
    })?;
    config.alpn_protocols = vec![ALPN.to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>, pem::Error> {
    let chain = CertificateDer::pem_file_iter(file)?.collect::<Result<Vec<_>, _>>()?;
    if chain.is_empty() { Err(pem::Error::NoItemsFound) } else { Ok(chain) }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use rcgen::{CertifiedKey, generate_simple_self_signed};
    use rustls::{ClientConfig, RootCertStore};
    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};
    use tokio_rustls::TlsConnector;
    use trimaran_net::StreamPeer;

    use super::*;

    /// Writes a new certificate and its key; returns the certificate.
    fn written(files: &TlsFiles) -> CertificateDer<'static> {
        let CertifiedKey { cert, signing_key } =
            generate_simple_self_signed(["plant.example".to_owned()]).unwrap();
        fs::write(&files.certificate, cert.pem()).unwrap();
        fs::write(&files.key, signing_key.serialize_pem()).unwrap();
        cert.into()
    }

    fn files(folder: &Path) -> TlsFiles {
        TlsFiles { certificate: folder.join("plant.pem"), key: folder.join("plant.key") }
    }

    /// Whether a client that trusts only `certificate` can talk to the server.
    async fn is_met(tls: &Tls, certificate: &CertificateDer<'static>) -> bool {
        let mut trusted = RootCertStore::empty();
        trusted.add(certificate.clone()).unwrap();
        let client = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_protocol_versions(&[&TLS13])
            .unwrap()
            .with_root_certificates(trusted)
            .with_no_client_auth();
        let (near, far) = duplex(1 << 16);
        let (reader, writer) = split(far);
        let peer = StreamPeer::Tcp(([127, 0, 0, 1], 1).into());
        let server = async {
            let accepted = tls.accept(Stream { reader: Box::new(reader), writer: Box::new(writer), peer });
            let Stream { mut reader, mut writer, .. } = accepted.await?;
            let byte = reader.read_u8().await?;
            writer.write_u8(byte + 1).await?;
            writer.flush().await
        };
        let client = async {
            let connector = TlsConnector::from(Arc::new(client));
            let mut stream = connector.connect("plant.example".try_into().unwrap(), near).await?;
            stream.write_u8(6).await?;
            stream.flush().await?;
            stream.read_u8().await
        };
        let (served, answer) = tokio::join!(server, client);
        served.is_ok() && answer.is_ok_and(|byte| byte == 7)
    }

    #[tokio::test]
    async fn a_certificate_is_replaced_and_a_broken_one_is_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let files = files(folder.path());
        let first = written(&files);
        let tls = Tls::read(files.clone()).unwrap();
        assert!(is_met(&tls, &first).await);
        let second = written(&files);
        assert!(is_met(&tls, &first).await && !is_met(&tls, &second).await, "nothing was read again");
        tls.read_again().unwrap();
        assert!(is_met(&tls, &second).await && !is_met(&tls, &first).await);
        for broken in ["", "no PEM", "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"] {
            fs::write(&files.certificate, broken).unwrap();
            assert!(tls.read_again().is_err(), "{broken}");
            assert!(is_met(&tls, &second).await, "the old one stays");
        }
    }

    #[test]
    fn a_key_of_another_certificate_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let (files, other) = (files(folder.path()), folder.path().join("other.key"));
        let others = TlsFiles { key: other, ..files.clone() };
        written(&others);
        written(&files);
        let refused = Tls::read(others).unwrap_err();
        assert!(matches!(refused, TlsError::Pair { .. }), "{refused:?}");
        let told = refused.to_string();
        assert!(told.contains("plant.pem") && told.contains("other.key"), "{told}");
        let none = TlsFiles { key: folder.path().join("none.key"), ..files };
        assert!(matches!(Tls::read(none).unwrap_err(), TlsError::Key { .. }));
    }
}
