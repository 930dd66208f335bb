//! The HTTP server that a monitoring system reads.

use std::{convert::Infallible, io, net::SocketAddr, sync::Arc, time::Duration};

use http_body_util::Full;
use hyper::{
    Method, Request, Response, StatusCode,
    body::{Bytes, Incoming},
    header::CONTENT_TYPE,
    server::conn::http1,
    service::service_fn,
};
use hyper_util::rt::TokioIo;
use serde::Serialize;
use thiserror::Error;
use tokio::{io::join, runtime::Handle, task::JoinHandle};
use trimaran_net::{BoxFuture, Stream};
use trimaran_transport::{
    Net, TcpOptions, TokioNet, until,
    ws::{ForeignOrigin, WsOptions},
};

use super::{Metrics, exposition::TEXT_FORMAT};
use crate::http;

const JSON: &str = "application/json";

/// How many readers are served at once.
const READERS: usize = 64;

/// How long a reader may take to ask and to take the answer. A connection has one answer.
const READING: Duration = Duration::from_secs(10);

/// Why the metrics cannot be served.
#[derive(Debug, Error)]
#[error("cannot show metrics on {address}: {cause}: choose another address in `metrics`")]
pub struct MetricsError {
    /// The address to listen on.
    pub address: SocketAddr,
    /// The system's error.
    #[source]
    pub cause: io::Error,
}

/// Serves metrics until this is dropped.
#[derive(Debug)]
pub struct Serving {
    address: SocketAddr,
    task: JoinHandle<()>,
}

impl Serving {
    /// The address, with the port that the system chose if it was 0.
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

impl Metrics {
    /// Serves them on `address`, on the threads of `runtime`, to clients whose `Host` is an IP address,
    /// `localhost` or a name that `names` allows. Other names are refused against DNS rebinding by pages in a
    /// browser.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub fn serve(
        self,
        address: SocketAddr,
        names: &WsOptions,
        runtime: &Handle,
    ) -> Result<Serving, MetricsError> {
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let (listener, address) = (net.listen_tcp(address, TcpOptions::default()))
            .map_err(|cause| MetricsError { address, cause })?;
        let page = Arc::new(Page { metrics: self, names: names.clone() });
        let clock = Arc::clone(&net);
        let each = move |stream| answer(Arc::clone(&page), Arc::clone(&clock), stream);
        Ok(Serving { address, task: runtime.spawn(http::serve(net, listener, READERS, each)) })
    }
}

/// The metrics, and the allowed names.
struct Page {
    metrics: Metrics,
    names: WsOptions,
}

impl Page {
    fn answer(&self, request: &Request<Incoming>) -> Response<Full<Bytes>> {
        if let Err(ForeignOrigin { origin }) = self.names.check_host(request.headers()) {
            return unknown_name(&origin);
        }
        // Hyper leaves out the body of an answer to HEAD.
        if !matches!(*request.method(), Method::GET | Method::HEAD) {
            return plain(StatusCode::METHOD_NOT_ALLOWED, "only GET and HEAD\n");
        }
        let Self { metrics, .. } = self;
        let page = match request.uri().path() {
            "/metrics" => metrics.text().map(|text| (TEXT_FORMAT, text)).ok(),
            "/status" => json(&metrics.status()),
            "/links" => json(&metrics.links().read()),
            "/livez" => return plain(StatusCode::OK, "ok\n"),
            "/readyz" if metrics.is_ready() => return plain(StatusCode::OK, "ok\n"),
            "/readyz" => {
                return plain(StatusCode::SERVICE_UNAVAILABLE, "scene, device or sockets are not open yet\n");
            }
            _ => {
                let there = "there is /metrics, /status, /links, /livez and /readyz\n";
                return plain(StatusCode::NOT_FOUND, there);
            }
        };
        let Some((content_type, text)) = page else {
            return plain(StatusCode::INTERNAL_SERVER_ERROR, "the metrics cannot be written\n");
        };
        let mut response = Response::new(Full::from(text));
        response.headers_mut().insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static(content_type));
        response
    }
}

fn json(reading: &impl Serialize) -> Option<(&'static str, String)> {
    serde_json::to_string(reading).map(|text| (JSON, text)).ok()
}

/// Answers one request, if it comes in time.
fn answer(page: Arc<Page>, net: Arc<dyn Net>, stream: Stream) -> BoxFuture<'static, ()> {
    Box::pin(async move {
        let answer = service_fn(|request| {
            let response = page.answer(&request);
            async move { Ok::<_, Infallible>(response) }
        });
        let stream = TokioIo::new(join(stream.reader, stream.writer));
        let reading = http1::Builder::new().keep_alive(false).serve_connection(stream, answer);
        // A reader that goes away, or takes too long, is not worth a message.
        let _read = until(&*net, net.now().after(READING), reading).await;
    })
}

