//! The page that a monitoring system reads.

use std::{collections::VecDeque, convert::Infallible, io, net::SocketAddr, sync::Arc, time::Duration};

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
use tokio::{
    io::{AsyncRead, AsyncWrite},
    net::TcpListener,
    runtime::Handle,
    task::{JoinHandle, JoinSet},
};
use trimaran_transport::{Net, TokioNet, sleep_until, until};

use super::LinkMetrics;

/// The type that Prometheus asks for.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// How many readers are served at once. One more takes the place of whoever came first: it has had time to
/// ask, and who asks in earnest is not kept out by those who say nothing.
const READERS: usize = 64;

/// How long a reader may take to ask and to take the answer. There is one answer to a connection.
const READING: Duration = Duration::from_secs(10);

/// The pause after the system could not accept, for instance for want of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

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
        let (net, listener) = (TokioNet::new(runtime.clone()), Arc::new(listener));
        let accept = move || {
            let listener = Arc::clone(&listener);
            async move { listener.accept().await.map(|(stream, _)| stream) }
        };
        Ok(Serving { address, task: runtime.spawn(show(self, net, accept)) })
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

/// Serves whoever `accept` gives, for ever.
async fn show<S, F>(metrics: LinkMetrics, net: TokioNet, accept: impl Fn() -> F)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
    F: Future<Output = io::Result<S>>,
{
    let (mut readers, mut places, mut failing) = (JoinSet::new(), VecDeque::new(), false);
    loop {
        match accept().await {
            Ok(stream) => {
                failing = false;
                while readers.try_join_next().is_some() {}
                places.retain(|reader: &tokio::task::AbortHandle| !reader.is_finished());
                if places.len() >= READERS
                    && let Some(first) = places.pop_front()
                {
                    first.abort();
                }
                places.push_back(readers.spawn(serve(metrics.clone(), net.clone(), stream)));
            }
            Err(e) => {
                if !failing {
                    let error = &e as &dyn std::error::Error;
                    tracing::warn!(error, "could not accept a reader of the metrics; trying again");
                }
                failing = true;
                sleep_until(&net, net.now().after(ACCEPT_PAUSE)).await;
            }
        }
    }
}

/// Answers one question, if it comes in time.
async fn serve(metrics: LinkMetrics, net: TokioNet, stream: impl AsyncRead + AsyncWrite + Unpin) {
    let answer = service_fn(|request| {
        let response = metrics.answer(&request);
        async move { Ok::<_, Infallible>(response) }
    });
    let reading = http1::Builder::new().keep_alive(false).serve_connection(TokioIo::new(stream), answer);
    // A reader that goes away, or that takes too long, is not worth a word.
    let _read = until(&net, net.now().after(READING), reading).await;
}

fn plain(status: StatusCode, text: &'static str) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::from(text));
    *response.status_mut() = status;
    response
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex},
        sync::{Mutex, mpsc},
    };

    use super::*;

    const QUESTION: &[u8] = b"GET /metrics HTTP/1.1\r\nhost: here\r\n\r\n";

    /// Guests that come one after the other, and the server that takes them.
    fn serving() -> (mpsc::UnboundedSender<DuplexStream>, JoinSet<()>) {
        let (come, guests) = mpsc::unbounded_channel();
        let guests = Arc::new(Mutex::new(guests));
        let accept = move || {
            let guests = Arc::clone(&guests);
            async move { guests.lock().await.recv().await.ok_or_else(|| io::ErrorKind::BrokenPipe.into()) }
        };
        let mut server = JoinSet::new();
        server.spawn(show(LinkMetrics::default(), TokioNet::current().unwrap(), accept));
        (come, server)
    }

    fn guest(come: &mpsc::UnboundedSender<DuplexStream>) -> DuplexStream {
        let (here, there) = duplex(64 << 10);
        come.send(there).unwrap();
        here
    }

    async fn answered(mut guest: DuplexStream) -> String {
        guest.write_all(QUESTION).await.unwrap();
        let mut answer = String::new();
        guest.read_to_string(&mut answer).await.unwrap();
        answer
    }

    /// Not even virtual time passes before the answer.
    #[tokio::test(start_paused = true)]
    async fn a_hundred_silent_readers_keep_nobody_waiting() {
        let net = TokioNet::current().unwrap();
        let (come, _server) = serving();
        let (before, mut silent) = (net.now(), Vec::new());
        for _ in 0..100 {
            silent.push(guest(&come));
            tokio::task::yield_now().await;
        }
        let answer = answered(guest(&come)).await;
        assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.contains("# EOF"), "{answer}");
        assert_eq!(net.now(), before, "it was served at once");
        // No more are held than there are places: those who came first have lost theirs.
        let mut ended = 0;
        for guest in &mut silent {
            let end = until(&net, net.now(), guest.read_u8()).await;
            ended += usize::from(end.is_some());
        }
        assert_eq!(ended, 100 + 1 - READERS);
    }

    #[tokio::test(start_paused = true)]
    async fn a_reader_that_says_nothing_or_half_of_it_is_left_after_ten_seconds() {
        let net = TokioNet::current().unwrap();
        let (come, _server) = serving();
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
        let (come, _server) = serving();
        let began = net.now();
        let answer = answered(guest(&come)).await;
        assert!(answer.contains("connection: close"), "{answer}");
        assert_eq!(net.now(), began, "the reader waited for the end of it");
    }

    /// As without file descriptors.
    #[tokio::test(start_paused = true)]
    async fn a_system_that_cannot_accept_is_asked_again_after_a_pause_and_not_at_once() {
        const FAILURES: usize = 30;
        let net = TokioNet::current().unwrap();
        let (asked, began) = (Cell::new(0), net.now());
        let (here, there) = duplex(64 << 10);
        let there = Cell::new(Some(there));
        let accept = || async {
            asked.set(asked.get() + 1);
            if asked.get() <= FAILURES {
                return Err(io::Error::from_raw_os_error(24));
            }
            match there.take() {
                Some(guest) => Ok(guest),
                None => std::future::pending().await,
            }
        };
        let answer = tokio::select! {
            answer = answered(here) => answer,
            () = show(LinkMetrics::default(), net.clone(), accept) => panic!("it shows for ever"),
        };
        assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
        assert_eq!(net.now().since(began), ACCEPT_PAUSE * FAILURES as u32);
    }
}
