//! A display that waits for its cullers, walks and reports, whether they are on other machines, in other
//! processes of this one or threads of this process.

use std::{future::pending, path::PathBuf, pin::Pin, sync::Arc};

use indicatif::ProgressBar;
use tokio::runtime::Runtime;
use trimaran::{
    report::{
        Writer,
        schema::{HowEnded, Seat as ReportSeat},
    },
    vulkan::{VulkanCullerError, VulkanDisplay},
    walkthrough::{CameraPath, Plan, Recorder, ReportPlan, SceneFile, begin, how_ended},
};
use trimaran_actors::{
    Cameras, CullerError, CullerFailure, DisplayRole, JoinTimeouts, Link, Listener, LostForGood, Participant,
    RoleError, ScenePictures, Stop, Stopwatch, Turns, again, await_cullers, leave_unable, take_part,
};
use trimaran_gpu::{GpuError, GpuInfo, GpuScene, ItemPass};
use trimaran_proto::{Identity, Role, Settings};
use trimaran_scene::walk::WalkKind;
use trimaran_transport::{Endpoints, Instant, Net, Options, PeerAddress, causes};

use super::{
    Failure, progress,
    recording::{Early, Outcome, report_on},
    starting::{Metrics, not_joined},
    walking,
};

/// A display that is ready to walk.
pub(super) struct DisplaySession<'s> {
    pub(super) file: &'s SceneFile,
    /// The scene on its device.
    pub(super) drawn: &'s Arc<GpuScene>,
    pub(super) plan: Plan,
    pub(super) path: CameraPath,
    /// The path as the user named it, and the seed of an automatic one.
    pub(super) path_name: String,
    pub(super) seed: u64,
    /// Where the report goes.
    pub(super) folder: Writer,
    /// The devices that the report names.
    pub(super) devices: Vec<(ReportSeat, GpuInfo)>,
    pub(super) timeouts: JoinTimeouts,
    /// Where what the links carry is shown.
    pub(super) metrics: Metrics,
    /// Where to record what each frame asked of the roles.
    pub(super) trace: Option<PathBuf>,
    pub(super) net: Arc<dyn Net>,
    pub(super) listener: Listener,
    pub(super) options: Options,
    /// What it measures by, as all roles of this process do.
    pub(super) clock: Stopwatch,
    pub(super) turns: Turns,
}

/// A display's walk while it goes on.
struct Walk<'w> {
    file: &'w SceneFile,
    drawn: &'w Arc<GpuScene>,
    plan: &'w Plan,
    path: &'w CameraPath,
    cameras: Box<dyn Cameras>,
    /// Until there is something to report.
    folder: Option<Writer>,
    metrics: Metrics,
    recorder: Recorder<'w>,
    about: ReportPlan,
    bar: &'w ProgressBar,
    settings: Settings,
    net: Arc<dyn Net>,
    /// As long as nobody has come to it.
    listener: Option<Listener>,
    endpoints: Endpoints,
    options: Options,
    reconnect_s: f64,
    clock: Stopwatch,
    turns: Turns,
    /// Ends when the cullers cannot come any more.
    hopeless: Pin<Box<dyn Future<Output = Failure> + 'w>>,
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
    /// Waits for the cullers, walks and reports. When `hopeless` ends, they cannot come any more. `beside` plays
    /// whatever else of the session is in this process beside the walk.
    pub(super) fn show(
        self,
        runtime: &Runtime,
        stop: &Stop,
        hopeless: impl Future<Output = Failure>,
        beside: impl FnOnce(&mut dyn FnMut() -> Result<(), Early>) -> Result<(), Early>,
    ) -> Result<Outcome, Failure> {
        let Self { file, drawn, plan, path, trace, timeouts, net, .. } = self;
        let bar = progress::walk(plan.pace, &path);
        let mut advance = |_| bar.inc(1);
        let mut walk = Walk {
            file,
            drawn,
            plan: &plan,
            path: &path,
            cameras: path.cameras(plan.pace),
            folder: Some(self.folder),
            metrics: self.metrics,
            recorder: Recorder::new(plan.audit_every, &mut advance),
            about: ReportPlan {
                command_line: std::env::args().collect(),
                started: walking::date(),
                link: String::new(),
                transport: String::new(),
                seed: (self.path_name == "auto").then_some(self.seed),
                path: self.path_name,
                devices: self.devices,
                notes: notes(&path),
            },
            bar: &bar,
            settings: plan.settings(path.frames()),
            net: Arc::clone(&net),
            endpoints: self.listener.local_endpoints().clone(),
            listener: Some(self.listener),
            options: self.options,
            reconnect_s: timeouts.rejoin.as_secs_f64(),
            clock: self.clock,
            turns: self.turns,
            hopeless: Box::pin(hopeless),
        };
        // What was walked before a failure is worth a report.
        let early = beside(&mut || runtime.block_on(take_part(&mut walk, &net, timeouts, stop))).err();
        bar.finish_and_clear();
        let Walk { recorder, folder, about, .. } = walk;
        report_on(recorder, folder, early, trace.as_deref(), file, drawn, &plan, about, &path, stop)
    }

    /// The same with cullers that are elsewhere, and come by themselves.
    pub(super) fn show_to_others(self, runtime: &Runtime, stop: &Stop) -> Result<Outcome, Failure> {
        self.show(runtime, stop, pending(), |walk| walk())
    }
}

