//! What the transport tests share: peers, cameras, and the conformance suite.
#![allow(dead_code, unused_imports, reason = "each test program uses a part")]

pub(crate) mod conformance;
pub(crate) mod ports;
pub(crate) mod router;
pub(crate) mod udp;

use std::sync::Arc;
use std::time::Duration;

use trimaran_proto::{
    BatchSize, Camera, DrawableId, EpsilonPx, FrameEnd, FrameEvent, FrameNumber, FrameOutcome, FrameStart,
    IdCoding, Identity, PictureSize, Refusal, Role, SceneHash, Settings, TesterKind,
};
use trimaran_transport::{
    AcceptError, AttemptError, ConnectError, Endpoint, FrameReceiver, HandshakeError, Instant,
    LatestReceiver, Link, Listener, Net, Options, RecvError, TokioNet, connect,
};

pub(crate) const SCENE: SceneHash = SceneHash(0x5ce7e);

pub(crate) fn net() -> Arc<dyn Net> {
    Arc::new(TokioNet::current().unwrap())
}

pub(crate) fn soon(net: &Arc<dyn Net>) -> Instant {
    net.now().after(Duration::from_secs(60))
}

pub(crate) fn identity(role: Role) -> Identity {
    Identity { role, scene: SCENE, settings: None }
}

pub(crate) fn settings(batch: u32) -> Settings {
    Settings {
        size: PictureSize::new(640, 480).unwrap(),
        epsilon: EpsilonPx::new(2.0).unwrap(),
        batch: BatchSize::new(batch).unwrap(),
        coding: IdCoding::Plain,
        tester: TesterKind::Query,
        lockstep: true,
        few_pixels: false,
        first: FrameNumber(0),
        frames: None,
    }
}

pub(crate) fn camera(frame: u32) -> Camera {
    let eye = [f64::from(frame), 2.0, -3.5];
    Camera::new(eye, [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(frame)).unwrap()
}

pub(crate) fn start(frame: u32) -> FrameStart {
    FrameStart { frame: FrameNumber(frame), camera: camera(frame + 100) }
}

pub(crate) fn ids(count: u32) -> Vec<DrawableId> {
    (0..count).map(|i| DrawableId(i.wrapping_mul(2_654_435_761))).collect()
}

/// One frame as it was received.
#[derive(Debug)]
pub(crate) struct Received {
    pub(crate) start: FrameStart,
    pub(crate) batches: Vec<usize>,
    pub(crate) ids: Vec<DrawableId>,
    pub(crate) end: FrameEnd,
}

/// Reads one frame that must be complete, however often the link's patience ends before it is.
pub(crate) async fn receive(rx: &mut FrameReceiver) -> Result<Received, RecvError> {
    let FrameEvent::Begin(start) = next_event(rx).await? else { panic!("no begin") };
    let (mut batches, mut ids) = (Vec::new(), Vec::new());
    loop {
        match next_event(rx).await? {
            FrameEvent::Ids(batch) => {
                batches.push(batch.count());
                ids.extend(batch.iter());
            }
            FrameEvent::End(FrameOutcome::Complete(end)) => return Ok(Received { start, batches, ids, end }),
            other => panic!("{other:?} within a frame"),
        }
    }
}

/// The next event of a frame, however often the link's patience ends before it comes.
async fn next_event(rx: &mut FrameReceiver) -> Result<FrameEvent, RecvError> {
    loop {
        match rx.recv().await {
            Err(RecvError::Silent { .. }) => {}
            event => return event,
        }
    }
}

/// The next camera, however often the link's patience ends before it comes.
pub(crate) async fn next_camera(rx: &mut LatestReceiver) -> Result<Camera, RecvError> {
    loop {
        match rx.latest().await {
            Err(RecvError::Silent { .. }) => {}
            camera => return camera,
        }
    }
}

/// A link over the transport that `endpoint` names, by a listener and a connector: switch A's end first, then
/// the display's.
pub(crate) async fn joined(endpoint: &str, options: &Options) -> (Link, Link) {
    let net = net();
    let endpoint: Endpoint = endpoint.parse().unwrap();
    let mut listener = Listener::bind(&net, &endpoint, identity(Role::SwitchA), options).await.unwrap();
    let there = listener.local_endpoint().clone();
    let (there, here) = tokio::join!(
        connect(&net, &there, identity(Role::Display), options, soon(&net)),
        listener.accept(soon(&net)),
    );
    (here.unwrap(), there.unwrap())
}

/// What stands in the way of a link of `who` to `at`, as the connecting side learns it: how its attempts end
/// once the other side has had the time to answer one.
pub(crate) async fn obstacle(
    net: &Arc<dyn Net>,
    at: &Endpoint,
    who: Identity,
    options: &Options,
) -> HandshakeError {
    let soon = soon(net);
    // The first wait that is long enough here.
    for wait in (0..).map(|doubled| Duration::from_millis(50) * 2_u32.pow(doubled)) {
        assert!(net.now() < soon, "no answer from {at}");
        let error = connect(net, at, who, options, net.now().after(wait)).await.unwrap_err();
        assert!(error.may_pass(), "{error:?}");
        match error {
            ConnectError::Deadline { last: AttemptError::Handshake { cause, .. }, .. } => match cause {
                HandshakeError::Closed | HandshakeError::Io(_) | HandshakeError::Unanswered => {}
                known => return known,
            },
            ConnectError::Deadline { last: AttemptError::TimedOut, .. } => {}
            other => panic!("{other:?}"),
        }
    }
    unreachable!()
}

/// With which words `at` refuses `who`.
pub(crate) async fn refusal(net: &Arc<dyn Net>, at: &Endpoint, who: Identity, options: &Options) -> Refusal {
    match obstacle(net, at, who, options).await {
        HandshakeError::Refused(refusal) => refusal,
        other => panic!("{other:?}"),
    }
}

/// What became of the last connection to `listener` that did not make it to a link, once there is such a one.
pub(crate) async fn last_failure(listener: &mut Listener) -> HandshakeError {
    let net = net();
    loop {
        match listener.accept(net.now()).await {
            Err(AcceptError::Deadline { last: Some(failure), .. }) => return failure,
            Err(AcceptError::Deadline { last: None, .. }) => tokio::task::yield_now().await,
            other => panic!("{other:?}"),
        }
    }
}
