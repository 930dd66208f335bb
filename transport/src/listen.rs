//! Listening for peers.

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
use crate::parts::Parts;
use crate::rates::TurnedAway;
use crate::scheme::Listened;
use crate::schemes::scheme_of;
use crate::transport::ListenFault;
use crate::{Endpoint, Endpoints, Link, Options};
use trimaran_net::{Instant, Net, until};

/// How many links may wait for [`Listener::accept`].
const QUEUE: usize = 8;

/// Why a listener could not be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ListenError {
    /// The host name has no address. It may pass: the name server may not be there yet.
    #[error("cannot listen on {endpoint}: its host has no address; check the name, or give an address")]
    Address {
        /// Where.
        endpoint: Endpoint,
        /// What the resolver says.
        #[source]
        cause: io::Error,
    },
    /// The address is none of this machine's. It may pass: a network may not be there yet.
    #[error(
        "cannot listen on {endpoint}: this machine has no such address; check it, and that its network is up"
    )]
    NotHere {
        /// Where.
        endpoint: Endpoint,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// Someone else listens there. It may pass: that program may end.
    #[error("cannot listen on {endpoint}: it is in use; choose another one, or stop the program that has it")]
    InUse {
        /// Where.
        endpoint: Endpoint,
    },
    /// This side lacks keys, or they cannot be used; or the system never allows what was asked for. It does
    /// not pass.
    #[error("cannot listen on {endpoint}")]
    Given {
        /// Where.
        endpoint: Endpoint,
        /// Why not.
        #[source]
        cause: io::Error,
    },
    /// Any other failure, such as want of descriptors or a folder that is not there yet. It may pass.
    #[error("cannot listen on {endpoint}")]
    Io {
        /// Where.
        endpoint: Endpoint,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
}

impl ListenError {
    /// Whether the same call may work another time: time or another program may mend it. Otherwise what this
    /// side was given has to change.
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
            // What this crate says of keys.
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
        /// Where we listened.
        endpoints: Endpoints,
        /// How long this call waited.
        waited: Duration,
        /// What became of the last connection that did not make it to a link.
        #[source]
        last: Option<HandshakeError>,
    },
    /// The listener's task is gone, because its runtime was shut down.
    #[error("the listener on {endpoints} was shut down")]
    ShutDown {
        /// Where we listened.
        endpoints: Endpoints,
    },
}

/// Takes peers that connect, over one transport or several.
///
/// Handshakes go on beside the caller: a stranger, or a peer that stops in the middle, holds up nobody. Each
/// has a limit in time and they have one in number.
pub struct Listener<P: Protocol> {
    links: mpsc::Receiver<Parts>,
    protocol: PhantomData<fn() -> P>,
    endpoints: Endpoints,
    net: Arc<dyn Net>,
    acceptor: Arc<Acceptor>,
    /// What goes with the listener, such as its names within this process.
    _guards: Vec<Box<dyn Send + Sync>>,
}

impl<P: Protocol> fmt::Debug for Listener<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listener").field("endpoints", &self.endpoints).finish_non_exhaustive()
    }
}

impl<P: Protocol> Listener<P> {
    /// Listens on `endpoint` as the peer that says `hello`; port 0 takes a free port.
    ///
    /// Dropping the future frees what it has taken so far.
    ///
    /// # Errors
    /// When the endpoint cannot be listened on; [`ListenError::may_pass`] says whether another time may do.
    pub async fn bind(
        net: &Arc<dyn Net>,
        endpoint: &Endpoint,
        hello: P::Hello,
        options: &Options,
    ) -> Result<Self, ListenError> {
        Self::bind_all(net, &endpoint.clone().into(), hello, options).await
    }

    /// As [`Listener::bind`], at each of `endpoints` at once: the limits hold for all together.
    ///
    /// Dropping the future frees what it has taken so far.
    ///
    /// # Errors
    /// When one of the endpoints cannot be listened on.
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
        let acceptor = Arc::new(Acceptor::new(net, application, options, done));
        let mut guards = Vec::new();
        let mut bound: Option<Endpoints> = None;
        for endpoint in endpoints.iter() {
            let failed = |fault| ListenError::new(endpoint, fault);
            let scheme = scheme_of(endpoint, options).map_err(|e| failed(e.into()))?;
            let Listened { at: local, guard } = scheme.listen(&acceptor).await.map_err(failed)?;
            guards.extend(guard);
            match &mut bound {
                Some(bound) => bound.push(local),
                None => bound = Some(local.into()),
            }
        }
        let endpoints = bound.unwrap_or_else(|| endpoints.clone());
        Ok(Self { links, protocol: PhantomData, endpoints, net: Arc::clone(net), acceptor, _guards: guards })
    }

    /// Where it listens, first of all: with the port that the system chose, where it was to.
    #[must_use]
    pub const fn local_endpoint(&self) -> &Endpoint {
        self.endpoints.first()
    }

    /// Everywhere that it listens, in the order given.
    #[must_use]
    pub const fn local_endpoints(&self) -> &Endpoints {
        &self.endpoints
    }

    /// What was turned away so far.
    #[must_use]
    pub fn turned_away(&self) -> TurnedAway {
        self.acceptor.turned_away()
    }

    /// Waits for the next peer, until `deadline` at most. Who does not fit is turned away, and the wait goes
    /// on.
    ///
    /// Dropping the future loses no peer: the next call gives it.
    ///
    /// # Errors
    /// When none came; then the error says what became of the last one that tried. Or when the runtime is
    /// shut down.
    pub async fn accept(&mut self, deadline: Instant) -> Result<Link<P>, AcceptError> {
        let started = self.net.now();
        let endpoints = self.endpoints.clone();
        loop {
            match until(&*self.net, deadline, self.links.recv()).await {
                Some(Some(parts)) => {
                    // Whose hello was admitted can be read.
                    if let Some(link) = parts.into_link(&self.net, &self.acceptor.options.link) {
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
