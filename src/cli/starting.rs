//! How roles start: with what the configuration names, which may not be there yet.

use std::{net::SocketAddr, path::Path, sync::Arc, time::Duration};

use tokio::runtime::Runtime;
use trimaran::{
    metrics::{LinkMetrics, Serving},
    walkthrough::SceneFile,
};
use trimaran_actors::{JoinError, JoinTimeouts, Link, Stop, again};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene};
use trimaran_scene::Scene;
use trimaran_transport::{Net, TokioNet};

use super::{Failure, walking::stop_on_signal};

/// How a role starts: what is not there yet, such as a scene that is being copied or a port in use, is waited
/// for.
pub(super) struct Start<'r> {
    runtime: &'r Runtime,
    pub(super) net: Arc<dyn Net>,
    pub(super) stop: Stop,
    pub(super) timeouts: JoinTimeouts,
}

impl<'r> Start<'r> {
    pub(super) fn new(runtime: &'r Runtime, join_timeout_s: f64, reconnect_s: f64) -> Self {
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let seconds = |s| Duration::try_from_secs_f64(s).unwrap_or_default();
        let timeouts = JoinTimeouts { join: seconds(join_timeout_s), rejoin: seconds(reconnect_s) };
        Self { runtime, net, stop: stop_on_signal(runtime), timeouts }
    }

    /// What `attempt` gives once it works; `None` if the role is asked to stop before. It is tried again
    /// while what it fails with may pass, for as long as the role waits for others.
    pub(super) fn until<T>(
        &self,
        attempt: impl AsyncFn() -> Result<T, Failure>,
    ) -> Result<Option<T>, Failure> {
        let deadline = self.net.now().after(self.timeouts.join);
        let attempts = again(&self.net, deadline, Failure::may_pass, || attempt());
        self.runtime.block_on(self.stop.unless_requested(attempts)).transpose()
    }
}

/// The scene, which may be being copied.
pub(super) fn scene(path: &Path) -> Result<SceneFile, Failure> {
    let scene = Scene::open(path).map_err(Failure::broken)?;
    Ok(SceneFile { path: path.to_owned(), scene: Arc::new(scene) })
}

/// The scene on a device.
pub(super) fn upload(file: &SceneFile, gpu: &GpuOptions) -> Result<Arc<GpuScene>, Failure> {
    let gpu = Gpu::open(gpu).map_err(Failure::broken)?;
    GpuScene::upload(&gpu, &file.scene).map_err(Failure::broken)
}

/// What may pass is no fault of the configuration: whoever starts roles again when they fail may do so.
pub(super) fn not_joined(error: JoinError) -> Failure {
    if error.may_pass() { Failure::broken(error) } else { Failure::bad_input(error) }
}

/// What the links carry, once there are any.
#[derive(Default)]
pub(super) struct Metrics {
    links: LinkMetrics,
    _shown: Option<Serving>,
}

impl Metrics {
    /// Shows them at this address, if there is one, for as long as this lives.
    pub(super) fn show(at: Option<SocketAddr>, runtime: &Runtime) -> Result<Self, Failure> {
        let links = LinkMetrics::default();
        let shown = at.map(|at| links.clone().serve(at, runtime.handle())).transpose();
        let shown = shown.map_err(Failure::broken)?;
        if let Some(serving) = &shown {
            eprintln!("trimaran: metrics on http://{}/metrics", serving.address());
        }
        Ok(Self { links, _shown: shown })
    }

    /// Shows what `links` carry from now on.
    pub(super) fn watch(&mut self, links: [&Link; 2]) {
        self.links.watch(links);
    }
}
