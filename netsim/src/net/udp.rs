//! UDP sockets of a simulated machine.

use std::collections::VecDeque;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use bytes::Bytes;
use trimaran_net::{EcnCodepoint, RecvMeta, Transmit, UdpPoller, UdpSocket, UdpSocketOptions};

use super::SimNet;
use crate::link::Ecn;
use crate::packet::{Body, Packet};
use crate::topology::HostId;

/// The first port that the system hands out itself (RFC 6335, section 6).
pub(super) const FIRST_FREE_PORT: u16 = 49_152;
/// The largest and the default buffer of a socket: Linux's `net.core.rmem_max` and `wmem_max`.
const LARGEST_BUFFER: usize = 212_992;

/// A bound socket.
#[derive(Debug)]
pub(crate) struct UdpState {
    host: HostId,
    inbox: VecDeque<Datagram>,
    inbox_cost: usize,
    inbox_limit: usize,
    reader: Option<Waker>,
    /// The data queued in the machine to be sent, and its limit.
    outgoing: usize,
    outgoing_limit: usize,
    writers: Vec<Waker>,
}

#[derive(Debug)]
struct Datagram {
    from: SocketAddr,
    to: SocketAddr,
    ecn: Ecn,
    data: Bytes,
}

/// The memory that Linux charges a socket for a packet (`truesize`): a page fragment of a power of two with
/// 320 bytes of bookkeeping at its end, and 256 bytes of `sk_buff`.
fn cost(bytes: usize) -> usize {
    (bytes + 320).next_power_of_two() + 256
}

impl UdpState {
    fn new(host: HostId, options: UdpSocketOptions) -> Self {
        // Linux doubles the requested size to pay for its bookkeeping.
        let limit =
            |asked: Option<usize>| asked.map_or(LARGEST_BUFFER, |bytes| 2 * bytes.min(LARGEST_BUFFER));
        Self {
            host,
            inbox: VecDeque::new(),
            inbox_cost: 0,
            inbox_limit: limit(options.recv_buffer),
            reader: None,
            outgoing: 0,
            outgoing_limit: limit(options.send_buffer),
            writers: Vec::new(),
        }
    }

    /// Takes a datagram; without room it is lost. Returns whether a task waited for it.
    pub(crate) fn receive(&mut self, from: SocketAddr, to: SocketAddr, ecn: Ecn, data: Bytes) -> bool {
        let cost = cost(data.len());
        if self.inbox_cost + cost > self.inbox_limit {
            return false;
        }
        self.inbox_cost += cost;
        self.inbox.push_back(Datagram { from, to, ecn, data });
        let reader = self.reader.take();
        let awaited = reader.is_some();
        reader.into_iter().for_each(Waker::wake);
        awaited
    }

    /// A packet of so many bytes has left the machine. Returns the machine if a task waited for that.
    pub(crate) fn left(&mut self, ip_bytes: u32) -> Option<HostId> {
        self.outgoing = self.outgoing.saturating_sub(cost(ip_bytes as usize));
        let awaited = !self.writers.is_empty();
        for writer in self.writers.drain(..) {
            writer.wake();
        }
        awaited.then_some(self.host)
    }
}

pub(super) fn bind(
    net: &SimNet,
    at: SocketAddr,
    options: UdpSocketOptions,
) -> io::Result<Arc<dyn UdpSocket>> {
    let mut core = net.world.core();
    let taken = |port| core.udp_ports.contains_key(&(net.host, port));
    let port = match at.port() {
        0 => (FIRST_FREE_PORT..=u16::MAX).find(|port| !taken(*port)).ok_or(io::ErrorKind::AddrInUse)?,
        port if taken(port) => return Err(io::ErrorKind::AddrInUse.into()),
        port => port,
    };
    let number = core.new_socket();
    core.udp_ports.insert((net.host, port), number);
    core.sockets.insert(number, UdpState::new(net.host, options));
    let local = SocketAddr::new(at.ip(), port);
    Ok(Arc::new(SimUdp { net: net.clone(), number, local }))
}

#[derive(Debug)]
struct SimUdp {
    net: SimNet,
    number: u32,
    local: SocketAddr,
}

