//! UDP sockets of a simulated host.

use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use trimaran_net::{EcnCodepoint, RecvMeta, Transmit, UdpPoller, UdpSocket, UdpSocketOptions};

use super::{SimNet, free_port};
use crate::link::Ecn;
use crate::packet::{Body, Packet};
use crate::world::{Datagram, UdpState};

pub(super) fn bind(
    net: &SimNet,
    at: SocketAddr,
    options: UdpSocketOptions,
) -> io::Result<Arc<dyn UdpSocket>> {
    let mut core = net.world.core();
    core.check_up(net.host)?;
    let port = free_port(at.port(), |port| core.udp_ports.contains_key(&(net.host, port)))?;
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
        let gone = core.sockets.remove(&self.number);
        // After a crash another socket may have the port.
        if gone.is_some() {
            core.udp_ports.remove(&(self.net.host, self.local.port()));
        }
        drop(core);
        drop(gone);
    }
}

/// One datagram at a time, so that a loss on a link loses one.
impl UdpSocket for SimUdp {
    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        let here = self.net.host;
        let to = here.of(transmit.destination.ip()).ok_or(io::ErrorKind::NetworkUnreachable)?;
        let mut core = self.net.world.core();
        let segment = transmit.segment_size.unwrap_or(transmit.contents.len()).max(1);
        let socket = core.sockets.get_mut(&self.number).ok_or(io::ErrorKind::NotConnected)?;
        if !socket.has_room() {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        let dst = transmit.destination;
        let source = transmit.src_ip.unwrap_or_else(|| here.source_to(to, dst.ip()));
        let (src, ecn) = (SocketAddr::new(source, self.local.port()), ecn_of(transmit.ecn));
        let packet = |piece| {
            let body = Body::Udp(Bytes::copy_from_slice(piece));
            Box::new(Packet { from: here, to, src, dst, ecn, body })
        };
        let packets: Vec<_> = transmit.contents.chunks(segment).map(packet).collect();
        packets.iter().for_each(|packet| socket.entered(packet.ip_bytes()));
        for packet in packets {
            core.send(packet, Some(self.number));
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
        ready!(socket.poll_readable(cx));
        let mut filled = 0;
        for (buffer, meta) in buffers.iter_mut().zip(meta) {
            let Some(Datagram { from, to, ecn, data }) = socket.read() else { break };
            let len = data.len().min(buffer.len());
            if let (Some(place), Some(data)) = (buffer.get_mut(..len), data.get(..len)) {
                place.copy_from_slice(data);
            }
            let (ecn, dst_ip) = (codepoint_of(ecn), Some(to.ip()));
            *meta = RecvMeta { addr: from, len, stride: len, ecn, dst_ip };
            filled += 1;
        }
        Poll::Ready(Ok(filled))
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.local)
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
            Some(socket) => socket.poll_writable(cx).map(Ok),
            None => Poll::Ready(Ok(())),
        }
    }
}
