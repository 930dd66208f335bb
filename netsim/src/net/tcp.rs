//! A program's handles of TCP: connections and listeners.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use trimaran_net::{BoxFuture, Instant, Listen, Stream, StreamPeer, TcpOptions};

use super::{FIRST_FREE_PORT, SimNet, free_port};
use crate::tcp::Socket;
use crate::world::{ListenerState, TcpState};

/// Connects.
pub(crate) async fn connect(net: &SimNet, to: SocketAddr, options: TcpOptions) -> io::Result<Connection> {
    let here = net.host;
    let there = here.of(to.ip()).ok_or(io::ErrorKind::NetworkUnreachable)?;
    let connection = {
        let mut core = net.world.core();
        core.check_up(here)?;
        let config = core.tcp_config(here, there, to, options).ok_or(io::ErrorKind::HostUnreachable)?;
        let taken = |port| {
            let is_itself = here == there && port == to.port();
            is_itself
                || core.tcp_ports.contains_key(&(here, port, to))
                || core.listeners.contains_key(&(here, port))
        };
        // In turn, because the other end may still have a connection from a port that is free again.
        let first = core.next_ports.get(&here).copied().unwrap_or(FIRST_FREE_PORT);
        let mut ports = (first..=u16::MAX).chain(FIRST_FREE_PORT..first);
        let port = ports.find(|port| !taken(*port)).ok_or(io::ErrorKind::AddrNotAvailable)?;
        core.next_ports.insert(here, port.checked_add(1).unwrap_or(FIRST_FREE_PORT));
        let local = SocketAddr::new(here.source_to(there, to.ip()), port);
        let socket = Socket::connect(core.now, config);
        let number = core.add_tcp(socket, here, local, there, to);
        core.pump_tcp(number);
        Connection { net: net.clone(), number, local, peer: to }
    };
    poll_fn(|cx| connection.poll_open(cx)).await?;
    Ok(connection)
}

/// Listens.
pub(crate) fn listen(net: &SimNet, at: SocketAddr, options: TcpOptions) -> io::Result<SimListener> {
    net.own(at.ip())?;
    let mut core = net.world.core();
    core.check_up(net.host)?;
    let port = free_port(at.port(), |port| core.listeners.contains_key(&(net.host, port)))?;
    let number = core.new_socket();
    let state = ListenerState { number, options, made: VecDeque::new(), waker: None };
    core.listeners.insert((net.host, port), state);
    Ok(SimListener { net: net.clone(), local: SocketAddr::new(at.ip(), port), number })
}

/// A program's handle of a listening port.
#[derive(Debug)]
pub(crate) struct SimListener {
    net: SimNet,
    pub(crate) local: SocketAddr,
    number: u32,
}

impl SimListener {
    pub(crate) fn poll_accept(&self, cx: &Context<'_>) -> Poll<io::Result<Connection>> {
        let mut core = self.net.world.core();
        let listener = core.listeners.get_mut(&(self.net.host, self.local.port()));
        let Some(listener) = listener.filter(|listener| listener.number == self.number) else {
            return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
        };
        let Some(number) = listener.made.pop_front() else {
            listener.waker = Some(cx.waker().clone());
            return Poll::Pending;
        };
        let state = core.tcp.get(&number).ok_or(io::ErrorKind::ConnectionAborted)?;
        let (local, peer) = (state.local, state.peer);
        Poll::Ready(Ok(Connection { net: self.net.clone(), number, local, peer }))
    }
}

impl Listen for SimListener {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(poll_fn(|cx| self.poll_accept(cx).map_ok(Connection::into_stream)))
    }
}

impl Drop for SimListener {
    fn drop(&mut self) {
        let mut core = self.net.world.core();
        let port = (self.net.host, self.local.port());
        // After a crash another listener may have the port.
        if core.listeners.get(&port).is_none_or(|listener| listener.number != self.number) {
            return;
        }
        for number in core.listeners.remove(&port).into_iter().flat_map(|listener| listener.made) {
            core.close_tcp(number);
        }
    }
}

/// A program's handle of a connection; closes it when dropped.
#[derive(Debug)]
pub(crate) struct Connection {
    net: SimNet,
    number: u32,
    pub(crate) local: SocketAddr,
    pub(crate) peer: SocketAddr,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.net.world.core().close_tcp(self.number);
    }
}

impl Connection {
    pub(super) fn into_stream(self) -> Stream {
        let (peer, connection) = (self.peer, Arc::new(self));
        Stream {
            reader: Box::new(Reader(Arc::clone(&connection))),
            writer: Box::new(Writer(connection)),
            peer: StreamPeer::Tcp(peer),
        }
    }

    /// Applies `act` to the connection, then sends what follows from it.
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

    pub(crate) fn poll_read(&self, cx: &Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        self.with(|state, now| {
            if !state.socket.is_readable() {
                state.reader = Some(cx.waker().clone());
                return Poll::Pending;
            }
            // Initializes only the part of the buffer that will be filled: it may be large.
            let size = buffer.remaining().min(state.socket.unread());
            let count = state.socket.read(now, buffer.initialize_unfilled_to(size));
            Poll::Ready(count.map(|count| buffer.advance(count)))
        })
    }

    pub(crate) fn poll_write(&self, cx: &Context<'_>, data: &[u8]) -> Poll<io::Result<usize>> {
        self.with(|state, _| match state.socket.write(data) {
            Ok(0) if !data.is_empty() => {
                state.writer = Some(cx.waker().clone());
                Poll::Pending
            }
            written => Poll::Ready(written),
        })
    }

    /// The program writes nothing more.
    pub(crate) fn shutdown(&self) -> io::Result<()> {
        self.set(Socket::shutdown)
    }

    pub(crate) fn set_nodelay(&self, nodelay: bool) -> io::Result<()> {
        self.set(|socket| socket.set_nodelay(nodelay))
    }

    /// Changes the socket, then sends what follows from that.
    fn set(&self, change: impl FnOnce(&mut Socket)) -> io::Result<()> {
        let mut core = self.net.world.core();
        let state = core.tcp.get_mut(&self.number).ok_or(io::ErrorKind::NotConnected)?;
        change(&mut state.socket);
        core.pump_tcp(self.number);
        Ok(())
    }
}

struct Reader(Arc<Connection>);

impl AsyncRead for Reader {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.0.poll_read(cx, buffer)
    }
}

struct Writer(Arc<Connection>);

impl AsyncWrite for Writer {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, data: &[u8]) -> Poll<io::Result<usize>> {
        self.0.poll_write(cx, data)
    }

    fn poll_flush(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(self.0.shutdown())
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        let _closed = self.0.shutdown();
    }
}
