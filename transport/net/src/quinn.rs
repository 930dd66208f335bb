//! quinn over [`Net`]: its clock, timers, tasks and sockets, so that a simulated network runs the same QUIC.
//!
//! [`client`], [`server`] and [`endpoint`] take the places of `quinn::Endpoint::client`, `server` and `new`.
//! The endpoints, connections and streams that come from them are quinn's own.
//!
//! ```
//! use std::sync::Arc;
//! use trimaran_net::{Net, TokioNet};
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let net: Arc<dyn Net> = Arc::new(TokioNet::current()?); // or the network of a simulated host
//! let endpoint = trimaran_net::quinn::client(&net, "127.0.0.1:0".parse()?)?;
//! assert_ne!(endpoint.local_addr()?.port(), 0);
//! # Ok(())
//! # }
//! ```

use std::fmt;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant as StdInstant};

use quinn::udp as quinn_udp;
use quinn::{
    AsyncTimer, AsyncUdpSocket, Endpoint, EndpointConfig, Runtime, ServerConfig, UdpPoller as QuinnPoller,
};

use crate::{
    BATCH_SIZE, EcnCodepoint, Instant, Net, RecvMeta, Timer, Transmit, UdpPoller, UdpSocket,
    UdpSocketOptions, random_bytes,
};

/// An endpoint that connects, on a socket bound to `at`; port 0 takes a free one.
///
/// # Errors
/// If the address cannot be bound.
pub fn client(net: &Arc<dyn Net>, at: SocketAddr) -> io::Result<Endpoint> {
    endpoint(net, EndpointConfig::default(), None, at, UdpSocketOptions::default())
}

/// An endpoint that accepts connections, on a socket bound to `at`; port 0 takes a free one.
///
/// # Errors
/// If the address cannot be bound.
pub fn server(net: &Arc<dyn Net>, config: ServerConfig, at: SocketAddr) -> io::Result<Endpoint> {
    endpoint(net, EndpointConfig::default(), Some(config), at, UdpSocketOptions::default())
}

/// An endpoint with all its options, on a socket bound to `at`. It accepts connections if there is a
/// `server`.
///
/// The seed of its random numbers comes from [`Net::random`], in place of that in `config`. So a simulated
/// network repeats them. quinn draws the contents of keys elsewhere.
///
/// # Errors
/// If the address cannot be bound, or the network gives no random bits.
pub fn endpoint(
    net: &Arc<dyn Net>,
    config: EndpointConfig,
    server: Option<ServerConfig>,
    at: SocketAddr,
    socket: UdpSocketOptions,
) -> io::Result<Endpoint> {
    endpoint_on(net, config, server, net.bind_udp(at, socket)?)
}

/// As [`endpoint`], on a socket of this network that is bound already.
///
/// # Errors
/// If the network gives no random bits.
pub fn endpoint_on(
    net: &Arc<dyn Net>,
    mut config: EndpointConfig,
    server: Option<ServerConfig>,
    socket: Arc<dyn UdpSocket>,
) -> io::Result<Endpoint> {
    config.rng_seed(Some(random_bytes(&**net)?));
    let (socket, runtime) = (Arc::new(NetSocket(socket)), Arc::new(NetRuntime::new(net)));
    Endpoint::new_with_abstract_socket(config, server, socket, runtime)
}

/// A [`Net`] as quinn's runtime, for programs that make their endpoints themselves.
#[derive(Debug, Clone)]
pub struct NetRuntime {
    net: Arc<dyn Net>,
    /// The `Net`'s origin in quinn's time: any fixed moment will do.
    origin: StdInstant,
}

impl NetRuntime {
    #[allow(clippy::disallowed_methods, reason = "a fixed point that the time of the seam is counted from")]
    /// The runtime of this network. Its time is that of `net`, counted from this moment of the real clock.
    #[must_use]
    pub fn new(net: &Arc<dyn Net>) -> Self {
        Self { net: Arc::clone(net), origin: StdInstant::now() }
    }

    fn net_instant(&self, at: StdInstant) -> Instant {
        Instant::from_nanos(0).after(at.saturating_duration_since(self.origin))
    }
}

