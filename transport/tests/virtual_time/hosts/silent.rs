//! A machine that begins handshakes over datagrams and never completes them.

use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};

use trimaran_net::{BoxFuture, Listen, RecvMeta, Stream, Timer, Transmit, UdpPoller, UdpSocket};
use trimaran_netsim::SimNet;
use trimaran_transport::{Instant, Net, TcpOptions, UdpSocketOptions};

/// A machine whose datagram sockets receive nothing but a Retry, so its handshakes stay open.
#[derive(Debug)]
pub(crate) struct SilentNet {
    net: SimNet,
    has_left: Arc<AtomicBool>,
}

impl SilentNet {
    pub(crate) fn new(net: SimNet) -> Self {
        Self { net, has_left: Arc::default() }
    }

    /// From now on its sockets send nothing: it vanishes without a close.
    pub(crate) fn leave(&self) {
        self.has_left.store(true, Ordering::Relaxed);
    }
}

impl Net for SilentNet {
    fn now(&self) -> Instant {
        self.net.now()
    }

    fn timer(&self) -> Box<dyn Timer> {
        self.net.timer()
    }

    fn spawn(&self, task: BoxFuture<'static, ()>) {
        self.net.spawn(task);
    }

    fn random(&self) -> io::Result<u64> {
        self.net.random()
    }

    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>> {
        self.net.resolve(address)
    }

    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>> {
        self.net.connect_tcp(to, options)
    }

    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
        self.net.listen_tcp(at, options)
    }

    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
        let socket = self.net.bind_udp(at, options)?;
        Ok(Arc::new(SilentSocket { socket, has_left: Arc::clone(&self.has_left) }))
    }
}

#[derive(Debug)]
struct SilentSocket {
    socket: Arc<dyn UdpSocket>,
    has_left: Arc<AtomicBool>,
}

/// Whether a datagram is a Retry: of QUIC (RFC 9000, section 17.2.5) or of the project's own protocol.
fn is_retry(first: u8) -> bool {
    first & 0xf0 == 0xf0 || first & 0x83 == 0x02
}

impl UdpSocket for SilentSocket {
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        if self.has_left.load(Ordering::Relaxed) { Ok(()) } else { self.socket.try_send(transmit) }
    }

    fn poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>> {
        Arc::clone(&self.socket).poller()
    }

    fn poll_recv(
        &self,
        cx: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>> {
        loop {
            let received = ready!(self.socket.poll_recv(cx, &mut buffers[..1], &mut meta[..1]))?;
            if buffers[0].first().copied().is_some_and(is_retry) {
                return Poll::Ready(Ok(received));
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }
}
