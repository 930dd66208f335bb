//! A display that waits for its pair, walks and reports, whether the pair is on other machines or in other processes of this one.

use std::{
    error::Error,
    net::SocketAddr,
    path::{Path, PathBuf},
    pin::pin,
    sync::Arc,
    time::SystemTime,
};

use indicatif::ProgressBar;
use thiserror::Error;
use tokio::runtime::Runtime;
use trimaran::{
    report::{Report, schema::Seat as ReportSeat},
    walkthrough::{Plan, Recorder, ReportPlan, SceneFile, Trail, viewport, write_report},
};
use trimaran_actors::{DisplayRole, Stop, Stopwatch, Turns, VulkanDisplay, again, await_pair};
use trimaran_gpu::{GpuInfo, GpuScene};
use trimaran_proto::{Identity, Role, Settings};
use trimaran_transport::{Endpoints, Link, Listener, Net, Options, TokioNet};

use super::{
    Failure, progress,
    role::{Metrics, deadline, not_joined, upload},
    run::{notes, record, report_on},
    walking::stop_on_signal,
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
    pub(super) plan: Plan,
    pub(super) trail: Trail,
    /// As the user named it.
    pub(super) path: String,
    pub(super) seed: u64,
    /// The devices that the report names.
    pub(super) devices: Vec<(ReportSeat, GpuInfo)>,
    /// How long to wait for the pair, seconds.
    pub(super) patience_s: f64,
    /// How long to wait for a machine that was lost, seconds; not at all if 0.
    pub(super) reconnect_s: f64,
    /// Where to show what the links carry.
    pub(super) metrics: Option<SocketAddr>,
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
    /// Opens the device and listens.
    pub(super) fn set(
        file: &SceneFile,
        device: Option<&str>,
        plan: &Plan,
        trail: &Trail,
        runtime: &Runtime,
        listen: &Endpoints,
        options: &Options,
    ) -> Result<Self, Failure> {
        let drawn = upload(file, device)?;
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let listening =
            Listener::bind_all(&net, listen, identity(file, plan.settings(trail.frames())), options);
        let listener = runtime.block_on(listening).map_err(Failure::bad_input)?;
        Ok(Self { drawn, listener, net, options: options.clone() })
    }

    /// The device's own words.
    pub(super) fn info(&self) -> &GpuInfo {
        self.drawn.gpu().info()
    }

    /// Waits for the pair, walks and writes the report into `out`. When `hopeless` ends, the pair cannot come any more.
    pub(super) fn show(
        self,
        file: &SceneFile,
        show: Show,
        out: &Path,
        runtime: &Runtime,
        hopeless: impl Future<Output = Failure>,
    ) -> Result<Report, Failure> {
        let started = SystemTime::now();
        let stop = stop_on_signal(runtime);
        let bar = progress::walk(show.plan.pace, &show.trail);
        let mut advance = |_| bar.inc(1);
        let mut recorder = Recorder::new(show.plan.audit_every, &mut advance);
        let drawn = Arc::clone(&self.drawn);
        let walked = self.walk(file, &show, &mut recorder, &bar, runtime, &stop, hopeless)?;
        let records = recorder.into_frames();
        bar.finish_and_clear();
        let Show { plan, trail, path, seed, devices, trace, .. } = show;
        record(trace.as_deref(), file, &plan, &records)?;
        let about = ReportPlan {
            command_line: std::env::args().collect(),
            started,
            link: walked.link,
            transport: walked.transport,
            seed: (path == "auto").then_some(seed),
            path,
            devices,
            notes: notes(&trail).into_iter().chain(walked.interruptions).collect(),
        };
        report_on(&records, &stop, |records, advance| {
            write_report(out, file, &drawn, &plan, &about, &trail, records, advance)
        })
    }

    /// Walks to the end of the session. When a machine of the pair is lost, it waits for both to come again and goes on with the frame
    /// that was due.
    #[expect(clippy::too_many_arguments, reason = "what one walk needs, each of its own type")]
    fn walk(
        self,
        file: &SceneFile,
        show: &Show,
        recorder: &mut Recorder<'_>,
        bar: &ProgressBar,
        runtime: &Runtime,
        stop: &Stop,
        hopeless: impl Future<Output = Failure>,
    ) -> Result<Walked, Failure> {
        let Self { drawn, mut listener, net, options } = self;
        let endpoints = listener.local_endpoints().clone();
        let size = viewport(show.plan.size).map_err(Failure::bad_input)?;
        let mut settings = show.plan.settings(show.trail.frames());
        let mut cameras = show.trail.cameras(show.plan.pace);
        let (clock, mut metrics, mut walked) =
            (Stopwatch::start(), Metrics::new(show.metrics), Walked::default());
        let (mut hopeless, mut wait_s, mut lost) = (pin!(hopeless), show.patience_s, None);
        loop {
            let coming = async {
                tokio::select! {
                    biased;
                    pair = await_pair(listener, deadline(&net, wait_s)) => pair.map_err(|e| match lost.take() {
                        Some(lost) => Failure::broken(LostForGood { seconds: wait_s, lost }),
                        None => not_joined(e),
                    }),
                    failure = hopeless.as_mut() => Err(failure),
                }
            };
            let Some(pair) = stop.unless_requested(runtime.handle(), coming) else {
                // What was walked before the loss is worth a report.
                return if settings.first.0 > 0 {
                    Ok(walked)
                } else {
                    Err(Failure::broken("interrupted before the pair had come"))
                };
            };
            let [first, second] = pair?;
            metrics.watch([&first, &second], runtime)?;
            walked.over(&first, &second);
            let device = VulkanDisplay::new(&drawn, size).map_err(Failure::broken)?;
            let (scene, net_of_role) = (Arc::clone(&file.scene), Arc::clone(&net));
            let turns = Turns::at_once();
            let role = DisplayRole { scene, device, first, second, settings, net: net_of_role, clock, turns };
            let Err(error) = role.run(&mut *cameras, recorder, runtime.handle(), stop) else {
                return Ok(walked);
            };
            if show.reconnect_s <= 0.0 || !error.lost_a_peer() || stop.requested() {
                return Err(Failure::broken(error));
            }
            settings.first = recorder.next_frame();
            if settings.frames.is_some_and(|frames| settings.first.0 >= frames) {
                return Ok(walked); // it was lost behind the last frame
            }
            let said = Failure::broken(error);
            bar.suspend(|| {
                eprintln!("trimaran: {said}; waiting {} s for all to join again", show.reconnect_s);
            });
            walked.interruptions.push(format!("the session stopped before {}: {said}", settings.first));
            (wait_s, lost) = (show.reconnect_s, Some(said.to_string().into()));
            // The old sockets may need a moment to be gone.
            let deadline = deadline(&net, wait_s);
            let listen = || Listener::bind_all(&net, &endpoints, identity(file, settings), &options);
            listener = runtime.block_on(again(&net, deadline, listen)).map_err(Failure::broken)?;
        }
    }
}

/// How a session went that has ended well.
#[derive(Debug, Default)]
struct Walked {
    link: String,
    transport: String,
    /// Each time that it stopped and went on.
    interruptions: Vec<String>,
}

impl Walked {
    /// Notes what the links go over.
    fn over(&mut self, first: &Link, second: &Link) {
        let [a, b] = [first.peer.address, second.peer.address];
        let (one, other) = (a.transport(), b.transport());
        (self.link, self.transport) = if one == other {
            (one.to_owned(), format!("{one}: {a} and {b}"))
        } else {
            (format!("{one} and {other}"), format!("{one}: {a}; {other}: {b}"))
        };
    }
}

fn identity(file: &SceneFile, settings: Settings) -> Identity {
    Identity { role: Role::Display, scene: file.scene.hash(), settings: Some(settings) }
}
