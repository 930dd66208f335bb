//! HTTP: a server that stays fair under load, and a client.

use std::{
    collections::{HashMap, VecDeque},
    error::Error,
    io,
    net::IpAddr,
    sync::Arc,
    time::Duration,
};

use http_body_util::{BodyExt, Empty, Limited};
use hyper::{Request, StatusCode, body::Bytes, client::conn::http1};
use hyper_util::rt::TokioIo;
use thiserror::Error as ThisError;
use tokio::{
    io::{AsyncRead, AsyncWrite, join},
    net::TcpStream,
    task::{AbortHandle, JoinSet},
};
use trimaran_net::{BoxFuture, Listen, Stream, StreamPeer};
use trimaran_transport::{HostPort, Net, sleep_until, ws::WsOptions};

/// The pause after the system could not accept, for instance for lack of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// A client. Clients of one address share the limits on simultaneous requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Asker(Option<IpAddr>);

impl Asker {
    pub(crate) fn of(peer: StreamPeer) -> Self {
        Self(match peer {
            StreamPeer::Unix(_) => None,
            StreamPeer::Tcp(at) => Some(match at.ip().to_canonical() {
                // One site owns all addresses of a network.
                IpAddr::V6(ip) => IpAddr::V6((ip.to_bits() >> 64 << 64).into()),
                ip => ip,
            }),
        })
    }
}

/// Serves clients for ever, `most` at once. A further client displaces the oldest one of the address that has
/// the most. The displaced one has had time to ask, so silent clients do not keep others out.
pub(crate) async fn serve(
    net: Arc<dyn Net>,
    mut listener: Box<dyn Listen>,
    most: usize,
    each: impl Fn(Stream) -> BoxFuture<'static, ()>,
) {
    let (mut guests, mut places, mut failing) = (JoinSet::new(), VecDeque::new(), false);
    loop {
        match listener.accept().await {
            Ok(stream) => {
                failing = false;
                while guests.try_join_next().is_some() {}
                places.retain(|(_, guest): &Place| !guest.is_finished());
                if places.len() >= most
                    && let Some((_, first)) = first_of_most(&places).and_then(|first| places.remove(first))
                {
                    first.abort();
                }
                places.push_back((Asker::of(stream.peer), guests.spawn(each(stream))));
            }
            Err(e) => {
                if !failing {
                    let error = &e as &dyn Error;
                    tracing::warn!(error, "could not accept whoever asks over HTTP; trying again");
                }
                failing = true;
                sleep_until(&*net, net.now().after(ACCEPT_PAUSE)).await;
            }
        }
    }
}

/// A client that is being served.
type Place = (Asker, AbortHandle);

/// The oldest client of the address that has the most.
fn first_of_most(places: &VecDeque<Place>) -> Option<usize> {
    let mut counts: HashMap<Asker, usize> = HashMap::new();
    for (asker, _) in places {
        *counts.entry(*asker).or_default() += 1;
    }
    let most = counts.values().max().copied();
    places.iter().position(|(asker, _)| counts.get(asker).copied() == most)
}

/// The longest answer, bytes.
const LONGEST: usize = 1 << 20;

