//! The baseline of links over QUIC: plain quinn, poses in datagrams, a stream for each frame.
//!
//! Both encrypt with the same ciphers (rustls on ring, the first that both sides have). On a lossless path
//! both use quinn's defaults: congestion control, acknowledgements, pacing, segmentation. A link is quinn
//! over its own sockets with larger buffers. It numbers its poses, copies the last one, hashes points, and
//! bounds waits by its timeout: the difference is the cost of these.

use std::net::SocketAddr;
use std::sync::{Arc, mpsc};

use anyhow::{Context, Result};
use bytes::Bytes;
use quinn::crypto::rustls::QuicClientConfig;
use quinn::{ClientConfig, Connection, Endpoint, ServerConfig};
use rustls::pki_types::{CertificateDer, PrivatePkcs8KeyDer};

use super::{pose, frame, number};
use crate::measure::{Arrivals, Far, Near, Subject};

const MAX_FRAME: usize = 1 << 20;
const LOCAL: &str = "127.0.0.1:0";

/// A QUIC connection.
pub(crate) struct Bare {
    certificate: CertificateDer<'static>,
    key: Vec<u8>,
}

impl Bare {
    pub(crate) fn new() -> Result<Self> {
        let made = rcgen::generate_simple_self_signed(["localhost".to_owned()])?;
        Ok(Self { certificate: made.cert.der().clone(), key: made.signing_key.serialize_der() })
    }
}

pub(crate) struct End {
    _endpoint: Endpoint,
    connection: Connection,
    frame: Vec<u8>,
}

impl Subject for Bare {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let key = PrivatePkcs8KeyDer::from(self.key.clone());
        let config = ServerConfig::with_single_cert(vec![self.certificate.clone()], key.into())?;
        let endpoint = Endpoint::server(config, LOCAL.parse()?)?;
        whereabouts.send(endpoint.local_addr()?.to_string())?;
        let connection = endpoint.accept().await.context("closed")?.await?;
        Ok(End { _endpoint: endpoint, connection, frame: frame(0) })
    }

    async fn far(&self, whereabouts: &str) -> Result<End> {
        let mut roots = rustls::RootCertStore::empty();
        roots.add(self.certificate.clone())?;
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let tls = rustls::ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&rustls::version::TLS13])?
            .with_root_certificates(roots)
            .with_no_client_auth();
        let mut endpoint = Endpoint::client(LOCAL.parse()?)?;
        endpoint.set_default_client_config(ClientConfig::new(Arc::new(QuicClientConfig::try_from(tls)?)));
        let connection = endpoint.connect(whereabouts.parse::<SocketAddr>()?, "localhost")?.await?;
        Ok(End { _endpoint: endpoint, connection, frame: Vec::new() })
    }
}

impl Near for End {
    async fn pose(&mut self, number: u32) -> Result<()> {
        Ok(self.connection.send_datagram(Bytes::copy_from_slice(&pose(number)))?)
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        self.frame[..4].copy_from_slice(&number.to_le_bytes());
        let mut stream = self.connection.open_uni().await?;
        stream.write_all(&self.frame).await?;
        Ok(stream.finish()?)
    }

    async fn answer(&mut self) -> Result<u32> {
        number(&self.connection.read_datagram().await?)
    }

    async fn close(self) -> Result<()> {
        self.connection.close(0_u8.into(), b"");
        self._endpoint.wait_idle().await;
        Ok(())
    }
}

impl Far for End {
    async fn serve(self, arrivals: Arc<Arrivals>) -> Result<()> {
        loop {
            let answer = tokio::select! {
                pose = self.connection.read_datagram() => match pose {
                    Ok(pose) => pose,
                    Err(_) => return Ok(()),
                },
                stream = self.connection.accept_uni() => {
                    let Ok(mut stream) = stream else { return Ok(()) };
                    let bytes = stream.read_to_end(MAX_FRAME).await?;
                    arrivals.mark();
                    Bytes::copy_from_slice(&pose(number(&bytes)?))
                }
            };
            self.connection.send_datagram(answer)?;
        }
    }
}