impl Participant for Walk<'_> {
    type Links = [Link; 2];
    type Device = GpuError;
    type Failure = Early;

    async fn join(&mut self, deadline: Instant) -> Result<[Link; 2], Early> {
        let failed = |why| Early { how: HowEnded::Failed, why };
        let listener = match self.listener.take() {
            Some(listener) => listener,
            None => {
                let identity = identity(self.file, self.settings);
                let listen = || Listener::bind_all(&self.net, &self.endpoints, identity, &self.options);
                // The old sockets may need a moment to be gone.
                let listening = again(&self.net, deadline, |_| true, listen).await;
                listening.map_err(|error| failed(Failure::broken(error)))?
            }
        };
        tokio::select! {
            biased;
            cullers = await_cullers(listener, deadline) => cullers.map_err(|e| failed(not_joined(e))),
            failure = self.hopeless.as_mut() => Err(failed(failure)),
        }
    }

    async fn play(&mut self, [first, second]: [Link; 2], stop: &Stop) -> Result<(), RoleError<GpuError>> {
        self.metrics.watch([&first, &second]);
        (self.about.link, self.about.transport) = transports(&first, &second);
        let work = match self.work() {
            Ok(work) => work,
            Err(error) => return Err(leave_unable([first, second], error).await),
        };
        let (settings, net, clock) = (self.settings, Arc::clone(&self.net), self.clock);
        let role = DisplayRole { work, first, second, settings, net, clock, turns: self.turns.clone() };
        role.run(&mut *self.cameras, &mut self.recorder, stop).await.map(|_| ())
    }

    fn lost(&mut self, error: &RoleError<GpuError>) -> bool {
        self.settings.first = self.recorder.next_frame();
        if self.settings.frames.is_some_and(|frames| self.settings.first.0 >= frames) {
            return false; // it was lost behind the last frame
        }
        let (said, seconds) = (causes(error), self.reconnect_s);
        self.bar.suspend(|| eprintln!("trimaran: {said}; waiting {seconds} s for all to join again"));
        self.about.notes.push(format!("the session stopped before {}: {said}", self.settings.first));
        true
    }
}

impl Walk<'_> {
    /// Begins to write what is shown, and makes the device ready.
    fn work(&mut self) -> Result<ScenePictures<VulkanDisplay>, RoleError<GpuError>> {
        if let Some(folder) = self.folder.take() {
            let journal = begin(folder, self.file, self.plan, &self.about, self.path);
            self.recorder.write_into(journal.map_err(|error| RoleError::Observer(error.into()))?);
        }
        let device = VulkanDisplay::new(self.drawn, self.settings.size).map_err(RoleError::unopened)?;
        Ok(ScenePictures::new(&self.file.scene, device, &self.settings)?)
    }
}

impl From<RoleError<GpuError>> for Early {
    fn from(error: RoleError<GpuError>) -> Self {
        Self { how: how_ended(&error), why: Failure::broken(error) }
    }
}

impl From<LostForGood<GpuError>> for Early {
    fn from(error: LostForGood<GpuError>) -> Self {
        Self { how: HowEnded::PeerLost, why: Failure::broken(error) }
    }
}

impl From<CullerFailure<VulkanCullerError>> for Early {
    fn from(failure: CullerFailure<VulkanCullerError>) -> Self {
        let how = match &failure.cause {
            CullerError::Role(error) => how_ended(error),
            _ => HowEnded::Failed,
        };
        Self { how, why: Failure::broken(failure) }
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
        None | Some(WalkKind::Floors) => return Vec::new(),
        Some(WalkKind::Hovering) => {
            "no floor was found to walk on: the automatic path hovers between the objects"
        }
        Some(WalkKind::Orbit) => {
            "no room was found to move in: the automatic path circles the scene from outside"
        }
    };
    vec![note.to_owned()]
}
