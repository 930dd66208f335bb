//! A transport from outside the crate: WebSocket (RFC 6455), which passes proxies, and which a page in a
//! browser speaks.
//!
//! ```sh
//! cargo run -p trimaran-transport --features conformance --example a_transport_of_your_own
//! ```
//!
//! A link has four byte streams, so it has four WebSockets. Bytes travel as binary messages, of any size: where
//! one ends means nothing.

use std::io;
use std::iter;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt, TryStreamExt, future, stream};
use tokio::io::{AsyncRead, AsyncWrite, join};
use tokio::sync::{Semaphore, mpsc};
use tokio_tungstenite::tungstenite::error::ProtocolError;
use tokio_tungstenite::tungstenite::{self, Bytes, Message};
use tokio_tungstenite::{WebSocketStream, accept_async, client_async};
use tokio_util::io::{CopyToBytes, SinkWriter, StreamReader};
use trimaran_net::{BoxFuture, Listen, Stream, StreamPeer, TcpOptions, sleep_until, until};
use trimaran_transport::conformance::{ARM, PANEL, Robot, finished, greeting, points, pose, receive, start};
use trimaran_transport::{AttemptError, Endpoint, ListenFault, Listening, Net, Options, TokioNet, Transport};

type Listener = trimaran_transport::Listener<Robot>;

/// How many clients may be in the midst of the WebSocket handshake, and how long each may take.
const HANDSHAKES: usize = 64;
const HANDSHAKE: Duration = Duration::from_secs(5);
/// The most bytes of one message: the other end refuses messages of more than 16 MiB.
const MESSAGE: usize = 64 * 1024;
/// The pause after the system could not accept, for instance for want of file descriptors.
const PAUSE: Duration = Duration::from_millis(100);

/// WebSockets over TCP: endpoints are written `ws://host:port/path`.
#[derive(Debug, Default)]
struct WebSockets(TcpOptions);

impl Transport for WebSockets {
    fn scheme(&self) -> &'static str {
        "ws"
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
            let Stream { reader, writer, peer } = net.connect_tcp(to, self.0).await.map_err(failed)?;
            let url = format!("ws://{address}");
            let (socket, _answer) =
                client_async(url, join(reader, writer)).await.map_err(|e| failed(io_error(e)))?;
            Ok(bytes_of(socket, peer))
        })
    }

    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>> {
        Box::pin(async move {
            let at = resolve(net, address).await.map_err(ListenFault::Address)?;
            let (tcp, at) = net.listen_tcp(at, self.0)?;
            let (sender, ready) = mpsc::channel(HANDSHAKES);
            net.spawn(Box::pin(accept(Arc::clone(net), tcp, sender)));
            let path = address.split_once('/').map_or("", |(_, path)| path);
            Ok(Listening { socket: Box::new(Accepted(ready)), address: format!("{at}/{path}") })
        })
    }
}

/// The first address of `host:port/path`.
async fn resolve(net: &Arc<dyn Net>, address: &str) -> io::Result<SocketAddr> {
    let host = address.split_once('/').map_or(address, |(host, _)| host);
    let addresses = net.resolve(host).await?;
    addresses.first().copied().ok_or_else(|| io::ErrorKind::NotFound.into())
}

/// Clients whose WebSocket handshake is done.
struct Accepted(mpsc::Receiver<Stream>);

impl Listen for Accepted {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async { self.0.recv().await.ok_or_else(|| io::ErrorKind::BrokenPipe.into()) })
    }
}

/// Shakes hands with each client beside the others, until nobody takes them any more: one that is slow holds
/// up nobody.
async fn accept(net: Arc<dyn Net>, mut tcp: Box<dyn Listen>, ready: mpsc::Sender<Stream>) {
    let room = Arc::new(Semaphore::new(HANDSHAKES));
    loop {
        let Ok(slot) = Arc::clone(&room).acquire_owned().await else { return };
        let accepted = tokio::select! {
            () = ready.closed() => return,
            accepted = tcp.accept() => accepted,
        };
        let Ok(Stream { reader, writer, peer }) = accepted else {
            sleep_until(&*net, net.now().after(PAUSE)).await;
            continue;
        };
        let (clock, ready) = (Arc::clone(&net), ready.clone());
        net.spawn(Box::pin(async move {
            let shaken =
                until(&*clock, clock.now().after(HANDSHAKE), accept_async(join(reader, writer))).await;
            if let Some(Ok(socket)) = shaken {
                let _nobody_left = ready.send(bytes_of(socket, peer)).await;
            }
            drop(slot);
        }));
    }
}

/// A WebSocket as a stream of bytes.
fn bytes_of<S>(socket: WebSocketStream<S>, peer: StreamPeer) -> Stream
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let (sink, stream) = socket.split();
    // Who is gone without a word may not have closed the WebSocket: the stream of bytes ends either way.
    let messages = stream.scan((), |(), message| {
        future::ready(match message {
            Err(tungstenite::Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => None,
            message => Some(message.map_err(io_error)),
        })
    });
    // Pings and pongs are tungstenite's business.
    let bytes = messages.try_filter_map(|message| {
        future::ready(match message {
            Message::Binary(bytes) => Ok(Some(bytes)),
            Message::Text(_) => {
                Err(io::Error::new(io::ErrorKind::InvalidData, "text came, which is no byte"))
            }
            _ => Ok(None),
        })
    });
    let sink = sink.sink_map_err(io_error).with_flat_map(|mut bytes: Bytes| {
        let pieces = iter::from_fn(move || {
            let piece = bytes.split_to(bytes.len().min(MESSAGE));
            (!piece.is_empty()).then(|| Ok(Message::Binary(piece)))
        });
        stream::iter(pieces)
    });
    Stream {
        reader: Box::new(StreamReader::new(bytes)),
        writer: Box::new(SinkWriter::new(CopyToBytes::new(sink))),
        peer,
    }
}

fn io_error(error: tungstenite::Error) -> io::Error {
    match error {
        tungstenite::Error::Io(error) => error,
        tungstenite::Error::ConnectionClosed | tungstenite::Error::AlreadyClosed => {
            io::ErrorKind::BrokenPipe.into()
        }
        other => io::Error::other(other),
    }
}

/// Everything else is as over any transport.
#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let options = Options { transports: vec![Arc::new(WebSockets::default())], ..Options::default() };
    let soon = net.now().after(Duration::from_secs(5));

    let at = Endpoint::other("ws", "127.0.0.1:0/robot");
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

    fn web_sockets() -> Joined {
        let options = Options { transports: vec![Arc::new(WebSockets::default())], ..Options::default() };
        Joined::over(Endpoint::other("ws", "127.0.0.1:0/robot"), options, OVERHEAD)
    }

    trimaran_transport::conformance!(web_sockets());
}
