//! Listening for peers.

use std::convert::Infallible;
use std::fmt;
use std::io;
use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use tokio::sync::mpsc;
use trimaran_wire::Protocol;

use crate::acceptor::Acceptor;
use crate::application::Side;
use crate::error::readable;
use crate::handshake::HandshakeError;
use crate::lane_transport::Listened;
use crate::parts::LinkParts;
use crate::rates::{ListenerLimits, ListenerStats, TurnedAway};
use crate::schemes::transport_of;
use crate::transport::ListenFault;
use crate::{Endpoint, Endpoints, Link, Options};
use trimaran_net::{Instant, Net, until};

/// How many links may wait for [`Listener::accept`].
const QUEUE: usize = 8;

/// Why a listener could not be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ListenError {
    /// The host name has no address. It may pass: the name server may not be up yet.
    #[error("cannot listen on {endpoint}: its host has no address; check the name, or give an address")]
    Address {
        /// The endpoint.
        endpoint: Endpoint,
        /// The resolver's error.
        #[source]
        cause: io::Error,
    },
    /// This machine does not have the address. It may pass: a network may not be up yet.
    #[error(
        "cannot listen on {endpoint}: this machine has no such address; check it, and that its network is up"
    )]
    NotHere {
        /// The endpoint.
        endpoint: Endpoint,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// Another program listens there. It may pass: that program may end.
    #[error("cannot listen on {endpoint}: it is in use; choose another one, or stop the program that has it")]
    InUse {
        /// The endpoint.
        endpoint: Endpoint,
    },
    /// This side has no usable keys, or the system never allows this. It does not pass.
    #[error("cannot listen on {endpoint}")]
    Given {
        /// The endpoint.
        endpoint: Endpoint,
        /// The cause.
        #[source]
        cause: io::Error,
    },
    /// Any other failure, such as a lack of descriptors or a missing folder. It may pass.
    #[error("cannot listen on {endpoint}")]
    Io {
        /// The endpoint.
        endpoint: Endpoint,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
}

impl ListenError {
    /// Whether the same call may succeed later: time or another program may fix it. Otherwise this side's
    /// settings have to change.
    #[must_use]
    pub const fn may_pass(&self) -> bool {
        !matches!(self, Self::Given { .. })
    }

    fn new(endpoint: &Endpoint, fault: ListenFault) -> Self {
        let endpoint = endpoint.clone();
        let cause = match fault {
            ListenFault::Address(cause) => return Self::Address { endpoint, cause },
            ListenFault::Io(cause) => cause,
        };
        match cause.kind() {
            io::ErrorKind::AddrInUse => Self::InUse { endpoint },
            io::ErrorKind::AddrNotAvailable => Self::NotHere { endpoint, cause },
            io::ErrorKind::PermissionDenied
            | io::ErrorKind::AlreadyExists
            | io::ErrorKind::NotADirectory
            | io::ErrorKind::InvalidInput
            | io::ErrorKind::Unsupported
            // This crate's errors about keys.
            | io::ErrorKind::Other => Self::Given { endpoint, cause },
            _ => Self::Io { endpoint, cause },
        }
    }
}

/// Why no peer was accepted.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AcceptError {
    /// No peer came before the deadline.
    #[error("no peer connected to {endpoints} in {:?}{}", readable(.waited), .last.as_ref().map(|e| format!(" (the last that tried: {e})")).unwrap_or_default())]
    Deadline {
        /// The endpoints.
        endpoints: Endpoints,
        /// How long this call waited.
        waited: Duration,
        /// The last failure of a connection before it became a link.
        #[source]
        last: Option<HandshakeError>,
    },
    /// The listener's task is gone, because its runtime was shut down.
    #[error("the listener on {endpoints} was shut down")]
    ShutDown {
        /// The endpoints.
        endpoints: Endpoints,
    },
}

/// Accepts connecting peers, over one transport or several.
///
/// Handshakes run in the background: a stranger, or a peer that stops midway, holds up nobody. Each handshake
/// has a time limit, and their number is limited.
pub struct Listener<P: Protocol> {
    links: mpsc::Receiver<LinkParts>,
    protocol: PhantomData<fn() -> P>,
    endpoints: Endpoints,
    net: Arc<dyn Net>,
    acceptor: Arc<Acceptor>,
    /// Receives nothing, and ends when no address is held any more.
    freed: mpsc::Receiver<Infallible>,
    /// Kept until this is closed, so that addresses are held from the beginning.
    held: mpsc::Sender<Infallible>,
    /// Guards that live with the listener, such as its names within this process.
    guards: Vec<Box<dyn Send + Sync>>,
}

impl<P: Protocol> fmt::Debug for Listener<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listener").field("endpoints", &self.endpoints).finish_non_exhaustive()
    }
}