fn unknown_name(origin: &str) -> Response<Full<Bytes>> {
    let text = format!(
        "These metrics are not known by that name. Ask by the IP address, or allow the name: \
         -o ws.allow_origins={origin}\n"
    );
    let mut response = Response::new(Full::from(text));
    *response.status_mut() = StatusCode::FORBIDDEN;
    response
}

fn plain(status: StatusCode, text: &'static str) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::from(text));
    *response.status_mut() = status;
    response
}

#[cfg(test)]
mod tests {
    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt, DuplexStream},
        sync::mpsc,
        task::JoinSet,
    };

    use super::*;
    use crate::{
        http::tests::{Guests, guest},
        metrics::StatusReading,
    };

    const QUESTION: &[u8] = b"GET /metrics HTTP/1.1\r\nhost: 127.0.0.1:9\r\n\r\n";

    /// Clients that come one after the other, and the server that takes them.
    fn serving(metrics: Metrics) -> (mpsc::UnboundedSender<DuplexStream>, JoinSet<()>) {
        let (come, guests) = mpsc::unbounded_channel();
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let clock = Arc::clone(&net);
        let names = WsOptions::default().with_allow_origins(vec!["http://pages:9".parse().unwrap()]);
        let page = Arc::new(Page { metrics, names });
        let each = move |stream| answer(Arc::clone(&page), Arc::clone(&clock), stream);
        let mut server = JoinSet::new();
        server.spawn(http::serve(net, Box::new(Guests(guests)), READERS, each));
        (come, server)
    }

    async fn answered(guest: DuplexStream) -> String {
        answer_to(QUESTION, guest).await
    }

    async fn answer_to(question: &[u8], mut guest: DuplexStream) -> String {
        guest.write_all(question).await.unwrap();
        let mut answer = String::new();
        guest.read_to_string(&mut answer).await.unwrap();
        answer
    }

    #[tokio::test(start_paused = true)]
    async fn a_reader_that_says_nothing_or_half_of_it_is_left_after_ten_seconds() {
        let net = TokioNet::current().unwrap();
        let (come, _server) = serving(Metrics::new("culler"));
        for question in [&[][..], &QUESTION[..9]] {
            let (mut guest, began) = (guest(&come), net.now());
            guest.write_all(question).await.unwrap();
            let mut answer = Vec::new();
            guest.read_to_end(&mut answer).await.unwrap();
            assert_eq!(net.now().since(began), READING);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_connection_is_closed_behind_its_answer() {
        let net = TokioNet::current().unwrap();
        let (come, _server) = serving(Metrics::new("culler"));
        let began = net.now();
        let answer = answered(guest(&come)).await;
        assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.contains("trimaran_build_info"), "{answer}");
        assert!(answer.contains("connection: close"), "{answer}");
        assert_eq!(net.now(), began, "the reader waited for the end of it");
    }

    /// DNS rebinding: a page in a browser gives this machine a name of its own, and asks by that.
    #[tokio::test(start_paused = true)]
    async fn whoever_asks_by_a_foreign_name_is_told_nothing() {
        let (come, _server) = serving(Metrics::new("culler"));
        for page in ["/metrics", "/status", "/links", "/livez"] {
            for (name, answer) in [
                ("evil.example", "HTTP/1.1 403"),
                ("127.0.0.1.evil.example:9", "HTTP/1.1 403"),
                ("localhost:9", "HTTP/1.1 200"),
                ("[::1]:9", "HTTP/1.1 200"),
                ("pages:9", "HTTP/1.1 200"),
            ] {
                let question = format!("GET {page} HTTP/1.1\r\nhost: {name}\r\n\r\n");
                let told = answer_to(question.as_bytes(), guest(&come)).await;
                assert!(told.starts_with(answer), "{page} by {name}: {told}");
            }
        }
    }
    #[tokio::test(start_paused = true)]
    async fn a_probe_hears_whether_the_process_lives_and_whether_it_is_ready() {
        let metrics = Metrics::new("culler");
        let (come, _server) = serving(metrics.clone());
        let told = async |method: &str, page: &str| {
            let question = format!("{method} {page} HTTP/1.1\r\nhost: 10.0.0.7\r\n\r\n");
            answer_to(question.as_bytes(), guest(&come)).await
        };
        assert!(told("GET", "/livez").await.starts_with("HTTP/1.1 200"));
        assert!(told("GET", "/readyz").await.starts_with("HTTP/1.1 503"));
        metrics.ready();
        assert!(told("GET", "/readyz").await.starts_with("HTTP/1.1 200"));
        for page in ["/livez", "/readyz", "/metrics"] {
            let answer = told("HEAD", page).await;
            assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("\r\n\r\n"), "{answer}");
        }
        assert!(told("POST", "/readyz").await.starts_with("HTTP/1.1 405"));
        let status: StatusReading =
            serde_json::from_str(told("GET", "/status").await.split("\r\n\r\n").nth(1).unwrap()).unwrap();
        assert_eq!((status.role.as_str(), status.ready), ("culler", true));
    }
}
