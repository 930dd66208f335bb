//! A display that finds its cullers, walks and reports, whether they are on other machines, in other
//! processes of this one or threads of this process.

use std::{future::pending, path::PathBuf, pin::Pin, sync::Arc, time::Duration};

use bytesize::ByteSize;
use indicatif::ProgressBar;
use tokio::runtime::Runtime;
use trimaran::{
    config::WhileLoading,
    culling::Culling,
    metrics::Metrics,
    report::{
        Run, Writer,
        schema::{Machine, RoleInfo, SentAhead, timestamp},
    },
    vulkan::VulkanDisplay,
    walkthrough::{CameraPath, Progress, Recorder, SceneFile, Walk, begin, how_ended, memory_use},
};
use trimaran_actors::{
    AheadUse, Arrival, BoxedError, CullerEvent, CullerId, DisplayRole, Listener, Observer, PeerEndpoint,
    Peers, PeersConfig, RoleError, ScenePictures, SessionError, ShownFrame, Stop, Supplied, Turns, max_frame,
};
use trimaran_gpu::{Gpu, GpuInfo, GpuScene};
use trimaran_proto::{FrameNumber, FrameStats, Identity, Role, SceneOutline, SessionKey, Settings};
use trimaran_scene::{Scene, path::PathKind};
use trimaran_transport::{Endpoint, Instant, Net, causes, until};

use super::{
    Failure,
    log::SAID,
    plural,
    recording::{Early, Recording},
    service_manager::ServiceManager,
    walking::{self, MetricsServer, opened},
};

/// A display that is ready to walk.
pub(super) struct DisplaySession<'s> {
    pub(super) walk: Walk<'s>,
    /// If it begins without the scene: the device that draws what its cullers send.
    pub(super) empty: Option<EmptyScene>,
    pub(super) about: Run,
    /// Where the report goes, until there is something to report.
    pub(super) folder: Option<Writer>,
    /// How long it waits for its cullers before it begins without those that are missing.
    pub(super) join_timeout: Duration,
    /// Where its figures are shown.
    pub(super) metrics: MetricsServer,
    /// Where to record the work of each frame.
    pub(super) trace: Option<PathBuf>,
    pub(super) net: Arc<dyn Net>,
    /// Identifies the session to cullers.
    pub(super) key: SessionKey,
    /// The progress of the walk, if it resumes one whose process was killed.
    pub(super) progress: Option<Progress>,
    pub(super) cullers: Cullers,
    pub(super) turns: Turns,
    /// Shows the walk's progress and lost cullers; without it only the recording tells.
    pub(super) bar: Option<ProgressBar>,
}

/// The cullers of a display.
pub(super) struct Cullers {
    /// Where it connects to some.
    pub(super) endpoints: Vec<PeerEndpoint>,
    /// Where others connect to it.
    pub(super) listener: Option<Listener>,
    /// All of them as they come, if the search has begun.
    pub(super) sought: Option<Peers>,
    /// How many to wait for, if not for those that it connects to.
    pub(super) awaited: Option<u8>,
}

/// A scene of which a display has only what cullers send.
pub(super) struct EmptyScene {
    supplied: Supplied,
    drawn: Arc<GpuScene>,
}

impl EmptyScene {
    /// Keeps this many bytes of the received geometry.
    pub(super) fn new(
        outline: SceneOutline,
        gpu: &Arc<Gpu>,
        memory: ByteSize,
        while_loading: WhileLoading,
    ) -> Result<Self, Failure> {
        tracing::info!("begins with nothing of the scene: cullers send what becomes visible");
        let scene = Arc::new(Scene::empty(outline));
        let drawn = GpuScene::new(gpu, &scene).map_err(Failure::broken)?;
        let (memory, while_loading) = (memory.as_u64(), while_loading.into());
        Ok(Self { supplied: Supplied { scene, memory, while_loading }, drawn })
    }

    /// Its entry in a report, which has no file to name.
    pub(super) fn file(&self, from: &str) -> SceneFile {
        SceneFile { path: from.into(), scene: Arc::clone(&self.supplied.scene) }
    }

    pub(super) const fn drawn(&self) -> &Arc<GpuScene> {
        &self.drawn
    }
}

