//! A socket for connections: receives many datagrams, sends to one address at a time.

use std::future::poll_fn;
use std::io::{self, IoSliceMut};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use smallvec::SmallVec;
use trimaran_udp::MIN_DATAGRAM;

use trimaran_net::{BATCH_SIZE, RecvMeta, Transmit, UdpSocket};

/// The size of a buffer if the system fills one datagram at a time: more than the protocol ever sends.
const DATAGRAM: usize = 2048;
/// The largest size of a buffer, for any number of datagrams that the system puts into it.
const BUFFER: usize = 64 << 10;

/// The two addresses of datagrams. A socket may have several local ones, and a peer takes answers only from
/// the one it used.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    pub(super) remote: SocketAddr,
    /// The local address, if known; otherwise the system chooses.
    local: Option<IpAddr>,
}

impl Path {
    /// A path to `remote`; the system chooses the local address.
    pub(super) const fn to(remote: SocketAddr) -> Self {
        Self { remote, local: None }
    }

    /// The path of an answer to a received datagram.
    fn back(meta: &RecvMeta) -> Self {
        // A multicast or broadcast address cannot be the source of an answer.
        let local = meta.dst_ip.filter(|ip| match ip {
            IpAddr::V4(ip) => !ip.is_multicast() && !ip.is_broadcast(),
            IpAddr::V6(ip) => !ip.is_multicast(),
        });
        Self { remote: meta.addr, local }
    }
}

/// Receives from a socket.
#[derive(Debug)]
pub(super) struct Incoming {
    socket: Arc<dyn UdpSocket>,
    buffers: Vec<Vec<u8>>,
    meta: [RecvMeta; BATCH_SIZE],
}

impl Incoming {
    pub(super) fn new(socket: &Arc<dyn UdpSocket>) -> Self {
        let room = (socket.max_receive_segments() * DATAGRAM).min(BUFFER);
        // The total size is the same for single datagrams and for many in a buffer.
        let count = (2 * BUFFER / room).min(BATCH_SIZE);
        Self {
            socket: Arc::clone(socket),
            buffers: vec![vec![0; room]; count],
            meta: [RecvMeta::default(); BATCH_SIZE],
        }
    }

    /// Waits for datagrams and hands each to `take`, with the path back to its sender.
    pub(super) async fn receive(&mut self, mut take: impl FnMut(Path, &[u8])) -> io::Result<()> {
        let Self { socket, buffers, meta } = self;
        let filled = {
            let mut slices: SmallVec<[_; BATCH_SIZE]> =
                buffers.iter_mut().map(|buffer| IoSliceMut::new(buffer)).collect();
            poll_fn(|cx| socket.poll_recv(cx, &mut slices, meta)).await?
        };
        for (meta, buffer) in meta.iter().zip(buffers).take(filled) {
            let bytes = buffer.get(..meta.len).unwrap_or_default();
            bytes.chunks(meta.stride.max(1)).for_each(|datagram| take(Path::back(meta), datagram));
        }
        Ok(())
    }
}

/// Datagrams to one address on their way into the system, several of one size at once if it supports that.
#[derive(Debug)]
pub(super) struct Outgoing {
    path: Path,
    bytes: Vec<u8>,
    /// The size of all of them but the last, which may be shorter.
    segment: usize,
    count: usize,
    /// How many datagrams the system takes at once.
    most: usize,
}

impl Outgoing {
    pub(super) fn new(path: Path, socket: &dyn UdpSocket) -> Self {
        let most = socket.max_transmit_segments().min(BUFFER / DATAGRAM);
        Self { path, bytes: Vec::with_capacity(most * MIN_DATAGRAM), segment: 0, count: 0, most }
    }

    /// The peer is at `to` from now on: waiting datagrams go there as well.
    pub(super) fn aim(&mut self, to: SocketAddr) {
        if self.path.remote != to {
            tracing::info!(from = %self.path.remote, %to, "the peer goes on at another address");
            self.path.remote = to;
        }
    }

    /// Datagrams to another address, from the same local one.
    pub(super) fn elsewhere(&self, to: SocketAddr, socket: &dyn UdpSocket) -> Self {
        Self::new(Path { remote: to, ..self.path }, socket)
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether `length` more bytes can leave together with the present ones.
    pub(super) const fn takes(&self, length: usize) -> bool {
        let last_is_short = self.count > 0 && !self.bytes.len().is_multiple_of(self.segment);
        self.count == 0 || self.count < self.most && !last_is_short && length <= self.segment
    }

    pub(super) fn push(&mut self, datagram: &[u8]) {
        if self.count == 0 {
            self.segment = datagram.len();
        }
        self.bytes.extend_from_slice(datagram);
        self.count += 1;
    }

    /// Hands everything to the system; false if it has no room now. Datagrams refused for another reason
    /// count as lost.
    pub(super) fn send(&mut self, socket: &dyn UdpSocket) -> bool {
        if self.is_empty() {
            return true;
        }
        let segment_size = (self.count > 1).then_some(self.segment);
        let Path { remote: destination, local: src_ip } = self.path;
        let transmit = Transmit { destination, ecn: None, contents: &self.bytes, segment_size, src_ip };
        match socket.try_send(&transmit) {
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => return false,
            Err(e) => {
                tracing::debug!(to = %destination, error = &e as &dyn std::error::Error, "a datagram could not be sent");
            }
            Ok(()) => {}
        }
        self.bytes.clear();
        self.count = 0;
        true
    }
}
