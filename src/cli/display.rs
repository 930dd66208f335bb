//! A display that waits for its pair, walks and reports, whether the pair is on other machines or in other
//! processes of this one.

use std::{error::Error, path::PathBuf, pin::pin, sync::Arc};

use indicatif::ProgressBar;
use thiserror::Error;
use tokio::runtime::Runtime;
use trimaran::vulkan::VulkanDisplay;
use trimaran::{
    report::{
        Writer,
        schema::{HowEnded, Seat as ReportSeat},
    },
    walkthrough::{Plan, Recorder, ReportPlan, SceneFile, Trail, begin, how_ended},
};
use trimaran_actors::{DisplayRole, Link, Listener, Stop, Stopwatch, Turns, again, await_pair, leave_unable};
use trimaran_gpu::{GpuInfo, GpuScene, ItemPass};
use trimaran_proto::{Identity, Role, Settings};
use trimaran_transport::{Endpoints, Net, Options, TokioNet};

use super::{
    Failure, progress,
    recording::{Early, Outcome, report_on},
    role::{Metrics, deadline, not_joined},
    run::notes,
    walking,
};

/// A display that listens for its pair, its device ready.
pub(super) struct DisplayStage {
    drawn: Arc<GpuScene>,
    pub(super) listener: Listener,
    net: Arc<dyn Net>,
    options: Options,
}

/// What a display shows.
pub(super) struct Show {
    /// Where the report goes.
    pub(super) folder: Option<Writer>,
    pub(super) plan: Plan,
    pub(super) trail: Trail,
    /// As the user named it.
    pub(super) path: String,
    pub(super) seed: u64,
    /// The devices that the report names.
    pub(super) devices: Vec<(ReportSeat, GpuInfo)>,
    /// How long to wait for the pair, seconds.
    pub(super) join_timeout_s: f64,
    /// How long to wait for a machine that was lost, seconds; not at all if 0.
    pub(super) reconnect_s: f64,
    /// Where what the links carry is shown.
    pub(super) metrics: Metrics,
    /// Where to record what each frame asked of the roles.
    pub(super) trace: Option<PathBuf>,
}

/// A peer was lost for good.
#[derive(Debug, Error)]
#[error("a peer was lost, and the session could not go on within {seconds} s")]
pub(super) struct LostForGood {
    pub(super) seconds: f64,
    /// How it was lost.
    #[source]
    pub(super) lost: Box<dyn Error + Send + Sync>,
}

impl DisplayStage {
    /// Listens, with the scene on its device.
    pub(super) async fn set(
        file: &SceneFile,
        drawn: Arc<GpuScene>,
        plan: &Plan,
        trail: &Trail,
        runtime: &Runtime,
        listen: &Endpoints,
        options: &Options,
    ) -> Result<Self, Failure> {
        if plan.audit_every > 0 {
            ItemPass::check(&drawn).map_err(Failure::broken)?;
        }
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let listening =
            Listener::bind_all(&net, listen, identity(file, plan.settings(trail.frames())), options);
        let listener = listening.await.map_err(|error| {
            if error.may_pass() { Failure::broken(error) } else { Failure::bad_input(error) }
        })?;
        Ok(Self { drawn, listener, net, options: options.clone() })
    }

    /// The device's own words.
    pub(super) fn info(&self) -> &GpuInfo {
        self.drawn.gpu().info()
    }

    /// Waits for the pair, walks and reports. When `hopeless` ends, the pair cannot come any more.
    pub(super) fn show(
        self,
        file: &SceneFile,
        mut show: Show,
        runtime: &Runtime,
        stop: &Stop,
        hopeless: impl Future<Output = Failure>,
    ) -> Result<Outcome, Failure> {
        let bar = progress::walk(show.plan.pace, &show.trail);
        let mut advance = |_| bar.inc(1);
        let mut recorder = Recorder::new(show.plan.audit_every, &mut advance);
        let mut about = ReportPlan {
            command_line: std::env::args().collect(),
            started: walking::date(),
            link: String::new(),
            transport: String::new(),
            seed: (show.path == "auto").then_some(show.seed),
            path: show.path.clone(),
            devices: show.devices.clone(),
            notes: notes(&show.trail),
        };
        let drawn = Arc::clone(&self.drawn);
        let early =
            self.walk(file, &mut show, &mut about, &mut recorder, &bar, runtime, stop, hopeless).err();
        bar.finish_and_clear();
        let Show { folder, plan, trail, trace, .. } = show;
        report_on(recorder, folder, early, trace.as_deref(), file, &drawn, &plan, about, &trail, stop)
    }

