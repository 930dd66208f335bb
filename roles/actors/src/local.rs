//! A display and its cullers in one process.

use std::{panic, sync::Arc, thread, time::Duration};

use tokio::runtime::Handle;
use trimaran_proto::{Identity, Role, SessionKey, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Name, Net, Options, TokioNet};

use crate::{
    deal::{CullerId, Pace, Schedule},
    device::{CullerDevice, PictureDevice},
    driver::{Cameras, CullerWork, DisplayRole, Observer, RoleError, Supplied},
    ids::max_frame,
    join::PeerEndpoint,
    limits::SessionLimits,
    peers::{Peers, PeersConfig},
    service::{CullerService, ServiceEndpoints, SessionError},
    stop::Stop,
    turn::Turns,
    work::{SceneCulling, ScenePictures},
};

/// The cullers of a process that is the display as well.
#[derive(Debug, Clone)]
pub struct LocalCullers {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The endpoint of each.
    pub endpoints: Vec<Endpoint>,
    /// The options of all links.
    pub options: Options,
    /// The roles' common clock, and whether they compute one after another.
    pub turns: Turns,
}

impl LocalCullers {
    /// This many, for links within this process.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, count: usize, turns: &Turns) -> Self {
        let mut options = Options::default();
        options.link.max_frame = max_frame(scene);
        let endpoints = CullerId::first(count).map(|_| Endpoint::Inproc(Name::unique())).collect();
        Self { scene: Arc::clone(scene), endpoints, options, turns: turns.clone() }
    }

    /// Their endpoints for a display.
    pub fn peers(&self) -> impl Iterator<Item = PeerEndpoint> + '_ {
        let peer =
            |endpoint: &Endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: self.options.clone() };
        self.endpoints.iter().map(peer)
    }

    /// Plays them on threads of their own, each with the `work` of its session, while `display` plays on this
    /// one. A culler's failure ends nothing else: the display notices it.
    ///
    /// # Errors
    /// Those of `display`, and when the system gives no thread.
    pub fn beside<W, T, X>(
        &self,
        work: impl Fn(CullerId, &Settings) -> Result<W, RoleError> + Sync,
        runtime: &Handle,
        display: impl FnOnce() -> Result<T, X>,
    ) -> Result<T, X>
    where
        W: CullerWork,
        X: From<SessionError>,
    {
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let (stopper, over) = Stop::new();
        thread::scope(|scope| {
            for (id, endpoint) in CullerId::first(self.endpoints.len()).zip(&self.endpoints) {
                let (net, over, work) = (&net, over.clone(), &work);
                let play = move || {
                    let served = runtime.block_on(self.serve(id, endpoint, net, work, &over));
                    if let Err(error) = served {
                        tracing::warn!(%id, error = &error as &dyn std::error::Error, "failed");
                    }
                };
                let thread = thread::Builder::new().name(id.to_string());
                thread.spawn_scoped(scope, play).map_err(SessionError::Thread)?;
            }
            let shown = panic::catch_unwind(panic::AssertUnwindSafe(display));
            stopper.stop();
            shown.unwrap_or_else(|panic| panic::resume_unwind(panic))
        })
    }

    async fn serve<W: CullerWork>(
        &self,
        id: CullerId,
        endpoint: &Endpoint,
        net: &Arc<dyn Net>,
        work: &(impl Fn(CullerId, &Settings) -> Result<W, RoleError> + Sync),
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let Self { scene, options, turns, .. } = self;
        let at = ServiceEndpoints {
            listen: Some(endpoint.clone().into()),
            displays: Vec::new(),
            cullers: self.endpoints.clone(),
            options: options.clone(),
        };
        let mut service = CullerService::start(net, scene.outline(), at).await?;
        while let Some(session) = stop.unless_requested(service.next()).await {
            let session = session?;
            match session
                .play(
                    |settings| work(id, settings),
                    turns,
                    max_frame(scene),
                    Some(scene),
                    &SessionLimits::none(),
                    stop,
                )
                .await
            {
                Err(error) if error.lost_a_peer() => {}
                played => played?,
            }
        }
        Ok(())
    }
}

/// A session of a display and cullers in this process.
#[derive(Debug, Clone)]
pub struct LocalSession {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The display's settings.
    pub settings: Settings,
    /// The frames.
    pub pace: Pace,
    /// How many cullers; without any the display culls for itself.
    pub cullers: usize,
    /// How frames are distributed.
    pub schedule: Schedule,
    /// Whether the roles compute one after another.
    pub turns: Turns,
    /// The supplied scene, if the display begins without its own.
    pub supplied: Option<Supplied>,
}

impl LocalSession {
    /// A session of two independent cullers, in lockstep through `frames` frames.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, settings: Settings, frames: u32) -> Self {
        Self {
            scene: Arc::clone(scene),
            settings,
            pace: Pace::Lockstep { frames: Some(frames) },
            cullers: 2,
            schedule: Schedule::Independent,
            turns: Turns::at_once(),
            supplied: None,
        }
    }

    /// Runs it: the cullers, whose devices `device` opens, on threads of their own, the display on this one.
    /// Without a culler's number `device` opens the one with which the display culls itself.
    ///
    /// # Errors
    /// When the display fails.
    pub fn run<P: CullerDevice>(
        self,
        device: impl Fn(Option<CullerId>) -> Result<P, P::Error> + Sync,
        display: impl PictureDevice,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        runtime: &Handle,
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let (scene, turns) = (Arc::clone(&self.scene), self.turns.clone());
        let cull = |culler: Option<CullerId>, settings: &Settings| {
            let device = device(culler).map_err(RoleError::device("opening it"))?;
            Ok(SceneCulling::new(&scene, device, settings, &turns))
        };
        self.run_with(cull, display, cameras, observer, runtime, stop)
    }

    /// The same with cullers whose work `cull` makes.
    ///
    /// # Errors
    /// When the display fails.
    pub fn run_with<W: CullerWork>(
        self,
        cull: impl Fn(Option<CullerId>, &Settings) -> Result<W, RoleError> + Sync,
        display: impl PictureDevice,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        runtime: &Handle,
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let Self { scene, settings, pace, cullers, schedule, turns, supplied } = self;
        let local = LocalCullers::new(&scene, cullers, &turns);
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let session = SessionKey(net.random().map_err(SessionError::Random)?);
        let alone = match supplied {
            Some(_) => None,
            None => Some(cull(None, &settings)?),
        };
        let shown = supplied.as_ref().map_or(&scene, |supplied| &supplied.scene);
        let work = ScenePictures::new(shown, display, &settings);
        let show = || {
            let sought = PeersConfig {
                identity: Identity {
                    role: Role::Display,
                    scene: supplied.is_none().then(|| scene.outline()),
                    session: Some((session, settings)),
                },
                role: Role::Culler,
                endpoints: local.peers().collect(),
                listener: None,
                most: CullerId::MOST,
            };
            let cullers = Peers::seek(&net, sought);
            let role = DisplayRole {
                alone,
                supplied,
                schedule,
                pace,
                join_timeout: Duration::from_secs(120),
                turns: turns.clone(),
                ..DisplayRole::new(work, cullers, session, settings, max_frame(&scene), &net)
            };
            Ok(runtime.block_on(role.run(cameras, observer, stop))?)
        };
        local.beside(|id, settings| cull(Some(id), settings), runtime, show)
    }
}
