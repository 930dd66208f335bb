//! The server of the page: its files are public, the scene needs the token.

use std::{
    convert::Infallible,
    fmt, io,
    net::SocketAddr,
    sync::Arc,
    time::{Duration, SystemTime},
};

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
use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;
use tokio::{
    io::join,
    sync::{Semaphore, mpsc},
};
use trimaran_net::{BoxFuture, Instant, Listen, Stream, StreamPeer};
use trimaran_scene::{ReadError, Scene};
use trimaran_transport::{
    AttemptError, Endpoint, ListenFault, Listening, Net, TcpOptions, Transport, until,
    ws::{self, WsOptions},
};

use super::{
    SceneDescription,
    access::{Access, Grant},
    answering::{Answering, busy},
    assets::ASSETS,
    clash::{ClashJobs, LONGEST_REQUEST},
    drive::{Drive, LONGEST_REPORT},
    embedding::{self, FrameAncestor},
    network::{Network, NetworkError, Networks, Wanted},
    notes::{LONGEST_BCF, LONGEST_NOTE, NotesQuestion, Person},
    people::{LONGEST_MEETING, People},
    proxies::{Asked, Proxies},
    questions::{Answers, Question},
    tls::{Tls, TlsError},
    tokens::{May, PersonName, Tokens},
    warnings::Warnings,
};
use crate::{
    http::{self, Asker},
    notes::{Guid, NotesFolder},
};

/// The most connections at once; those that have become links do not count.
const CONNECTIONS: usize = 256;
/// The time limits of a request and of a connection.
const ASKING: Duration = Duration::from_secs(10);
const CONNECTION: Duration = Duration::from_secs(120);
/// WebSockets that wait to become links.
const WAITING: usize = 16;

/// A page may load only from its own address, and only its own pages show it; decoders are WebAssembly.
pub(super) const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; \
                      connect-src 'self'; img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'self'";

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

/// How a page is served, and to whom.
#[derive(Debug)]
pub struct PageOptions {
    /// The tokens that open it.
    pub tokens: Tokens,
    /// Its certificate; without one it is not encrypted.
    pub tls: Option<Tls>,
    /// The proxies in front of it.
    pub proxies: Proxies,
    /// The scene's notes.
    pub notes: NotesFolder,
    /// The pages that may show it in a frame and drive it, besides its own.
    pub frame_ancestors: Vec<FrameAncestor>,
    /// The options of its links.
    pub ws: WsOptions,
    /// Those of its connections.
    pub tcp: TcpOptions,
}

/// The page of one scene, and the links of its viewers: a transport of the scheme `http`, or `https`.
#[derive(Clone)]
pub struct Pages(Arc<Inner>);

struct Inner {
    /// The text behind `token=` in the page's address.
    shown: String,
    access: Access,
    tls: Option<Tls>,
    proxies: Proxies,
    /// The content security policy.
    policy: HeaderValue,
    scene: Bytes,
    answers: Arc<Answers>,
    answering: Answering,
    /// BCF files are large: they are taken one at a time.
    bcf: Semaphore,
    clashes: ClashJobs,
    networks: Networks,
    people: People,
    warnings: Warnings,
    drive: Option<Drive>,
    ws: WsOptions,
    tcp: TcpOptions,
}

/// A scene's description, with that of its hierarchy.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Described<'d> {
    #[serde(flatten)]
    scene: &'d SceneDescription,
    /// How many named groups an object is in, at most: without its file.
    group_levels: usize,
    /// The origins that may show the page in a frame.
    frame_ancestors: &'d [FrameAncestor],
}

/// A person's own token takes its place in the address.
const OWN_TOKEN: &str = "TOKEN";