impl Drop for SimUdp {
    fn drop(&mut self) {
        let mut core = self.net.world.core();
        core.udp_ports.remove(&(self.net.host, self.local.port()));
        let gone = core.sockets.remove(&self.number);
        drop(core);
        drop(gone);
    }
}

impl UdpSocket for SimUdp {
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        let here = self.net.host;
        let to = here.of(transmit.destination.ip()).ok_or(io::ErrorKind::NetworkUnreachable)?;
        let mut core = self.net.world.core();
        let segment = transmit.segment_size.unwrap_or(transmit.contents.len()).max(1);
        let socket = core.sockets.get_mut(&self.number).ok_or(io::ErrorKind::NotConnected)?;
        if socket.outgoing >= socket.outgoing_limit {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        let pieces = || transmit.contents.chunks(segment);
        let source = |to: HostId| match to {
            own if own == here => transmit.destination.ip(),
            _ => here.like(transmit.destination.ip()),
        };
        let packets: Vec<Packet> = pieces()
            .map(|piece| Packet {
                from: here,
                to,
                src: SocketAddr::new(transmit.src_ip.unwrap_or_else(|| source(to)), self.local.port()),
                dst: transmit.destination,
                ecn: ecn_of(transmit.ecn),
                body: Body::Udp(Bytes::copy_from_slice(piece)),
            })
            .collect();
        socket.outgoing += packets.iter().map(|packet| cost(packet.ip_bytes() as usize)).sum::<usize>();
        for packet in packets {
            core.send(Box::new(packet), Some(self.number));
        }
        Ok(())
    }

    fn poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>> {
        Box::pin(SimPoller(self))
    }

    fn poll_recv(
        &self,
        cx: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>> {
        let mut core = self.net.world.core();
        let Some(socket) = core.sockets.get_mut(&self.number) else {
            return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
        };
        if socket.inbox.is_empty() {
            socket.reader = Some(cx.waker().clone());
            return Poll::Pending;
        }
        let mut filled = 0;
        for (buffer, meta) in buffers.iter_mut().zip(meta) {
            let Some(Datagram { from, to, ecn, data }) = socket.inbox.pop_front() else { break };
            socket.inbox_cost -= cost(data.len());
            let len = data.len().min(buffer.len());
            if let (Some(place), Some(data)) = (buffer.get_mut(..len), data.get(..len)) {
                place.copy_from_slice(data);
            }
            *meta = RecvMeta::default();
            (meta.addr, meta.len, meta.stride) = (from, len, len);
            (meta.ecn, meta.dst_ip) = (codepoint_of(ecn), Some(to.ip()));
            filled += 1;
        }
        Poll::Ready(Ok(filled))
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.local)
    }

    /// One, so that a loss on a link loses one datagram.
    fn max_transmit_segments(&self) -> usize {
        1
    }

    fn max_receive_segments(&self) -> usize {
        1
    }

    fn may_fragment(&self) -> bool {
        false
    }
}

const fn ecn_of(codepoint: Option<EcnCodepoint>) -> Ecn {
    match codepoint {
        None => Ecn::NotCapable,
        Some(EcnCodepoint::Ect0) => Ecn::Capable0,
        Some(EcnCodepoint::Ect1) => Ecn::Capable1,
        Some(EcnCodepoint::Ce) => Ecn::Experienced,
    }
}

const fn codepoint_of(ecn: Ecn) -> Option<EcnCodepoint> {
    match ecn {
        Ecn::NotCapable => None,
        Ecn::Capable0 => Some(EcnCodepoint::Ect0),
        Ecn::Capable1 => Some(EcnCodepoint::Ect1),
        Ecn::Experienced => Some(EcnCodepoint::Ce),
    }
}

#[derive(Debug)]
struct SimPoller(Arc<SimUdp>);

impl UdpPoller for SimPoller {
    fn poll_writable(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let mut core = self.0.net.world.core();
        match core.sockets.get_mut(&self.0.number) {
            Some(socket) if socket.outgoing >= socket.outgoing_limit => {
                socket.writers.push(cx.waker().clone());
                Poll::Pending
            }
            _ => Poll::Ready(Ok(())),
        }
    }
}
