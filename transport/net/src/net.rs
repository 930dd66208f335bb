//! The interface to time, tasks and sockets.

use std::fmt;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite};

use crate::{Credentials, Instant, TcpOptions, UdpSocket, UdpSocketOptions, UnixSocketOptions};

/// A future on the heap. It is used where connections are made, never per message.
pub type BoxFuture<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// The reading end of a stream. Dropping it closes it.
pub type BoxReader = Box<dyn AsyncRead + Send + Unpin>;

/// The writing end of a stream. Dropping it closes it: the peer reads the end of the stream.
pub type BoxWriter = Box<dyn AsyncWrite + Send + Unpin>;

/// Time, tasks and sockets. `TokioNet` is the real one; a simulator implements the same trait over virtual
/// time and runs the same code.
///
/// Object-safe on purpose: users of a link do not depend on the network below it.
pub trait Net: fmt::Debug + Send + Sync + 'static {
    /// The time now.
    fn now(&self) -> Instant;

    /// A timer that is not set.
    fn timer(&self) -> Box<dyn Timer>;

    /// Runs `task` beside the caller.
    fn spawn(&self, task: BoxFuture<'static, ()>);

    /// Runs work that may block, such as a read from a disk, without holding up tasks. By default at once: a
    /// simulated network has no spare thread, and its time stands still meanwhile.
    fn spawn_blocking(&self, work: Box<dyn FnOnce() + Send>) {
        work();
    }

    /// 64 random bits, for session ids and the like. A simulated network draws them from its seed.
    ///
    /// # Errors
    /// If the system gives no random bits.
    fn random(&self) -> io::Result<u64>;

    /// The addresses of `host:port`; host is a name, an IPv4 address or an IPv6 address in brackets.
    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>>;

    /// Connects to a TCP listener. Dropping the future ends the attempt.
    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>>;

    /// Listens for TCP connections, and returns the address; port 0 takes a free one.
    ///
    /// # Errors
    /// If the address cannot be listened on, for instance because the port is in use.
    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)>;

    /// Binds a UDP socket; port 0 takes a free one.
    ///
    /// # Errors
    /// If the address cannot be bound.
    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>>;

    /// Connects to a Unix socket. A network without them fails with [`io::ErrorKind::Unsupported`].
    fn connect_unix<'a>(&'a self, _path: &'a Path) -> BoxFuture<'a, io::Result<Stream>> {
        Box::pin(std::future::ready(Err(io::ErrorKind::Unsupported.into())))
    }

    /// Listens on a Unix socket. The file of a dead listener is replaced, that of a live one is not. A
    /// network without Unix sockets fails with [`io::ErrorKind::Unsupported`].
    fn listen_unix<'a>(
        &'a self,
        _path: &'a Path,
        _options: &'a UnixSocketOptions,
    ) -> BoxFuture<'a, io::Result<Box<dyn Listen>>> {
        Box::pin(std::future::ready(Err(io::ErrorKind::Unsupported.into())))
    }
}

/// A timer that can be reset without allocating.
pub trait Timer: Send {
    /// Sets the timer to ring at `at`, in place of any earlier setting.
    fn reset(&mut self, at: Instant);

    /// Ready once the set time has come.
    fn poll(&mut self, cx: &mut Context<'_>) -> Poll<()>;
}

/// A listening socket.
pub trait Listen: Send {
    /// Waits for the next connection. Dropping the future loses none.
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>>;
}

/// A connected byte stream.
pub struct Stream {
    /// Reads from the peer.
    pub reader: BoxReader,
    /// Writes to the peer.
    pub writer: BoxWriter,
    /// The other end, as far as the system knows it.
    pub peer: StreamPeer,
}

/// The other end of a byte stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamPeer {
    /// The peer with this address and port.
    Tcp(SocketAddr),
    /// A process of this machine.
    Unix(Credentials),
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stream").field("peer", &self.peer).finish_non_exhaustive()
    }
}

/// 32 random bytes, for a secret.
///
/// # Errors
/// If the system gives no random bits.
pub fn random_bytes(net: &dyn Net) -> io::Result<[u8; 32]> {
    let mut bytes = [0; 32];
    for word in bytes.as_chunks_mut::<8>().0 {
        *word = net.random()?.to_le_bytes();
    }
    Ok(bytes)
}

/// Waits until `at`.
///
/// Dropping the future ends the wait.
pub async fn sleep_until(net: &dyn Net, at: Instant) {
    let mut timer = net.timer();
    timer.reset(at);
    poll_fn(|cx| timer.poll(cx)).await;
}

/// The output of `future`, or `None` if `at` comes first; `future` is dropped then.
///
/// Dropping the future drops `future`.
pub async fn until<F: Future>(net: &dyn Net, at: Instant, future: F) -> Option<F::Output> {
    let mut future = std::pin::pin!(future);
    let mut timer = net.timer();
    timer.reset(at);
    poll_fn(|cx| match future.as_mut().poll(cx) {
        Poll::Ready(output) => Poll::Ready(Some(output)),
        Poll::Pending => timer.poll(cx).map(|()| None),
    })
    .await
}
