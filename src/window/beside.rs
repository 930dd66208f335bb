//! The roles beside a window: a display that draws nothing, and its culler in this process or in a service.

use std::sync::Arc;

use tokio::runtime::Handle;
use trimaran_actors::{
    CullerId, DisplayRole, LocalCullers, Pace, PeerEndpoint, Peers, PeersConfig, RoleError, SessionError,
    Stop, Supplied, Turns, WhileLoading, max_frame,
};
use trimaran_gpu::GpuScene;
use trimaran_proto::{Identity, Role, SceneOutline, SessionKey, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Net, Options, TokioNet, until};

use super::{
    display_role::{DrawsNothing, PassesOn, Wish},
    service::TIMEOUT,
};
use crate::culling::{Culling, CullingMethod};

/// The size limit of packed geometry kept from a service, bytes.
const MEMORY: u64 = 512 << 20;

/// State shared by all roles of a window.
#[derive(Clone)]
pub(super) struct Beside {
    pub(super) settings: Settings,
    pub(super) turns: Turns,
    pub(super) runtime: Handle,
}

impl Beside {
    fn net(&self) -> Arc<dyn Net> {
        Arc::new(TokioNet::new(self.runtime.clone()))
    }

    /// Plays a display with a culler of this process, on a device of its own, until `stop` asks.
    pub(super) fn play_local<F: Fn()>(
        &self,
        (scene, culled): (&Arc<Scene>, &Arc<GpuScene>),
        wish: Wish,
        observer: PassesOn<F>,
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let Self { settings, turns, runtime } = self;
        let cull =
            |settings: &Settings| Culling::open(CullingMethod::Trimaran, scene, culled, settings, turns);
        let local = LocalCullers::new(scene, 1, turns);
        let show = || -> Result<(), SessionError> {
            let sought = self.seek(Some(scene.outline()), local.peers().collect())?;
            let display = Display { sought, alone: Some(cull(settings)?), supplied: None };
            self.show(display, max_frame(scene), wish, observer, stop)
        };
        match local.beside(|_, settings| cull(settings), runtime, show) {
            Err(SessionError::Role(RoleError::Stopped)) => Ok(()),
            played => played,
        }
    }

    /// Plays a display of a service's scene, of which it has nothing at first, until `stop` asks. Reconnects
    /// to a lost service.
    pub(super) fn play_remote<F: Fn()>(
        &self,
        scene: Arc<Scene>,
        sought: Seeking,
        wish: Wish,
        observer: PassesOn<F>,
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let drawables = scene.outline().drawables;
        let supplied = Supplied { scene, memory: MEMORY, while_loading: WhileLoading::Coarser };
        let display = Display { sought, alone: None, supplied: Some(supplied) };
        match self.show(display, drawables, wish, observer, stop) {
            Err(SessionError::Role(RoleError::Stopped)) => Ok(()),
            played => played,
        }
    }

    /// Connects to the culler of a service, until it says which scene it has. `None` if it does not come in
    /// time.
    pub(super) fn find(
        &self,
        at: Endpoint,
        mut options: Options,
    ) -> Result<Option<(SceneOutline, Seeking)>, SessionError> {
        // The number of ids in a frame is checked once the culler has come: it is not known yet.
        options.link.max_frame = u32::MAX;
        let _within = self.runtime.enter();
        let mut seeking = self.seek(None, vec![PeerEndpoint { endpoint: at, options }])?;
        let net = self.net();
        let found = self.runtime.block_on(until(&*net, net.now().after(TIMEOUT), async {
            loop {
                let arrival = seeking.peers.next().await?;
                if let Some(outline) = arrival.link.peer.hello.scene {
                    seeking.peers.put_back(arrival);
                    return Ok::<_, SessionError>(outline);
                }
            }
        }));
        found.transpose().map(|outline| outline.map(|outline| (outline, seeking)))
    }

    fn seek(
        &self,
        scene: Option<SceneOutline>,
        endpoints: Vec<PeerEndpoint>,
    ) -> Result<Seeking, SessionError> {
        let net = self.net();
        let session = SessionKey(net.random().map_err(SessionError::Random)?);
        let identity = Identity { role: Role::Display, scene, session: Some((session, self.settings)) };
        let most = CullerId::MOST;
        let sought = PeersConfig { identity, role: Role::Culler, endpoints, listener: None, most };
        Ok(Seeking { session, peers: Peers::seek(&net, sought) })
    }

    fn show<F: Fn()>(
        &self,
        Display { sought, alone, supplied }: Display,
        drawables: u32,
        mut wish: Wish,
        mut observer: PassesOn<F>,
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let Seeking { session, peers } = sought;
        let role = DisplayRole {
            alone,
            supplied,
            pace: Pace::Live,
            turns: self.turns.clone(),
            ..DisplayRole::new(DrawsNothing, peers, session, self.settings, drawables, &self.net())
        };
        Ok(self.runtime.block_on(role.run(&mut wish, &mut observer, stop))?)
    }
}

/// A session whose cullers are being connected.
pub(super) struct Seeking {
    session: SessionKey,
    peers: Peers,
}

/// The properties of one display.
struct Display {
    sought: Seeking,
    /// How it culls itself when no culler does.
    alone: Option<Culling>,
    /// If it holds no scene: the supplied geometry.
    supplied: Option<Supplied>,
}
