//! The connection under a link, and how it ends.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use quinn::{Connection, ConnectionError, ReadError, SendStream, VarInt, WriteError};

use crate::desk::lock;
use crate::error::Loss;
use crate::net::{Net, until};

/// How long what was sent may take to arrive after the last half of a link was dropped.
const LINGER: Duration = Duration::from_secs(2);
/// The code that a connection is closed with: QUIC needs one, this protocol has its goodbye.
const CLOSED: VarInt = VarInt::from_u32(0);

/// A connection that the halves of a link share. Dropping the last half closes it, once what was sent has arrived: closing at
/// once would take back what QUIC has not delivered.
#[derive(Debug)]
pub(crate) struct Carrier {
    pub(crate) net: Arc<dyn Net>,
    pub(crate) connection: Connection,
    /// Streams of halves that are gone, not all of which has arrived.
    leaving: Mutex<Vec<SendStream>>,
}

impl Carrier {
    pub(crate) fn new(net: &Arc<dyn Net>, connection: Connection) -> Arc<Self> {
        Arc::new(Self { net: Arc::clone(net), connection, leaving: Mutex::default() })
    }

    /// Keeps the connection for the sake of `streams`, whose half is dropped.
    pub(crate) fn outlive(&self, streams: impl IntoIterator<Item = SendStream>) {
        lock(&self.leaving).extend(streams);
    }
}

impl Drop for Carrier {
    fn drop(&mut self) {
        let (net, connection) = (Arc::clone(&self.net), self.connection.clone());
        let leaving = std::mem::take(&mut *lock(&self.leaving));
        self.net.spawn(Box::pin(async move {
            until(&*net, net.now().after(LINGER), all_arrived(&leaving)).await;
            connection.close(CLOSED, b"");
        }));
    }
}

/// Waits until the peer's machine has everything of `streams`, or the connection is gone.
pub(crate) async fn all_arrived(streams: impl IntoIterator<Item = &SendStream>) {
    for stream in streams {
        let _gone = stream.stopped().await;
    }
}

/// How a connection was lost.
pub(crate) fn loss(error: ConnectionError) -> Loss {
    match error {
        ConnectionError::ApplicationClosed(_) | ConnectionError::LocallyClosed => Loss::Closed,
        ConnectionError::TimedOut => Loss::Silent,
        other => Loss::Io(other.into()),
    }
}

pub(crate) fn read_loss(error: ReadError) -> Loss {
    match error {
        ReadError::ConnectionLost(e) => loss(e),
        other => Loss::Io(io::Error::new(io::ErrorKind::ConnectionReset, other)),
    }
}

pub(crate) fn write_loss(error: WriteError) -> Loss {
    match error {
        WriteError::ConnectionLost(e) => loss(e),
        WriteError::Stopped(_) => Loss::Closed,
        other => Loss::Io(io::Error::new(io::ErrorKind::ConnectionReset, other)),
    }
}
