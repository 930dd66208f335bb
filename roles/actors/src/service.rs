//! A culler as a service: it serves one session after another, and several displays at once.

use std::{
    io,
    panic::{self, AssertUnwindSafe},
    sync::Arc,
};

use thiserror::Error;
use trimaran_proto::{Identity, Role, SceneOutline, SessionKey, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Endpoints, ListenError, ListenerLimits, ListenerStats, Net, Options};

use crate::{
    driver::{CullerRole, CullerWork, RoleError, leave_unable},
    join::{JoinError, PeerEndpoint},
    limits::SessionLimits,
    links::{Link, Listener},
    meeting::{Expected, Meeting},
    peers::{Arrival, Peers, PeersConfig, SlotGuard},
    sharing::Sharing,
    stop::Stop,
    turn::Turns,
};

/// Why a role could not take part in a session to its end.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The system gave it no thread.
    #[error("cannot start a thread for a role")]
    Thread(#[source] io::Error),
    /// The system gave no random number for the session's key.
    #[error("the system gives no random number for the session")]
    Random(#[source] io::Error),
    /// It cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// Its settings rule out a link to a peer.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// It ended early.
    #[error(transparent)]
    Role(#[from] RoleError),
}

/// A culler that waits for displays.
#[derive(Debug)]
pub struct CullerService {
    net: Arc<dyn Net>,
    scene: SceneOutline,
    displays: Peers,
    /// Where other cullers listen to which a display may introduce it, and the options of links to them.
    cullers: Arc<[Endpoint]>,
    others: Options,
    expected: Expected,
    endpoints: Option<Endpoints>,
    listener: Option<ListenerHandles>,
    sharing: Sharing,
}

/// A listener that a service's own task has.
#[derive(Debug, Clone)]
pub struct ListenerHandles {
    /// The counts of peers that it has turned away.
    pub stats: ListenerStats,
    /// Its limits.
    pub limits: ListenerLimits,
}

impl ListenerHandles {
    /// Of this listener.
    #[must_use]
    pub fn of(listener: &Listener) -> Self {
        Self { stats: listener.stats(), limits: listener.limits() }
    }
}

/// Where a culler finds its displays.
#[derive(Debug, Clone)]
pub struct ServiceEndpoints {
    /// Where it listens, for displays and for other cullers.
    pub listen: Option<Endpoints>,
    /// Displays that it connects to.
    pub displays: Vec<PeerEndpoint>,
    /// Endpoints of other cullers to which a display may introduce it, for the schedule `switch`: it connects
    /// to no others.
    pub cullers: Vec<Endpoint>,
    /// The options of accepted links, with the known keys.
    pub options: Options,
}

/// A display has come to a culler.
#[derive(Debug)]
pub struct NewSession {
    /// The session, which identifies a restarted display.
    pub key: SessionKey,
    /// The display's settings.
    pub settings: Settings,
    /// The link to it.
    pub display: Link,
    /// How the culler connects to another one for it.
    pub meeting: Meeting,
    /// The display's slot at this culler, free on drop.
    pub slot: SlotGuard,
    /// Objects that the service's sessions share.
    pub sharing: Sharing,
}

impl CullerService {
    /// Listens for displays and connects to others, as a culler that holds `scene`.
    ///
    /// # Errors
    /// When it cannot listen.
    pub async fn start(
        net: &Arc<dyn Net>,
        scene: SceneOutline,
        ServiceEndpoints { listen, displays, cullers, options }: ServiceEndpoints,
    ) -> Result<Self, ListenError> {
        let identity = Identity { role: Role::Culler, scene: Some(scene), session: None };
        let listener = match &listen {
            Some(at) => Some(Listener::bind_all(net, at, identity, &options).await?),
            None => None,
        };
        let endpoints = listener.as_ref().map(|listener| listener.local_endpoints().clone());
        let handles = listener.as_ref().map(ListenerHandles::of);
        let expected = Expected::default();
        // The listener holds them to its limit, which may change.
        let most = usize::MAX;
        let sought = PeersConfig { identity, role: Role::Display, endpoints: displays, listener, most };
        let displays = Peers::seek_and_expect(net, sought, expected.clone());
        let (net, cullers) = (Arc::clone(net), cullers.into());
        let sharing = Sharing::default();
        let listener = handles;
        Ok(Self { net, scene, displays, cullers, others: options, expected, endpoints, listener, sharing })
    }

    /// Its endpoints, with the ports that the system chose.
    #[must_use]
    pub const fn endpoints(&self) -> Option<&Endpoints> {
        self.endpoints.as_ref()
    }

    /// Its listener, if it listens.
    #[must_use]
    pub const fn listener(&self) -> Option<&ListenerHandles> {
        self.listener.as_ref()
    }

    /// Objects that its sessions share.
    #[must_use]
    pub const fn sharing(&self) -> &Sharing {
        &self.sharing
    }

    /// The next display that comes. Dropping the future loses none.
    ///
    /// # Errors
    /// When its settings rule out a link to a display.
    pub async fn next(&mut self) -> Result<NewSession, JoinError> {
        loop {
            let Arrival { link, slot, .. } = self.displays.next().await?;
            // A display always has a session.
            let Some((key, settings)) = link.peer.hello.session else { continue };
            let meeting = Meeting {
                net: Arc::clone(&self.net),
                scene: self.scene,
                settings,
                options: self.others.clone(),
                cullers: Arc::clone(&self.cullers),
                expected: self.expected.clone(),
            };
            let sharing = self.sharing.clone();
            return Ok(NewSession { key, settings, display: link, meeting, slot, sharing });
        }
    }
}

impl NewSession {
    /// Plays the culler in it, with the `work` for the display's settings, until the display leaves or `stop`
    /// asks. `drawables` is how many the scene has. With the `scene` itself it can serve a display that holds
    /// none.
    ///
    /// # Errors
    /// When the session exceeds `limits`, making `work` fails, the display dies, or the device fails. The
    /// display is told.
    pub async fn play<W: CullerWork>(
        self,
        work: impl FnOnce(&Settings) -> Result<W, RoleError>,
        turns: &Turns,
        drawables: u32,
        scene: Option<&Arc<Scene>>,
        limits: &SessionLimits,
        stop: &Stop,
    ) -> Result<(), RoleError> {
        let opened = async {
            let lease = limits.lease(self.settings.viewport)?;
            // Starting a session takes the device as long as some frames do.
            let turn = turns.of_a_role();
            turn.take().await;
            let work = panic::catch_unwind(AssertUnwindSafe(|| work(&self.settings)));
            Ok((lease, work.unwrap_or_else(|payload| Err(RoleError::panic(&*payload)))?))
        };
        match stop.unless_requested(opened).await.unwrap_or(Err(RoleError::Stopped)) {
            Ok((lease, work)) => {
                let Self { display, meeting, slot: _slot, sharing, .. } = self;
                let (turns, scene) = (turns.clone(), scene.map(Arc::clone));
                let role = CullerRole { work, display, meeting, turns, drawables, scene, lease, sharing };
                role.run(stop).await
            }
            Err(error) => self.turn_away(error, stop).await,
        }
    }

    /// Tells the display why this session is not played. Returns that error.
    ///
    /// # Errors
    /// Always, unless `stop` asked for it.
    pub async fn turn_away(self, error: RoleError, stop: &Stop) -> Result<(), RoleError> {
        let _unheard = stop.unless_insisted(leave_unable(self.display, &error)).await;
        if error.is_clean_end() { Ok(()) } else { Err(error) }
    }
}