/// The parts of a report beside its frames, before the cullers have come.
pub(super) fn about(walk: Walk<'_>, path: &str, seed: u64, roles: Vec<RoleInfo>) -> Run {
    Run {
        command_line: std::env::args().collect(),
        started: timestamp(walking::date()),
        path: path.to_owned(),
        seed: (path == "auto").then_some(seed),
        roles,
        notes: notes(walk.path),
        schedule: walk.plan.schedule.name().to_owned(),
        ..walk.run()
    }
}

/// The device of a role, for a report.
pub(super) fn role_info(machine: Machine, drawn: &GpuScene) -> RoleInfo {
    let GpuInfo { name, driver, .. } = drawn.gpu().info().clone();
    RoleInfo { machine, device: name, driver }
}

/// The display's identity in the handshake.
pub(super) fn identity(scene: Option<&Scene>, session: SessionKey, settings: Settings) -> Identity {
    Identity { role: Role::Display, scene: scene.map(Scene::outline), session: Some((session, settings)) }
}

impl<'s> DisplaySession<'s> {
    /// Finds the cullers and walks. Once `no_cullers` ends, none can come any more. `beside` plays the rest
    /// of the session in this process during the walk.
    pub(super) fn show(
        mut self,
        runtime: &Runtime,
        stop: &Stop,
        no_cullers: impl Future<Output = Failure>,
        beside: impl FnOnce(&mut dyn FnMut() -> Result<(), Early>) -> Result<(), Early>,
    ) -> Result<Recording<'s>, Failure> {
        let Cullers { endpoints, listener, awaited, .. } = &self.cullers;
        (self.about.link, self.about.transport) = transports(endpoints, listener.as_ref());
        // Those that connect by themselves are awaited.
        let places = endpoints.len().max(awaited.map_or(0, usize::from));
        self.about.cullers = u32::try_from(places).unwrap_or(u32::MAX);
        let bar = self.bar.clone();
        let mut advance = |frame: FrameNumber| {
            if let Some(bar) = &bar {
                bar.set_position(u64::from(frame.0) + 1);
            }
        };
        let recorder = Recorder::new(self.walk.plan.audit_every, &mut advance);
        let metrics = self.metrics.metrics.clone();
        metrics.opened(opened(self.walk.file, self.walk.drawn));
        metrics.has_places(places);
        metrics.ready();
        let manager = ServiceManager::of_this_process();
        let net = Arc::clone(&self.net);
        let status = Status { manager, net: Arc::clone(&net), told: (net.now(), 0), cullers: 0 };
        let mut watched = Watched { recorder, metrics, bar: bar.as_ref(), ahead: None, status };
        let mut no_cullers = Box::pin(no_cullers);
        let mut walk = || {
            let walk = self.walk(&mut watched, stop, no_cullers.as_mut());
            runtime.block_on(manager.watching(&*net, walk))
        };
        // The frames before a failure are worth a report.
        let early = beside(&mut walk).err();
        bar.iter().for_each(ProgressBar::finish_and_clear);
        let Self { walk, empty, mut about, folder: unused, trace, .. } = self;
        about.ahead = watched.ahead;
        about.memory = empty.map(|empty| memory_use(&empty.supplied.scene, &empty.drawn));
        let shown = watched.recorder.has_shown();
        let (records, notes, journal) = watched.recorder.into_parts();
        let stop = stop.clone();
        Ok(Recording { walk, about, records, notes, journal, unused, shown, early, trace, stop })
    }

    /// The same with cullers elsewhere that connect by themselves.
    pub(super) fn show_to_others(self, runtime: &Runtime, stop: &Stop) -> Result<Recording<'s>, Failure> {
        self.show(runtime, stop, pending(), |walk| walk())
    }

    /// Walks to the end of the session, or until `stop` asks.
    async fn walk(
        &mut self,
        watched: &mut Watched<'_, '_>,
        stop: &Stop,
        no_cullers: Pin<&mut impl Future<Output = Failure>>,
    ) -> Result<(), Early> {
        let Walk { file, drawn, plan, path } = self.walk;
        let settings = plan.settings();
        let (first, walked) =
            self.progress.as_ref().map(|so_far| (so_far.first(), so_far.walked())).unwrap_or_default();
        if plan.frames_due(path.frames()) == Some(first.0) {
            // Only the report is missing.
            self.cullers.endpoints.clear();
        }
        let cullers = tokio::select! {
            biased;
            cullers = stop.unless_requested(self.find_cullers(settings)) => match cullers {
                Some(cullers) => cullers.map_err(Early::failed)?,
                None => return Ok(()),
            },
            failure = no_cullers => return Err(Early::failed(failure)),
        };
        let mut prepare = || {
            let open = RoleError::device;
            let drawn_here = self.empty.as_ref().map_or(drawn, |empty| &empty.drawn);
            let display = VulkanDisplay::new(drawn_here, settings.viewport).map_err(open("opening it"))?;
            let alone = match self.empty {
                Some(_) => None,
                None => Some(Culling::open(plan.culling, &file.scene, drawn, &settings, &self.turns)?),
            };
            if let Some(folder) = self.folder.take() {
                let journal = begin(folder, self.walk, self.about.clone(), self.progress.as_ref());
                watched.recorder.write_into(journal.map_err(|error| RoleError::Observer(error.into()))?);
            }
            if let Some(so_far) = self.progress.take() {
                watched.recorder.go_on(so_far);
            }
            Ok((display, alone))
        };
        let (display, alone) = prepare().map_err(SessionError::Role)?;
        let supplied = self.empty.as_ref().map(|empty| empty.supplied.clone());
        let scene = supplied.as_ref().map_or(&file.scene, |supplied| &supplied.scene);
        let work = ScenePictures::new(scene, display, &settings);
        let role = DisplayRole {
            alone,
            supplied,
            schedule: plan.schedule,
            pace: plan.frames(path.frames()),
            first,
            turns: self.turns.clone(),
            ..DisplayRole::new(work, cullers, self.key, settings, max_frame(&file.scene), &self.net)
        };
        let mut cameras = path.cameras(plan.pace, walked);
        Ok(role.run(&mut *cameras, watched, stop).await.map_err(SessionError::from)?)
    }

    /// Waits, up to its timeout, for the cullers that it connects to; it goes on looking for the others.
    async fn find_cullers(&mut self, settings: Settings) -> Result<Peers, Failure> {
        let Cullers { endpoints: peers, listener, sought, awaited } = &mut self.cullers;
        let endpoints: Vec<_> = peers.iter().map(|peer| peer.endpoint.clone()).collect();
        let scene = self.empty.is_none().then_some(&*self.walk.file.scene);
        let mut seek = || {
            let identity = identity(scene, self.key, settings);
            seek(&self.net, identity, std::mem::take(peers), listener.take())
        };
        let mut cullers = sought.take().unwrap_or_else(&mut seek);
        let deadline = self.net.now().after(self.join_timeout);
        let awaited = awaited.map_or(cullers.expected(), usize::from);
        let mut came = Vec::new();
        while came.len() < awaited {
            match until(&*self.net, deadline, cullers.next()).await {
                Some(arrival) => came.push(arrival.map_err(Failure::bad_input)?),
                None => {
                    let there = |place| came.iter().any(|arrival: &Arrival| arrival.place == place);
                    let missing = endpoints.iter().enumerate().filter(|(place, _)| !there(*place));
                    let named = |(place, endpoint): (usize, &Endpoint)| match cullers.obstacle(place) {
                        Some(why) => format!("{endpoint} ({why})"),
                        None => format!("{endpoint} (no answer yet)"),
                    };
                    let missing = missing.map(named).collect::<Vec<_>>().join(", ");
                    let count = awaited - came.len();
                    let due = plural(awaited as u64, "culler", "cullers");
                    tracing::warn!(target: SAID, "begins without {count} of {due}: {missing}");
                    break;
                }
            }
        }
        came.into_iter().for_each(|arrival| cullers.put_back(arrival));
        Ok(cullers)
    }
}

