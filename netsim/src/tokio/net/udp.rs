//! UDP sockets.

use std::future::poll_fn;
use std::io::{self, IoSliceMut};
use std::net::SocketAddr;
use std::sync::Arc;

use parking_lot::Mutex;
use trimaran_net::{Net, RecvMeta, Transmit, UdpSocketOptions};

use super::address::{ToSocketAddrs, no_address};
use crate::net::context::here;

/// A UDP socket of the host. One task at a time receives from it.
#[derive(Debug)]
pub struct UdpSocket {
    socket: Arc<dyn trimaran_net::UdpSocket>,
    peer: Mutex<Option<SocketAddr>>,
}

impl UdpSocket {
    /// Binds the first address that can be bound; port 0 takes a free one.
    ///
    /// # Errors
    /// If none can, for instance because the port is in use, or the program is on no host.
    pub async fn bind<A: ToSocketAddrs>(at: A) -> io::Result<Self> {
        let net = here()?;
        let system = UdpSocketOptions::default().with_send_buffer(None).with_recv_buffer(None);
        let mut last = no_address();
        for at in at.lookup(&net)? {
            match net.bind_udp(at, system) {
                Ok(socket) => return Ok(Self { socket, peer: Mutex::new(None) }),
                Err(e) => last = e,
            }
        }
        Err(last)
    }

    /// The bound address.
    ///
    /// # Errors
    /// Never: the result is for programs on tokio.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Names the peer of [`UdpSocket::send`]. From now on only its datagrams are received.
    ///
    /// # Errors
    /// If the name has no address of the socket's family, or the program is on no host.
    pub async fn connect<A: ToSocketAddrs>(&self, to: A) -> io::Result<()> {
        let peer = self.destination(to)?;
        *self.peer.lock() = Some(peer);
        Ok(())
    }

    /// The peer.
    ///
    /// # Errors
    /// If there is none.
    pub fn peer_addr(&self) -> io::Result<SocketAddr> {
        self.peer.lock().ok_or_else(|| io::ErrorKind::NotConnected.into())
    }

    /// Sends a datagram, and waits while the socket has no room. Returns its size. Dropping the future sends
    /// nothing.
    ///
    /// # Errors
    /// If the address belongs to no host, or the host of the socket has crashed.
    pub async fn send_to<A: ToSocketAddrs>(&self, contents: &[u8], to: A) -> io::Result<usize> {
        let destination = self.destination(to)?;
        let transmit = Transmit { destination, ecn: None, contents, segment_size: None, src_ip: None };
        let mut poller = Arc::clone(&self.socket).poller();
        loop {
            match self.socket.try_send(&transmit) {
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => {
                    poll_fn(|cx| poller.as_mut().poll_writable(cx)).await?;
                }
                sent => return sent.map(|()| contents.len()),
            }
        }
    }

    /// Sends a datagram to the peer, as [`UdpSocket::send_to`] does.
    ///
    /// # Errors
    /// If there is no peer, or the host of the socket has crashed.
    pub async fn send(&self, contents: &[u8]) -> io::Result<usize> {
        let peer = self.peer_addr()?;
        self.send_to(contents, peer).await
    }

    /// Receives a datagram: its size, and where it came from. Excess bytes are lost. Dropping the future
    /// loses none.
    ///
    /// # Errors
    /// If the host of the socket has crashed.
    pub async fn recv_from(&self, buffer: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        loop {
            let mut meta = [RecvMeta::default()];
            poll_fn(|cx| self.socket.poll_recv(cx, &mut [IoSliceMut::new(buffer)], &mut meta)).await?;
            let [RecvMeta { len, addr, .. }] = meta;
            if self.peer.lock().is_none_or(|peer| peer == addr) {
                return Ok((len, addr));
            }
        }
    }

    /// Receives a datagram of the peer, as [`UdpSocket::recv_from`] does. Returns its size.
    ///
    /// # Errors
    /// If there is no peer, or the host of the socket has crashed.
    pub async fn recv(&self, buffer: &mut [u8]) -> io::Result<usize> {
        self.peer_addr()?;
        Ok(self.recv_from(buffer).await?.0)
    }

    /// The first address of the socket's family.
    fn destination(&self, to: impl ToSocketAddrs) -> io::Result<SocketAddr> {
        let is_v4 = self.local_addr()?.is_ipv4();
        to.lookup(&here()?)?.into_iter().find(|to| to.is_ipv4() == is_v4).ok_or_else(no_address)
    }
}
