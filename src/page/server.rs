//! The server of the page: its files are public, the scene needs the token.

use std::{convert::Infallible, fmt, io, net::SocketAddr, sync::Arc, time::Duration};

use http_body_util::{BodyExt, Full, Limited};
use hyper::{
    Method, Request, Response, StatusCode,
    body::{Bytes, Incoming},
    header::{self, HeaderValue},
    server::conn::http1,
    service::service_fn,
    upgrade::OnUpgrade,
};
use hyper_util::rt::{TokioIo, TokioTimer};
use serde::de::DeserializeOwned;
use thiserror::Error;
use tokio::{io::join, sync::mpsc};
use trimaran_net::{BoxFuture, Instant, Listen, Stream, StreamPeer};
use trimaran_scene::{ReadError, Scene};
use trimaran_transport::{
    AttemptError, Endpoint, ListenFault, Listening, Net, TcpOptions, Transport, until,
    ws::{self, WsOptions},
};

use super::{
    SceneDescription, Token,
    answering::Answering,
    assets::ASSETS,
    drive::{Drive, LONGEST_REPORT},
    network::{Network, NetworkError, Networks, Wanted},
    people::{LONGEST_MEETING, People},
    questions::{Answers, Question},
    warnings::Warnings,
};
use crate::http::{self, Asker};

/// The most connections at once; those that have become links do not count.
const CONNECTIONS: usize = 256;
/// The time limits of a request and of a connection.
const ASKING: Duration = Duration::from_secs(10);
const CONNECTION: Duration = Duration::from_secs(120);
/// WebSockets that wait to become links.
const WAITING: usize = 16;

/// A page may load only from its own address; decoders are WebAssembly.
const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; \
                      connect-src 'self'; img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'none'";

/// Why the page cannot be served.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PageError {
    /// The program was built without the page.
    #[error("this program was built without its page: run ./x page in its source, and build it again")]
    NotBuilt,
    /// A part of the scene cannot be read.
    #[error(transparent)]
    Scene(#[from] ReadError),
    /// The scene cannot be described.
    #[error("the scene cannot be described to a page")]
    Description(#[from] serde_json::Error),
    /// There is no thread for answers.
    #[error("the system has no thread to answer pages with")]
    Thread(#[source] io::Error),
}

/// The page of one scene, and the links of its viewers: a transport of the scheme `http`.
#[derive(Clone)]
pub struct Pages(Arc<Inner>);

struct Inner {
    token: Token,
    scene: Bytes,
    answers: Arc<Answers>,
    answering: Answering,
    networks: Networks,
    people: People,
    warnings: Warnings,
    drive: Option<Drive>,
    options: WsOptions,
    tcp: TcpOptions,
}

impl Pages {
    /// The page of a scene, for clients with the `token`.
    ///
    /// # Errors
    /// When the program was built without the page, or a part of the scene cannot be read.
    pub fn new(
        scene: &Arc<Scene>,
        description: &SceneDescription,
        token: Token,
        options: WsOptions,
        tcp: TcpOptions,
        drive: Option<Drive>,
    ) -> Result<Self, PageError> {
        if ASSETS.is_empty() {
            return Err(PageError::NotBuilt);
        }
        let answers = Arc::new(Answers::new(scene, description.eye_height)?);
        let answering = Answering::start(&answers).map_err(PageError::Thread)?;
        let scene = serde_json::to_vec(description)?.into();
        Ok(Self(Arc::new(Inner {
            token,
            scene,
            answers,
            answering,
            networks: Networks::default(),
            people: People::default(),
            warnings: Warnings::default(),
            drive,
            options,
            tcp,
        })))
    }

    /// The endpoint to listen at.
    #[must_use]
    pub fn endpoint(at: SocketAddr) -> Endpoint {
        Endpoint::other("http", &at.to_string())
    }

    /// How many pages are open.
    #[must_use]
    pub fn open(&self, now: Instant) -> usize {
        self.0.people.count(now)
    }

    /// The page's address for a person, if it listens at `at`.
    #[must_use]
    pub fn url(&self, at: &Endpoint) -> String {
        format!("{at}/?token={}", self.0.token.as_str())
    }
}

impl fmt::Debug for Pages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pages").finish_non_exhaustive()
    }
}

impl Transport for Pages {
    fn scheme(&self) -> &'static str {
        "http"
    }

    /// Only browsers connect to a page; displays use `ws://`.
    fn connect<'a>(
        &'a self,
        _net: &'a Arc<dyn Net>,
        address: &'a str,
        _beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>> {
        let cause = io::Error::new(io::ErrorKind::Unsupported, "a page is for browsers: connect to ws://");
        Box::pin(std::future::ready(Err(AttemptError::Connect { address: address.to_owned(), cause })))
    }

    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>> {
        Box::pin(async move {
            let addresses = net.resolve(address).await.map_err(ListenFault::Address)?;
            let at = addresses.first().ok_or_else(|| ListenFault::Address(io::ErrorKind::NotFound.into()))?;
            let (listener, at) = net.listen_tcp(*at, self.0.tcp)?;
            let (links, opened) = mpsc::channel(WAITING);
            let (pages, clock) = (self.clone(), Arc::clone(net));
            let ended = links.clone();
            let each = move |stream| pages.connection(Arc::clone(&clock), links.clone(), stream);
            let serving = http::serve(Arc::clone(net), listener, CONNECTIONS, each);
            net.spawn(Box::pin(async move {
                tokio::select! {
                    () = serving => {}
                    () = ended.closed() => {}
                }
            }));
            Ok(Listening { socket: Box::new(Opened(opened)), address: at.to_string() })
        })
    }
}

