//! How the suite makes pairs of links.

use std::sync::Arc;
use std::time::Duration;

use super::robot::Robot;
use super::talk::{ARM, PANEL, greeting};
use crate::{Endpoint, Link, LinkConfig, Listener, Net, Options, TokioNet, connect};

/// Makes pairs of joined links over one transport.
pub trait Pairs {
    /// The bytes and messages that the transport adds.
    fn overhead(&self) -> Overhead;

    /// Two links, each the other's peer: that of [`ARM`] first, which listened, then that of [`PANEL`].
    ///
    /// They have this configuration. They buffer less than 64 MiB in flight.
    fn pair(&self, config: LinkConfig) -> impl Future<Output = (Link<Robot>, Link<Robot>)>;

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

    async fn pair(&self, link: LinkConfig) -> (Link<Robot>, Link<Robot>) {
        let (net, options) = (self.net(), Options { link, ..self.options.clone() });
        let soon = net.now().after(Duration::from_secs(60));
        let mut listener = Listener::bind(&net, &self.endpoint, greeting(ARM), &options).await.unwrap();
        let there = listener.local_endpoint().clone();
        let (there, here) =
            tokio::join!(connect(&net, &there, greeting(PANEL), &options, soon), listener.accept(soon),);
        (here.unwrap(), there.unwrap())
    }
}