impl Pages {
    /// The page of a scene.
    ///
    /// # Errors
    /// When the program was built without the page, or a part of the scene cannot be read.
    pub fn new(
        scene: &Arc<Scene>,
        description: &SceneDescription,
        options: PageOptions,
        drive: Option<Drive>,
    ) -> Result<Self, PageError> {
        if ASSETS.is_empty() {
            return Err(PageError::NotBuilt);
        }
        let PageOptions { tokens, tls, proxies, notes, frame_ancestors, ws, tcp } = options;
        let answers = Arc::new(Answers::new(scene, notes, description.eye_height)?);
        let answering = Answering::start(&answers).map_err(PageError::Thread)?;
        let clashes = ClashJobs::new(scene, description.name.clone());
        let group_levels = answers.group_levels();
        let described = Described { scene: description, group_levels, frame_ancestors: &frame_ancestors };
        let scene = serde_json::to_vec(&described)?.into();
        let shown = match &tokens {
            Tokens::One(token) => token.as_str(),
            Tokens::Listed(_) => OWN_TOKEN,
        };
        let (shown, access) = (shown.to_owned(), Access::default());
        access.replace(&tokens);
        Ok(Self(Arc::new(Inner {
            shown,
            access,
            tls,
            proxies,
            policy: embedding::policy(&frame_ancestors),
            scene,
            answers,
            answering,
            bcf: Semaphore::new(1),
            clashes,
            networks: Networks::default(),
            people: People::default(),
            warnings: Warnings::default(),
            drive,
            ws,
            tcp,
        })))
    }

    /// The endpoint to listen at.
    #[must_use]
    pub fn endpoint(&self, at: SocketAddr) -> Endpoint {
        Endpoint::other(self.scheme(), &at.to_string())
    }

    /// How many pages are open.
    #[must_use]
    pub fn open(&self, now: Instant) -> usize {
        self.0.people.count(now)
    }

    /// The page's address for a person, if it listens at `at`.
    #[must_use]
    pub fn url(&self, at: &Endpoint) -> String {
        format!("{at}/?token={}", self.0.shown)
    }

    /// Takes these tokens in place of those before. Links of the others end.
    pub fn replace_tokens(&self, tokens: &Tokens) {
        self.0.access.replace(tokens);
    }

    /// Ends the tokens whose time has come, and their links.
    pub fn expire_tokens(&self, now: SystemTime) {
        self.0.access.expire(now);
    }

    /// Reads the certificate again, for new connections.
    ///
    /// # Errors
    /// If the new one cannot be used: then the old one stays.
    pub fn renew_certificate(&self) -> Result<(), TlsError> {
        self.0.tls.as_ref().map_or(Ok(()), Tls::read_again)
    }
}

impl fmt::Debug for Pages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pages").finish_non_exhaustive()
    }
}

