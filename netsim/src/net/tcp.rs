//! TCP connections and listeners of a simulated machine.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use trimaran_transport::{BoxFuture, Instant, Listen, PeerAddress, Stream, TcpOptions};

use super::SimNet;
use super::udp::FIRST_FREE_PORT;
use crate::link::Ecn;
use crate::packet::{Body, Packet};
use crate::tcp::{Class, Config, Segment, Socket};
use crate::topology::HostId;
use crate::world::Core;

/// The MTU of a machine's way to itself, as Linux's loopback has it.
const LOOPBACK_MTU: u32 = 65_535;

/// One end of a connection.
#[derive(Debug)]
pub(crate) struct TcpState {
    socket: Socket,
    host: HostId,
    local: SocketAddr,
    peer_host: HostId,
    peer: SocketAddr,
    reader: Option<Waker>,
    writer: Option<Waker>,
    /// Whoever waits for the connection to be made.
    connector: Option<Waker>,
    /// The port of the listener that hands it out once it is made.
    listener: Option<u16>,
    /// When the earliest event for its timers comes.
    queued: Option<Instant>,
}

/// A listening port.
#[derive(Debug)]
pub(crate) struct ListenerState {
    options: TcpOptions,
    made: VecDeque<u32>,
    waker: Option<Waker>,
}

