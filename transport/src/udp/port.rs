//! A connection at a socket, shared by the halves of its link and its tasks.

use parking_lot::{Mutex, MutexGuard};
use std::fmt;
use std::net::SocketAddr;
use std::sync::{Arc, Weak};
use std::task::{Context, Waker};

use trimaran_udp::{Closed, Connection, PathStats, UnitLane};
use trimaran_wire::ChannelNumber;

use super::socket::{Outgoing, Path};
use crate::error::{LaneError, Loss, ProtocolError};
use crate::stats::PathSource;
use trimaran_net::{Instant, Net, UdpSocket};

/// A connection and the wake-ups of its tasks.
pub(super) struct Port {
    pub(super) net: Arc<dyn Net>,
    pub(super) socket: Arc<dyn UdpSocket>,
    /// The first address of the peer.
    remote: SocketAddr,
    state: Mutex<State>,
    /// The connection's last counts.
    last: Arc<Mutex<PathStats>>,
}

/// Reads a port's counts, and its last ones once it is gone. It does not keep the socket.
#[derive(Debug)]
struct Watch {
    port: Weak<Port>,
    last: Arc<Mutex<PathStats>>,
}

impl PathSource for Watch {
    fn path(&self) -> PathStats {
        let live = self.port.upgrade().map(|port| port.lock().connection.stats());
        live.unwrap_or_else(|| *self.last.lock())
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        let counted = self.lock().connection.stats();
        *self.last.lock() = counted;
    }
}

pub(super) struct State {
    pub(super) connection: Connection,
    outgoing: Outgoing,
    /// The next datagram, and whether it must wait for others to leave first.
    datagram: Vec<u8>,
    waits: bool,
    /// When the driver next handles the connection by itself.
    pub(super) armed: Option<Instant>,
    /// The driver waits for the socket to have room.
    pub(super) full: bool,
    /// No half of the link is left.
    pub(super) left: bool,
    waiting: Waiting,
}

/// A task that waits for a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Waiter {
    Driver,
    Greeter,
    UnitTx(UnitLane),
    UnitRx(UnitLane),
    /// Of the latest lane, or of a channel.
    LatestTx(Option<ChannelNumber>),
    LatestRx(Option<ChannelNumber>),
}

/// The tasks that wait for a connection. Few wait at a time.
#[derive(Debug, Default)]
struct Waiting(Vec<(Waiter, Waker)>);

impl Waiting {
    fn put(&mut self, who: Waiter, waker: &Waker) {
        match self.0.iter_mut().find(|(known, _)| *known == who) {
            Some((_, known)) => known.clone_from(waker),
            None => self.0.push((who, waker.clone())),
        }
    }

    fn take(&mut self, who: Waiter) -> Option<Waker> {
        let at = self.0.iter().position(|(known, _)| *known == who)?;
        Some(self.0.swap_remove(at).1)
    }
}

impl fmt::Debug for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Port").field("remote", &self.remote).finish_non_exhaustive()
    }
}

impl Port {
    pub(super) fn new(
        net: &Arc<dyn Net>,
        socket: &Arc<dyn UdpSocket>,
        path: Path,
        connection: Connection,
    ) -> Arc<Self> {
        let state = State {
            connection,
            outgoing: Outgoing::new(path, &**socket),
            datagram: Vec::new(),
            waits: false,
            armed: None,
            full: false,
            left: false,
            waiting: Waiting::default(),
        };
        Arc::new(Self {
            net: Arc::clone(net),
            socket: Arc::clone(socket),
            remote: path.remote,
            state: Mutex::new(state),
            last: Arc::default(),
        })
    }

    /// Counts its packets.
    pub(super) fn watch(self: &Arc<Self>) -> impl PathSource + use<> {
        Watch { port: Arc::downgrade(self), last: Arc::clone(&self.last) }
    }

    pub(super) const fn remote(&self) -> SocketAddr {
        self.remote
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// Takes a datagram for the connection, from any address. [`Port::settle`] follows the last one.
    pub(super) fn handle(&self, now: Instant, from: SocketAddr, datagram: &[u8]) {
        self.lock().connection.handle_from(now, from, datagram);
    }

    /// Answers the datagrams that have come by `now`, and wakes tasks that can go on.
    pub(super) fn settle(&self, now: Instant) {
        let mut state = self.lock();
        state.flush(now, &*self.socket);
        state.wake_ready();
    }

    /// Sends pending data, after something was passed to the connection.
    pub(super) fn flush(&self, state: &mut State) {
        state.flush(self.net.now(), &*self.socket);
    }
}

impl State {
    /// Hands the system everything that may leave now; false if it has no room.
    pub(super) fn flush(&mut self, now: Instant, socket: &dyn UdpSocket) -> bool {
        let sent = self.send_all(now, socket);
        let due = self.connection.poll_timeout();
        let early = due.is_some_and(|due| self.armed.is_none_or(|armed| due < armed));
        if (!sent && !self.full) || early || self.connection.closed().is_some() {
            self.wake(Waiter::Driver);
        }
        sent
    }

