//! A relay: the publisher of one display's frames to many others, between them and a culler.
//!
//! Upstream it is a display, downstream a culler. The display that leads is served as by the culler: its
//! cameras and view states go up, and frames come down. All other displays watch. A relay may stand between
//! another relay and displays.

mod hub;
mod leader;
mod names;
mod upstream;
mod watcher;

use std::{fmt, sync::Arc, time::Duration};

use thiserror::Error;
use trimaran_proto::{CloseCode, Identity, Role, SceneOutline, Walkthrough};
use trimaran_transport::{AcceptError, Endpoints, ListenError, Net, Options, PeerAddress, connect, until};

use crate::{
    join::{JoinError, PeerEndpoint},
    links::{Link, Listener},
    service::ListenerHandles,
    stop::Stop,
};

use hub::Hub;
use upstream::Upstream;

/// How long one attempt takes to hear from upstream at the start.
const ATTEMPT: Duration = Duration::from_secs(5);
/// How long a listener waits before it waits again.
const WAIT: Duration = Duration::from_secs(3600);

/// Why a relay could not start, or cannot go on.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RelayError {
    /// It cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// It cannot reach what it relays, or its own settings rule that out.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// The peer upstream holds no scene.
    #[error("{0} holds no scene: give the endpoint of a culler or of another relay")]
    NoScene(PeerAddress),
}

impl RelayError {
    /// Whether another try may succeed.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Listen(error) => error.may_pass(),
            Self::Join(error) => error.may_pass(),
            Self::NoScene(_) => false,
        }
    }
}

/// Observes a relay's links: each is given with its peer's kind, and the result is dropped at its end.
pub type WatchLink = Arc<dyn Fn(&'static str, &Link) -> Box<dyn Send> + Send + Sync>;

/// Where a relay stands.
#[derive(Debug, Clone)]
pub struct RelayEndpoints {
    /// The culler or relay whose frames it passes on.
    pub upstream: PeerEndpoint,
    /// Where displays connect to it.
    pub listen: Endpoints,
    /// The options of their links; at most `limits.peers` displays come, the one that leads among them.
    pub options: Options,
}

/// A relay that listens.
pub struct Relay {
    net: Arc<dyn Net>,
    upstream: Upstream,
    listener: Listener,
    hub: Arc<Hub>,
}

impl fmt::Debug for Relay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Relay").field("listener", &self.listener).finish_non_exhaustive()
    }
}

impl Relay {
    /// Asks upstream for its scene, and listens as a relay of that scene. Each link is told to `watch`.
    ///
    /// # Errors
    /// When upstream does not answer within seconds, or this role cannot listen.
    pub async fn start(
        net: &Arc<dyn Net>,
        RelayEndpoints { mut upstream, listen, mut options }: RelayEndpoints,
        watch: WatchLink,
    ) -> Result<Self, RelayError> {
        let outline = scene_of(net, &upstream).await?;
        options.link.max_frame = outline.drawables;
        upstream.options.link.max_frame = outline.drawables;
        let identity = Identity { role: Role::Relay, scene: Some(outline), session: None };
        let listener = Listener::bind_all(net, &listen, identity, &options).await?;
        let config = options.link.with_batching(Walkthrough::relayed());
        let hub = Arc::new(Hub::new(net, outline, &config, watch));
        let upstream = Upstream::new(net, upstream, outline, &hub);
        Ok(Self { net: Arc::clone(net), upstream, listener, hub })
    }

    /// Its endpoints, with the ports that the system chose.
    #[must_use]
    pub fn endpoints(&self) -> &Endpoints {
        self.listener.local_endpoints()
    }

    /// Its listener.
    #[must_use]
    pub fn listener(&self) -> ListenerHandles {
        ListenerHandles::of(&self.listener)
    }

    /// Passes on frames until `stop` asks. When upstream is lost, displays stay, and their pictures go on
    /// once it is back.
    ///
    /// # Errors
    /// When its own settings rule out a link upstream.
    pub async fn run(self, stop: &Stop) -> Result<(), RelayError> {
        let Self { net, upstream, listener, hub } = self;
        let relay = async {
            tokio::select! {
                ended = upstream.run() => ended.map(|never| match never {}),
                () = accept(&net, listener, &hub) => Ok(()),
            }
        };
        let ended = stop.unless_requested(relay).await.unwrap_or(Ok(()));
        hub.end();
        ended
    }
}

/// The scene of the peer upstream. The link is made for this question alone.
async fn scene_of(net: &Arc<dyn Net>, at: &PeerEndpoint) -> Result<SceneOutline, RelayError> {
    let identity = Identity { role: Role::Display, scene: None, session: None };
    let by = net.now().after(ATTEMPT);
    let link = connect::<Walkthrough>(net, &at.endpoint, identity, &at.options, by).await;
    let link = link.map_err(|cause| JoinError::Connect { peer: Role::Culler, cause: Box::new(cause) })?;
    let (scene, address) = (link.peer.hello.scene, link.peer.address);
    // It may have closed the link before.
    let _unheard = until(&**net, by, link.close(CloseCode::Finished.reason())).await;
    scene.ok_or(RelayError::NoScene(address))
}

/// Takes displays as they come.
async fn accept(net: &Arc<dyn Net>, mut listener: Listener, hub: &Arc<Hub>) {
    loop {
        match listener.accept(net.now().after(WAIT)).await {
            Ok(link) => hub.welcome(link),
            Err(AcceptError::Deadline { .. }) => {}
            Err(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "takes no more displays");
                return;
            }
        }
    }
}
