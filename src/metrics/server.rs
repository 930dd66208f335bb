//! The page that a monitoring system reads.

use std::{convert::Infallible, io, net::SocketAddr};

use http_body_util::Full;
use hyper::{
    Method, Request, Response, StatusCode,
    body::{Bytes, Incoming},
    header::CONTENT_TYPE,
    server::conn::http1,
    service::service_fn,
};
use hyper_util::rt::TokioIo;
use thiserror::Error;
use tokio::{net::TcpListener, runtime::Handle, sync::Semaphore, task::JoinHandle};

use super::LinkMetrics;

/// The type that Prometheus asks for.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// How many readers are served at once; more wait.
const READERS: usize = 16;

/// Why the metrics cannot be shown.
#[derive(Debug, Error)]
#[error("cannot show metrics on {address}: {cause}: choose another address in `metrics`")]
pub struct MetricsError {
    /// Where they should be.
    pub address: SocketAddr,
    /// Why.
    #[source]
    pub cause: io::Error,
}

/// Metrics that are being shown, until this is dropped.
#[derive(Debug)]
pub struct Serving {
    address: SocketAddr,
    task: JoinHandle<()>,
}

impl Serving {
    /// Where they are: the port that the system chose, if it was to choose one.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl LinkMetrics {
    /// Shows them on `address`, on the threads of `runtime`.
    ///
    /// # Errors
    /// When nobody can listen there.
    pub fn serve(self, address: SocketAddr, runtime: &Handle) -> Result<Serving, MetricsError> {
        let failed = |cause| MetricsError { address, cause };
        let listener = std::net::TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let within = runtime.enter();
        let listener = TcpListener::from_std(listener).map_err(failed)?;
        drop(within);
        let address = listener.local_addr().map_err(failed)?;
        Ok(Serving { address, task: runtime.spawn(show(self, listener, runtime.clone())) })
    }

    fn answer(&self, request: &Request<Incoming>) -> Response<Full<Bytes>> {
        let page = match (request.method(), request.uri().path()) {
            (&Method::GET, "/metrics") => self.text().map(|text| (OPEN_METRICS, text)).ok(),
            (&Method::GET, "/links") => {
                serde_json::to_string(&self.read()).map(|text| ("application/json", text)).ok()
            }
            (&Method::GET, "/listener") => {
                serde_json::to_string(&self.turned_away()).map(|text| ("application/json", text)).ok()
            }
            (&Method::GET, _) => {
                return plain(StatusCode::NOT_FOUND, "there is /metrics, /links and /listener\n");
            }
            _ => return plain(StatusCode::METHOD_NOT_ALLOWED, "only GET\n"),
        };
        let Some((content_type, text)) = page else {
            return plain(StatusCode::INTERNAL_SERVER_ERROR, "the metrics cannot be written\n");
        };
        let mut response = Response::new(Full::from(text));
        response.headers_mut().insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static(content_type));
        response
    }
}

async fn show(metrics: LinkMetrics, listener: TcpListener, runtime: Handle) {
    let places = std::sync::Arc::new(Semaphore::new(READERS));
    while let Ok(place) = std::sync::Arc::clone(&places).acquire_owned().await {
        let Ok((stream, _)) = listener.accept().await else { continue };
        let metrics = metrics.clone();
        runtime.spawn(async move {
            let answer = service_fn(|request| {
                let response = metrics.answer(&request);
                async move { Ok::<_, Infallible>(response) }
            });
            // A reader that goes away is not worth a word. One that says nothing keeps its place, not the session's time.
            let _read =
                http1::Builder::new().keep_alive(false).serve_connection(TokioIo::new(stream), answer).await;
            drop(place);
        });
    }
}

fn plain(status: StatusCode, text: &'static str) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::from(text));
    *response.status_mut() = status;
    response
}
