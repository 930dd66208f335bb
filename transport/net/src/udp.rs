//! Datagrams: in batches, with the kernel's metadata for each.

use std::fmt;
use std::io::{self, IoSliceMut};
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

/// The most buffers that one [`UdpSocket::poll_recv`] fills.
pub const BATCH_SIZE: usize = 32;

/// One datagram to send, or several of one size to one address.
#[derive(Debug, Clone, Copy)]
pub struct Transmit<'a> {
    /// The destination.
    pub destination: SocketAddr,
    /// The ECN codepoint, if any (RFC 3168).
    pub ecn: Option<EcnCodepoint>,
    /// The bytes of the datagram, or of all of them one after the other.
    pub contents: &'a [u8],
    /// The bytes of each of several datagrams; the last one may have fewer. `None` for a single one.
    pub segment_size: Option<usize>,
    /// The source address, where there are several; otherwise the system chooses.
    pub src_ip: Option<IpAddr>,
}

/// The metadata of one received buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecvMeta {
    /// The source address.
    pub addr: SocketAddr,
    /// The filled bytes of the buffer.
    pub len: usize,
    /// The bytes of each datagram in the buffer; the last one may have fewer.
    pub stride: usize,
    /// The ECN codepoint on arrival (RFC 3168).
    pub ecn: Option<EcnCodepoint>,
    /// The destination address, where the system tells.
    pub dst_ip: Option<IpAddr>,
}

impl Default for RecvMeta {
    /// The metadata of an empty buffer.
    fn default() -> Self {
        let addr = SocketAddr::new(Ipv6Addr::UNSPECIFIED.into(), 0);
        Self { addr, len: 0, stride: 0, ecn: None, dst_ip: None }
    }
}

/// The two bits of explicit congestion notification (RFC 3168, section 5), if they are not zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EcnCodepoint {
    /// ECT(0): its sender slows down when it is marked.
    Ect0,
    /// ECT(1): the same (RFC 9331 gives it another meaning).
    Ect1,
    /// CE: it met congestion.
    Ce,
}

/// Options of a UDP socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct UdpSocketOptions {
    /// The system's send buffer, bytes; the system may grant less. `None` leaves it as it is. Default 4 MiB.
    pub send_buffer: Option<usize>,
    /// The system's receive buffer, bytes; the system may grant less. `None` leaves it as it is. Default 4
    /// MiB: a frame of 200,000 ids may arrive while the runtime does something else.
    pub recv_buffer: Option<usize>,
}

impl UdpSocketOptions {
    crate::setters! {
        with_send_buffer send_buffer: Option<usize>,
        with_recv_buffer recv_buffer: Option<usize>,
    }
}

impl Default for UdpSocketOptions {
    fn default() -> Self {
        Self { send_buffer: Some(4 << 20), recv_buffer: Some(4 << 20) }
    }
}

/// A UDP socket. Any number of senders may share it; one task receives.
pub trait UdpSocket: fmt::Debug + Send + Sync + 'static {
    /// Sends a datagram, or several of one size if `segment_size` is given, at most
    /// [`UdpSocket::max_transmit_segments`]. Never waits.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] when there is no room now: wait with a [`UdpSocket::poller`]. Any other
    /// error concerns this datagram or its destination; a sender may take the datagram for lost.
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()>;

    /// Wakes one waiter when there may be room to send. Each waiter has its own poller, so that none takes
    /// another's wake-up.
    fn poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>>;

    /// Receives into as many buffers as there are both datagrams and buffers, and returns how many it filled.
    /// A buffer may get several datagrams of [`RecvMeta::stride`] bytes each, at most
    /// [`UdpSocket::max_receive_segments`]; excess bytes are lost.
    fn poll_recv(
        &self,
        cx: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>>;

    /// The bound address.
    ///
    /// # Errors
    /// If the system does not tell.
    fn local_addr(&self) -> io::Result<SocketAddr>;

    /// How many datagrams one [`Transmit`] may hold; at least 1, the default.
    fn max_transmit_segments(&self) -> usize {
        1
    }

    /// How many datagrams one buffer may receive; at least 1, the default.
    fn max_receive_segments(&self) -> usize {
        1
    }

    /// Whether a datagram larger than the path MTU may be fragmented rather than dropped. Default false.
    fn may_fragment(&self) -> bool {
        false
    }
}

/// Wakes one waiter when a [`UdpSocket`] may have room to send.
pub trait UdpPoller: fmt::Debug + Send + Sync + 'static {
    /// Ready once there may be room.
    fn poll_writable(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>>;
}
