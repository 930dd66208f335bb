//! A culler's process: it serves displays side by side, each on a thread of its own.

use std::{
    future::pending,
    io,
    panic::{self, AssertUnwindSafe},
    sync::Arc,
    thread::{self, Scope, ScopedJoinHandle},
    time::Duration,
};

use bytesize::ByteSize;
use parking_lot::Mutex;
use tokio::{runtime::Runtime, sync::mpsc};
use trimaran::{
    culling::{Culling, CullingMethod},
    metrics::{DeviceMemory, Metrics, Opened},
    page::Pages,
    walkthrough::SceneFile,
};
use trimaran_actors::{CullerService, NewSession, RoleError, SessionLimits, Stop, Stopper, Turns, max_frame};
use trimaran_gpu::{DeviceKind, GpuScene};
use trimaran_proto::{SessionKey, Settings, Viewport};
use trimaran_transport::{Net, TokioNet, causes, sleep_until};

use super::{
    Failure,
    log::SAID,
    plural,
    served::{Serving, told_of_limits},
    walking::opened,
};

/// The step of the wait for sessions to tell their displays that they end.
const STEP: Duration = Duration::from_millis(10);
const STEPS: u32 = 100;

/// Serves displays.
pub(super) struct Host<'h> {
    pub(super) file: &'h SceneFile,
    pub(super) drawn: &'h Arc<GpuScene>,
    pub(super) runtime: &'h Runtime,
    pub(super) metrics: Metrics,
    /// How it culls.
    pub(super) method: CullingMethod,
    pub(super) limits: SessionLimits,
    /// How many displays may be there at once.
    pub(super) places: usize,
    /// The pages that it serves, if it does.
    pub(super) pages: Option<Pages>,
    /// It ends with its first display, which comes within this time.
    pub(super) for_one_session: Option<Duration>,
}

/// The end of a session.
#[derive(Debug, Clone, Copy)]
enum End {
    /// The display has finished, or this service was stopped.
    Clean,
    /// The display was lost, or the session met a fault.
    Lost,
}

/// An event for a service that waits.
enum Event {
    Came(Box<NewSession>),
    Ended(End),
}

/// A session that goes on.
struct Running<'scope> {
    key: SessionKey,
    stopper: Stopper,
    thread: ScopedJoinHandle<'scope, ()>,
}

impl Running<'_> {
    fn is_over(&self) -> bool {
        self.thread.is_finished()
    }
}

/// How many sessions have the device at a time. A device of its own works for one while others compute on the
/// host. A driver on the CPU needs all of it for one.
fn at_once(kind: DeviceKind) -> usize {
    if kind == DeviceKind::Discrete { 3 } else { 1 }
}

