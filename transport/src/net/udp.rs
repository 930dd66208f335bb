//! Datagrams through the seam: in batches, with what the kernel knows about each.

use std::fmt;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

pub use quinn_udp::{BATCH_SIZE, EcnCodepoint, RecvMeta, Transmit};

/// Options of a UDP socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UdpSocketOptions {
    /// The system's send buffer, bytes; the system may grant less. `None` leaves it as it is. Default 4 MiB.
    pub send_buffer: Option<usize>,
    /// The system's receive buffer, bytes; the system may grant less. `None` leaves it as it is. Default 4 MiB: a frame of
    /// 200,000 ids may arrive while the runtime does something else.
    pub recv_buffer: Option<usize>,
}

impl Default for UdpSocketOptions {
    fn default() -> Self {
        Self { send_buffer: Some(4 << 20), recv_buffer: Some(4 << 20) }
    }
}

/// A UDP socket. Any number of senders may share it; one task receives.
pub trait UdpSocket: fmt::Debug + Send + Sync + 'static {
    /// Sends a datagram, or several of one size where `segment_size` is given and at most
    /// [`UdpSocket::max_transmit_segments`] of them are in it. Never waits.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] when there is no room now: wait with a [`UdpSocket::poller`]. Any other error is about
    /// this datagram or its destination; a sender may take the datagram for lost.
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()>;

    /// Tells one waiter when there may be room to send. Each waiter has its own, so that none takes another's wake-up.
    fn poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>>;

    /// Receives into as many buffers as there are both datagrams and buffers, and says how many it filled. A buffer may
    /// get several datagrams of [`RecvMeta::stride`] bytes each, at most [`UdpSocket::max_receive_segments`]; what does not
    /// fit is lost.
    fn poll_recv(
        &self,
        cx: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>>;

    /// Where it is bound.
    ///
    /// # Errors
    /// When the system does not say.
    fn local_addr(&self) -> io::Result<SocketAddr>;

    /// How many datagrams one [`Transmit`] may hold; at least 1.
    fn max_transmit_segments(&self) -> usize;

    /// How many datagrams one buffer may receive; at least 1.
    fn max_receive_segments(&self) -> usize;

    /// Whether a datagram larger than the path takes may be cut up on the way rather than dropped.
    fn may_fragment(&self) -> bool;
}

/// Tells one waiter when a [`UdpSocket`] may have room to send.
pub trait UdpPoller: fmt::Debug + Send + Sync + 'static {
    /// Ready once there may be room.
    fn poll_writable(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>>;
}
