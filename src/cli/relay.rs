//! A relay's process, and that of a display that watches.

use std::{fs, path::Path, sync::Arc};

use tokio::runtime::Runtime;
use trimaran::{
    config::{ConfigError, RelayConfig, WatcherConfig},
    metrics::Metrics,
    vulkan::VulkanDisplay,
};
use trimaran_actors::{
    BoxedError, CullerEvent, ListenerHandles, Observer, PeerEndpoint, Peers, PeersConfig, Relay,
    RelayEndpoints, RelayError, RoleError, ScenePictures, ShownFrame, Turns, WatcherRole, max_frame,
};
use trimaran_cull::{Image, RgbImage};
use trimaran_proto::{FrameNumber, Identity, LodRule, Role, Settings, Viewport};
use trimaran_transport::{Endpoint, Endpoints, TokioNet};

use super::{
    Failure,
    log::SAID,
    reconfigure::Live,
    role::{Configured, no_sessions},
    served::told_of_limits,
    service_manager::ServiceManager,
    walking::{Start, opened, role_gpu, scene, upload},
};

/// Passes on frames until it is stopped.
pub(super) fn relay(
    Configured { config, options, until_input_ends, reconfigure }: Configured<RelayConfig>,
    runtime: &Runtime,
) -> Result<(), Failure> {
    let start = Start::of_service(runtime, config.common.join_timeout_s, until_input_ends)?;
    let Some(server) = start.metrics("relay", &config.common, &options)? else { return Ok(()) };
    let endpoint = the_one("upstream", &config.upstream)?;
    let upstream = PeerEndpoint { endpoint, options: options.clone() };
    let peers = options.security.as_ref().map(|security| security.peers.clone());
    let at = RelayEndpoints { upstream, listen: config.listen.clone(), options };
    let links = server.metrics.links().clone();
    let watch: trimaran_actors::WatchLink = Arc::new(move |kind, link| Box::new(links.watch(kind, link)));
    let join = async || {
        let started = Relay::start(&start.net, at.clone(), Arc::clone(&watch)).await;
        started.map_err(|e| if e.may_pass() { Failure::broken(e) } else { Failure::bad_input(e) })
    };
    let Some(relay) = start.until(join)? else { return Ok(()) };
    if !until_input_ends {
        tracing::info!(target: SAID, "the relay listens on {}", relay.endpoints());
    }
    let metrics = server.metrics.clone();
    let ListenerHandles { stats, limits } = relay.listener();
    metrics.links().listens(stats.clone());
    runtime.spawn(told_of_limits(TokioNet::new(runtime.handle().clone()), stats));
    let live = Live { metrics, peers, limits: Some(limits), sessions: None };
    let _reconfigured = reconfigure.begin(live, no_sessions::<RelayConfig>, runtime);
    let manager = ServiceManager::of_this_process();
    server.metrics.ready();
    manager.ready(&format!("passes on what {} sends", config.upstream));
    let relayed = runtime.block_on(manager.watching(&*start.net, relay.run(&start.stop)));
    relayed.map_err(|error: RelayError| Failure::bad_input(error))
}

/// Draws the frames of a relay until it is stopped.
pub(super) fn watcher(
    Configured { config, mut options, until_input_ends, reconfigure }: Configured<WatcherConfig>,
    runtime: &Runtime,
) -> Result<(), Failure> {
    let gpu = role_gpu(&config.gpu);
    let start = Start::of_service(runtime, config.common.join_timeout_s, until_input_ends)?;
    let Some(server) = start.metrics("watcher", &config.common, &options)? else { return Ok(()) };
    let Some(file) = start.until(async || scene(&config.scene))? else { return Ok(()) };
    options.link.max_frame = max_frame(&file.scene);
    let Some(drawn) = start.until(async || upload(&file, &gpu))? else { return Ok(()) };
    // The first frame's view state has the size of the picture, and its levels.
    let small = Viewport::new(64, 64).map_err(Failure::broken)?;
    let settings = Settings::new(small, LodRule::new(2.0).map_err(Failure::broken)?);
    let display = VulkanDisplay::new(&drawn, settings.viewport).map_err(Failure::broken)?;
    let outline = file.scene.outline();
    let endpoint = the_one("relay", &config.relay)?;
    let peers = options.security.as_ref().map(|security| security.peers.clone());
    let sought = PeersConfig {
        identity: Identity { role: Role::Display, scene: Some(outline), session: None },
        role: Role::Relay,
        endpoints: vec![PeerEndpoint { endpoint, options }],
        listener: None,
        most: 1,
    };
    let role = WatcherRole {
        work: ScenePictures::new(&file.scene, display, &settings),
        relay: runtime.block_on(async { Peers::seek(&start.net, sought) }),
        drawables: outline.drawables,
        objects: outline.objects,
        net: Arc::clone(&start.net),
        turns: Turns::at_once(),
    };
    let metrics = server.metrics.clone();
    let live = Live { metrics: metrics.clone(), peers, limits: None, sessions: None };
    let _reconfigured = reconfigure.begin(live, no_sessions::<WatcherConfig>, runtime);
    metrics.opened(opened(&file, &drawn));
    metrics.has_places(1);
    metrics.ready();
    let mut seen = Seen { metrics, keeps: config.picture.is_some(), last: None };
    let watched = runtime.block_on(role.run(&mut seen, &start.stop));
    watched.map_err(|error| match error {
        RoleError::Join(_) => Failure::bad_input(error),
        error => Failure::broken(error),
    })?;
    match (&config.picture, &seen.last) {
        (Some(path), Some(picture)) => save(path, picture),
        (Some(_), None) => Err(Failure::stopped("no frame has come: there is no picture")),
        (None, _) => Ok(()),
    }
}

/// The endpoint of a key that names one.
fn the_one(key: &'static str, endpoints: &Endpoints) -> Result<Endpoint, Failure> {
    let missing = || Failure::bad_input(ConfigError::Value { key, why: "give one endpoint" });
    endpoints.iter().next().cloned().ok_or_else(missing)
}

fn save(path: &Path, picture: &Image) -> Result<(), Failure> {
    let picture = RgbImage::of(picture).ok_or_else(|| Failure::broken("the last picture has no pixels"))?;
    let file = picture.encode(png::Compression::Fast).map_err(Failure::broken)?;
    fs::write(path, file)
        .map_err(|cause| Failure::broken(format!("cannot write {}: {cause}", path.display())))
}

/// Keeps the last picture, and counts frames and the link's traffic.
struct Seen {
    metrics: Metrics,
    keeps: bool,
    last: Option<Image>,
}

impl Observer for Seen {
    fn wants_picture(&self, _: FrameNumber) -> bool {
        self.keeps
    }

    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.metrics.frames().shown(frame);
        self.last = frame.picture.cloned().or_else(|| self.last.take());
        Ok(())
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        match event {
            CullerEvent::Came(_, link) => self.metrics.links().add("relay".to_owned(), link),
            CullerEvent::Left(_, why) => {
                self.metrics.sessions().failed(why);
                self.metrics.links().remove("relay");
            }
            _ => {}
        }
    }
}
