//! quinn over [`Net`]: its clock, timers, tasks and sockets, so that a simulated network runs the same QUIC.

use std::fmt;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant as StdInstant};

use quinn::udp as quinn_udp;
use quinn::{AsyncTimer, AsyncUdpSocket, Runtime, UdpPoller as QuinnPoller};

use trimaran_net::{BATCH_SIZE, EcnCodepoint, Instant, Net, RecvMeta, Timer, Transmit, UdpPoller, UdpSocket};

/// A [`Net`] as quinn's runtime.
#[derive(Debug, Clone)]
pub(crate) struct NetRuntime {
    net: Arc<dyn Net>,
    /// The `Net`'s origin in quinn's time: any fixed moment will do.
    origin: StdInstant,
}

impl NetRuntime {
    #[allow(clippy::disallowed_methods, reason = "a fixed point that the time of the seam is counted from")]
    pub(crate) fn new(net: &Arc<dyn Net>) -> Self {
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

/// A socket of [`Net`] as quinn's socket.
#[derive(Debug)]
pub(crate) struct NetSocket(pub(crate) Arc<dyn UdpSocket>);

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
