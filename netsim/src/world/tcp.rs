//! TCP of the hosts: their connections and listening ports.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::task::Waker;

use trimaran_net::{Instant, TcpOptions};

use super::Core;
use crate::host::HostId;
use crate::link::Ecn;
use crate::packet::{Body, Packet};
use crate::tcp::{Class, Config, Segment, Socket};

/// The MTU of a host's loopback, as in Linux.
const LOOPBACK_MTU: u32 = 65_535;

/// One end of a connection.
#[derive(Debug)]
pub(crate) struct TcpState {
    pub(crate) socket: Socket,
    host: HostId,
    pub(crate) local: SocketAddr,
    peer_host: HostId,
    pub(crate) peer: SocketAddr,
    pub(crate) reader: Option<Waker>,
    pub(crate) writer: Option<Waker>,
    /// The task that waits for the connection.
    pub(crate) connector: Option<Waker>,
    /// The port of the listener that accepts it.
    listener: Option<u16>,
    /// The earliest queued event for its timers.
    queued: Option<Instant>,
}

impl TcpState {
    pub(super) const fn host(&self) -> HostId {
        self.host
    }

    /// The wakers of all that wait for a connection that is gone.
    pub(super) fn into_wakers(self) -> impl Iterator<Item = Waker> {
        [self.reader, self.writer, self.connector].into_iter().flatten()
    }
}

/// A listening port.
#[derive(Debug)]
pub(crate) struct ListenerState {
    /// Tells it from another listener that has had the port.
    pub(crate) number: u32,
    pub(crate) options: TcpOptions,
    pub(crate) made: VecDeque<u32>,
    pub(crate) waker: Option<Waker>,
}

impl Core {
    /// A segment came for a port of `host`.
    pub(super) fn tcp_segment(
        &mut self,
        host: HostId,
        from: HostId,
        local: SocketAddr,
        peer: SocketAddr,
        segment: &Segment,
    ) {
        let now = self.now;
        if let Some(&number) = self.tcp_ports.get(&(host, local.port(), peer)) {
            if let Some(state) = self.tcp.get_mut(&number) {
                state.socket.receive(now, segment);
            }
            self.pump_tcp(number);
            return;
        }
        let listener = self.listeners.get(&(host, local.port()));
        if segment.syn
            && segment.ack.is_none()
            && let Some(listener) = listener
        {
            // Without room the segment is dropped, as in Linux: the peer tries again.
            if (listener.made.len() as i64) < i64::from(listener.options.backlog) {
                let options = listener.options;
                if let Some(config) = self.tcp_config(host, from, peer, options) {
                    let socket = Socket::accept(now, config, segment);
                    let number = self.add_tcp(socket, host, local, from, peer);
                    if let Some(state) = self.tcp.get_mut(&number) {
                        state.listener = Some(local.port());
                    }
                    self.pump_tcp(number);
                }
            }
        } else if !segment.rst {
            let seq = segment.ack.unwrap_or(0);
            let refusal = Segment {
                seq,
                ack: Some(segment.end()),
                rst: true,
                class: Class::Handshake,
                ..Segment::default()
            };
            self.send(packet(host, local, from, peer, refusal), None);
        }
    }

    /// So many bytes of a connection have left the host.
    pub(super) fn tcp_left(&mut self, number: u32, ip_bytes: u32) {
        if self.tcp.get_mut(&number).is_some_and(|state| state.socket.left(ip_bytes.into())) {
            self.pump_tcp(number);
        }
    }

    /// A connection's timers may be due.
    pub(super) fn tcp_timer(&mut self, number: u32) {
        let now = self.now;
        let Some(state) = self.tcp.get_mut(&number) else { return };
        if state.queued.is_none_or(|queued| queued > now) {
            return; // an earlier setting's
        }
        state.queued = None;
        if state.socket.next_timeout().is_some_and(|due| due <= now) {
            state.socket.expire(now);
        }
        self.pump_tcp(number);
    }

    /// Sends a connection's segments, wakes waiting tasks, and sets its timer.
    pub(crate) fn pump_tcp(&mut self, number: u32) {
        let now = self.now;
        while let Some(state) = self.tcp.get_mut(&number)
            && let Some(segment) = state.socket.transmit(now)
        {
            let token = (!segment.data.is_empty() || segment.fin).then_some(number);
            let packet = packet(state.host, state.local, state.peer_host, state.peer, segment);
            self.send(packet, token);
        }
        let Some(state) = self.tcp.get_mut(&number) else { return };
        let (host, mut roused) = (state.host, false);
        let mut wake = |waker: &mut Option<Waker>| {
            if let Some(waker) = waker.take() {
                waker.wake();
                roused = true;
            }
        };
        let socket = &state.socket;
        if socket.is_readable() {
            wake(&mut state.reader);
        }
        if socket.is_writable() {
            wake(&mut state.writer);
        }
        if socket.is_open() || socket.failure().is_some() {
            wake(&mut state.connector);
        }
        if let Some(port) = state.listener.take_if(|_| socket.is_open()) {
            match self.listeners.get_mut(&(state.host, port)) {
                Some(listener) => {
                    listener.made.push_back(number);
                    wake(&mut listener.waker);
                }
                None => {
                    state.socket.close();
                    self.pump_tcp(number);
                    return;
                }
            }
        }
        if roused {
            self.timers.rouse(now, host);
        }
        if state.socket.is_over() {
            let key = (state.host, state.local.port(), state.peer);
            self.tcp_ports.remove(&key);
            if state.socket.is_abandoned() {
                self.tcp.remove(&number);
            }
            return;
        }
        if let Some(due) = state.socket.next_timeout()
            && state.queued.is_none_or(|queued| queued > due)
        {
            state.queued = Some(due);
            self.wake_tcp(number, due);
        }
    }

    /// The program has dropped the connection.
    pub(crate) fn close_tcp(&mut self, number: u32) {
        if let Some(state) = self.tcp.get_mut(&number) {
            state.socket.close();
        }
        self.pump_tcp(number);
    }

    pub(crate) fn tcp_config(
        &self,
        host: HostId,
        to: HostId,
        peer: SocketAddr,
        options: TcpOptions,
    ) -> Option<Config> {
        let mtu = if host == to { Some(LOOPBACK_MTU) } else { self.fabric.path_mtu(host, to) };
        Some(Config { options, mtu: mtu?, ip_header: if peer.is_ipv4() { 20 } else { 40 } })
    }

    pub(crate) fn add_tcp(
        &mut self,
        socket: Socket,
        host: HostId,
        local: SocketAddr,
        peer_host: HostId,
        peer: SocketAddr,
    ) -> u32 {
        let number = self.new_socket();
        let (reader, writer, connector, listener, queued) = (None, None, None, None, None);
        let state =
            TcpState { socket, host, local, peer_host, peer, reader, writer, connector, listener, queued };
        self.tcp.insert(number, state);
        self.tcp_ports.insert((host, local.port(), peer), number);
        number
    }
}

fn packet(from: HostId, src: SocketAddr, to: HostId, dst: SocketAddr, segment: Segment) -> Box<Packet> {
    Box::new(Packet { from, to, src, dst, ecn: Ecn::NotCapable, body: Body::Tcp(segment) })
}
