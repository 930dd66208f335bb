//! The tasks behind connections: one per socket to receive, one per connection to keep its timers.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Poll, ready};
use std::time::Duration;

use tokio::sync::Notify;
use trimaran_udp::{Closed, ConnectionId, destination};

use super::port::{Port, State, Waiter};
use super::socket::{Incoming, Path};
use trimaran_net::{Instant, Net, UdpPoller, sleep_until};

/// How long sent data may take to arrive after the last half of a link was dropped.
const LINGER: Duration = Duration::from_secs(2);
/// How long a peer that keeps sending is told that the connection is closed.
const TELL: Duration = Duration::from_secs(1);
/// The pause after a socket has failed to receive.
const PAUSE: Duration = Duration::from_millis(10);

/// The connections at one socket, by their ids on this side.
#[derive(Debug)]
pub(super) struct Connections {
    net: Arc<dyn Net>,
    ports: Mutex<BTreeMap<ConnectionId, Arc<Port>>>,
    emptied: Notify,
}

impl Connections {
    pub(super) fn new(net: &Arc<dyn Net>) -> Arc<Self> {
        Arc::new(Self { net: Arc::clone(net), ports: Mutex::default(), emptied: Notify::new() })
    }

    pub(super) fn has(&self, id: ConnectionId) -> bool {
        self.ports.lock().contains_key(&id)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.ports.lock().is_empty()
    }

    /// Ends when the last connection does.
    pub(super) async fn emptied(&self) {
        loop {
            // Created before the check, so that an end in between is not missed.
            let emptied = self.emptied.notified();
            if self.is_empty() {
                return;
            }
            emptied.await;
        }
    }

    /// Runs a connection to its end.
    pub(super) fn serve(
        self: &Arc<Self>,
        id: ConnectionId,
        port: &Arc<Port>,
    ) -> impl Future<Output = ()> + Send + use<> {
        self.ports.lock().insert(id, Arc::clone(port));
        let (connections, port) = (Arc::clone(self), Arc::clone(port));
        async move {
            drive(&port).await;
            connections.ports.lock().remove(&id);
            connections.emptied.notify_waiters();
        }
    }

    /// Receives once; datagrams for no connection go to `stranger`.
    pub(super) async fn receive(&self, incoming: &mut Incoming, mut stranger: impl FnMut(Path, &[u8])) {
        let mut touched: Option<Arc<Port>> = None;
        // Datagrams received together have one time.
        let mut came = None;
        let received = incoming
            .receive(|path, datagram| {
                let port = destination(datagram).and_then(|id| self.ports.lock().get(&id).cloned());
                let Some(port) = port else { return stranger(path, datagram) };
                let now = *came.get_or_insert_with(|| self.net.now());
                port.handle(now, path.remote, datagram);
                if !touched.as_ref().is_some_and(|last| Arc::ptr_eq(last, &port))
                    && let Some(last) = touched.replace(port)
                {
                    last.settle(now);
                }
            })
            .await;
        if let (Some(last), Some(now)) = (touched, came) {
            last.settle(now);
        }
        if let Err(e) = received {
            tracing::debug!(error = &e as &dyn std::error::Error, "nothing could be received");
            sleep_until(&*self.net, self.net.now().after(PAUSE)).await;
        }
    }
}

/// Keeps the timers of a connection, sends when its socket has room again, and ends it once its link is gone.
async fn drive(port: &Port) {
    let mut timer = port.net.timer();
    // When the timer rings. It may ring too early, as deadlines move on with every acknowledgement: setting
    // it costs more than a check.
    let mut armed: Option<Instant> = None;
    let mut poller: Option<Pin<Box<dyn UdpPoller>>> = None;
    let mut departure = Departure::default();
    poll_fn(|cx| {
        loop {
            let (sent, sooner) = {
                let mut state = port.lock();
                state.forget(Waiter::Driver);
                let now = port.net.now();
                if state.connection.poll_timeout().is_some_and(|at| at <= now) {
                    state.connection.handle_timeout(now);
                }
                let leave = departure.step(now, &mut state);
                let sent = state.flush(now, &*port.socket);
                state.wake_ready();
                let due = match leave {
                    Next::Done => return Poll::Ready(()),
                    Next::At(at) => state.connection.poll_timeout().map_or(at, |due| due.min(at)),
                    Next::Never => match state.connection.poll_timeout() {
                        Some(due) => due,
                        None => return Poll::Ready(()),
                    },
                };
                let sooner = armed.is_none_or(|armed| due < armed).then_some(due);
                armed = sooner.or(armed);
                (state.armed, state.full) = (armed, !sent);
                state.wait(Waiter::Driver, cx);
                (sent, sooner)
            };
            if let Some(at) = sooner {
                timer.reset(at);
            }
            if !sent {
                let poller = poller.get_or_insert_with(|| Arc::clone(&port.socket).poller());
                // A socket that fails to wait fails again when it is used.
                let _writable = ready!(poller.as_mut().poll_writable(cx));
                continue;
            }
            ready!(timer.poll(cx));
            armed = None;
        }
    })
    .await;
}

/// How a connection ends.
#[derive(Debug, Default)]
struct Departure {
    /// Until when sent data may still arrive.
    linger: Option<Instant>,
    /// Until when the peer is told of the close.
    tell: Option<Instant>,
}

/// When to look again.
enum Next {
    Done,
    At(Instant),
    Never,
}

impl Departure {
    fn step(&mut self, now: Instant, state: &mut State) -> Next {
        if state.left && state.connection.closed().is_none() {
            let linger = *self.linger.get_or_insert(now.after(LINGER));
            if !state.connection.is_drained() && now < linger {
                return Next::At(linger);
            }
            state.connection.close();
        }
        match state.connection.closed() {
            None => Next::Never,
            Some(Closed::Peer | Closed::Reset | Closed::Silent(_)) => Next::Done,
            Some(_) => {
                let tell = *self.tell.get_or_insert(now.after(TELL));
                if now < tell { Next::At(tell) } else { Next::Done }
            }
        }
    }
}