impl Transport for Pages {
    fn scheme(&self) -> &'static str {
        if self.is_encrypted() { "https" } else { "http" }
    }

    fn is_encrypted(&self) -> bool {
        self.0.tls.is_some()
    }

    /// Only browsers connect to a page; displays use `ws://` or `wss://`.
    fn connect<'a>(
        &'a self,
        _net: &'a Arc<dyn Net>,
        address: &'a str,
        _beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>> {
        let cause =
            io::Error::new(io::ErrorKind::Unsupported, "a page is for browsers: connect to ws:// or wss://");
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

/// The paths that take a token.
const OF_THE_SCENE: [&str; 22] = [
    "/drive",
    "/people",
    "/clash",
    "/link",
    "/scene",
    "/part",
    "/children",
    "/search",
    "/objects",
    "/box",
    "/rows",
    "/attributes",
    "/classes",
    "/snap",
    "/surface",
    "/object",
    "/clearance",
    "/tile",
    "/notes",
    "/note",
    "/note-picture",
    "/notes.bcf",
];

/// Those to which a page posts.
const POSTED: [&str; 6] = ["/drive", "/people", "/clash", "/box", "/notes", "/notes.bcf"];

/// The bytes of an answer.
pub(super) type Body = Full<Bytes>;

/// How to answer a request.
enum Answer {
    Response(Response<Body>),
    /// The connection becomes a link.
    Link(Response<Body>, Opening),
    /// The answer takes a moment.
    Later(Question),
    /// The report of a page's walk.
    Report(Drive),
    /// A page's message with its person's pose.
    Meet(Option<PersonName>),
    /// A page's message with a note of this person.
    Note(Person),
    /// A page's BCF file, from this person.
    Bcf(Person),
    /// A page's request about its search for clashes.
    Clash,
    /// A page's set of objects, for the box around them.
    Bounds,
}

/// A link that is being opened.
struct Opening {
    upgrade: OnUpgrade,
    /// The simulated network that it crosses.
    network: Option<Arc<Network>>,
    grant: Grant,
    peer: StreamPeer,
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
        let pages = self.clone();
        Box::pin(async move {
            let encrypted = match &pages.0.tls {
                Some(tls) => until(&*net, net.now().after(ASKING), tls.accept(stream)).await,
                None => Some(Ok(stream)),
            };
            // A client that goes away, or does not speak TLS or HTTP, is not worth a message.
            let Some(Ok(Stream { reader, writer, peer })) = encrypted else { return };
            let clock = Arc::clone(&net);
            let answer = service_fn(move |request| {
                pages.clone().answer(request, peer, Arc::clone(&net), links.clone())
            });
            let serving = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(ASKING)
                .serve_connection(TokioIo::new(join(reader, writer)), answer)
                .with_upgrades();
            let serving: BoxFuture<'static, _> = Box::pin(serving);
            let _served = until(&*clock, clock.now().after(CONNECTION), serving).await;
        })
    }

    /// Answers a request that came from `peer`, the client or a proxy.
    async fn answer(
        self,
        mut request: Request<Incoming>,
        peer: StreamPeer,
        net: Arc<dyn Net>,
        links: mpsc::Sender<Stream>,
    ) -> Result<Response<Body>, Infallible> {
        let asked = self.0.proxies.asked(peer, request.headers(), self.is_encrypted());
        let asker = Asker::of(asked.peer);
        let policy = self.0.policy.clone();
        let mut response = match self.decide(&mut request, asked, &net) {
            Answer::Response(response) => response,
            Answer::Link(response, opening) => {
                net.spawn(Box::pin(open(opening, links)));
                response
            }
            Answer::Later(question) => self.think(asker, question).await,
            Answer::Report(drive) => take_report(request, &drive).await,
            Answer::Meet(name) => self.meet(asker, name, request, net.now()).await,
            Answer::Note(person) => self.take_note(asker, person, request, &*net).await,
            Answer::Bcf(person) => self.take_bcf(asker, person, request).await,
            Answer::Clash => self.clash(request, &net).await,
            Answer::Bounds => self.bounds(asker, request).await,
        };
        response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy);
        Ok(response)
    }

    fn decide(&self, request: &mut Request<Incoming>, asked: Asked, net: &Arc<dyn Net>) -> Answer {
        let path = request.uri().path();
        let is_post = request.method() == Method::POST && POSTED.contains(&path);
        match (path, request.method()) {
            // A page is served once the scene is open.
            ("/livez" | "/readyz", &(Method::GET | Method::HEAD)) => {
                return plain(StatusCode::OK, "ok\n").into();
            }
            (_, &Method::GET) => {}
            _ if is_post => {}
            _ => return plain(StatusCode::METHOD_NOT_ALLOWED, "only GET\n").into(),
        }
        if path == "/"
            && let Err(ws::ForeignOrigin { origin }) = self.0.ws.check_site(&asked.site)
        {
            return unknown_name(&origin).into();
        }
        if let Some(asset) = ASSETS.iter().find(|asset| asset.path == path) {
            return asset.answer(request.headers()).into();
        }
        if !OF_THE_SCENE.contains(&path) {
            return nothing_here().into();
        }
        let Some(grant) = self.grant(request) else { return wrong_token().into() };
        let name = asked.name.clone().or_else(|| grant.name.clone());
        let person = Person { name: name.clone(), may_write: grant.may == May::Write };
        match path {
            "/drive" => self.drive(request),
            "/people" if is_post => Answer::Meet(name),
            "/notes" | "/notes.bcf" if is_post && !person.may_write => {
                plain(StatusCode::CONFLICT, "this token lets its holder look, and write nothing\n").into()
            }
            "/notes" if is_post => Answer::Note(person),
            "/notes.bcf" if is_post => Answer::Bcf(person),
            "/clash" if is_post => Answer::Clash,
            "/box" if is_post => Answer::Bounds,
            "/link" => self.link(request, &asked, grant, net),
            "/scene" => {
                tell_of(name.as_ref(), asked.peer);
                file("application/json", self.0.scene.clone()).into()
            }
            _ => {
                let query = form_urlencoded::parse(request.uri().query().unwrap_or_default().as_bytes());
                Question::parse(path, query, person).map_or_else(|| nothing_here().into(), Answer::Later)
            }
        }
    }

    /// Sends the walk that a page is to repeat, or takes its report.
    fn drive(&self, request: &Request<Incoming>) -> Answer {
        match &self.0.drive {
            Some(drive) if request.method() == Method::GET => {
                file("application/json", drive.path.clone()).into()
            }
            Some(drive) if request.method() == Method::POST => Answer::Report(drive.clone()),
            _ => nothing_here().into(),
        }
    }

    /// Registers a person, who meets the others.
    async fn meet(
        &self,
        asker: Asker,
        name: Option<PersonName>,
        request: Request<Incoming>,
        now: Instant,
    ) -> Response<Body> {
        let Some(here) = json(request, LONGEST_MEETING).await else {
            return plain(StatusCode::BAD_REQUEST, "that is no place of a person\n");
        };
        match self.0.people.meet(asker, name, here, now).map(|company| serde_json::to_vec(&company)) {
            Ok(Ok(company)) => file("application/json", company.into()),
            _ => plain(StatusCode::BAD_REQUEST, "that is no place of a person\n"),
        }
    }

    async fn take_note(
        &self,
        asker: Asker,
        person: Person,
        request: Request<Incoming>,
        net: &dyn Net,
    ) -> Response<Body> {
        let Some(body) = body(request, LONGEST_NOTE).await else {
            return plain(StatusCode::PAYLOAD_TOO_LARGE, "the note is too large\n");
        };
        let Ok(fresh) = fresh(net) else {
            return plain(StatusCode::INTERNAL_SERVER_ERROR, "there are no random numbers\n");
        };
        self.think(asker, Question::Notes(NotesQuestion::Change { body, fresh }, person)).await
    }

    async fn take_bcf(&self, asker: Asker, person: Person, request: Request<Incoming>) -> Response<Body> {
        let Ok(_turn) = self.0.bcf.try_acquire() else { return busy() };
        let Some(body) = body(request, LONGEST_BCF).await else {
            let why = "the file is too large for a page: `trimaran notes --import` reads it\n";
            return plain(StatusCode::PAYLOAD_TOO_LARGE, why);
        };
        self.think(asker, Question::Notes(NotesQuestion::Import { body }, person)).await
    }

    /// Begins or ends a page's search for clashes, or says how it is.
    async fn clash(&self, request: Request<Incoming>, net: &Arc<dyn Net>) -> Response<Body> {
        let Some(asked) = json(request, LONGEST_REQUEST).await else {
            return plain(StatusCode::BAD_REQUEST, "that is no search for clashes\n");
        };
        match serde_json::to_vec(&self.0.clashes.answer(asked, net)) {
            Ok(answer) => file("application/json", answer.into()),
            Err(_) => plain(StatusCode::INTERNAL_SERVER_ERROR, "the answer cannot be written\n"),
        }
    }

    /// The box around objects: sets of many runs are too long for an address.
    async fn bounds(&self, asker: Asker, request: Request<Incoming>) -> Response<Body> {
        let Some(objects) = json(request, LONGEST_REQUEST).await else {
            return plain(StatusCode::BAD_REQUEST, "that is no set of objects\n");
        };
        self.think(asker, Question::Bounds(objects)).await
    }

    /// Answers on a thread that may block, unlike those of links. Hyper drops this when the client goes away.
    async fn think(&self, asker: Asker, question: Question) -> Response<Body> {
        match self.0.answers.known(&question) {
            Some(known) => known,
            None => self.0.answering.ask(asker, question).await,
        }
    }

    /// Upgrades the connection to a WebSocket.
    fn link(
        &self,
        request: &mut Request<Incoming>,
        asked: &Asked,
        grant: Grant,
        net: &Arc<dyn Net>,
    ) -> Answer {
        if let Err(foreign) = self.0.ws.check_at(&asked.site, request.headers()) {
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
                let upgrade = hyper::upgrade::on(request);
                let opening = Opening { upgrade, network, grant, peer: asked.peer };
                Answer::Link(answer.map(|()| Full::default()), opening)
            }
            Err(fault) => {
                self.0.warnings.warn(&fault, net.now());
                refused(&fault).into()
            }
        }
    }

    fn grant(&self, request: &Request<Incoming>) -> Option<Grant> {
        self.0.access.grant(token_in(request)?)
    }
}