impl Host<'_> {
    /// Serves the displays that come until `stop` asks, or the device is lost. They share its time.
    ///
    /// Any other error in a session ends that session: its display is told, and the others go on.
    pub(super) fn serve(&self, mut service: CullerService, stop: &Stop) -> Result<(), Failure> {
        let net = TokioNet::new(self.runtime.handle().clone());
        let serving = Serving::begin(&self.file.path);
        service.sharing().observe(self.metrics.frames().clone());
        if let Some(listener) = service.listener() {
            self.metrics.links().listens(listener.stats.clone());
            self.runtime.spawn(told_of_limits(net.clone(), listener.stats.clone()));
        }
        self.metrics.opened(self.opened(&net));
        self.metrics.has_places(self.places);
        self.metrics.ready();
        let turns = Turns::fair(at_once(self.drawn.gpu().info().kind));
        let (ended, mut ends) = mpsc::unbounded_channel::<Result<End, RoleError>>();
        let serving = &serving;
        let latest = self.for_one_session.map(|time| (time, net.now().after(time)));
        thread::scope(|scope| {
            let mut sessions: Vec<Running<'_>> = Vec::new();
            let mut serve = || {
                loop {
                    let none_came = async {
                        match latest.filter(|_| sessions.is_empty()) {
                            Some((time, latest)) => {
                                sleep_until(&net, latest).await;
                                time
                            }
                            None => pending().await,
                        }
                    };
                    let next = async {
                        tokio::select! {
                            session = service.next() => session
                                .map(|session| Event::Came(Box::new(session)))
                                .map_err(Failure::bad_input),
                            Some(end) = ends.recv() => end.map(Event::Ended).map_err(Failure::broken),
                            time = none_came => {
                                let seconds = time.as_secs_f64();
                                Err(Failure::broken(format!("no display has come within {seconds} s")))
                            }
                        }
                    };
                    let next = serving.manager.watching(&net, stop.unless_requested(next));
                    let Some(event) = self.runtime.block_on(next) else {
                        return Ok(());
                    };
                    let session = match event? {
                        Event::Came(session) => *session,
                        // A display that has come again has ended its old session.
                        Event::Ended(end) if self.for_one_session.is_some() && serving.is_idle() => {
                            return match end {
                                End::Clean => Ok(()),
                                End::Lost => {
                                    Err(Failure::broken("the session has ended without its display"))
                                }
                            };
                        }
                        Event::Ended(_) => continue,
                    };
                    let (key, (stopper, over)) = (session.key, Stop::new());
                    sessions.retain(|session| !session.is_over());
                    // A display that comes again has no use for its old session, and does not hear its end.
                    sessions.iter().filter(|old| old.key == key).for_each(|old| old.stopper.insist());
                    let (turns, ended, over_here) = (turns.clone(), ended.clone(), over.clone());
                    let served = serving.one_more();
                    let play = move |session| {
                        let played = AssertUnwindSafe(|| self.play(session, &turns, stop, &over_here));
                        // The panic hook has already printed other panics on standard error.
                        let end = panic::catch_unwind(played).unwrap_or(Ok(End::Lost));
                        drop(served);
                        let _nobody_waits = ended.send(end);
                    };
                    match spawn(scope, thread::Builder::new().name("session".to_owned()), session, play) {
                        Ok(thread) => sessions.push(Running { key, stopper, thread }),
                        Err((Some(session), cause)) => self.turn_away(session, cause, &over),
                        Err((None, _)) => {}
                    }
                }
            };
            let served = serve();
            sessions.iter().for_each(|session| session.stopper.stop());
            // Displays that take longer are not waited for.
            for _ in (0..STEPS).take_while(|_| sessions.iter().any(|session| !session.is_over())) {
                thread::sleep(STEP);
            }
            sessions.iter().for_each(|session| session.stopper.insist());
            served
        })
    }

    /// Its open scene and device.
    fn opened(&self, net: &TokioNet) -> Opened {
        let Opened { scene, device, memory, .. } = opened(self.file, self.drawn);
        let limits = self.limits.clone();
        let memory = move || DeviceMemory { depth: limits.reserved(), ..memory() };
        let (net, pages) = (net.clone(), self.pages.clone());
        let pages = pages
            .map(|pages| -> Box<dyn Fn() -> usize + Send + Sync> { Box::new(move || pages.open(net.now())) });
        Opened { scene, device, memory: Box::new(memory), pages }
    }

    /// Plays a session. An error ends all sessions: the device is lost, or hangs.
    fn play(&self, session: NewSession, turns: &Turns, stop: &Stop, over: &Stop) -> Result<End, RoleError> {
        let Self { file, drawn, runtime, metrics, limits, .. } = self;
        let watching = metrics.links().watch("display", &session.display);
        let (name, stats) = (watching.peer(), session.display.stats.clone());
        let _running = metrics.sessions().begin();
        tracing::info!(display = name, settings = %session.settings, address = %session.display.peer.address, "has joined");
        let work = |settings: &Settings| {
            // Giving up a wait for the device ends all sessions: a single session waits to the end.
            Ok(Culling::open(self.method, &file.scene, drawn, settings, turns)?.cancelled_by(stop))
        };
        let (drawables, scene) = (max_frame(&file.scene), Some(&file.scene));
        let played = runtime.block_on(session.play(work, turns, drawables, scene, limits, over));
        if let Err(error) = &played {
            metrics.sessions().failed(error);
        }
        let frames = stats.read().sent.end.messages;
        match played {
            Err(error) if error.device_failure().is_none() => {
                let frames = plural(frames, "frame", "frames");
                tracing::warn!(target: SAID, "{name} is gone after {frames}: {}", causes(&error));
                Ok(End::Lost)
            }
            Err(error) => Err(error),
            Ok(()) => {
                tracing::info!(display = name, frames, "has left");
                Ok(End::Clean)
            }
        }
    }

    /// Tells a display that its session gets no thread.
    fn turn_away(&self, session: NewSession, cause: io::Error, over: &Stop) {
        tracing::warn!(target: SAID, "turned a display away: the system gives no thread: {cause}");
        let over = over.clone();
        self.runtime.spawn(async move { session.turn_away(RoleError::Thread(cause), &over).await });
    }
}

/// The largest picture that `asked` and the device allow.
pub(super) fn largest(drawn: &GpuScene, asked: Viewport) -> Viewport {
    let most = drawn.gpu().info().max_viewport;
    Viewport::new(asked.width().min(most), asked.height().min(most)).unwrap_or(asked)
}

/// The limits of sessions: pictures up to `largest`, and this much depth memory in total, by default a
/// quarter of the device's.
pub(super) fn limits(drawn: &GpuScene, largest: Viewport, depth: Option<ByteSize>) -> SessionLimits {
    SessionLimits::new(largest, depth.map_or(drawn.gpu().info().memory / 4, |depth| depth.as_u64()))
}

/// Starts a thread that uses `taken`. If there is no thread, gives `taken` back.
fn spawn<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    thread: thread::Builder,
    taken: T,
    run: impl FnOnce(T) + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, ()>, (Option<T>, io::Error)> {
    let slot = Arc::new(Mutex::new(Some(taken)));
    let its = Arc::clone(&slot);
    let run = move || {
        let taken = its.lock().take();
        if let Some(taken) = taken {
            run(taken);
        }
    };
    thread.spawn_scoped(scope, run).map_err(|cause| (slot.lock().take(), cause))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_thread_was_for_is_there_still_where_there_is_none() {
        let (told, heard) = std::sync::mpsc::channel();
        thread::scope(|scope| {
            let tell = |name: String| told.send(name).unwrap();
            spawn(scope, thread::Builder::new(), "first".to_owned(), tell).unwrap();
            let endless = thread::Builder::new().stack_size(1 << 50);
            let (given_back, _) = spawn(scope, endless, "second".to_owned(), |_| {}).unwrap_err();
            assert_eq!(given_back.as_deref(), Some("second"));
        });
        assert_eq!(heard.recv().unwrap(), "first");
    }
}
