//! Datagrams through the seam: in batches, with what the kernel knows about each.

use std::fmt;
use std::io::{self, IoSliceMut};
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

/// The most buffers that one [`UdpSocket::poll_recv`] need fill.
pub const BATCH_SIZE: usize = 32;

/// One datagram to send, or several of one size to one place.
#[derive(Debug, Clone, Copy)]
pub struct Transmit<'a> {
    /// Where it goes.
    pub destination: SocketAddr,
    /// How routers may mark it, if at all (RFC 3168).
    pub ecn: Option<EcnCodepoint>,
    /// What is in it, or in all of them one after the other.
    pub contents: &'a [u8],
    /// How many bytes each of several has; the last one may have fewer. `None` where there is only one.
    pub segment_size: Option<usize>,
    /// The address here that it leaves from, where there are several; else the system chooses.
    pub src_ip: Option<IpAddr>,
}

/// What is known of what came into one buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecvMeta {
    /// Where it comes from.
    pub addr: SocketAddr,
    /// How many bytes of the buffer are filled.
    pub len: usize,
    /// How many bytes each datagram in the buffer has; the last one may have fewer.
    pub stride: usize,
    /// How it was marked on the way (RFC 3168).
    pub ecn: Option<EcnCodepoint>,
    /// The address here that it was sent to, where the system tells.
    pub dst_ip: Option<IpAddr>,
}

impl Default for RecvMeta {
    /// Of an empty buffer.
    fn default() -> Self {
        let addr = SocketAddr::new(Ipv6Addr::UNSPECIFIED.into(), 0);
        Self { addr, len: 0, stride: 0, ecn: None, dst_ip: None }
    }
}

/// The two bits of explicit congestion notification (RFC 3168, section 5), where they are not zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EcnCodepoint {
    /// ECT(0): its sender slows down when it is marked.
    Ect0,
    /// ECT(1): the same (RFC 9331 gives it a meaning of its own).
    Ect1,
    /// CE: it met congestion.
    Ce,
}

/// Options of a UDP socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct UdpSocketOptions {
    /// The system's send buffer, bytes; the system may grant less. `None` leaves it as it is. Default 4 MiB.
    pub send_buffer: Option<usize>,
    /// The system's receive buffer, bytes; the system may grant less. `None` leaves it as it is. Default 4
    /// MiB: a frame of 200,000 ids may arrive while the runtime does something else.
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
    /// [`io::ErrorKind::WouldBlock`] when there is no room now: wait with a [`UdpSocket::poller`]. Any other
    /// error is about this datagram or its destination; a sender may take the datagram for lost.
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()>;

    /// Tells one waiter when there may be room to send. Each waiter has its own, so that none takes another's
    /// wake-up.
    fn poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>>;

    /// Receives into as many buffers as there are both datagrams and buffers, and says how many it filled. A
    /// buffer may get several datagrams of [`RecvMeta::stride`] bytes each, at most
    /// [`UdpSocket::max_receive_segments`]; what does not fit is lost.
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
