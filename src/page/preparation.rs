//! The page while its model is prepared: it shows how far that is, or why it failed.

use std::{convert::Infallible, fmt, io, net::SocketAddr, sync::Arc, time::Duration};

use hyper::{
    Method, Request, Response, StatusCode,
    body::Incoming,
    header::{self, HeaderValue},
    server::conn::http1,
    service::service_fn,
};
use hyper_util::rt::{TokioIo, TokioTimer};
use parking_lot::{Condvar, Mutex};
use serde::Serialize;
use tokio::{io::join, runtime::Handle};
use trimaran_net::{BoxFuture, Stream};
use trimaran_transport::{
    Net, TcpOptions, TokioNet, until,
    ws::{ForeignOrigin, WsOptions},
};

use super::{
    FrameAncestor, Token, Tokens,
    access::Access,
    assets::ASSETS,
    embedding,
    server::{Body, file, nothing_here, plain, token_in, unknown_name, wrong_token},
};
use crate::http;

/// The most connections at once, and their time limit.
const CONNECTIONS: usize = 64;
const CONNECTION: Duration = Duration::from_secs(10);
/// How long a failure is kept for the page that is to show it.
const TELLING: Duration = Duration::from_secs(10);

/// How far the preparation of a model is. Clones are the same one.
#[derive(Clone, Default)]
pub struct Preparation(Arc<Shared>);

#[derive(Default)]
struct Shared {
    now: Mutex<Now>,
    is_told: Condvar,
}

#[derive(Default)]
struct Now {
    stage: Stage,
    failure: Option<String>,
    /// A page has asked.
    is_watched: bool,
    /// A page has the failure.
    is_told: bool,
}

/// A stage, as pages get it.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Stage {
    stage: &'static str,
    done: usize,
    /// Zero if it is not known.
    total: usize,
}

impl Preparation {
    /// A stage of `total` steps begins; zero if their number is not known.
    pub fn begin(&self, stage: &'static str, total: usize) {
        self.0.now.lock().stage = Stage { stage, done: 0, total };
    }

    /// This many more steps of the stage are done.
    pub fn advance(&self, steps: usize) {
        self.0.now.lock().stage.done += steps;
    }

    /// The preparation has failed. Waits for a page to get the reason: at most ten seconds, and not at all if
    /// no page has asked and none `is_expected`.
    pub fn fail(&self, why: &str, is_expected: bool) {
        let mut now = self.0.now.lock();
        now.failure = Some(why.to_owned());
        if now.is_watched || is_expected {
            self.0.is_told.wait_while_for(&mut now, |now| !now.is_told, TELLING);
        }
    }

    /// Serves the page at `at` to those who have the token, on the threads of `runtime`, until that ends.
    /// The `ancestors` may show it in a frame. Returns where it listens; `None` if the program was built
    /// without its page.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub fn serve(
        &self,
        token: &Token,
        at: SocketAddr,
        ws: &WsOptions,
        ancestors: &[FrameAncestor],
        runtime: &Handle,
    ) -> io::Result<Option<SocketAddr>> {
        if ASSETS.is_empty() {
            return Ok(None);
        }
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let (listener, at) = net.listen_tcp(at, TcpOptions::default())?;
        let access = Access::default();
        access.replace(&Tokens::One(token.clone()));
        let page = Arc::new(Page {
            preparation: self.clone(),
            access,
            ws: ws.clone(),
            policy: embedding::policy(ancestors),
        });
        let clock = Arc::clone(&net);
        let each = move |stream| Arc::clone(&page).connection(Arc::clone(&clock), stream);
        runtime.spawn(http::serve(net, listener, CONNECTIONS, each));
        Ok(Some(at))
    }
}

impl fmt::Debug for Preparation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Preparation").field(&self.0.now.lock().stage).finish()
    }
}

struct Page {
    preparation: Preparation,
    access: Access,
    ws: WsOptions,
    policy: HeaderValue,
}

impl Page {
    /// Answers one request.
    fn connection(self: Arc<Self>, net: Arc<dyn Net>, stream: Stream) -> BoxFuture<'static, ()> {
        Box::pin(async move {
            let tells = Mutex::new(false);
            let answer = service_fn(|request| {
                let mut response = self.answer(&request);
                response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, self.policy.clone());
                *tells.lock() = response.status() == StatusCode::UNPROCESSABLE_ENTITY;
                async move { Ok::<_, Infallible>(response) }
            });
            let stream = TokioIo::new(join(stream.reader, stream.writer));
            let serving = http1::Builder::new()
                .timer(TokioTimer::new())
                .keep_alive(false)
                .serve_connection(stream, answer);
            let served = until(&*net, net.now().after(CONNECTION), serving).await;
            if matches!(served, Some(Ok(()))) && *tells.lock() {
                self.preparation.0.now.lock().is_told = true;
                self.preparation.0.is_told.notify_all();
            }
        })
    }

    fn answer(&self, request: &Request<Incoming>) -> Response<Body> {
        if request.method() != Method::GET {
            return plain(StatusCode::METHOD_NOT_ALLOWED, "only GET\n");
        }
        let path = request.uri().path();
        if path == "/"
            && let Err(ForeignOrigin { origin }) = self.ws.check_host(request.headers())
        {
            return unknown_name(&origin);
        }
        if let Some(asset) = ASSETS.iter().find(|asset| asset.path == path) {
            return asset.answer(request.headers());
        }
        if path != "/scene" {
            return nothing_here();
        }
        match token_in(request).and_then(|token| self.access.grant(token)) {
            Some(_) => self.progress(),
            None => wrong_token(),
        }
    }

    /// The stage, or the failure.
    fn progress(&self) -> Response<Body> {
        let mut now = self.preparation.0.now.lock();
        now.is_watched = true;
        let (status, mut response) = match (&now.failure, serde_json::to_vec(&now.stage)) {
            (Some(why), _) => {
                let text = format!("The model cannot be shown: {why}\n");
                (StatusCode::UNPROCESSABLE_ENTITY, file("text/plain; charset=utf-8", text.into()))
            }
            (None, Ok(stage)) => (StatusCode::ACCEPTED, file("application/json", stage.into())),
            (None, Err(_)) => return nothing_here(),
        };
        *response.status_mut() = status;
        response
    }
}