/// Looks for a display's cullers.
pub(super) fn seek(
    net: &Arc<dyn Net>,
    identity: Identity,
    endpoints: Vec<PeerEndpoint>,
    listener: Option<Listener>,
) -> Peers {
    Peers::seek(net, PeersConfig { identity, role: Role::Culler, endpoints, listener, most: CullerId::MOST })
}

/// Watches a walk: records it, counts its links' traffic, and tells what becomes of cullers.
struct Watched<'w, 'p> {
    recorder: Recorder<'p>,
    metrics: Metrics,
    bar: Option<&'w ProgressBar>,
    ahead: Option<SentAhead>,
    status: Status,
}

/// The state of a walk, for the service manager.
struct Status {
    manager: ServiceManager,
    net: Arc<dyn Net>,
    /// When it was told last, and the next frame then.
    told: (Instant, u32),
    cullers: usize,
}

/// The shortest time between two of its messages.
const STATUS_PERIOD: Duration = Duration::from_secs(1);

impl Status {
    /// Tells it, unless it was told just now. `next` is the next frame.
    fn tell(&mut self, next: FrameNumber) {
        let (now, (told, before)) = (self.net.now(), self.told);
        let since = now.since(told);
        if since >= STATUS_PERIOD {
            let rate = f64::from(next.0.saturating_sub(before)) / since.as_secs_f64();
            let Self { manager, cullers, .. } = self;
            manager.status(&format!("frame {}, {rate:.1} frames a second, cullers: {cullers}", next.0));
            self.told = (now, next.0);
        }
    }
}