impl Core {
    /// A segment came for a port of `host`.
    pub(crate) fn tcp_segment(
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
            // Without room the segment is dropped, as Linux does it: the peer tries again.
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

    /// So many bytes of a connection have left the machine.
    pub(crate) fn tcp_left(&mut self, number: u32, ip_bytes: u32) {
        if let Some(state) = self.tcp.get_mut(&number) {
            state.socket.left(ip_bytes.into());
            self.pump_tcp(number);
        }
    }

    /// A connection's timers may have come.
    pub(crate) fn tcp_timer(&mut self, number: u32) {
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

    /// Sends what a connection has to send, wakes whom it has news for, and sets its timer.
    fn pump_tcp(&mut self, number: u32) {
        let now = self.now;
        loop {
            let Some(state) = self.tcp.get_mut(&number) else { return };
            let Some(segment) = state.socket.transmit(now) else { break };
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
            self.rouse(host);
        }
        let Some(state) = self.tcp.get_mut(&number) else { return };
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

    fn tcp_config(&self, host: HostId, to: HostId, peer: SocketAddr, options: TcpOptions) -> Option<Config> {
        let mtu = if host == to { Some(LOOPBACK_MTU) } else { self.fabric.path_mtu(host, to) };
        Some(Config { options, mtu: mtu?, ip_header: if peer.is_ipv4() { 20 } else { 40 } })
    }

    fn add_tcp(
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

fn packet(from: HostId, src: SocketAddr, to: HostId, dst: SocketAddr, segment: Segment) -> Packet {
    Packet { from, to, src, dst, ecn: Ecn::NotCapable, body: Body::Tcp(Box::new(segment)) }
}

/// Connects.
pub(super) async fn connect(net: &SimNet, to: SocketAddr, options: TcpOptions) -> io::Result<Stream> {
    let here = net.host;
    let there = here.of(to.ip()).ok_or(io::ErrorKind::NetworkUnreachable)?;
    let connection = {
        let mut core = net.world.core();
        let config = core.tcp_config(here, there, to, options).ok_or(io::ErrorKind::HostUnreachable)?;
        let port = (FIRST_FREE_PORT..=u16::MAX)
            .find(|port| {
                !core.tcp_ports.contains_key(&(here, *port, to))
                    && !core.listeners.contains_key(&(here, *port))
            })
            .ok_or(io::ErrorKind::AddrNotAvailable)?;
        let source = if here == there { to.ip() } else { here.like(to.ip()) };
        let socket = Socket::connect(core.now, config);
        let number = core.add_tcp(socket, here, SocketAddr::new(source, port), there, to);
        core.pump_tcp(number);
        Connection { net: net.clone(), number }
    };
    poll_fn(|cx| connection.poll_open(cx)).await?;
    Ok(connection.into_stream(to))
}

/// Listens.
pub(super) fn listen(
    net: &SimNet,
    at: SocketAddr,
    options: TcpOptions,
) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
    let mut core = net.world.core();
    let taken = |port: u16| core.listeners.contains_key(&(net.host, port));
    let port = match at.port() {
        0 => (FIRST_FREE_PORT..=u16::MAX).find(|port| !taken(*port)).ok_or(io::ErrorKind::AddrInUse)?,
        port if taken(port) => return Err(io::ErrorKind::AddrInUse.into()),
        port => port,
    };
    core.listeners.insert((net.host, port), ListenerState { options, made: VecDeque::new(), waker: None });
    Ok((Box::new(SimListener { net: net.clone(), port }), SocketAddr::new(at.ip(), port)))
}

struct SimListener {
    net: SimNet,
    port: u16,
}

impl Listen for SimListener {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(poll_fn(|cx| {
            let mut core = self.net.world.core();
            let Some(listener) = core.listeners.get_mut(&(self.net.host, self.port)) else {
                return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
            };
            let Some(number) = listener.made.pop_front() else {
                listener.waker = Some(cx.waker().clone());
                return Poll::Pending;
            };
            let peer =
                core.tcp.get(&number).map(|state| state.peer).ok_or(io::ErrorKind::ConnectionAborted)?;
            drop(core);
            Poll::Ready(Ok(Connection { net: self.net.clone(), number }.into_stream(peer)))
        }))
    }
}

impl Drop for SimListener {
    fn drop(&mut self) {
        let mut core = self.net.world.core();
        let Some(listener) = core.listeners.remove(&(self.net.host, self.port)) else { return };
        for number in listener.made {
            core.close_tcp(number);
        }
    }
}

impl Core {
    /// The program is gone.
    fn close_tcp(&mut self, number: u32) {
        if let Some(state) = self.tcp.get_mut(&number) {
            state.socket.close();
        }
        self.pump_tcp(number);
    }
}

/// A program's hold on a connection; closes it when it is dropped.
#[derive(Debug)]
struct Connection {
    net: SimNet,
    number: u32,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.net.world.core().close_tcp(self.number);
    }
}

impl Connection {
    fn into_stream(self, peer: SocketAddr) -> Stream {
        let connection = Arc::new(self);
        Stream {
            reader: Box::new(Reader(Arc::clone(&connection))),
            writer: Box::new(Writer(connection)),
            peer: PeerAddress::Tcp(peer),
        }
    }

    /// Does something to the connection, and then what that leads to.
    fn with<T>(
        &self,
        act: impl FnOnce(&mut TcpState, Instant) -> Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        let mut core = self.net.world.core();
        let now = core.now;
        let state = core.tcp.get_mut(&self.number).ok_or(io::ErrorKind::NotConnected)?;
        let outcome = ready!(act(state, now));
        core.pump_tcp(self.number);
        Poll::Ready(outcome)
    }

    fn poll_open(&self, cx: &Context<'_>) -> Poll<io::Result<()>> {
        self.with(|state, _| match state.socket.failure() {
            Some(kind) => Poll::Ready(Err(kind.into())),
            None if state.socket.is_open() => Poll::Ready(Ok(())),
            None => {
                state.connector = Some(cx.waker().clone());
                Poll::Pending
            }
        })
    }
}

struct Reader(Arc<Connection>);

impl AsyncRead for Reader {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.0.with(|state, now| {
            if !state.socket.is_readable() {
                state.reader = Some(cx.waker().clone());
                return Poll::Pending;
            }
            // No more of the buffer is made ready than will be filled: it may be large.
            let size = buffer.remaining().min(state.socket.unread());
            let count = state.socket.read(now, buffer.initialize_unfilled_to(size));
            Poll::Ready(count.map(|count| buffer.advance(count)))
        })
    }
}

struct Writer(Arc<Connection>);

impl AsyncWrite for Writer {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, data: &[u8]) -> Poll<io::Result<usize>> {
        self.0.with(|state, _| match state.socket.write(data) {
            Ok(0) if !data.is_empty() => {
                state.writer = Some(cx.waker().clone());
                Poll::Pending
            }
            written => Poll::Ready(written),
        })
    }

    fn poll_flush(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.0.with(|state, _| {
            state.socket.shutdown();
            Poll::Ready(Ok(()))
        })
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        let _closed = self.0.with(|state, _| {
            state.socket.shutdown();
            Poll::Ready(Ok(()))
        });
    }
}
