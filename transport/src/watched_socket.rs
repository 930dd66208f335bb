//! A UDP socket that knows whether anything has come, and holds a listener's address.

use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

use trimaran_net::{RecvMeta, Transmit, UdpPoller, UdpSocket};

use crate::acceptor::Serving;

/// A socket that others use.
#[derive(Debug)]
pub(crate) struct WatchedSocket {
    socket: Arc<dyn UdpSocket>,
    heard: AtomicBool,
    /// Dropped with the socket, when its address is free again.
    _serving: Option<Serving>,
}

impl WatchedSocket {
    pub(crate) fn new(socket: Arc<dyn UdpSocket>, serving: Option<Serving>) -> Arc<Self> {
        Arc::new(Self { socket, heard: AtomicBool::new(false), _serving: serving })
    }

    /// Whether any datagram has come.
    #[cfg_attr(not(feature = "quic"), expect(dead_code, reason = "over udp the connection knows"))]
    pub(crate) fn has_heard(&self) -> bool {
        self.heard.load(Ordering::Relaxed)
    }
}

impl UdpSocket for WatchedSocket {
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        self.socket.try_send(transmit)
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
        let received = self.socket.poll_recv(cx, buffers, meta);
        if let Poll::Ready(Ok(_)) = received {
            self.heard.store(true, Ordering::Relaxed);
        }
        received
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    fn max_transmit_segments(&self) -> usize {
        self.socket.max_transmit_segments()
    }

    fn max_receive_segments(&self) -> usize {
        self.socket.max_receive_segments()
    }

    fn may_fragment(&self) -> bool {
        self.socket.may_fragment()
    }
}
