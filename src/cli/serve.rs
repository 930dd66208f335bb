//! `trimaran serve`: a scene for whoever comes with a browser or a display.

use std::{
    io::{self, Write},
    sync::Arc,
};

use trimaran::{
    config::options,
    culling::CullingMethod,
    page::{Pages, SceneDescription, Token},
};
use trimaran_actors::{CullerService, ServiceEndpoints, max_frame};
use trimaran_transport::{Net, Options, TokioNet};

use super::{
    Failure,
    args::ServeArgs,
    culling::Host,
    printed,
    walking::{Metrics, gpu_options, open, runtime, stop_on_signal, upload},
};

pub(super) fn run(args: &ServeArgs) -> Result<(), Failure> {
    let options = options(&args.links.options, toml::Table::new()).map_err(Failure::bad_input)?;
    let runtime = runtime()?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let stop = stop_on_signal(&runtime);
    let file = open(&args.scene)?;
    let description = SceneDescription::new(&args.scene, &file.scene).map_err(Failure::broken)?;
    let token = match &args.token {
        Some(token) => token.clone(),
        None => Token::random(&*net).map_err(Failure::broken)?,
    };
    let pages =
        Pages::new(&description, token, options.ws.clone(), options.tcp).map_err(Failure::bad_input)?;
    let gpu = gpu_options(args.device.as_deref(), args.gpu_memory, args.device_timeout);
    let drawn = upload(&file, &gpu)?;
    let metrics = Metrics::show(args.metrics, &runtime)?;
    let mut options = Options { transports: vec![Arc::new(pages.clone())], ..options };
    options.link.max_frame = max_frame(&file.scene);
    let at =
        ServiceEndpoints { listen: Some(Pages::endpoint(args.listen).into()), displays: Vec::new(), options };
    let started = runtime.block_on(CullerService::start(&net, file.scene.outline(), at));
    let service =
        started.map_err(|e| if e.may_pass() { Failure::broken(e) } else { Failure::bad_input(e) })?;
    for at in service.endpoints().into_iter().flat_map(trimaran_transport::Endpoints::iter) {
        printed(writeln!(io::stdout(), "{}", pages.url(at)))?;
    }
    let method = CullingMethod::Trimaran;
    let host = Host { file: &file, drawn: &drawn, runtime: &runtime, links: metrics.links(), method };
    host.serve(service, &stop)
}
