//! A display that waits for its cullers, walks and reports, whether they are on other machines, in other
//! processes of this one or threads of this process.

use std::{future::pending, path::PathBuf, pin::Pin, sync::Arc};

use indicatif::ProgressBar;
use tokio::runtime::Runtime;
use trimaran::{
    report::{
        Writer,
        schema::{HowEnded, Machine},
    },
    vulkan::VulkanDisplay,
    walkthrough::{CameraPath, Plan, Recorder, ReportPlan, SceneFile, begin, how_ended},
};
use trimaran_actors::{
    Cameras, DisplayRole, JoinTimeouts, Link, Listener, RoleError, ScenePictures, SessionError, Stop, Turns,
    again, await_cullers, leave_unable,
};
use trimaran_gpu::{GpuInfo, GpuScene, ItemPass};
use trimaran_proto::{Identity, Role, Settings};
use trimaran_scene::path::PathKind;
use trimaran_transport::{Endpoints, Instant, Net, Options, PeerAddress, causes};

use super::{
    Failure, progress,
    recording::{Early, Outcome, report_on},
    walking::{self, Metrics, not_joined},
};

/// A display that is ready to walk.
pub(super) struct DisplaySession<'s> {
    pub(super) file: &'s SceneFile,
    /// The scene on its device.
    pub(super) drawn: &'s Arc<GpuScene>,
    pub(super) plan: Plan,
    pub(super) path: &'s CameraPath,
    pub(super) about: ReportPlan,
    /// Where the report goes, until there is something to report.
    pub(super) folder: Option<Writer>,
    pub(super) timeouts: JoinTimeouts,
    /// Where what the links carry is shown.
    pub(super) metrics: Metrics,
    /// Where to record what each frame asked of the roles.
    pub(super) trace: Option<PathBuf>,
    pub(super) net: Arc<dyn Net>,
    /// Until somebody has come to it.
    pub(super) listener: Option<Listener>,
    /// Where it listens.
    pub(super) endpoints: Endpoints,
    pub(super) options: Options,
    pub(super) turns: Turns,
}

/// What a report says of a walk beside its frames, before the cullers have come.
pub(super) fn about(
    path: &CameraPath,
    name: &str,
    seed: u64,
    devices: Vec<(Machine, GpuInfo)>,
) -> ReportPlan {
    ReportPlan {
        command_line: std::env::args().collect(),
        started: walking::date(),
        link: String::new(),
        transport: String::new(),
        path: name.to_owned(),
        seed: (name == "auto").then_some(seed),
        devices,
        notes: notes(path),
    }
}

/// Listens for the cullers that a display on this device waits for.
pub(super) async fn listen(
    file: &SceneFile,
    drawn: &GpuScene,
    plan: &Plan,
    path: &CameraPath,
    net: &Arc<dyn Net>,
    at: &Endpoints,
    options: &Options,
) -> Result<Listener, Failure> {
    if plan.audit_every > 0 {
        ItemPass::check(drawn).map_err(Failure::broken)?;
    }
    let identity = identity(file, plan.settings(path.frames()));
    Listener::bind_all(net, at, identity, options)
        .await
        .map_err(|error| if error.may_pass() { Failure::broken(error) } else { Failure::bad_input(error) })
}

fn identity(file: &SceneFile, settings: Settings) -> Identity {
    Identity { role: Role::Display, scene: file.scene.hash(), settings: Some(settings) }
}