    /// Walks to the end of the session, or until `stop` asks. When a machine of the pair is lost, it waits
    /// for both to come again and goes on with the frame that was due.
    #[expect(clippy::too_many_arguments, reason = "what one walk needs, each of its own type")]
    fn walk(
        self,
        file: &SceneFile,
        show: &mut Show,
        about: &mut ReportPlan,
        recorder: &mut Recorder<'_>,
        bar: &ProgressBar,
        runtime: &Runtime,
        stop: &Stop,
        hopeless: impl Future<Output = Failure>,
    ) -> Result<(), Early> {
        let failed = |why| Early { how: HowEnded::Failed, why };
        let Self { drawn, mut listener, net, options } = self;
        let endpoints = listener.local_endpoints().clone();
        let mut settings = show.plan.settings(show.trail.frames());
        let mut cameras = show.trail.cameras(show.plan.pace);
        let clock = Stopwatch::start();
        let (mut hopeless, mut wait_s, mut lost) = (pin!(hopeless), show.join_timeout_s, None);
        loop {
            let coming = async {
                tokio::select! {
                    biased;
                    pair = await_pair(listener, deadline(&net, wait_s)) => pair.map_err(|e| match lost.take() {
                        Some(lost) => Early {
                            how: HowEnded::PeerLost,
                            why: Failure::broken(LostForGood { seconds: wait_s, lost }),
                        },
                        None => failed(not_joined(e)),
                    }),
                    failure = hopeless.as_mut() => Err(failed(failure)),
                }
            };
            // What was walked before the loss is worth a report.
            let Some(pair) = stop.unless_requested(runtime.handle(), coming) else { return Ok(()) };
            let [first, second] = pair?;
            show.metrics.watch([&first, &second]);
            (about.link, about.transport) = transports(&first, &second);
            if let Some(folder) = show.folder.take() {
                let journal = begin(folder, file, &show.plan, about, &show.trail);
                recorder.write_into(
                    journal
                        .map_err(|error| Early { how: HowEnded::NotRecorded, why: Failure::broken(error) })?,
                );
            }
            let device = match VulkanDisplay::new(&drawn, settings.size) {
                Ok(device) => device,
                Err(error) => {
                    leave_unable(runtime.handle(), [first, second], &error.to_string());
                    return Err(Early { how: HowEnded::DeviceFailed, why: Failure::broken(error) });
                }
            };
            let (scene, net_of_role) = (Arc::clone(&file.scene), Arc::clone(&net));
            let turns = Turns::at_once();
            let role = DisplayRole { scene, device, first, second, settings, net: net_of_role, clock, turns };
            let Err(error) = role.run(&mut *cameras, recorder, runtime.handle(), stop) else { return Ok(()) };
            if show.reconnect_s <= 0.0 || !error.lost_a_peer() {
                return Err(Early { how: how_ended(&error), why: Failure::broken(error) });
            }
            settings.first = recorder.next_frame();
            if settings.frames.is_some_and(|frames| settings.first.0 >= frames) {
                return Ok(()); // it was lost behind the last frame
            }
            let said = Failure::broken(error);
            bar.suspend(|| {
                eprintln!("trimaran: {said}; waiting {} s for all to join again", show.reconnect_s);
            });
            about.notes.push(format!("the session stopped before {}: {said}", settings.first));
            (wait_s, lost) = (show.reconnect_s, Some(said.to_string().into()));
            // The old sockets may need a moment to be gone.
            let deadline = deadline(&net, wait_s);
            let listen = || Listener::bind_all(&net, &endpoints, identity(file, settings), &options);
            let listening = again(&net, deadline, |_| true, listen);
            let Some(again) = stop.unless_requested(runtime.handle(), listening) else { return Ok(()) };
            listener = again.map_err(|error| failed(Failure::broken(error)))?;
        }
    }
}

/// What the links go over: the name of the transport, and in words.
fn transports(first: &Link, second: &Link) -> (String, String) {
    let [a, b] = [first.peer.address, second.peer.address];
    let (one, other) = (a.transport(), b.transport());
    if one == other {
        (one.to_owned(), format!("{one}: {a} and {b}"))
    } else {
        (format!("{one} and {other}"), format!("{one}: {a}; {other}: {b}"))
    }
}

fn identity(file: &SceneFile, settings: Settings) -> Identity {
    Identity { role: Role::Display, scene: file.scene.hash(), settings: Some(settings) }
}