/// The token with which the query begins: `?token=...`.
pub(super) fn token_in(request: &Request<Incoming>) -> Option<&str> {
    request.uri().query()?.split('&').next()?.strip_prefix("token=")
}

/// Logs that a person has opened the page.
fn tell_of(name: Option<&PersonName>, peer: StreamPeer) {
    if let StreamPeer::Tcp(address) = peer {
        tracing::info!(name = name.map(PersonName::as_str), %address, "opens the page");
    }
}

/// Hands on a WebSocket once it is upgraded.
async fn open(Opening { upgrade, network, grant, peer }: Opening, links: mpsc::Sender<Stream>) {
    if let Ok(upgraded) = upgrade.await {
        let connection = grant.over(TokioIo::new(upgraded));
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
    serde_json::from_slice(&body(request, longest).await?).ok()
}

/// The body of a request; `None` if it is longer than this, or does not come to its end.
async fn body(request: Request<Incoming>, longest: usize) -> Option<Bytes> {
    Limited::new(request.into_body(), longest).collect().await.ok().map(|body| body.to_bytes())
}

/// For a note or a reply, and its view.
fn fresh(net: &dyn Net) -> io::Result<[Guid; 2]> {
    Ok([Guid::random(net)?, Guid::random(net)?])
}

fn refused(fault: &NetworkError) -> Response<Body> {
    match fault {
        NetworkError::Unknown => plain(StatusCode::NOT_FOUND, "there is no such network\n"),
        _ => plain(StatusCode::SERVICE_UNAVAILABLE, "too many pages are on simulated networks\n"),
    }
}

/// A page opened under an unknown host name may not connect, so it is not shown at all.
pub(super) fn unknown_name(origin: &str) -> Response<Body> {
    let text = format!(
        "This service does not know the name by which it was opened. Open it by its IP address, or let \
         whoever starts it allow the name: TRIMARAN_WS_ALLOW_ORIGINS={origin}\n"
    );
    let mut response = file("text/plain; charset=utf-8", text.into());
    *response.status_mut() = StatusCode::FORBIDDEN;
    response
}

pub(super) fn nothing_here() -> Response<Body> {
    plain(StatusCode::NOT_FOUND, "there is nothing here\n")
}

pub(super) fn wrong_token() -> Response<Body> {
    plain(StatusCode::FORBIDDEN, "the token in the address is not valid, or not any more\n")
}

pub(super) fn plain(status: StatusCode, text: impl Into<Bytes>) -> Response<Body> {
    let mut response = file("text/plain; charset=utf-8", text.into());
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
