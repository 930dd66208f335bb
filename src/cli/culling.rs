//! A culler's process: it serves displays side by side, each on a thread of its own.

use std::{sync::Arc, thread};

use tokio::{runtime::Runtime, sync::mpsc};
use trimaran::{
    culling::{Culling, CullingMethod},
    metrics::LinkMetrics,
    walkthrough::SceneFile,
};
use trimaran_actors::{CullerService, NewSession, RoleError, Stop, Stopper, Turns, max_frame};
use trimaran_gpu::GpuScene;
use trimaran_proto::{SessionKey, Settings};
use trimaran_transport::causes;

use super::Failure;

/// What serves displays.
pub(super) struct Host<'h> {
    pub(super) file: &'h SceneFile,
    pub(super) drawn: &'h Arc<GpuScene>,
    pub(super) runtime: &'h Runtime,
    pub(super) links: LinkMetrics,
    /// How it culls.
    pub(super) method: CullingMethod,
}

impl Host<'_> {
    /// Serves the displays that come until `stop` asks, or the device fails. Where there are several, each
    /// gets a frame in turn.
    pub(super) fn serve(&self, mut service: CullerService, stop: &Stop) -> Result<(), Failure> {
        let turns = Turns::fair();
        let (failed, mut failures) = mpsc::unbounded_channel::<RoleError>();
        let mut sessions: Vec<(SessionKey, Stopper)> = Vec::new();
        thread::scope(|scope| {
            let mut serve = || {
                loop {
                    let next = async {
                        tokio::select! {
                            session = service.next() => session.map_err(Failure::bad_input),
                            Some(error) = failures.recv() => Err(Failure::broken(error)),
                        }
                    };
                    let Some(session) = self.runtime.block_on(stop.unless_requested(next)) else {
                        return Ok(());
                    };
                    let session = session?;
                    let (stopper, over) = Stop::new();
                    // A display that comes again has no use for its old session, and does not hear its end.
                    for (_, old) in sessions.extract_if(.., |(key, _)| *key == session.key) {
                        old.insist();
                    }
                    sessions.push((session.key, stopper));
                    let (turns, failed) = (turns.clone(), failed.clone());
                    let play = move || {
                        if let Err(error) = self.play(session, &turns, &over) {
                            let _ended = failed.send(error);
                        }
                    };
                    let thread = thread::Builder::new().name("session".to_owned());
                    thread.spawn_scoped(scope, play).map_err(Failure::broken)?;
                }
            };
            let served = serve();
            for (_, stopper) in &sessions {
                stopper.stop();
            }
            served
        })
    }

    fn play(&self, session: NewSession, turns: &Turns, stop: &Stop) -> Result<(), RoleError> {
        let Self { file, drawn, runtime, links, .. } = self;
        let name = format!("display {:016x}", session.key.0);
        tracing::info!(display = name, settings = %session.settings, address = %session.display.peer.address, "serves");
        links.add(name.clone(), &session.display);
        let work = |settings: &Settings| Culling::open(self.method, &file.scene, drawn, settings, turns);
        let played =
            runtime.block_on(session.play(work, turns, max_frame(&file.scene), Some(&file.scene), stop));
        links.remove(&name);
        match played {
            Err(error) if error.device_failure().is_none() => {
                eprintln!("trimaran: {name} is gone: {}", causes(&error));
                Ok(())
            }
            played => {
                tracing::info!(display = name, "has left");
                played
            }
        }
    }
}
