//! UDP of the hosts: their bound sockets.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::task::{Context, Poll, Waker};

use bytes::Bytes;
use trimaran_net::UdpSocketOptions;

use crate::host::HostId;
use crate::link::Ecn;

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
    /// The data queued in the host to be sent, and its limit.
    outgoing: usize,
    outgoing_limit: usize,
    writers: Vec<Waker>,
}

/// A datagram that waits to be read.
#[derive(Debug)]
pub(crate) struct Datagram {
    pub(crate) from: SocketAddr,
    pub(crate) to: SocketAddr,
    pub(crate) ecn: Ecn,
    pub(crate) data: Bytes,
}

/// The memory that Linux charges a socket for a packet (`truesize`): a page fragment of a power of two with
/// 320 bytes of bookkeeping at its end, and 256 bytes of `sk_buff`.
fn cost(bytes: usize) -> usize {
    (bytes + 320).next_power_of_two() + 256
}

impl UdpState {
    pub(crate) fn new(host: HostId, options: UdpSocketOptions) -> Self {
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

    pub(super) const fn host(&self) -> HostId {
        self.host
    }

    /// The wakers of all that wait for a socket that is gone.
    pub(super) fn into_wakers(self) -> impl Iterator<Item = Waker> {
        self.reader.into_iter().chain(self.writers)
    }

    /// Takes a datagram; without room it is lost. Returns whether a task waited for it.
    pub(super) fn receive(&mut self, from: SocketAddr, to: SocketAddr, ecn: Ecn, data: Bytes) -> bool {
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

    /// Takes the oldest datagram.
    pub(crate) fn read(&mut self) -> Option<Datagram> {
        let datagram = self.inbox.pop_front()?;
        self.inbox_cost -= cost(datagram.data.len());
        Some(datagram)
    }

    /// Ready once there is a datagram.
    pub(crate) fn poll_readable(&mut self, cx: &Context<'_>) -> Poll<()> {
        if self.inbox.is_empty() {
            self.reader = Some(cx.waker().clone());
            return Poll::Pending;
        }
        Poll::Ready(())
    }

    /// Whether a packet may be sent now.
    pub(crate) const fn has_room(&self) -> bool {
        self.outgoing < self.outgoing_limit
    }

    /// Ready once there is room.
    pub(crate) fn poll_writable(&mut self, cx: &Context<'_>) -> Poll<()> {
        if self.has_room() {
            return Poll::Ready(());
        }
        self.writers.push(cx.waker().clone());
        Poll::Pending
    }

    /// A packet of so many bytes is sent.
    pub(crate) fn entered(&mut self, ip_bytes: u32) {
        self.outgoing += cost(ip_bytes as usize);
    }

    /// A packet of so many bytes has left the host. Returns the host if a task waited for that.
    pub(super) fn left(&mut self, ip_bytes: u32) -> Option<HostId> {
        self.outgoing = self.outgoing.saturating_sub(cost(ip_bytes as usize));
        let awaited = !self.writers.is_empty();
        for writer in self.writers.drain(..) {
            writer.wake();
        }
        awaited.then_some(self.host)
    }
}
