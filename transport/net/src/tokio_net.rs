//! The real network: tokio's clock, tasks and sockets.
#![allow(clippy::disallowed_methods, reason = "this file is the seam that the rule sends everyone to")]

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use socket2::{Domain, Protocol, SockRef, Socket, TcpKeepalive, Type};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::runtime::Handle;
use tokio::time::{Sleep, sleep_until};

use crate::{
    BoxFuture, Instant, Listen, Net, Stream, StreamPeer, TcpOptions, Timer, UdpSocket, UdpSocketOptions,
};

mod udp;
#[cfg(unix)]
mod unix;

/// Sockets, time and tasks of a tokio runtime.
///
/// The runtime needs IO and time enabled. Its sockets may be used from any thread, also through
/// `Handle::block_on`; a multi-threaded runtime drives them while those threads are busy.
#[derive(Debug, Clone)]
pub struct TokioNet {
    runtime: Handle,
    origin: tokio::time::Instant,
}

impl TokioNet {
    /// The network of `runtime`; its time starts now.
    #[must_use]
    pub fn new(runtime: Handle) -> Self {
        Self { runtime, origin: tokio::time::Instant::now() }
    }

    /// The network of the caller's runtime.
    ///
    /// # Errors
    /// If the caller does not run on one.
    pub fn current() -> Result<Self, tokio::runtime::TryCurrentError> {
        Handle::try_current().map(Self::new)
    }

    fn tokio_instant(&self, at: Instant) -> tokio::time::Instant {
        // tokio cannot wait longer than about two years; a year is long enough here.
        const FAR: Duration = Duration::from_secs(365 * 24 * 3600);
        let offset = Duration::from_nanos(at.as_nanos());
        // Timers are set for each datagram, so the clock is read only if needed.
        let offset = if offset > FAR { offset.min(self.origin.elapsed() + FAR) } else { offset };
        self.origin + offset
    }
}

impl Net for TokioNet {
    fn now(&self) -> Instant {
        Instant::from_nanos(0).after(self.origin.elapsed())
    }

    fn timer(&self) -> Box<dyn Timer> {
        Box::new(TokioTimer { net: self.clone(), sleep: None })
    }

    fn spawn(&self, task: BoxFuture<'static, ()>) {
        self.runtime.spawn(task);
    }

    fn spawn_blocking(&self, work: Box<dyn FnOnce() + Send>) {
        self.runtime.spawn_blocking(work);
    }

    fn random(&self) -> io::Result<u64> {
        Ok(getrandom::u64()?)
    }

    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>> {
        Box::pin(async move { Ok(tokio::net::lookup_host(address).await?.collect()) })
    }

    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async move {
            let socket = if to.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
            apply(&SockRef::from(&socket), &options)?;
            stream(socket.connect(to).await?, to)
        })
    }

    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
        let _guard = self.runtime.enter();
        let socket = Socket::new(Domain::for_address(at), Type::STREAM, Some(Protocol::TCP))?;
        socket.set_nonblocking(true)?;
        // A restarted role takes its port again at once, though old connections still linger. On Windows the
        // option would let two listeners share the port.
        #[cfg(unix)]
        socket.set_reuse_address(true)?;
        apply(&SockRef::from(&socket), &options)?;
        socket.bind(&at.into())?;
        socket.listen(options.backlog)?;
        let listener = TcpListener::from_std(socket.into())?;
        let address = listener.local_addr()?;
        Ok((Box::new(TokioListener { listener, options }), address))
    }

    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
        let _guard = self.runtime.enter();
        udp::bind(at, options)
    }

    #[cfg(unix)]
    fn connect_unix<'a>(&'a self, path: &'a std::path::Path) -> BoxFuture<'a, io::Result<Stream>> {
        Box::pin(unix::connect(path))
    }

    #[cfg(unix)]
    fn listen_unix<'a>(
        &'a self,
        path: &'a std::path::Path,
        options: &'a crate::UnixSocketOptions,
    ) -> BoxFuture<'a, io::Result<Box<dyn Listen>>> {
        Box::pin(unix::listen(path, options))
    }
}

/// Buffers must be set before the handshake, because it fixes the window scale. Accepted connections inherit
/// them from the listener.
fn apply(socket: &SockRef<'_>, options: &TcpOptions) -> io::Result<()> {
    socket.set_tcp_nodelay(options.nodelay)?;
    if let Some(bytes) = options.send_buffer {
        socket.set_send_buffer_size(bytes)?;
    }
    if let Some(bytes) = options.recv_buffer {
        socket.set_recv_buffer_size(bytes)?;
    }
    if let Some(idle) = options.keepalive {
        let wish = TcpKeepalive::new().with_time(idle).with_interval(options.keepalive_interval);
        socket.set_tcp_keepalive(&wish)?;
    }
    #[cfg(any(target_os = "linux", target_os = "android"))]
    socket.set_tcp_user_timeout(options.user_timeout)?;
    Ok(())
}

fn stream(tcp: TcpStream, peer: SocketAddr) -> io::Result<Stream> {
    let (reader, writer) = tcp.into_split();
    Ok(Stream { reader: Box::new(reader), writer: Box::new(writer), peer: StreamPeer::Tcp(peer) })
}

struct TokioTimer {
    net: TokioNet,
    sleep: Option<Pin<Box<Sleep>>>,
}

impl Timer for TokioTimer {
    fn reset(&mut self, at: Instant) {
        let at = self.net.tokio_instant(at);
        match &mut self.sleep {
            Some(sleep) => sleep.as_mut().reset(at),
            None => {
                let _guard = self.net.runtime.enter();
                self.sleep = Some(Box::pin(sleep_until(at)));
            }
        }
    }

    fn poll(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        match &mut self.sleep {
            Some(sleep) => sleep.as_mut().poll(cx),
            None => Poll::Pending,
        }
    }
}

struct TokioListener {
    listener: TcpListener,
    options: TcpOptions,
}

impl Listen for TokioListener {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async move {
            let (tcp, peer) = self.listener.accept().await?;
            apply(&SockRef::from(&tcp), &self.options)?;
            stream(tcp, peer)
        })
    }
}
