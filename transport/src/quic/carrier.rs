//! The connection under a link, and how it ends.

use parking_lot::Mutex;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::join_all;
use quinn::{Connection, ConnectionError, ReadError, SendStream, VarInt, WriteError};

use crate::error::Loss;
use trimaran_net::{Net, sleep_until, until};

/// How long sent data may take to arrive after the last half of a link was dropped.
const LINGER: Duration = Duration::from_secs(2);
/// How long the close packet may take to leave.
const TELL: Duration = Duration::from_millis(500);
/// How often to look whether it has left.
const LOOK: Duration = Duration::from_millis(1);
/// The code of QUIC's own close: it needs one, and this protocol has a close of its own.
const CLOSED: VarInt = VarInt::from_u32(0);

/// A connection shared by the halves of a link. Dropping the last half closes it once everything has arrived:
/// closing at once would discard data that QUIC has not delivered.
#[derive(Debug)]
pub(crate) struct Carrier {
    pub(crate) net: Arc<dyn Net>,
    pub(crate) connection: Connection,
    /// Streams of dropped halves, with data that has not arrived.
    leaving: Mutex<Vec<SendStream>>,
}

impl Carrier {
    pub(crate) fn new(net: &Arc<dyn Net>, connection: Connection) -> Arc<Self> {
        Arc::new(Self { net: Arc::clone(net), connection, leaving: Mutex::default() })
    }

    /// Keeps the connection for `streams`, whose half is dropped.
    pub(crate) fn outlive(&self, streams: impl IntoIterator<Item = SendStream>) {
        self.leaving.lock().extend(streams);
    }

    /// Closes the connection, and waits until the close packet has left. It also acknowledges the last data:
    /// without it the peer would wait for that until the idle timeout.
    pub(crate) async fn part(&self) {
        if self.connection.close_reason().is_some() {
            return;
        }
        // quinn does not report when it has sent its last packet, but counts packets: after the close only
        // that one is sent.
        let sent = || self.connection.stats().udp_tx.datagrams;
        let before = sent();
        self.connection.close(CLOSED, b"");
        let by = self.net.now().after(TELL);
        while sent() == before && self.net.now() < by {
            sleep_until(&*self.net, self.net.now().after(LOOK)).await;
        }
    }
}

impl Drop for Carrier {
    fn drop(&mut self) {
        let (net, connection) = (Arc::clone(&self.net), self.connection.clone());
        let leaving = std::mem::take(&mut *self.leaving.lock());
        self.net.spawn(Box::pin(async move {
            until(&*net, net.now().after(LINGER), join_all(leaving.iter().map(SendStream::stopped))).await;
            connection.close(CLOSED, b"");
        }));
    }
}

/// The cause of a lost connection.
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

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::thread;

    use tokio::runtime::Builder;
    use trimaran_wire::Message;

    use super::super::connect::endpoint;
    use super::super::control::Control;
    use super::super::listen::server;
    use super::*;
    use crate::acceptor::Acceptor;
    use crate::application::Side;
    use crate::conformance::{ARM, PANEL, Robot, finished, greeting};
    use crate::handshake::Handshake;
    use crate::keys::{Keys, Security};
    use crate::{Bulk, Endpoint, Link, LinkConfig, Options, RecvError, TokioNet, connect};

    const SECONDS: Duration = Duration::from_secs(10);

    /// A process may end once it has closed the link: nothing of it sends any more.
    #[test]
    fn the_close_has_left_when_a_close_is_over() {
        let [here, there] = ["near", "far"].map(|name| Keys::generate(name.parse().unwrap()).unwrap());
        let options = |own: &Keys, peer: &Keys| Options {
            security: Some(Security { keys: own.clone(), peers: vec![peer.public().clone().into()].into() }),
            ..Options::default()
        };
        let (ours, theirs) = (options(&here, &there), options(&there, &here));
        let (tell, told) = mpsc::channel();
        let runtime = || Builder::new_current_thread().enable_all().build().unwrap();
        let process = thread::spawn(move || {
            runtime().block_on(async {
                let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
                let (endpoint, by): (Endpoint, _) = (told.recv().unwrap(), net.now().after(SECONDS));
                let mut link = connect::<Robot>(&net, &endpoint, greeting(PANEL), &theirs, by).await.unwrap();
                let heard = link.frames_rx.recv().await;
                assert!(matches!(heard, Err(RecvError::Closed { .. })), "{heard:?}");
                link.close(finished()).await.unwrap();
            });
        });
        runtime().block_on(async {
            let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
            let application = Side::<Robot>::of(greeting(ARM)).unwrap();
            let acceptor = Acceptor::new(
                &net,
                Arc::clone(&application),
                ours.link,
                ours.limits,
                tokio::sync::mpsc::channel(1).0,
                &tokio::sync::mpsc::channel(1).0,
            );
            let security = ours.security.as_ref().unwrap();
            let (config, _) = server(&acceptor, security, &ours.quic).unwrap();
            let loopback = "127.0.0.1:0".parse().unwrap();
            let (endpoint, at) = endpoint(
                &net,
                net.bind_udp(loopback, ours.quic.socket).unwrap(),
                Some((config, security.keys.quic().unwrap())),
            )
            .unwrap();
            tell.send(format!("quic://{at}").parse().unwrap()).unwrap();
            let connection = endpoint.accept().await.unwrap().await.unwrap();
            let streams = connection.accept_bi().await.unwrap();
            let mut control = Control::new(connection.clone(), streams, application.format());
            let hello = control.recv_hello().await.unwrap();
            let peer = application.recognize(&hello.application).unwrap();
            let beside = control.accept_beside().await.unwrap();
            control.send(&Message::Accept(acceptor.answer(&peer))).await.unwrap();
            let parts = control.into_parts(&net, peer, (hello.session, beside));
            let config = LinkConfig::default();
            let link = parts.into_link::<Robot>(&net, &config, &application.format()).unwrap();
            let Link { frames_tx, latest_tx, messages_tx, bulk, latest_rx: _latest_rx, .. } = link;
            frames_tx.close(finished()).await.unwrap();
            latest_tx.close(finished()).await.unwrap();
            messages_tx.close(finished()).await.unwrap();
            let Bulk { tx: bulk_tx, rx: _bulk_rx } = bulk.unwrap();
            bulk_tx.close(finished()).await.unwrap();
            // Not a silence until the idle timeout.
            let end = connection.closed().await;
            assert!(matches!(end, ConnectionError::ApplicationClosed(_)), "{end:?}");
        });
        process.join().unwrap();
    }
}
