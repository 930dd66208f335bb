//! A link that is made again whenever it is lost.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use tokio::sync::watch;
use trimaran_wire::Protocol;

use crate::causes::causes;
use crate::channels::ChannelError;
use crate::connect::{connect, growing_pauses};
use crate::error::{RecvError, SendError};
use crate::lanes::blobs::BlobError;
use crate::{ConnectError, Endpoint, Link, Options};
use trimaran_net::{Instant, Net, sleep_until};

/// A link that lives for so long was a good one: the next one is made without a pause.
const GOOD: Duration = Duration::from_secs(10);
/// The pauses after links that are lost at once, as where the peer fails on each.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LAST_PAUSE: Duration = Duration::from_secs(5);
/// How long one call tries to connect, before the next one does.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3600);

/// How a link ended for its user: what receiving or sending says.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LinkError {
    /// Nothing more can be received.
    #[error(transparent)]
    Receive(#[from] RecvError),
    /// Nothing more can be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// A channel could not be taken out.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// A blob could not be received.
    #[error(transparent)]
    Blob(#[from] BlobError),
}

/// Whether there is a link.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum LinkState {
    /// There is none: it is being made.
    Down {
        /// How the last one ended; `None` before the first.
        why: Option<Arc<LinkError>>,
    },
    /// There is one.
    Up {
        /// How many there have been, with this one.
        links: u64,
    },
}

/// Reads the changes of a link's state, from any task.
#[derive(Debug, Clone)]
pub struct LinkEvents(watch::Receiver<LinkState>);

impl LinkEvents {
    /// The state now.
    #[must_use]
    pub fn state(&self) -> LinkState {
        self.0.borrow().clone()
    }

    /// Waits until the state is another than the last one seen here, and returns it; `None` once the
    /// [`Reconnecting`] is dropped. Of changes in quick succession only the last is seen.
    ///
    /// Dropping the future loses no change.
    pub async fn changed(&mut self) -> Option<LinkState> {
        self.0.changed().await.ok()?;
        Some(self.0.borrow_and_update().clone())
    }
}

/// Connects to a listener, and again whenever the link is lost.
///
/// ```
/// # use std::sync::Arc;
/// # use trimaran_transport::{ConnectError, Endpoint, Net, Options, Protocol, Reconnecting};
/// # async fn show<P: Protocol>(
/// #     net: Arc<dyn Net>, robot: Endpoint, hello: P::Hello, subscribe: P::Message,
/// # ) -> Result<(), ConnectError> where P::Hello: Clone {
/// let mut robot = Reconnecting::<P>::new(&net, &robot, hello, &Options::default());
/// robot
///     .run(async |mut link| {
///         // Each link begins so: this is how the session is resumed.
///         link.messages_tx.send(&subscribe).await?;
///         loop {
///             println!("{:?}", link.frames_rx.recv().await?);
///         }
///     })
///     .await
/// # }
/// ```
pub struct Reconnecting<P: Protocol> {
    net: Arc<dyn Net>,
    endpoint: Endpoint,
    hello: P::Hello,
    options: Options,
    state: watch::Sender<LinkState>,
    links: u64,
    /// How many links in a row were lost soon.
    short: usize,
}

impl<P: Protocol> fmt::Debug for Reconnecting<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = self.state.borrow();
        f.debug_struct("Reconnecting").field("endpoint", &self.endpoint).field("state", &*state).finish()
    }
}

impl<P: Protocol> Reconnecting<P>
where
    P::Hello: Clone,
{
    /// Links to the listener at `endpoint`; nothing is done yet.
    #[must_use]
    pub fn new(net: &Arc<dyn Net>, endpoint: &Endpoint, hello: P::Hello, options: &Options) -> Self {
        Self {
            net: Arc::clone(net),
            endpoint: endpoint.clone(),
            hello,
            options: options.clone(),
            state: watch::Sender::new(LinkState::Down { why: None }),
            links: 0,
            short: 0,
        }
    }

    /// Reads when the link goes up and down.
    #[must_use]
    pub fn events(&self) -> LinkEvents {
        LinkEvents(self.state.subscribe())
    }

    /// Talks over a link, and over the next one whenever `talk` says that it was lost. Returns what `talk`
    /// does in the end. A `talk` that ends in order closes its link itself.
    ///
    /// It waits for a listener for as long as it takes. Between attempts is a pause of a tenth of the time so
    /// far, 2 s at most. Where links are lost within 10 s again and again, a pause of up to 5 s comes before
    /// the next one.
    ///
    /// Dropping the future drops the link: to the peer that looks like a crash.
    ///
    /// # Errors
    /// If this side's settings have to change: see [`ConnectError::may_pass`].
    pub async fn run<T, F>(&mut self, mut talk: impl FnMut(Link<P>) -> F) -> Result<T, ConnectError>
    where
        F: Future<Output = Result<T, LinkError>>,
    {
        loop {
            let link = self.connect().await?;
            let since = self.net.now();
            self.links += 1;
            self.state.send_replace(LinkState::Up { links: self.links });
            let said = talk(link).await;
            let why = match said {
                Ok(value) => {
                    self.state.send_replace(LinkState::Down { why: None });
                    return Ok(value);
                }
                Err(why) => why,
            };
            tracing::info!(endpoint = %self.endpoint, "the link is down: {}", causes(&why));
            self.state.send_replace(LinkState::Down { why: Some(Arc::new(why)) });
            self.pause(since).await;
        }
    }

    /// Waits if links are lost again and again.
    async fn pause(&mut self, since: Instant) {
        if self.net.now().since(since) >= GOOD {
            self.short = 0;
            return;
        }
        let mut pauses = growing_pauses(FIRST_PAUSE, LAST_PAUSE);
        let pause = self.short.checked_sub(1).and_then(|before| pauses.nth(before));
        self.short = self.short.saturating_add(1);
        if let Some(pause) = pause {
            sleep_until(&*self.net, self.net.now().after(pause)).await;
        }
    }

    async fn connect(&self) -> Result<Link<P>, ConnectError> {
        loop {
            let by = self.net.now().after(CONNECT_TIMEOUT);
            match connect(&self.net, &self.endpoint, self.hello.clone(), &self.options, by).await {
                Err(ConnectError::Deadline { .. }) => {}
                done => return done,
            }
        }
    }
}