/// The bytes of an answer.
pub(super) type Body = Full<Bytes>;

/// How to answer a request.
enum Answer {
    Response(Response<Body>),
    /// The connection becomes a link, maybe over a simulated network.
    Link(Response<Body>, OnUpgrade, Option<Arc<Network>>),
    /// The answer takes a moment.
    Later(Question),
    /// The report of a page's walk.
    Report(Drive),
    /// A page's message with its person's pose.
    Meet,
}

impl From<Response<Body>> for Answer {
    fn from(response: Response<Body>) -> Self {
        Self::Response(response)
    }
}

/// The WebSockets that pages and displays have opened.
struct Opened(mpsc::Receiver<Stream>);

impl Listen for Opened {
    fn accept(&mut self) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async { self.0.recv().await.ok_or_else(|| io::ErrorKind::BrokenPipe.into()) })
    }
}

impl Pages {
    /// Answers the requests of a connection, until it becomes a link or its time is over.
    fn connection(
        &self,
        net: Arc<dyn Net>,
        links: mpsc::Sender<Stream>,
        stream: Stream,
    ) -> BoxFuture<'static, ()> {
        let (pages, clock) = (self.clone(), Arc::clone(&net));
        let Stream { reader, writer, peer } = stream;
        let answer = service_fn(move |mut request: Request<Incoming>| {
            let answer = pages.answer(&mut request, &net);
            let (pages, net, links) = (pages.clone(), Arc::clone(&net), links.clone());
            async move {
                Ok::<_, Infallible>(match answer {
                    Answer::Response(response) => response,
                    Answer::Link(response, upgrade, network) => {
                        net.spawn(Box::pin(open(upgrade, network, peer, links)));
                        response
                    }
                    Answer::Later(question) => pages.think(Asker::of(peer), question).await,
                    Answer::Report(drive) => take_report(request, &drive).await,
                    Answer::Meet => pages.meet(Asker::of(peer), request, net.now()).await,
                })
            }
        });
        let serving = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(ASKING)
            .serve_connection(TokioIo::new(join(reader, writer)), answer)
            .with_upgrades();
        let serving: BoxFuture<'static, _> = Box::pin(serving);
        // A client that goes away, or does not speak HTTP, is not worth a message.
        Box::pin(async move {
            let _served = until(&*clock, clock.now().after(CONNECTION), serving).await;
        })
    }

    fn answer(&self, request: &mut Request<Incoming>, net: &Arc<dyn Net>) -> Answer {
        let path = request.uri().path();
        match path {
            "/drive" => return self.drive(request),
            "/people" if !self.knows_token(request) => return wrong_token().into(),
            "/people" if request.method() == Method::POST => return Answer::Meet,
            _ => {}
        }
        match (path, request.method()) {
            // A page is served once the scene is open.
            ("/livez" | "/readyz", &(Method::GET | Method::HEAD)) => {
                return plain(StatusCode::OK, "ok\n").into();
            }
            (_, &Method::GET) => {}
            _ => return plain(StatusCode::METHOD_NOT_ALLOWED, "only GET\n").into(),
        }
        if path == "/"
            && let Err(ws::ForeignOrigin { origin }) = self.0.options.check_host(request.headers())
        {
            return unknown_name(&origin).into();
        }
        if let Some(asset) = ASSETS.iter().find(|asset| asset.path == path) {
            return asset.answer(request.headers()).into();
        }
        let query = form_urlencoded::parse(request.uri().query().unwrap_or_default().as_bytes());
        let question = Question::parse(path, query);
        match path {
            "/link" => self.link(request, net),
            "/scene" | "/part" | "/children" | "/search" | "/snap" | "/tile"
                if !self.knows_token(request) =>
            {
                wrong_token().into()
            }
            "/scene" => file("application/json", self.0.scene.clone()).into(),
            _ => question.map_or_else(|| nothing_here().into(), Answer::Later),
        }
    }

    /// Sends the walk that a page is to repeat, or takes its report.
    fn drive(&self, request: &Request<Incoming>) -> Answer {
        if !self.knows_token(request) {
            return wrong_token().into();
        }
        match &self.0.drive {
            Some(drive) if request.method() == Method::GET => {
                file("application/json", drive.path.clone()).into()
            }
            Some(drive) if request.method() == Method::POST => Answer::Report(drive.clone()),
            _ => nothing_here().into(),
        }
    }

    /// Registers a person, who meets the others.
    async fn meet(&self, asker: Asker, request: Request<Incoming>, now: Instant) -> Response<Body> {
        let Some(here) = json(request, LONGEST_MEETING).await else {
            return plain(StatusCode::BAD_REQUEST, "that is no place of a person\n");
        };
        match self.0.people.meet(asker, here, now).map(|company| serde_json::to_vec(&company)) {
            Ok(Ok(company)) => file("application/json", company.into()),
            _ => plain(StatusCode::BAD_REQUEST, "that is no place of a person\n"),
        }
    }

    /// Answers on a thread that may block, unlike those of links. Hyper drops this when the client goes away.
    async fn think(&self, asker: Asker, question: Question) -> Response<Body> {
        match self.0.answers.known(&question) {
            Some(known) => known,
            None => self.0.answering.ask(asker, question).await,
        }
    }

    /// Upgrades the connection to a WebSocket.
    fn link(&self, request: &mut Request<Incoming>, net: &Arc<dyn Net>) -> Answer {
        if !self.knows_token(request) {
            return wrong_token().into();
        }
        if let Err(foreign) = self.0.options.check(request.headers()) {
            self.0.warnings.warn(&foreign, net.now());
            return plain(StatusCode::FORBIDDEN, "pages from elsewhere may not connect here\n").into();
        }
        let Some(answer) = ws::answer(request) else {
            return plain(StatusCode::UPGRADE_REQUIRED, "links are WebSockets\n").into();
        };
        let network = match Wanted::of(request.uri().query().unwrap_or_default()) {
            Some(wanted) => self.0.networks.get(wanted, net).map(Some),
            None => Ok(None),
        };
        match network {
            Ok(network) => {
                Answer::Link(answer.map(|()| Full::default()), hyper::upgrade::on(request), network)
            }
            Err(fault) => {
                self.0.warnings.warn(&fault, net.now());
                refused(&fault).into()
            }
        }
    }

    /// Whether the query begins with the token: `?token=...`.
    fn knows_token(&self, request: &Request<Incoming>) -> bool {
        let first = request.uri().query().and_then(|query| query.split('&').next());
        first.and_then(|first| first.strip_prefix("token=")).is_some_and(|given| self.0.token.is(given))
    }
}

