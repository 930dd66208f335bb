//! TCP streams and listeners, and the halves of streams.

use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use trimaran_net::TcpOptions;

use super::address::{ToSocketAddrs, no_address};
use crate::net::context::here;
use crate::net::tcp::{Connection, SimListener, connect, listen};

/// How long Linux sends data again to a peer that does not answer (`tcp_retries2`).
const GIVE_UP: Duration = Duration::from_millis(924_600);

/// The options of a socket that has set none.
fn options() -> TcpOptions {
    TcpOptions::default().with_nodelay(false).with_keepalive(None).with_user_timeout(Some(GIVE_UP))
}

/// A listening socket of the host.
#[derive(Debug)]
pub struct TcpListener(SimListener);

impl TcpListener {
    /// Listens at the first address that can be listened on; port 0 takes a free one.
    ///
    /// # Errors
    /// If none can, for instance because the port is in use, or the program is on no host.
    pub async fn bind<A: ToSocketAddrs>(at: A) -> io::Result<Self> {
        let net = here()?;
        let mut last = no_address();
        for at in at.lookup(&net)? {
            match listen(&net, at, options()) {
                Ok(listener) => return Ok(Self(listener)),
                Err(e) => last = e,
            }
        }
        Err(last)
    }

    /// Waits for the next connection. Dropping the future loses none.
    ///
    /// # Errors
    /// If the host has crashed.
    pub async fn accept(&self) -> io::Result<(TcpStream, SocketAddr)> {
        poll_fn(|cx| self.poll_accept(cx)).await
    }

    /// Takes the next connection.
    ///
    /// # Errors
    /// If the host has crashed.
    pub fn poll_accept(&self, cx: &mut Context<'_>) -> Poll<io::Result<(TcpStream, SocketAddr)>> {
        self.0.poll_accept(cx).map_ok(|connection| {
            let peer = connection.peer;
            (TcpStream(connection), peer)
        })
    }

    /// The address at which it listens.
    ///
    /// # Errors
    /// Never: the result is for programs on tokio.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.0.local)
    }
}

/// A connection. Dropping it closes it; unread data is refused with a reset.
#[derive(Debug)]
pub struct TcpStream(Connection);

impl TcpStream {
    /// Connects to the first address that answers. Dropping the future ends the attempt.
    ///
    /// # Errors
    /// If none answers, or the program is on no host.
    pub async fn connect<A: ToSocketAddrs>(to: A) -> io::Result<Self> {
        let net = here()?;
        let mut last = no_address();
        for to in to.lookup(&net)? {
            match connect(&net, to, options()).await {
                Ok(connection) => return Ok(Self(connection)),
                Err(e) => last = e,
            }
        }
        Err(last)
    }

    /// Its address on this host.
    ///
    /// # Errors
    /// Never: the result is for programs on tokio.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.0.local)
    }

    /// The address of its peer.
    ///
    /// # Errors
    /// Never: the result is for programs on tokio.
    pub fn peer_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.0.peer)
    }

    /// Whether small segments go at once, without Nagle's wait for an acknowledgement. At first they wait.
    ///
    /// # Errors
    /// If the host has crashed.
    pub fn set_nodelay(&self, nodelay: bool) -> io::Result<()> {
        self.0.set_nodelay(nodelay)
    }

    /// Its two halves, which borrow it.
    pub const fn split(&mut self) -> (ReadHalf<'_>, WriteHalf<'_>) {
        (ReadHalf(self), WriteHalf(self))
    }

    /// Its two halves. Dropping the writing one ends that direction.
    #[must_use]
    pub fn into_split(self) -> (OwnedReadHalf, OwnedWriteHalf) {
        let stream = Arc::new(self);
        (OwnedReadHalf(Arc::clone(&stream)), OwnedWriteHalf(stream))
    }

    const fn stream(&self) -> &Self {
        self
    }
}

/// The reading half of a borrowed stream.
#[derive(Debug)]
pub struct ReadHalf<'s>(&'s TcpStream);

/// The writing half of a borrowed stream.
#[derive(Debug)]
pub struct WriteHalf<'s>(&'s TcpStream);

/// The reading half of a stream.
#[derive(Debug)]
pub struct OwnedReadHalf(Arc<TcpStream>);

/// The writing half of a stream. Dropping it ends that direction.
#[derive(Debug)]
pub struct OwnedWriteHalf(Arc<TcpStream>);

impl Drop for OwnedWriteHalf {
    fn drop(&mut self) {
        let _closed = self.0.0.shutdown();
    }
}

/// Gives halves access to their stream.
macro_rules! halves {
    ($($half:ty),+) => {
        $(impl $half {
            /// The stream.
            fn stream(&self) -> &TcpStream {
                &self.0
            }

            /// The address of the stream on this host.
            ///
            /// # Errors
            /// Never: the result is for programs on tokio.
            pub fn local_addr(&self) -> io::Result<SocketAddr> {
                self.stream().local_addr()
            }

            /// The address of the peer.
            ///
            /// # Errors
            /// Never: the result is for programs on tokio.
            pub fn peer_addr(&self) -> io::Result<SocketAddr> {
                self.stream().peer_addr()
            }
        })+
    };
}

halves!(ReadHalf<'_>, WriteHalf<'_>, OwnedReadHalf, OwnedWriteHalf);

/// Lets types read from their stream.
macro_rules! reads {
    ($($reader:ty),+) => {
        $(impl AsyncRead for $reader {
            fn poll_read(
                self: Pin<&mut Self>,
                cx: &mut Context<'_>,
                buffer: &mut ReadBuf<'_>,
            ) -> Poll<io::Result<()>> {
                self.stream().0.poll_read(cx, buffer)
            }
        })+
    };
}

reads!(TcpStream, ReadHalf<'_>, OwnedReadHalf);

/// Lets types write to their stream.
macro_rules! writes {
    ($($writer:ty),+) => {
        $(impl AsyncWrite for $writer {
            fn poll_write(
                self: Pin<&mut Self>,
                cx: &mut Context<'_>,
                data: &[u8],
            ) -> Poll<io::Result<usize>> {
                self.stream().0.poll_write(cx, data)
            }

            fn poll_flush(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
                Poll::Ready(Ok(()))
            }

            fn poll_shutdown(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<io::Result<()>> {
                Poll::Ready(self.stream().0.shutdown())
            }
        })+
    };
}

writes!(TcpStream, WriteHalf<'_>, OwnedWriteHalf);