impl Observer for Watched<'_, '_> {
    fn wants_picture(&self, frame: FrameNumber) -> bool {
        self.recorder.wants_picture(frame)
    }

    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.recorder.shown(frame)?;
        self.metrics.frames().shown(frame);
        self.status.tell(self.recorder.next_frame());
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.recorder.culled(stats);
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        let before = self.recorder.next_frame();
        let said = match event {
            CullerEvent::Came(id, link) => {
                self.metrics.links().add(id.to_string(), link);
                self.status.cullers += 1;
                // At the start no culler is missing.
                (before.0 > 0).then(|| format!("{id} came before {before}"))
            }
            CullerEvent::Late(id) => {
                self.metrics.frames().late();
                Some(format!("{id} was late with {before}"))
            }
            CullerEvent::Left(id, why) => {
                self.metrics.links().remove(&id.to_string());
                self.metrics.sessions().failed(why);
                self.status.cullers = self.status.cullers.saturating_sub(1);
                Some(format!("{id} was lost before {before}: {}", causes(why)))
            }
            _ => None,
        };
        if let Some(said) = said {
            if let Some(bar) = self.bar {
                bar.suspend(|| tracing::warn!(target: SAID, "{said}"));
            }
            self.recorder.note(said);
        }
    }

    fn ahead(&mut self, sent: &AheadUse) {
        self.ahead = Some((*sent).into());
    }
}

impl From<SessionError> for Early {
    fn from(error: SessionError) -> Self {
        Self { how: how_ended(&error), why: Failure::broken(error) }
    }
}

/// The links' transports: the name, and a description.
fn transports(cullers: &[PeerEndpoint], listener: Option<&Listener>) -> (String, String) {
    let listens = listener.into_iter().flat_map(|listener| listener.local_endpoints().iter());
    let all: Vec<_> = cullers.iter().map(|peer| &peer.endpoint).chain(listens).collect();
    let mut names: Vec<_> = all.iter().map(|endpoint| endpoint.transport()).collect();
    names.sort_unstable();
    names.dedup();
    let words = match names[..] {
        [] => "none: the display culls for itself".to_owned(),
        ["inproc"] => "in one process: shared memory, nothing is encoded".to_owned(),
        _ => all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    };
    (if names.is_empty() { "none".to_owned() } else { names.join(" and ") }, words)
}

/// Remarks that apply to all figures of the walk.
fn notes(path: &CameraPath) -> Vec<String> {
    let note = match path.kind {
        None | Some(PathKind::Floors) => return Vec::new(),
        Some(PathKind::Hovering) => {
            "no floor was found to walk on: the automatic path hovers between the objects"
        }
        Some(PathKind::Orbit) => {
            "no room was found to move in: the automatic path circles the scene from outside"
        }
    };
    vec![note.to_owned()]
}