/// Hands on a WebSocket once it is upgraded.
async fn open(
    upgrade: OnUpgrade,
    network: Option<Arc<Network>>,
    peer: StreamPeer,
    links: mpsc::Sender<Stream>,
) {
    if let Ok(upgraded) = upgrade.await {
        let connection = TokioIo::new(upgraded);
        let stream = match network {
            Some(network) => ws::stream(network.cross(connection), peer).await,
            None => ws::stream(connection, peer).await,
        };
        let _nobody_left = links.send(stream).await;
    }
}

async fn take_report(request: Request<Incoming>, drive: &Drive) -> Response<Body> {
    match json(request, LONGEST_REPORT).await {
        Some(report) => {
            let _nobody_asks_any_more = drive.reports.send(report).await;
            plain(StatusCode::OK, "")
        }
        None => plain(StatusCode::BAD_REQUEST, "that is no report of a walk\n"),
    }
}

/// Parses the body of a request as JSON of at most this many bytes; `None` if it is not valid.
async fn json<T: DeserializeOwned>(request: Request<Incoming>, longest: usize) -> Option<T> {
    let body = Limited::new(request.into_body(), longest).collect().await.ok()?;
    serde_json::from_slice(&body.to_bytes()).ok()
}

fn refused(fault: &NetworkError) -> Response<Body> {
    match fault {
        NetworkError::Unknown => plain(StatusCode::NOT_FOUND, "there is no such network\n"),
        _ => plain(StatusCode::SERVICE_UNAVAILABLE, "too many pages are on simulated networks\n"),
    }
}

/// A page opened under an unknown host name may not connect, so it is not shown at all.
fn unknown_name(origin: &str) -> Response<Body> {
    let text = format!(
        "This service does not know the name by which it was opened. Open it by its IP address, or let \
         whoever starts it allow the name: TRIMARAN_WS_ALLOW_ORIGINS={origin}\n"
    );
    let mut response = file("text/plain; charset=utf-8", text.into());
    *response.status_mut() = StatusCode::FORBIDDEN;
    response
}

fn nothing_here() -> Response<Body> {
    plain(StatusCode::NOT_FOUND, "there is nothing here\n")
}

fn wrong_token() -> Response<Body> {
    plain(StatusCode::FORBIDDEN, "the token in the address is not the one that was printed at the start\n")
}

pub(super) fn plain(status: StatusCode, text: &'static str) -> Response<Body> {
    let mut response = file("text/plain; charset=utf-8", Bytes::from_static(text.as_bytes()));
    *response.status_mut() = status;
    response
}

pub(super) fn file(kind: &'static str, bytes: Bytes) -> Response<Body> {
    let mut response = Response::new(Full::new(bytes));
    // The address of a page holds a secret: it must not reach other sites.
    for (name, value) in [
        (header::CONTENT_TYPE, kind),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::CACHE_CONTROL, "no-cache"),
    ] {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}
