//! A culler as a service: it serves one session after another, and several displays at once.

use std::{
    io,
    panic::{self, AssertUnwindSafe},
    sync::Arc,
};

use thiserror::Error;
use trimaran_proto::{Identity, Role, SceneOutline, SessionKey, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Endpoints, ListenError, Net, Options};

use crate::{
    driver::{CullerRole, CullerWork, RoleError, leave_unable},
    join::{JoinError, PeerEndpoint},
    limits::SessionLimits,
    links::{Link, Listener},
    meeting::{Expected, Meeting},
    peers::{Arrival, Peers, Seat, Sought},
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
    /// The system gave it no random number to know the session by.
    #[error("the system gives no random number for the session")]
    Random(#[source] io::Error),
    /// It cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// It can never reach a peer with what it was given.
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
    /// Where other cullers listen that a display may let it meet, and what holds for links to them.
    cullers: Arc<[Endpoint]>,
    others: Options,
    expected: Expected,
    endpoints: Option<Endpoints>,
}

/// Where a culler finds its displays.
#[derive(Debug, Clone)]
pub struct ServiceEndpoints {
    /// Where it listens, for displays and for cullers that it is to meet.
    pub listen: Option<Endpoints>,
    /// Displays that it connects to.
    pub displays: Vec<PeerEndpoint>,
    /// Where other cullers listen that a display may let it meet, for the schedule `switch`: it connects to
    /// no others.
    pub cullers: Vec<Endpoint>,
    /// What holds for links of those that come, and which keys are known.
    pub options: Options,
}

/// A display has come to a culler.
#[derive(Debug)]
pub struct NewSession {
    /// The session, by which a display that was started again is known.
    pub key: SessionKey,
    /// What the display has decided.
    pub settings: Settings,
    /// The link to it.
    pub display: Link,
    /// How the culler meets another one for it.
    pub meeting: Meeting,
    /// The display's place at this culler, free when this is dropped.
    pub seat: Seat,
}

impl CullerService {
    /// Listens and looks for displays, as a culler that holds `scene`.
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
        let expected = Expected::default();
        let most = displays.len() + options.limits.peers;
        let sought = Sought { identity, role: Role::Display, endpoints: displays, listener, most };
        let displays = Peers::seek_and_expect(net, sought, expected.clone());
        let (net, cullers) = (Arc::clone(net), cullers.into());
        Ok(Self { net, scene, displays, cullers, others: options, expected, endpoints })
    }

    /// Where it listens, with the ports that the system chose.
    #[must_use]
    pub const fn endpoints(&self) -> Option<&Endpoints> {
        self.endpoints.as_ref()
    }

    /// The next display that comes. Dropping the future loses none.
    ///
    /// # Errors
    /// When a display that it is to connect to can never be reached with what it was given.
    pub async fn next(&mut self) -> Result<NewSession, JoinError> {
        loop {
            let Arrival { link, seat, .. } = self.displays.next().await?;
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
            return Ok(NewSession { key, settings, display: link, meeting, seat });
        }
    }
}

impl NewSession {
    /// Plays the culler in it, with the `work` that what the display has decided asks for, until the display
    /// leaves or `stop` asks. `drawables` is how many the scene has. With the `scene` itself it can serve a
    /// display that holds none.
    ///
    /// # Errors
    /// When the session asks for more than `limits` allow, `work` cannot be had, the display dies, or the
    /// device fails. The display is told.
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
            // What a session begins with takes the device as long as some frames do.
            let turn = turns.of_a_role();
            turn.take().await;
            let work = panic::catch_unwind(AssertUnwindSafe(|| work(&self.settings)));
            Ok((lease, work.unwrap_or_else(|payload| Err(RoleError::panic(&*payload)))?))
        };
        match stop.unless_requested(opened).await.unwrap_or(Err(RoleError::Stopped)) {
            Ok((lease, work)) => {
                let Self { display, meeting, seat: _seat, .. } = self;
                let (turns, scene) = (turns.clone(), scene.map(Arc::clone));
                CullerRole { work, display, meeting, turns, drawables, scene, lease }.run(stop).await
            }
            Err(error) => self.turn_away(error, stop).await,
        }
    }

    /// Tells the display that this session is not played, and why. It gives that error.
    ///
    /// # Errors
    /// Always but where `stop` asked for it.
    pub async fn turn_away(self, error: RoleError, stop: &Stop) -> Result<(), RoleError> {
        let _unheard = stop.unless_insisted(leave_unable(self.display, &error)).await;
        if error.is_clean_end() { Ok(()) } else { Err(error) }
    }
}