impl DisplaySession<'_> {
    /// Waits for the cullers, walks and reports. When `no_cullers` ends, they cannot come any more. `beside`
    /// plays whatever else of the session is in this process while the walk goes on.
    pub(super) fn show(
        mut self,
        runtime: &Runtime,
        stop: &Stop,
        no_cullers: impl Future<Output = Failure>,
        beside: impl FnOnce(&mut dyn FnMut() -> Result<(), Early>) -> Result<(), Early>,
    ) -> Result<Outcome, Failure> {
        let bar = progress::walk(self.plan.pace, self.path);
        let mut advance = |_| bar.inc(1);
        let mut recorder = Recorder::new(self.plan.audit_every, &mut advance);
        let mut no_cullers = Box::pin(no_cullers);
        let mut walk = || runtime.block_on(self.walk(&mut recorder, &bar, stop, no_cullers.as_mut()));
        // What was walked before a failure is worth a report.
        let early = beside(&mut walk).err();
        bar.finish_and_clear();
        let Self { file, drawn, plan, path, about, folder, trace, .. } = self;
        report_on(recorder, folder, early, trace.as_deref(), file, drawn, &plan, about, path, stop)
    }

    /// The same with cullers that are elsewhere, and come by themselves.
    pub(super) fn show_to_others(self, runtime: &Runtime, stop: &Stop) -> Result<Outcome, Failure> {
        self.show(runtime, stop, pending(), |walk| walk())
    }

    /// Walks to the end of the session, or until `stop` asks. When a culler is lost, it waits for both to
    /// come again and goes on with the frame that was due.
    async fn walk(
        &mut self,
        recorder: &mut Recorder<'_>,
        bar: &ProgressBar,
        stop: &Stop,
        mut no_cullers: Pin<&mut impl Future<Output = Failure>>,
    ) -> Result<(), Early> {
        let mut cameras = self.path.cameras(self.plan.pace);
        let mut settings = self.plan.settings(self.path.frames());
        let (mut within, mut lost) = (self.timeouts.join, None);
        loop {
            let joining = self.join(settings, self.net.now().after(within), no_cullers.as_mut());
            let Some(links) = stop.unless_requested(joining).await else { return Ok(()) };
            let links = links.map_err(|early| match lost.take() {
                Some(cause) => SessionError::Lost { within, cause }.into(),
                None => early,
            })?;
            let error = match self.play(links, settings, &mut *cameras, recorder, stop).await {
                Err(error) if !self.timeouts.rejoin.is_zero() && error.lost_a_peer() => error,
                played => return Ok(played.map_err(SessionError::from)?),
            };
            settings.first = recorder.next_frame();
            if settings.frames.is_some_and(|frames| settings.first.0 >= frames) {
                return Ok(()); // it was lost behind the last frame
            }
            let (said, seconds) = (causes(&error), self.timeouts.rejoin.as_secs_f64());
            bar.suspend(|| eprintln!("trimaran: {said}; waiting {seconds} s for all to join again"));
            self.about.notes.push(format!("the session stopped before {}: {said}", settings.first));
            (within, lost) = (self.timeouts.rejoin, Some(error));
        }
    }

    async fn join(
        &mut self,
        settings: Settings,
        deadline: Instant,
        no_cullers: Pin<&mut impl Future<Output = Failure>>,
    ) -> Result<[Link; 2], Early> {
        let failed = |why| Early { how: HowEnded::Failed, why };
        let listener = match self.listener.take() {
            Some(listener) => listener,
            None => {
                let identity = identity(self.file, settings);
                let listen = || Listener::bind_all(&self.net, &self.endpoints, identity, &self.options);
                // The old sockets may need a moment to be gone.
                again(&self.net, deadline, |_| true, listen).await.map_err(SessionError::from)?
            }
        };
        tokio::select! {
            biased;
            cullers = await_cullers(listener, deadline) => cullers.map_err(|e| failed(not_joined(e))),
            failure = no_cullers => Err(failed(failure)),
        }
    }

    /// Plays the role, after it has begun to write what is shown and made its device ready.
    async fn play(
        &mut self,
        [first, second]: [Link; 2],
        settings: Settings,
        cameras: &mut dyn Cameras,
        recorder: &mut Recorder<'_>,
        stop: &Stop,
    ) -> Result<(), RoleError> {
        self.metrics.watch([&first, &second]);
        (self.about.link, self.about.transport) = transports(&first, &second);
        let mut prepare = || {
            if let Some(folder) = self.folder.take() {
                let journal = begin(folder, self.file, &self.plan, &self.about, self.path);
                recorder.write_into(journal.map_err(|error| RoleError::Observer(error.into()))?);
            }
            let device =
                VulkanDisplay::new(self.drawn, settings.viewport).map_err(RoleError::device("opening it"))?;
            Ok(ScenePictures::new(&self.file.scene, device, &settings))
        };
        let work = match prepare() {
            Ok(work) => work,
            Err(error) => return Err(leave_unable([first, second], error).await),
        };
        let (net, turns) = (Arc::clone(&self.net), self.turns.clone());
        let role = DisplayRole { work, first, second, settings, net, turns };
        role.run(cameras, recorder, stop).await.map(|_| ())
    }
}

impl From<SessionError> for Early {
    fn from(error: SessionError) -> Self {
        Self { how: how_ended(&error), why: Failure::broken(error) }
    }
}

/// What the links go over: the name of the transport, and in words.
fn transports(first: &Link, second: &Link) -> (String, String) {
    let [a, b] = [first.peer.address, second.peer.address];
    let (one, other) = (a.transport(), b.transport());
    if a == PeerAddress::InProcess {
        (one.to_owned(), "in one process: shared memory, nothing is encoded".to_owned())
    } else if one == other {
        (one.to_owned(), format!("{one}: {a} and {b}"))
    } else {
        (format!("{one} and {other}"), format!("{one}: {a}; {other}: {b}"))
    }
}

/// Remarks that belong beside every figure of the walk.
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