impl<P: Protocol> Listener<P> {
    /// Listens on `endpoint` as the peer with `hello`; port 0 takes a free port.
    ///
    /// Dropping the future frees everything taken so far.
    ///
    /// # Errors
    /// If the endpoint cannot be listened on; [`ListenError::may_pass`] says whether a later try may work.
    pub async fn bind(
        net: &Arc<dyn Net>,
        endpoint: &Endpoint,
        hello: P::Hello,
        options: &Options,
    ) -> Result<Self, ListenError> {
        Self::bind_all(net, &endpoint.clone().into(), hello, options).await
    }

    /// As [`Listener::bind`], at each of `endpoints` at once; they share the limits.
    ///
    /// Dropping the future frees everything taken so far.
    ///
    /// # Errors
    /// If one of the endpoints cannot be listened on.
    pub async fn bind_all(
        net: &Arc<dyn Net>,
        endpoints: &Endpoints,
        hello: P::Hello,
        options: &Options,
    ) -> Result<Self, ListenError> {
        let application = Side::<P>::of(hello).map_err(|e| ListenError::Given {
            endpoint: endpoints.first().clone(),
            cause: io::Error::other(e),
        })?;
        let (done, links) = mpsc::channel(QUEUE);
        let (held, freed) = mpsc::channel(1);
        let acceptor = Acceptor::new(net, application, options.link, options.limits, done, &held);
        let acceptor = Arc::new(acceptor);
        let mut guards = Vec::new();
        let mut bound: Option<Endpoints> = None;
        for endpoint in endpoints.iter() {
            let failed = |fault| ListenError::new(endpoint, fault);
            let transport = transport_of(endpoint, options).map_err(|e| failed(e.into()))?;
            let fits = transport.check_channels(&*acceptor.application);
            fits.map_err(|e| failed(io::Error::other(e).into()))?;
            let address = endpoint.address();
            let Listened { address, guard } = transport.listen(&address, &acceptor).await.map_err(failed)?;
            let local = endpoint.at(&address).map_err(|e| failed(io::Error::other(e).into()))?;
            guards.extend(guard);
            match &mut bound {
                Some(bound) => bound.push(local),
                None => bound = Some(local.into()),
            }
        }
        let endpoints = bound.unwrap_or_else(|| endpoints.clone());
        let net = Arc::clone(net);
        Ok(Self { links, protocol: PhantomData, endpoints, net, acceptor, freed, held, guards })
    }

    /// The first endpoint, with the port that the system chose for port 0.
    #[must_use]
    pub const fn local_endpoint(&self) -> &Endpoint {
        self.endpoints.first()
    }

    /// All endpoints, in the order given.
    #[must_use]
    pub const fn local_endpoints(&self) -> &Endpoints {
        &self.endpoints
    }

    /// The counts of refused handshakes so far.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAway {
        self.acceptor.stats().turned_away()
    }

    /// Its limits, which may change while it listens.
    #[must_use]
    pub fn limits(&self) -> ListenerLimits {
        self.acceptor.changeable_limits()
    }

    /// The same counts, readable while another task has the listener.
    #[must_use]
    pub fn stats(&self) -> ListenerStats {
        self.acceptor.stats()
    }

    /// Stops listening, and waits until the addresses are free for another listener. Links that were not
    /// accepted yet are lost to their peers; the others live on.
    ///
    /// Over quic and udp they use the listener's socket, so its address is free only once they have ended:
    /// close or drop them before.
    ///
    /// Dropping the future, or the listener instead, stops listening as well. The addresses are then free
    /// soon.
    pub async fn close(self) {
        let Self { links, acceptor, mut freed, held, guards, .. } = self;
        drop((links, acceptor, held, guards));
        let _nothing = freed.recv().await;
    }

    /// Waits for the next peer, until `deadline` at most. Peers that do not fit are refused, and the wait
    /// goes on.
    ///
    /// Dropping the future loses no peer: the next call returns it.
    ///
    /// # Errors
    /// If no peer came; the error then tells the last failure. Or if the runtime is shut down.
    pub async fn accept(&mut self, deadline: Instant) -> Result<Link<P>, AcceptError> {
        let started = self.net.now();
        let endpoints = self.endpoints.clone();
        loop {
            match until(&*self.net, deadline, self.links.recv()).await {
                Some(Some(parts)) => {
                    // An admitted hello can be read.
                    let format = self.acceptor.application.format();
                    if let Some(link) = parts.into_link(&self.net, &self.acceptor.link, &format) {
                        return Ok(link);
                    }
                }
                Some(None) => return Err(AcceptError::ShutDown { endpoints }),
                None => {
                    let waited = self.net.now().since(started);
                    let last = self.acceptor.last_failure();
                    return Err(AcceptError::Deadline { endpoints, waited, last });
                }
            }
        }
    }
}
