//! Three roles in one process.

use std::{panic, sync::Arc, thread};

use tokio::runtime::Handle;
use trimaran_proto::{Identity, Role, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{Endpoint, Name, Net, Options, TokioNet};

use crate::{
    device::{CullerDevice, PictureDevice},
    driver::{Cameras, CullerTraffic, DisplayRole, Observer, RoleError},
    ids::max_frame,
    join::{PeerEndpoint, await_cullers},
    links::Listener,
    machine::CullerIndex,
    session::{CullerSession, JoinTimeouts, SessionError, SessionEvent},
    stop::Stop,
    turn::Turns,
    work::{SceneCulling, ScenePictures},
};

/// The cullers of a process that is the display as well.
#[derive(Debug, Clone)]
pub struct LocalCullers {
    /// The scene.
    pub scene: Arc<Scene>,
    /// Where the display listens.
    pub display: Endpoint,
    /// Where the cullers meet.
    pub meet: Endpoint,
    /// What holds for all links.
    pub options: Options,
    /// How long they wait for the others.
    pub timeouts: JoinTimeouts,
    /// What all roles of the process measure by, and whether they compute one after another.
    pub turns: Turns,
}

impl LocalCullers {
    /// Plays them on threads of their own, with what `device` opens, while `display` plays on this one.
    ///
    /// # Errors
    /// When a role fails: rather one that has not only heard of another's failure.
    pub fn beside<P, T, X>(
        self,
        device: impl Fn(CullerIndex, &Settings) -> Result<P, P::Error> + Sync,
        runtime: &Handle,
        stop: &Stop,
        display: impl FnOnce() -> Result<T, X>,
    ) -> Result<T, X>
    where
        P: CullerDevice,
        X: From<SessionError>,
    {
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let Self { scene, options, timeouts, turns, .. } = &self;
        let peer =
            |endpoint: &Endpoint| PeerEndpoint { endpoint: endpoint.clone(), options: options.clone() };
        let play = |index| {
            let session = CullerSession {
                index,
                scene: scene.hash(),
                net: Arc::clone(&net),
                display: peer(&self.display),
                other: peer(&self.meet),
                timeouts: *timeouts,
                turns: turns.clone(),
                work: |settings: &Settings| {
                    let device = device(index, settings).map_err(RoleError::device("opening it"))?;
                    Ok(SceneCulling::new(scene, device, settings, turns))
                },
                watch: |_: SessionEvent<'_>| {},
            };
            runtime.block_on(session.run(stop))
        };
        let failed = |index, cause| SessionError::Culler { index, cause: Box::new(cause) };
        thread::scope(|scope| {
            let play = &play;
            let mut threads = Vec::new();
            for index in CullerIndex::ALL {
                let thread = thread::Builder::new().name(index.name().to_owned());
                let thread = thread.spawn_scoped(scope, move || play(index));
                threads.push((index, thread.map_err(SessionError::Thread)?));
            }
            let shown = display();
            let mut hearsay = None;
            for (index, thread) in threads {
                match thread.join().unwrap_or_else(|panic| panic::resume_unwind(panic)) {
                    Ok(()) => {}
                    // When one role fails, the others fail for it.
                    Err(error @ SessionError::Role(RoleError::Link { .. })) => hearsay = Some((index, error)),
                    Err(error) => return Err(failed(index, error).into()),
                }
            }
            match hearsay {
                Some((index, error)) if shown.is_ok() => Err(failed(index, error).into()),
                _ => shown,
            }
        })
    }
}

/// A session of three roles in this process.
#[derive(Debug, Clone)]
pub struct LocalSession {
    /// The scene.
    pub scene: Arc<Scene>,
    /// What the display decides.
    pub settings: Settings,
    /// Whether the roles compute one after another.
    pub turns: Turns,
}

impl LocalSession {
    /// A session within this process alone, whose roles compute at once.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, settings: Settings) -> Self {
        Self { scene: Arc::clone(scene), settings, turns: Turns::at_once() }
    }

    /// Runs it: the cullers, whose devices `device` opens, on threads of their own, the display on this one.
    /// Returns what the display's links carried.
    ///
    /// # Errors
    /// The first role to fail; the others are told and end as well.
    pub fn run<P: CullerDevice>(
        self,
        device: impl Fn(CullerIndex) -> Result<P, P::Error> + Sync,
        display: impl PictureDevice,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        runtime: &Handle,
        stop: &Stop,
    ) -> Result<CullerTraffic, SessionError> {
        let Self { scene, settings, turns } = self;
        // Where the display listens, and where the cullers meet.
        let [listen, meet] = [(); 2].map(|()| Endpoint::Inproc(Name::unique()));
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let mut options = Options::default();
        options.link.max_frame = max_frame(&scene);
        let identity = Identity { role: Role::Display, scene: scene.hash(), settings: Some(settings) };
        let listener = runtime.block_on(Listener::bind(&net, &listen, identity, &options))?;
        let timeouts = JoinTimeouts::ONCE;
        let deadline = net.now().after(timeouts.join);
        let cullers = LocalCullers {
            scene: Arc::clone(&scene),
            display: listener.local_endpoint().clone(),
            meet,
            options,
            timeouts,
            turns: turns.clone(),
        };
        let work = ScenePictures::new(&scene, display, &settings);
        let show = || {
            let [first, second] = runtime.block_on(await_cullers(listener, deadline))?;
            let role = DisplayRole { work, first, second, settings, net, turns };
            Ok(runtime.block_on(role.run(cameras, observer, stop))?)
        };
        cullers.beside(|index, _| device(index), runtime, stop, show)
    }
}
