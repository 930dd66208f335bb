//! Three roles in one process.

use std::{error::Error, panic, sync::Arc, thread, time::Duration};

use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_proto::{Identity, Role, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, ListenError, Name, Net, Options, TokioNet};

use crate::{
    clock::Stopwatch,
    device::{CullerDevice, PictureDevice},
    driver::{Cameras, CullerTraffic, CullerWork, DisplayRole, Observer, RoleError},
    ids::max_frame,
    join::{JoinError, PeerEndpoint, await_cullers},
    links::Listener,
    machine::CullerIndex,
    session::{CullerError, CullerSession, JoinTimeouts, SessionEvent},
    stop::Stop,
    turn::Turns,
    work::{SceneCulling, ScenePictures},
};

/// How long the roles of a process may take to find each other.
const TIMEOUT: Duration = Duration::from_secs(120);

/// A culler failed.
#[derive(Debug, Error)]
#[error("the {} failed", .index.name())]
pub struct CullerFailure<D: Error + 'static> {
    /// Which.
    pub index: CullerIndex,
    /// Why.
    #[source]
    pub cause: CullerError<D>,
}

impl<D: Error + 'static> CullerFailure<D> {
    /// Whether it may only have heard of another role's failure: when one role fails, the others fail for it.
    const fn is_hearsay(&self) -> bool {
        matches!(self.cause, CullerError::Role(RoleError::Link { .. }))
    }
}

/// Plays two cullers on threads of their own, and `display` on this one.
///
/// # Errors
/// When a role fails: rather one that has not only heard of another's failure.
pub fn beside_cullers<W, F, E, T, X>(
    cullers: [CullerSession<F, E>; 2],
    runtime: &Handle,
    stop: &Stop,
    display: impl FnOnce() -> Result<T, X>,
) -> Result<T, X>
where
    W: CullerWork<Error: Send>,
    F: FnMut(&Settings) -> Result<W, RoleError<W::Error>> + Send,
    E: FnMut(SessionEvent<'_>) + Send,
    X: From<CullerFailure<W::Error>>,
{
    thread::scope(|scope| {
        let mut threads = Vec::new();
        for culler in cullers {
            let index = culler.index;
            let play =
                move || runtime.block_on(culler.run(stop)).map_err(|cause| CullerFailure { index, cause });
            let thread = thread::Builder::new().name(index.name().to_owned()).spawn_scoped(scope, play);
            threads.push(thread.map_err(|e| CullerFailure { index, cause: CullerError::Thread(e) })?);
        }
        let shown = display();
        let ended = threads.into_iter().map(|role| role.join().unwrap_or_else(|e| panic::resume_unwind(e)));
        let failures: Vec<_> = ended.filter_map(Result::err).collect();
        match failures.into_iter().min_by_key(CullerFailure::is_hearsay) {
            Some(culler) if shown.is_ok() || !culler.is_hearsay() => Err(culler.into()),
            _ => shown,
        }
    })
}

/// A session of three roles in this process.
#[derive(Debug, Clone)]
pub struct LocalSession {
    /// The scene.
    pub scene: Arc<Scene>,
    /// What the display decides.
    pub settings: Settings,
    /// Where the display listens, and where the cullers meet.
    pub endpoints: [Endpoint; 2],
    /// Whether the roles compute one after another.
    pub turns: Turns,
}

/// Why a session in one process failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LocalSessionError<P: Error + 'static, D: Error + 'static> {
    /// The display cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// The cullers did not come.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// A culler failed.
    #[error(transparent)]
    Culler(#[from] CullerFailure<P>),
    /// The display failed.
    #[error("the display failed")]
    Display(#[from] RoleError<D>),
}

impl LocalSession {
    /// A session within this process alone, whose roles compute at once.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, settings: Settings) -> Self {
        let endpoints = [(); 2].map(|()| Endpoint::Inproc(Name::unique()));
        Self { scene: Arc::clone(scene), settings, endpoints, turns: Turns::at_once() }
    }

    /// Runs it: the cullers, whose devices `device` opens, on two threads of their own, and the display on this
    /// one. Returns what the display's links carried. All three measure by one clock.
    ///
    /// # Errors
    /// The first role to fail; the others are told and end as well.
    pub fn run<P, D>(
        self,
        device: impl Fn(CullerIndex) -> Result<P, P::Error> + Sync,
        display: D,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        runtime: &Handle,
        stop: &Stop,
    ) -> Result<CullerTraffic, LocalSessionError<P::Error, D::Error>>
    where
        P: CullerDevice<Error: Send>,
        D: PictureDevice,
    {
        let Self { scene, settings, endpoints: [listen, meet], turns } = self;
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let mut options = Options::default();
        options.link.max_frame = max_frame(&scene);
        let identity = Identity { role: Role::Display, scene: scene.hash(), settings: Some(settings) };
        let listener = runtime.block_on(Listener::bind(&net, &listen, identity, &options))?;
        let peer =
            |endpoint: &Endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: options.clone() };
        let clock = Stopwatch::start();
        let (device, scene, turns) = (&device, &scene, &turns);
        let culler = |index| CullerSession {
            index,
            scene: scene.hash(),
            net: Arc::clone(&net),
            display: peer(listener.local_endpoint()),
            other: peer(&meet),
            timeouts: JoinTimeouts { join: TIMEOUT, rejoin: Duration::ZERO },
            clock,
            turns: turns.clone(),
            work: move |settings: &Settings| {
                let device = device(index).map_err(RoleError::unopened)?;
                Ok(SceneCulling::new(scene, device, settings, clock, turns)?)
            },
            watch: |_: SessionEvent<'_>| {},
        };
        let cullers = CullerIndex::ALL.map(culler);
        let show = || {
            let deadline = net.now().after(TIMEOUT);
            let [first, second] = runtime.block_on(await_cullers(listener, deadline))?;
            let work = ScenePictures::new(scene, display, &settings).map_err(RoleError::from)?;
            let (net, turns) = (Arc::clone(&net), turns.clone());
            let role = DisplayRole { work, first, second, settings, net, clock, turns };
            Ok(runtime.block_on(role.run(cameras, observer, stop))?)
        };
        beside_cullers(cullers, runtime, stop, show)
    }
}
