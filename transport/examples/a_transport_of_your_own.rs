//! A transport from outside the crate: TLS (RFC 8446) over TCP, by rustls.
//!
//! ```sh
//! cargo run -p trimaran-transport --features conformance --example a_transport_of_your_own
//! ```
//!
//! A link has four byte streams, so it has four TLS connections.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use futures_util::{StreamExt, future};
use tokio::io::{AsyncRead, AsyncWrite, join, split};
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivatePkcs8KeyDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, RootCertStore, ServerConfig};
use tokio_rustls::{TlsAcceptor, TlsConnector};
use tokio_util::io::{ReaderStream, StreamReader};
use trimaran_net::{BoxFuture, Stream, StreamPeer, TcpOptions};
use trimaran_transport::conformance::{ARM, PANEL, Robot, finished, greeting, points, pose, receive, start};
use trimaran_transport::{
    AttemptError, Endpoint, ListenFault, Listening, Net, Options, TokioNet, Transport, Upgrade,
};

type Listener = trimaran_transport::Listener<Robot>;

/// TLS connections: endpoints are written `tls://host:port`.
struct Tls {
    tcp: TcpOptions,
    listener: TlsAcceptor,
    connector: TlsConnector,
    /// The name in the listener's certificate.
    name: ServerName<'static>,
}

impl std::fmt::Debug for Tls {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tls").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Tls {
    /// For a listener with `certificate` and its `key`, and for peers that trust nobody else.
    fn new(
        certificate: CertificateDer<'static>,
        key: PrivatePkcs8KeyDer<'static>,
        name: ServerName<'static>,
    ) -> Result<Self, Box<dyn std::error::Error>> {
        let mut trusted = RootCertStore::empty();
        trusted.add(certificate.clone())?;
        let provider = Arc::new(default_provider());
        let client = ClientConfig::builder_with_provider(Arc::clone(&provider))
            .with_safe_default_protocol_versions()?
            .with_root_certificates(trusted)
            .with_no_client_auth();
        let server = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()?
            .with_no_client_auth()
            .with_single_cert(vec![certificate], key.into())?;
        let (listener, connector) = (Arc::new(server).into(), Arc::new(client).into());
        Ok(Self { tcp: TcpOptions::default(), listener, connector, name })
    }
}

impl Transport for Tls {
    fn scheme(&self) -> &'static str {
        "tls"
    }

    fn is_encrypted(&self) -> bool {
        true
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>> {
        Box::pin(async move {
            let failed = |cause| AttemptError::Connect { address: address.to_owned(), cause };
            let to = match beside {
                Some(StreamPeer::Tcp(to)) => to,
                _ => resolve(net, address).await.map_err(AttemptError::Resolve)?,
            };
            let Stream { reader, writer, peer } = net.connect_tcp(to, self.tcp).await.map_err(failed)?;
            let encrypted = self.connector.connect(self.name.clone(), join(reader, writer)).await;
            Ok(bytes_of(encrypted.map_err(failed)?, peer))
        })
    }

    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>> {
        Box::pin(async move {
            let at = resolve(net, address).await.map_err(ListenFault::Address)?;
            let (socket, at) = net.listen_tcp(at, self.tcp)?;
            Ok(Listening { socket, address: at.to_string() })
        })
    }

    /// The listener's part of the TLS handshake.
    fn upgrade(&self) -> Option<&dyn Upgrade> {
        Some(self)
    }
}

impl Upgrade for Tls {
    fn upgrade(&self, Stream { reader, writer, peer }: Stream) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async move { Ok(bytes_of(self.listener.accept(join(reader, writer)).await?, peer)) })
    }
}

/// The first address of a host and port.
async fn resolve(net: &Arc<dyn Net>, address: &str) -> io::Result<SocketAddr> {
    let addresses = net.resolve(address).await?;
    addresses.first().copied().ok_or_else(|| io::ErrorKind::NotFound.into())
}

fn bytes_of<S: AsyncRead + AsyncWrite + Send + 'static>(encrypted: S, peer: StreamPeer) -> Stream {
    let (reader, writer) = split(encrypted);
    // Links have a close of their own, so a missing TLS close is an ordinary end of the stream.
    let ends = |read: &io::Result<_>| matches!(read, Err(e) if e.kind() == io::ErrorKind::UnexpectedEof);
    let bytes = ReaderStream::new(reader).take_while(move |read| future::ready(!ends(read)));
    Stream { reader: Box::new(StreamReader::new(bytes)), writer: Box::new(writer), peer }
}

/// Options of robots that know a certificate made for now.
fn options() -> Result<Options, Box<dyn std::error::Error>> {
    let made = rcgen::generate_simple_self_signed(["robot".to_owned()])?;
    let key = made.signing_key.serialize_der().into();
    let tls = Tls::new(made.cert.into(), key, "robot".try_into()?)?;
    Ok(Options::default().with_transports(vec![Arc::new(tls)]))
}

/// The rest is the same over any transport.
#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let options = options()?;
    let soon = net.now().after(std::time::Duration::from_secs(5));

    let at = Endpoint::other("tls", "127.0.0.1:0");
    let mut listener = Listener::bind(&net, &at, greeting(ARM), &options).await?;
    let at = listener.local_endpoint().clone();
    let (arm, panel) = tokio::join!(
        listener.accept(soon),
        trimaran_transport::connect::<Robot>(&net, &at, greeting(PANEL), &options, soon),
    );
    let (mut arm, mut panel) = (arm?, panel?);
    println!("linked with {} over {at}", arm.peer.name);

    panel.latest_tx.publish(pose(7))?;
    println!("the newest pose: {:?}", arm.latest_rx.latest().await?);
    arm.frames_tx.begin(start(0)).await?;
    arm.frames_tx.push(&points(1000)).await?;
    arm.frames_tx.finish().await?;
    println!("a frame of {} points", receive(&mut panel.frames_rx).await?.points.len());

    let (left, heard) = tokio::join!(arm.close(finished()), panel.close(finished()));
    left.and(heard)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use trimaran_transport::conformance::{Joined, Overhead};

    use super::*;

    const OVERHEAD: Overhead = Overhead { header_bytes: 4, handshake: 4, coded: true };

    fn tls() -> Joined {
        Joined::over(Endpoint::other("tls", "127.0.0.1:0"), options().unwrap(), OVERHEAD)
    }

    trimaran_transport::conformance!(tls());
}
