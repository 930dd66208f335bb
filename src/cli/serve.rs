//! `trimaran serve`: serves a scene to browsers and displays.

use std::{io::Write as _, net::SocketAddr, path::Path, slice, sync::Arc};

use tokio::sync::{mpsc, oneshot};
use trimaran::{
    config::options,
    culling::CullingMethod,
    notes::NotesFolder,
    page::{
        Drive, DriveReport, FrameAncestor, PageOptions, Pages, Proxies, SceneDescription, Tls, TlsFiles,
        model_name,
    },
};
use trimaran_actors::{CullerService, ServiceEndpoints, max_frame};
use trimaran_transport::{Endpoints, Net, Options, TokioNet};

use super::{
    Failure,
    access::{TokenSource, keep},
    args::{DeviceArgs, GuestArgs, ServeArgs},
    culling::{Host, largest, limits},
    log::is_journal,
    printed,
    reload::HangUps,
    service_manager::ServiceManager,
    stopping::stoppable_service,
    terminal::stdout,
    walking::{MetricsServer, open, runtime, upload},
};

pub(super) fn run(args: &ServeArgs) -> Result<(), Failure> {
    let options = options(&args.links.options, toml::Table::new()).map_err(Failure::bad_input)?;
    let service = Service {
        scene: &args.scene,
        name: model_name(slice::from_ref(&args.scene)),
        listen: args.listen,
        tokens: TokenSource::from(&args.access),
        tls: args.access.tls(),
        proxies: args.access.proxies(),
        notes: NotesFolder::new(
            args.notes.clone().unwrap_or_else(|| NotesFolder::beside(&args.scene)),
            !args.read_only,
        ),
        frame_ancestors: args.embedding.frame_ancestors.clone(),
        metrics: args.metrics,
        device: &args.device,
        guests: args.guests,
        options,
        drive: None,
    };
    // The journal keeps no secrets.
    let in_journal = is_journal();
    if in_journal && matches!(service.tokens, TokenSource::New) {
        let why = "a new token would have to stand in the journal: set TRIMARAN_TOKEN or TRIMARAN_TOKEN_FILE";
        return Err(Failure::bad_input(why));
    }
    let shown = |url: &str| url.split('?').next().filter(|_| in_journal).unwrap_or(url).to_owned();
    service.run(|url| printed(writeln!(stdout(), "{}", shown(url)))).map(drop)
}

/// A culler and its page, open to all clients.
pub(super) struct Service<'s> {
    pub(super) scene: &'s Path,
    /// The model's name.
    pub(super) name: String,
    pub(super) listen: SocketAddr,
    pub(super) tokens: TokenSource<'s>,
    pub(super) tls: Option<TlsFiles>,
    pub(super) proxies: Proxies,
    pub(super) notes: NotesFolder,
    pub(super) frame_ancestors: Vec<FrameAncestor>,
    pub(super) metrics: Option<SocketAddr>,
    pub(super) device: &'s DeviceArgs,
    pub(super) guests: GuestArgs,
    pub(super) options: Options,
    /// A camera path for a page to repeat, as JSON. Its report ends the service.
    pub(super) drive: Option<Vec<u8>>,
}

/// The report of a page's walk, if one has ended the service.
pub(super) type Driven = Option<DriveReport>;

impl Service<'_> {
    /// Serves until it is asked to stop. `ready` gets the page's address once the page can be opened.
    pub(super) fn run(self, ready: impl FnOnce(&str) -> Result<(), Failure>) -> Result<Driven, Failure> {
        let runtime = runtime()?;
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let (stopper, stop) = stoppable_service()?;
        let token_file = self.tokens.file().cloned();
        // In a terminal that is closed, a service with nothing to read again ends.
        let reads_again = token_file.is_some() || self.tls.is_some() || ServiceManager::is_there();
        let hang_ups = reads_again.then(|| HangUps::listen(&runtime)).transpose()?;
        let tokens = self.tokens.read(&*net)?;
        let tls = self.tls.map(Tls::read).transpose().map_err(Failure::bad_input)?;
        let (reports, mut reported) = mpsc::channel(1);
        let drive = self.drive.map(|path| Drive::new(path, reports));
        let server = MetricsServer::start("serve", self.metrics, &self.options.ws, &runtime)?;
        let file = open(self.scene)?;
        let drawn = upload(&file, &self.device.gpu_options())?;
        let GuestArgs { people, max_picture, depth_memory } = self.guests;
        let max_picture = largest(&drawn, max_picture);
        let described = SceneDescription::new(self.name, &file.scene).map_err(Failure::broken)?;
        let description = SceneDescription { max_picture, ..described };
        let (ws, tcp) = (self.options.ws.clone(), self.options.tcp);
        let served = PageOptions {
            tokens,
            tls,
            proxies: self.proxies,
            notes: self.notes,
            frame_ancestors: self.frame_ancestors,
            ws,
            tcp,
        };
        let pages = Pages::new(&file.scene, &description, served, drive).map_err(Failure::bad_input)?;
        net.spawn(Box::pin(keep(pages.clone(), token_file, hang_ups, Arc::clone(&net))));
        let mut options = self.options.with_transports(vec![Arc::new(pages.clone())]);
        let places = people.unwrap_or(options.limits.peers);
        options.limits.peers = places;
        options.link.max_frame = max_frame(&file.scene);
        // The first is the page's.
        let meeting = description.meeting.clone();
        let listen = Endpoints::from(pages.endpoint(self.listen)).and(meeting.clone());
        let at =
            ServiceEndpoints { listen: Some(listen), displays: Vec::new(), cullers: vec![meeting], options };
        let started = runtime.block_on(CullerService::start(&net, file.scene.outline(), at));
        let service =
            started.map_err(|e| if e.may_pass() { Failure::broken(e) } else { Failure::bad_input(e) })?;
        let at = service.endpoints().and_then(|endpoints| endpoints.iter().next());
        if let Some(url) = at.map(|at| pages.url(at)) {
            ready(&url)?;
        }
        let method = CullingMethod::Trimaran;
        let limits = limits(&drawn, max_picture, depth_memory);
        let (metrics, pages) = (server.metrics.clone(), Some(pages));
        let (file, drawn, runtime) = (&file, &drawn, &runtime);
        let host =
            Host { file, drawn, runtime, metrics, method, limits, places, pages, for_one_session: None };
        let (driven, mut report) = oneshot::channel();
        runtime.spawn(async move {
            if let Some(report) = reported.recv().await {
                let _given_up = driven.send(report);
                stopper.stop();
            }
        });
        host.serve(service, &stop)?;
        Ok(report.try_recv().ok())
    }
}
