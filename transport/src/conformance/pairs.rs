//! How the suite makes pairs of links.

use std::sync::Arc;
use std::time::Duration;

use super::robot::Robot;
use super::talk::{ARM, PANEL, greeting};
use crate::{
    ConnectError, Endpoint, Link, LinkConfig, ListenError, Listener, Net, Options, Protocol, TokioNet,
    connect,
};

/// Makes pairs of joined links over one transport.
pub trait Pairs {
    /// The bytes and messages that the transport adds.
    fn overhead(&self) -> Overhead;

    /// Two links, each the other's peer: first the one that listened, then the one that connected. Each has
    /// this configuration, and they buffer less than 64 MiB in flight.
    ///
    /// # Errors
    /// If there is no link within that time.
    fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        config: LinkConfig,
        within: Duration,
    ) -> impl Future<Output = Result<(Link<P>, Link<Q>), ConnectError>>;

    /// Such links of [`ARM`] and of [`PANEL`].
    fn pair(&self, config: LinkConfig) -> impl Future<Output = (Link<Robot>, Link<Robot>)> {
        async move {
            let hellos = (greeting(ARM), greeting(PANEL));
            self.join(hellos, config, Duration::from_secs(60)).await.unwrap()
        }
    }

    /// The network whose time the links use. By default that of the runtime under which this is called.
    fn net(&self) -> Arc<dyn Net> {
        Arc::new(TokioNet::current().unwrap())
    }
}

/// The bytes and messages that a transport adds, as [`LinkStats`](crate::LinkStats) counts them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overhead {
    /// The bytes of a message's header.
    pub header_bytes: u64,
    /// The messages of a handshake in each direction.
    pub handshake: u64,
    /// Whether batches are coded where the link is configured so.
    pub coded: bool,
}

/// Pairs through a listener at an endpoint, both sides with the same options.
#[derive(Debug, Clone)]
pub struct Joined {
    endpoint: Endpoint,
    options: Options,
    overhead: Overhead,
}

impl Joined {
    /// Pairs over the transport of `endpoint`. Use port 0: cases run at the same time.
    ///
    /// # Panics
    /// If `endpoint` is invalid.
    #[must_use]
    pub fn at(endpoint: &str, options: Options, overhead: Overhead) -> Self {
        let endpoint = endpoint.parse().unwrap_or_else(|e| panic!("{endpoint}: {e}"));
        Self::over(endpoint, options, overhead)
    }

    /// The same for an endpoint that cannot be written as text, such as that of a transport from outside.
    #[must_use]
    pub const fn over(endpoint: Endpoint, options: Options, overhead: Overhead) -> Self {
        Self { endpoint, options, overhead }
    }
}

impl Pairs for Joined {
    fn overhead(&self) -> Overhead {
        self.overhead
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        link: LinkConfig,
        within: Duration,
    ) -> Result<(Link<P>, Link<Q>), ConnectError> {
        let (net, options) = (self.net(), Options { link, ..self.options.clone() });
        meet([&net, &net], &self.endpoint, [&options, &options], hellos, within, Clone::clone).await
    }
}

/// Listens at `endpoint` and connects to it, for [`Pairs::join`]. `seen` gives the address of the listener as
/// the other side sees it.
///
/// # Errors
/// If there is no link within that time.
///
/// # Panics
/// If `endpoint` cannot be listened on, although a peer could connect to it.
pub async fn meet<P: Protocol, Q: Protocol>(
    [here, there]: [&Arc<dyn Net>; 2],
    endpoint: &Endpoint,
    [ours, theirs]: [&Options; 2],
    hellos: (P::Hello, Q::Hello),
    within: Duration,
    seen: impl Fn(&Endpoint) -> Endpoint,
) -> Result<(Link<P>, Link<Q>), ConnectError> {
    let by = here.now().after(within);
    let mut listener = match Listener::<P>::bind(here, endpoint, hellos.0, ours).await {
        Ok(listener) => listener,
        // A transport that cannot have such links at all says so on both sides.
        Err(ListenError::Given { .. }) => {
            return Err(connect::<Q>(there, endpoint, hellos.1, theirs, by).await.unwrap_err());
        }
        Err(other) => panic!("{other:?}"),
    };
    let at = seen(listener.local_endpoint());
    let connects = connect(there, &at, hellos.1, theirs, by);
    let (connected, accepted) = tokio::join!(connects, listener.accept(by));
    connected.map(|there| (accepted.unwrap(), there))
}