/// Why a request failed.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum GetError {
    /// The connection failed.
    #[error("nobody answers there")]
    Connect(#[source] io::Error),
    /// The connection cannot be encrypted, for instance as the server's certificate is not valid.
    #[error("the connection cannot be encrypted")]
    Tls(#[source] io::Error),
    /// The target is not a valid URI.
    #[error("that is no address")]
    Target(#[source] hyper::http::Error),
    /// The connection was lost, or does not speak HTTP.
    #[error("it does not speak HTTP to the end")]
    Exchange(#[source] hyper::Error),
    /// The answer is too long, or was cut off.
    #[error("its answer does not come to an end")]
    Body(#[source] Box<dyn Error + Send + Sync>),
    /// The server answered with an error status.
    #[error("it answers {0}")]
    Status(StatusCode),
}

/// Gets a target, such as `/scene?token=T`, from a server at a host and port, such as `127.0.0.1:7480`.
///
/// # Errors
/// When the request fails.
pub async fn get(at: &str, target: &str) -> Result<Bytes, GetError> {
    let stream = TcpStream::connect(at).await.map_err(GetError::Connect)?;
    ask(stream, at, target).await
}

/// The same, with the server's IP address as its `Host`: the server may not know its name.
///
/// # Errors
/// When the request fails.
pub async fn get_by_address(at: &str, target: &str) -> Result<Bytes, GetError> {
    let stream = TcpStream::connect(at).await.map_err(GetError::Connect)?;
    let host = stream.peer_addr().map_err(GetError::Connect)?.to_string();
    ask(stream, &host, target).await
}

/// The same over TLS, from a server whose certificate is valid.
///
/// # Errors
/// When the request fails.
pub async fn get_over_tls(at: &HostPort, target: &str, options: &WsOptions) -> Result<Bytes, GetError> {
    let host = at.to_string();
    let stream = TcpStream::connect(&host).await.map_err(GetError::Connect)?;
    let peer = StreamPeer::Tcp(stream.peer_addr().map_err(GetError::Connect)?);
    let (reader, writer) = stream.into_split();
    let stream = Stream { reader: Box::new(reader), writer: Box::new(writer), peer };
    let Stream { reader, writer, .. } = options.encrypt(&at.host, stream).await.map_err(GetError::Tls)?;
    ask(join(reader, writer), &host, target).await
}

async fn ask<S>(stream: S, host: &str, target: &str) -> Result<Bytes, GetError>
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let (mut sender, connection) =
        http1::handshake(TokioIo::new(stream)).await.map_err(GetError::Exchange)?;
    let request =
        Request::get(target).header("host", host).body(Empty::<Bytes>::new()).map_err(GetError::Target)?;
    let exchange = async {
        let response = sender.send_request(request).await.map_err(GetError::Exchange)?;
        let status = response.status();
        let body = Limited::new(response.into_body(), LONGEST).collect().await.map_err(GetError::Body)?;
        let body = body.to_bytes();
        // This closes the connection.
        drop(sender);
        Ok((status, body))
    };
    // The connection does the work that the exchange waits for; it may end first.
    let (_, exchanged) = tokio::join!(connection, exchange);
    match exchanged? {
        (StatusCode::OK, body) => Ok(body),
        (status, _) => Err(GetError::Status(status)),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::net::SocketAddr;

    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex, split},
        sync::mpsc,
    };
    use trimaran_net::StreamPeer;
    use trimaran_transport::{TokioNet, until};

    use super::*;

    /// Clients that come one after the other.
    pub(crate) struct Guests(pub(crate) mpsc::UnboundedReceiver<DuplexStream>);

    impl Listen for Guests {
        fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
            Box::pin(async {
                self.0.recv().await.map(stream).ok_or_else(|| io::ErrorKind::BrokenPipe.into())
            })
        }
    }

    fn stream(guest: DuplexStream) -> Stream {
        let (reader, writer) = split(guest);
        let peer = StreamPeer::Tcp(SocketAddr::from(([127, 0, 0, 1], 1)));
        Stream { reader: Box::new(reader), writer: Box::new(writer), peer }
    }

    pub(crate) fn guest(come: &mpsc::UnboundedSender<DuplexStream>) -> DuplexStream {
        let (here, there) = duplex(64 << 10);
        come.send(there).unwrap();
        here
    }

    /// Sends back the first byte.
    fn echo(mut stream: Stream) -> BoxFuture<'static, ()> {
        Box::pin(async move {
            if let Ok(byte) = stream.reader.read_u8().await {
                let _gone = stream.writer.write_u8(byte).await;
            }
        })
    }

    /// Not even virtual time passes before the answer.
    #[tokio::test(start_paused = true)]
    async fn a_hundred_silent_guests_keep_nobody_waiting() {
        const MOST: usize = 64;
        let net = TokioNet::current().unwrap();
        let (come, guests) = mpsc::unbounded_channel();
        let mut server = JoinSet::new();
        server.spawn(serve(Arc::new(net.clone()), Box::new(Guests(guests)), MOST, echo));
        let (before, mut silent) = (net.now(), Vec::new());
        for _ in 0..100 {
            silent.push(guest(&come));
            tokio::task::yield_now().await;
        }
        let mut one = guest(&come);
        one.write_u8(7).await.unwrap();
        assert_eq!(one.read_u8().await.unwrap(), 7);
        assert_eq!(net.now(), before, "it was served at once");
        // No more are held than there are places: the oldest ones have lost theirs.
        let mut ended = 0;
        for guest in &mut silent {
            let end = until(&net, net.now(), guest.read_u8()).await;
            ended += usize::from(end.is_some());
        }
        assert_eq!(ended, 100 + 1 - MOST);
    }

    /// A client from somewhere else waits for its answer as long as it takes.
    #[tokio::test(start_paused = true)]
    async fn a_crowd_from_one_address_takes_the_place_of_nobody_else() {
        let net = TokioNet::current().unwrap();
        let (come, guests) = mpsc::unbounded_channel();
        let mut server = JoinSet::new();
        server.spawn(serve(Arc::new(net), Box::new(Elsewhere { first: true, guests }), 8, echo));
        let (mut one, mut crowd) = (guest(&come), Vec::new());
        tokio::task::yield_now().await;
        for _ in 0..50 {
            crowd.push(guest(&come));
            tokio::task::yield_now().await;
        }
        one.write_u8(5).await.unwrap();
        assert_eq!(one.read_u8().await.unwrap(), 5);
    }

    /// The first client comes from another address than all others.
    struct Elsewhere {
        first: bool,
        guests: mpsc::UnboundedReceiver<DuplexStream>,
    }

    impl Listen for Elsewhere {
        fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
            let first = std::mem::take(&mut self.first);
            Box::pin(async move {
                let guest = self.guests.recv().await.ok_or(io::ErrorKind::BrokenPipe)?;
                let peer = StreamPeer::Tcp(SocketAddr::from(([127, 0, 0, 1 + u8::from(first)], 1)));
                Ok(Stream { peer, ..stream(guest) })
            })
        }
    }

    #[test]
    fn addresses_of_one_network_are_one_asker() {
        let of = |text: &str| Asker::of(StreamPeer::Tcp(text.parse().unwrap()));
        assert_eq!(of("[2001:db8:1:2::1]:80"), of("[2001:db8:1:2:3::9]:81"));
        assert_ne!(of("[2001:db8:1:2::1]:80"), of("[2001:db8:1:3::1]:80"));
        assert_eq!(of("[::ffff:10.0.0.1]:80"), of("10.0.0.1:7"));
        assert_ne!(of("10.0.0.1:80"), of("10.0.0.2:80"));
    }

    /// Fails as if there were no file descriptors.
    struct Failing {
        failures: usize,
        then: Option<DuplexStream>,
    }

    impl Listen for Failing {
        fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
            if let Some(left) = self.failures.checked_sub(1) {
                self.failures = left;
                return Box::pin(std::future::ready(Err(io::Error::from_raw_os_error(24))));
            }
            match self.then.take() {
                Some(guest) => Box::pin(std::future::ready(Ok(stream(guest)))),
                None => Box::pin(std::future::pending()),
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_system_that_cannot_accept_is_asked_again_after_a_pause_and_not_at_once() {
        const FAILURES: usize = 30;
        let net = TokioNet::current().unwrap();
        let began = net.now();
        let (mut here, there) = duplex(64 << 10);
        let listener = Box::new(Failing { failures: FAILURES, then: Some(there) });
        let answered = async {
            here.write_u8(9).await.unwrap();
            here.read_u8().await.unwrap()
        };
        tokio::select! {
            answer = answered => assert_eq!(answer, 9),
            () = serve(Arc::new(net.clone()), listener, 1, echo) => panic!("it serves for ever"),
        }
        assert_eq!(net.now().since(began), ACCEPT_PAUSE * FAILURES as u32);
    }
}