    fn send_all(&mut self, now: Instant, socket: &dyn UdpSocket) -> bool {
        let Self { connection, outgoing, datagram, waits, .. } = self;
        if let Some(remote) = connection.remote() {
            outgoing.aim(remote);
        }
        while *waits || connection.poll_transmit(now, datagram) {
            *waits = true;
            if !outgoing.takes(datagram.len()) && !outgoing.send(socket) {
                return false;
            }
            outgoing.push(datagram);
            *waits = false;
        }
        while let Some(elsewhere) = connection.poll_excursion(now, datagram) {
            // A datagram that cannot be sent counts as lost.
            let mut excursion = outgoing.elsewhere(elsewhere, socket);
            excursion.push(datagram);
            excursion.send(socket);
        }
        outgoing.send(socket)
    }

    pub(super) fn wait(&mut self, who: Waiter, cx: &Context<'_>) {
        self.waiting.put(who, cx.waker());
    }

    pub(super) fn forget(&mut self, who: Waiter) {
        self.waiting.take(who);
    }

    pub(super) fn wake(&mut self, who: Waiter) {
        if let Some(waker) = self.waiting.take(who) {
            waker.wake();
        }
    }

    /// Wakes the halves that can go on.
    pub(super) fn wake_ready(&mut self) {
        let Self { connection, waiting, .. } = self;
        let over = connection.closed().is_some();
        let is_ready = |who: &Waiter| match *who {
            Waiter::Driver => false,
            Waiter::Greeter => connection.is_confirmed() || over,
            Waiter::UnitTx(lane) => {
                over || connection.is_writable(lane)
                    || connection.is_stopped(lane)
                    || connection.is_lane_drained(lane)
            }
            Waiter::UnitRx(lane) => over || connection.is_readable(lane),
            Waiter::LatestTx(channel) => over || connection.is_latest_drained(channel),
            Waiter::LatestRx(channel) => over || connection.is_latest_readable(channel),
        };
        for (_, waker) in waiting.0.extract_if(.., |(who, _)| is_ready(who)) {
            waker.wake();
        }
    }

    /// Whether the peer has closed the connection in order: a close that crosses the peer's own need not
    /// arrive.
    pub(super) fn peer_has_left(&self) -> bool {
        matches!(self.connection.closed(), Some(Closed::Peer))
    }

    /// How the connection was lost, if so.
    pub(super) fn loss(&self) -> Option<Loss> {
        self.connection.closed().map(|why| match why {
            Closed::Peer | Closed::Here => Loss::Closed,
            Closed::Silent(_) => Loss::Silent,
            Closed::Reset => Loss::Io(std::io::Error::new(std::io::ErrorKind::ConnectionReset, why.clone())),
            // The path to the peer is cut, and the path back is not.
            Closed::Deaf(_) => Loss::Io(std::io::Error::new(std::io::ErrorKind::TimedOut, why.clone())),
            other => Loss::Io(std::io::Error::new(std::io::ErrorKind::InvalidData, other.clone())),
        })
    }

    /// How the connection ended for a reader, if it did. Violations of the protocol are distinct from losses.
    pub(super) fn end(&self) -> Option<LaneError> {
        match self.connection.closed()? {
            Closed::Here
            | Closed::Peer
            | Closed::Reset
            | Closed::Silent(_)
            | Closed::Deaf(_)
            | Closed::Forged
            | Closed::Exhausted => self.loss().map(LaneError::Lost),
            broken => Some(LaneError::Protocol(ProtocolError::Datagrams(Box::new(broken.clone())))),
        }
    }
}

/// A port held by the halves of a link. Dropping the last one lets the connection end once sent data has
/// arrived.
#[derive(Debug)]
pub(crate) struct Carrier(Arc<Port>);

impl Carrier {
    pub(super) fn new(port: &Arc<Port>) -> Arc<Self> {
        Arc::new(Self(Arc::clone(port)))
    }

    pub(super) fn port(&self) -> &Port {
        &self.0
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock()
    }
}

impl Drop for Carrier {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.left = true;
        state.wake(Waiter::Driver);
    }
}