impl Runtime for NetRuntime {
    fn new_timer(&self, at: StdInstant) -> Pin<Box<dyn AsyncTimer>> {
        let mut timer = NetTimer { timer: self.net.timer(), runtime: self.clone() };
        timer.timer.reset(self.net_instant(at));
        Box::pin(timer)
    }

    fn spawn(&self, task: Pin<Box<dyn Future<Output = ()> + Send>>) {
        self.net.spawn(task);
    }

    fn wrap_udp_socket(&self, _socket: std::net::UdpSocket) -> io::Result<Arc<dyn AsyncUdpSocket>> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn now(&self) -> StdInstant {
        self.origin + Duration::from_nanos(self.net.now().as_nanos())
    }
}

struct NetTimer {
    timer: Box<dyn Timer>,
    runtime: NetRuntime,
}

impl fmt::Debug for NetTimer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("NetTimer").finish_non_exhaustive()
    }
}

impl AsyncTimer for NetTimer {
    fn reset(mut self: Pin<&mut Self>, at: StdInstant) {
        let at = self.runtime.net_instant(at);
        self.timer.reset(at);
    }

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        self.timer.poll(cx)
    }
}

/// A socket of [`Net`] as quinn's socket. A datagram that cannot be sent counts as lost.
#[derive(Debug)]
pub struct NetSocket(pub Arc<dyn UdpSocket>);

impl AsyncUdpSocket for NetSocket {
    fn create_io_poller(self: Arc<Self>) -> Pin<Box<dyn QuinnPoller>> {
        Box::pin(NetPoller(Arc::clone(&self.0).poller()))
    }

    fn try_send(&self, transmit: &quinn_udp::Transmit<'_>) -> io::Result<()> {
        let quinn_udp::Transmit { destination, ecn, contents, segment_size, src_ip } = *transmit;
        let ecn = ecn.map(|mark| match mark {
            quinn_udp::EcnCodepoint::Ect0 => EcnCodepoint::Ect0,
            quinn_udp::EcnCodepoint::Ect1 => EcnCodepoint::Ect1,
            quinn_udp::EcnCodepoint::Ce => EcnCodepoint::Ce,
        });
        match self.0.try_send(&Transmit { destination, ecn, contents, segment_size, src_ip }) {
            Err(e) if e.kind() != io::ErrorKind::WouldBlock => {
                // This concerns one datagram, and QUIC retransmits lost ones; quinn would give the connection
                // up.
                tracing::debug!(error = &e as &dyn std::error::Error, "a datagram could not be sent");
                Ok(())
            }
            sent => sent,
        }
    }

    fn poll_recv(
        &self,
        cx: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [quinn_udp::RecvMeta],
    ) -> Poll<io::Result<usize>> {
        let mut received = [RecvMeta::default(); BATCH_SIZE];
        let room = buffers.len().min(meta.len()).min(BATCH_SIZE);
        let (buffers, known) = (buffers.get_mut(..room).unwrap_or_default(), &mut received);
        let filled = ready!(self.0.poll_recv(cx, buffers, known))?;
        for (meta, received) in meta.iter_mut().zip(&received).take(filled) {
            *meta = told(received);
        }
        Poll::Ready(Ok(filled))
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.0.local_addr()
    }

    fn max_transmit_segments(&self) -> usize {
        self.0.max_transmit_segments()
    }

    fn max_receive_segments(&self) -> usize {
        self.0.max_receive_segments()
    }

    fn may_fragment(&self) -> bool {
        self.0.may_fragment()
    }
}

fn told(received: &RecvMeta) -> quinn_udp::RecvMeta {
    let mut meta = quinn_udp::RecvMeta::default();
    (meta.addr, meta.len, meta.stride, meta.dst_ip) =
        (received.addr, received.len, received.stride, received.dst_ip);
    meta.ecn = received.ecn.map(|mark| match mark {
        EcnCodepoint::Ect0 => quinn_udp::EcnCodepoint::Ect0,
        EcnCodepoint::Ect1 => quinn_udp::EcnCodepoint::Ect1,
        EcnCodepoint::Ce => quinn_udp::EcnCodepoint::Ce,
    });
    meta
}

#[derive(Debug)]
struct NetPoller(Pin<Box<dyn UdpPoller>>);

impl QuinnPoller for NetPoller {
    fn poll_writable(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.0.as_mut().poll_writable(cx)
    }
}
