//! A relay: displays that watch show the frames of the display that leads.

use std::{
    net::TcpListener,
    sync::Arc,
    thread::{self, JoinHandle},
    time::Duration,
};

use parking_lot::Mutex;
use tokio::runtime::{Builder, Runtime};
use trimaran_actors::{
    BoxedError, CullerEvent, DisplayWork, FrameEvent, Link, Listener, Observer, PeerEndpoint, Peers,
    PeersConfig, Relay, RelayEndpoints, RelayError, RoleError, ShownFrame, Stop, Stopper, Turns, WatcherRole,
    again, max_frame,
};
use trimaran_cull::Image;
use trimaran_proto::{
    Camera, CloseCode, DrawableId, FrameNumber, Identity, Role, RoleMessage, SessionKey, Settings,
    ViewReader, ViewState, ViewVersion, Walkthrough,
};
use trimaran_scene::Scene;
use trimaran_transport::{
    ConnectError, Endpoint, Endpoints, Limits, ListenError, Net, Options, RecvError, TokioNet, connect,
    sleep_until, until,
};

use crate::common::{middle, send_frame, settings, small_scene, turned};

/// Nothing here takes so long.
const LONG: Duration = Duration::from_secs(100);
const PAUSE: Duration = Duration::from_millis(5);
/// The view states that a relay tells a culler that comes anew.
const KEPT: usize = 4;
/// The culler refuses pictures below this width.
const REFUSED: u32 = 16;
/// More frames than wait for a reader.
const FRAMES: u32 = 1_000;

/// A picture: its pose, its view state and what was drawn.
#[derive(Debug, Clone, PartialEq)]
struct Picture {
    camera: Camera,
    state: ViewState,
    ids: Vec<DrawableId>,
}

struct Bench {
    runtime: Runtime,
    net: Arc<dyn Net>,
    scene: Arc<Scene>,
}

/// A process that ends when this is dropped.
struct Process {
    stopper: Stopper,
    at: Endpoint,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Process {
    fn drop(&mut self) {
        self.stopper.stop();
        let ended = self.thread.take().unwrap().join();
        // The first panic tells more.
        assert!(ended.is_ok() || thread::panicking());
    }
}

/// A watcher's device: keeps what it draws, and waits while it is held.
struct Screen {
    drawn: Arc<Mutex<Vec<Picture>>>,
    state: Option<ViewState>,
    held: Arc<Mutex<()>>,
}

impl DisplayWork for Screen {
    fn change_view(&mut self, state: &ViewState) {
        self.state = Some(state.clone());
    }

    async fn draw(&mut self, camera: Camera, ids: &mut Vec<DrawableId>, _: u32) -> Result<usize, RoleError> {
        drop(self.held.lock());
        let (state, ids) = (self.state.clone().unwrap(), ids.clone());
        self.drawn.lock().push(Picture { camera: camera.in_view(ViewVersion(0)), state, ids });
        Ok(0)
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        Ok(None)
    }
}

/// Counts how often the relay came and left.
struct Comings(Arc<Mutex<(u32, u32)>>);

impl Observer for Comings {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        Ok(())
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        let mut comings = self.0.lock();
        match event {
            CullerEvent::Came(..) => comings.0 += 1,
            CullerEvent::Left(..) => comings.1 += 1,
            _ => {}
        }
    }
}

struct Watcher {
    held: Arc<Mutex<()>>,
    drawn: Arc<Mutex<Vec<Picture>>>,
    comings: Arc<Mutex<(u32, u32)>>,
    _process: Process,
}

impl Bench {
    fn new() -> Self {
        let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        Self { runtime, net, scene: small_scene() }
    }

    fn options(&self) -> Options {
        let limits =
            Limits::default().with_handshakes_per_s(10_000).with_handshakes_per_s_per_address(10_000);
        let mut options = Options::default().with_limits(limits);
        options.link.max_frame = max_frame(&self.scene);
        // A peer that takes nothing is not given up here.
        options.link.timeout = 10 * LONG;
        options
    }

    fn process(&self, at: Endpoint, run: impl FnOnce(Stop) + Send + 'static) -> Process {
        let (stopper, stop) = Stop::new();
        Process { stopper, at, thread: Some(thread::spawn(move || run(stop))) }
    }

    /// A culler that answers each camera, and counts them. It refuses small pictures, a view state that it
    /// was told before, and a camera whose view state it lacks.
    fn culler(&self, at: &Endpoint, culls: &Arc<Mutex<u32>>) -> Process {
        let (drawables, culls) = (max_frame(&self.scene), Arc::clone(culls));
        self.serves(Role::Culler, at, move |mut link| {
            let culls = Arc::clone(&culls);
            async move {
                if let Some(why) = answer(&mut link, &culls, drawables).await {
                    link.close(CloseCode::Failed.because(why)).await.unwrap();
                }
            }
        })
    }

    /// A listener that serves each link so.
    fn serves<S>(&self, role: Role, at: &Endpoint, serve: impl Fn(Link) -> S + Send + 'static) -> Process
    where
        S: Future<Output = ()> + Send + 'static,
    {
        let identity = Identity { role, scene: Some(self.scene.outline()), session: None };
        let (at, options) = (Endpoints::from(at.clone()), self.options());
        // The port of the one before it may still be in use.
        let bound = again(&self.net, self.net.now().after(LONG), ListenError::may_pass, || {
            Listener::bind_all(&self.net, &at, identity, &options)
        });
        let mut listener = self.runtime.block_on(bound).unwrap();
        let at = listener.local_endpoints().iter().next().unwrap().clone();
        let (net, handle) = (Arc::clone(&self.net), self.runtime.handle().clone());
        self.process(at, move |stop| {
            let served = async {
                let mut serving = tokio::task::JoinSet::new();
                loop {
                    let link = listener.accept(net.now().after(100 * LONG)).await.unwrap();
                    serving.spawn(serve(link));
                }
            };
            let _stopped: Option<()> = handle.block_on(stop.unless_requested(served));
        })
    }

    fn relay(&self, upstream: &Endpoint, listen: &str) -> Process {
        let at = RelayEndpoints {
            upstream: PeerEndpoint { endpoint: upstream.clone(), options: self.options() },
            listen: listen.parse().unwrap(),
            options: self.options(),
        };
        // The port of the one before it may still be in use.
        let started = again(&self.net, self.net.now().after(LONG), RelayError::may_pass, || {
            Relay::start(&self.net, at.clone(), Arc::new(|_, _| Box::new(())))
        });
        let relay = self.runtime.block_on(started).unwrap();
        let at = relay.endpoints().iter().next().unwrap().clone();
        let handle = self.runtime.handle().clone();
        self.process(at, move |stop| handle.block_on(relay.run(&stop)).unwrap())
    }

    /// A display that watches.
    fn watcher(&self, at: &Endpoint) -> Watcher {
        let (drawn, comings, held) = (Arc::default(), Arc::default(), Arc::default());
        let work = Screen { drawn: Arc::clone(&drawn), state: None, held: Arc::clone(&held) };
        let identity = Identity { role: Role::Display, scene: Some(self.scene.outline()), session: None };
        let endpoints = vec![PeerEndpoint { endpoint: at.clone(), options: self.options() }];
        let sought = PeersConfig { identity, role: Role::Relay, endpoints, listener: None, most: 1 };
        let (net, turns, outline) = (Arc::clone(&self.net), Turns::at_once(), self.scene.outline());
        let (drawables, objects) = (outline.drawables, outline.objects);
        let relay = self.runtime.block_on(async { Peers::seek(&net, sought) });
        let (handle, mut seen) = (self.runtime.handle().clone(), Comings(Arc::clone(&comings)));
        let process = self.process(at.clone(), move |stop| {
            let role = WatcherRole { work, relay, drawables, objects, net, turns };
            handle.block_on(role.run(&mut seen, &stop)).unwrap();
        });
        Watcher { held, drawn, comings, _process: process }
    }

    /// A display that leads.
    fn try_lead(
        &self,
        at: &Endpoint,
        key: u64,
        side: u32,
        scene: bool,
    ) -> Result<Leader<'_>, Box<ConnectError>> {
        let settings = settings(side, 2.0);
        let session = Some((SessionKey(key), settings));
        let scene = scene.then(|| self.scene.outline());
        let identity = Identity { role: Role::Display, scene, session };
        let by = self.net.now().after(if scene.is_some() { LONG } else { Duration::from_millis(300) });
        let link =
            self.runtime.block_on(connect::<Walkthrough>(&self.net, at, identity, &self.options(), by))?;
        Ok(Leader { bench: self, link, state: settings.into(), version: ViewVersion(0) })
    }

    fn lead(&self, at: &Endpoint, key: u64) -> Leader<'_> {
        self.try_lead(at, key, 64, true).unwrap()
    }

    /// Waits until it is so.
    fn wait(&self, what: &str, is_so: impl Fn() -> bool) {
        let deadline = self.net.now().after(LONG);
        while !is_so() {
            assert!(self.net.now() < deadline, "{what}");
            self.runtime.block_on(sleep_until(&*self.net, self.net.now().after(PAUSE)));
        }
    }

    /// Waits until the watcher's last picture is this one.
    fn shows(&self, watcher: &Watcher, picture: &Picture) {
        let last = || watcher.drawn.lock().last().cloned();
        self.wait("the picture does not come", || last().as_ref() == Some(picture));
    }
}

/// Answers a display's cameras until it leaves, or is refused for a reason.
async fn answer(link: &mut Link, culls: &Mutex<u32>, drawables: u32) -> Option<&'static str> {
    let is_small = |(_, settings): (_, Settings)| settings.viewport.width() < REFUSED;
    if link.peer.hello.session.is_some_and(is_small) {
        return Some("the picture is too small");
    }
    let (mut known, mut reader, mut number) = (vec![ViewVersion(0)], ViewReader::default(), 0);
    loop {
        let camera = tokio::select! {
            biased;
            message = link.messages_rx.recv() => {
                if let RoleMessage::View { version, part, last } = message.ok()?
                    && reader.take(version, &part, last).unwrap().is_some()
                {
                    if known.contains(&version) {
                        return Some("the view state is known");
                    }
                    known.push(version);
                    if number == 0 && known.len() > 1 + KEPT {
                        return Some("so many view states are not kept");
                    }
                }
                continue;
            }
            camera = link.latest_rx.latest() => camera.ok()?,
        };
        if !known.contains(&camera.view()) {
            return Some("the view state is unknown");
        }
        *culls.lock() += 1;
        send_frame(link, number, camera, &visible(drawables, camera)).await?;
        number += 1;
    }
}

/// The drawables visible from there: another set for each frame and view state.
fn visible(drawables: u32, camera: Camera) -> Vec<DrawableId> {
    let (frame, view) = (camera.frame().0, camera.view().0);
    (0..drawables).filter(|id| (id + view) % (2 + frame % 5) == 0).map(DrawableId).collect()
}

struct Leader<'b> {
    bench: &'b Bench,
    link: Link,
    state: ViewState,
    version: ViewVersion,
}

impl Leader<'_> {
    fn pose(&self, frame: u32) -> Camera {
        let eye = middle(&self.bench.scene);
        turned(eye, f64::from(frame) * 0.01, 1.0, FrameNumber(frame)).in_view(self.version)
    }

    /// Changes its view state from the next frame on.
    fn changes(&mut self, state: ViewState) {
        self.version.0 += 1;
        for message in state.to_messages(self.version).unwrap() {
            self.bench.runtime.block_on(self.link.messages_tx.send(&message)).unwrap();
        }
        self.state = state;
    }

    /// Returns once the relay has all of its messages: it can meet no other culler there, and is told so.
    fn is_heard(&mut self) {
        let (runtime, net, key) = (&self.bench.runtime, &self.bench.net, SessionKey(5));
        let meets = async {
            self.link.messages_tx.send(&RoleMessage::Meet { key, at: None }).await.unwrap();
            while self.link.messages_rx.recv().await.unwrap() != (RoleMessage::Unmet { key }) {}
        };
        runtime.block_on(until(&**net, net.now().after(LONG), meets)).unwrap();
    }

    fn asks(&mut self, frame: u32) {
        let camera = self.pose(frame);
        self.link.latest_tx.publish(camera).unwrap();
    }

    /// The picture of its next frame.
    fn sees(&mut self, frame: u32) -> Picture {
        let expected = self.pose(frame);
        let read = async {
            let mut ids = Vec::new();
            loop {
                match self.link.frames_rx.recv().await.unwrap() {
                    FrameEvent::Begin(start) => assert_eq!(start.header, expected),
                    FrameEvent::Batch(batch) => ids.extend(batch.iter()),
                    FrameEvent::End(_) => return ids,
                }
            }
        };
        let (runtime, net) = (&self.bench.runtime, &self.bench.net);
        let ids = runtime.block_on(until(&**net, net.now().after(LONG), read)).unwrap();
        assert_eq!(ids, visible(max_frame(&self.bench.scene), expected));
        Picture { camera: expected.in_view(ViewVersion(0)), state: self.state.clone(), ids }
    }

    fn walks(&mut self, frame: u32) -> Picture {
        self.asks(frame);
        self.sees(frame)
    }

    /// Why its link was closed.
    fn end(mut self) -> String {
        let (runtime, net) = (&self.bench.runtime, &self.bench.net);
        let closed = async {
            loop {
                if let Err(end) = self.link.frames_rx.recv().await {
                    return end;
                }
            }
        };
        let end = runtime.block_on(until(&**net, net.now().after(LONG), closed)).unwrap();
        let RecvError::Closed { reason, .. } = end else { panic!("{end:?}") };
        format!("{:?}: {reason:?}", CloseCode::of(&reason))
    }

    fn leaves(self) {
        self.bench.runtime.block_on(self.link.close(CloseCode::Finished.reason())).unwrap();
    }
}

fn anywhere() -> Endpoint {
    "tcp://127.0.0.1:0".parse().unwrap()
}

/// A free port of this machine.
fn port() -> Endpoint {
    let at = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    format!("tcp://{at}").parse().unwrap()
}

#[test]
fn watchers_show_each_picture_of_the_leader_and_the_culler_culls_it_once() {
    let bench = Bench::new();
    let culls = Arc::default();
    let culler = bench.culler(&anywhere(), &culls);
    for listen in ["tcp://127.0.0.1:0", "ws://127.0.0.1:0/link", "inproc:relay"] {
        *culls.lock() = 0;
        let relay = bench.relay(&culler.at, listen);
        let watchers = [(); 3].map(|()| bench.watcher(&relay.at));
        let mut leader = bench.lead(&relay.at, 1);
        for frame in 0..20 {
            if frame % 7 == 6 {
                let hidden = (0..frame).step_by(2).collect();
                leader.changes(ViewState { hidden, ..leader.state.clone() });
            }
            let picture = leader.walks(frame);
            watchers.iter().for_each(|watcher| bench.shows(watcher, &picture));
        }
        for watcher in &watchers {
            assert_eq!(watcher.drawn.lock().len(), 20, "{listen}");
        }
        assert_eq!(*culls.lock(), 20, "{listen}");
    }
}

#[test]
fn a_watcher_that_comes_late_or_again_shows_the_last_picture_at_once() {
    let bench = Bench::new();
    let culler = bench.culler(&anywhere(), &Arc::default());
    let relay = bench.relay(&culler.at, "tcp://127.0.0.1:0");
    let mut leader = bench.lead(&relay.at, 1);
    for frame in 0..4 {
        leader.walks(frame);
    }
    leader.changes(ViewState { hidden: [3].into_iter().collect(), ..leader.state.clone() });
    let last = leader.walks(4);
    for _ in 0..2 {
        bench.shows(&bench.watcher(&relay.at), &last);
    }
    let watcher = bench.watcher(&relay.at);
    bench.shows(&watcher, &last);
    leader.leaves();
    assert_eq!(*watcher.comings.lock(), (1, 0), "it stays when the leader leaves");
}

#[test]
fn a_slow_watcher_skips_frames_and_one_that_hangs_holds_up_nobody() {
    let bench = Bench::new();
    let culler = bench.culler(&anywhere(), &Arc::default());
    let relay = bench.relay(&culler.at, "inproc:relay-of-slow-watchers");
    let slow = bench.watcher(&relay.at);
    let quick = bench.watcher(&relay.at);
    // It reads nothing.
    let identity = Identity { role: Role::Display, scene: Some(bench.scene.outline()), session: None };
    let (by, options) = (bench.net.now().after(LONG), bench.options());
    let hangs = connect::<Walkthrough>(&bench.net, &relay.at, identity, &options, by);
    let mut hangs = bench.runtime.block_on(hangs).unwrap();
    bench.wait("the watchers do not come", || slow.comings.lock().0 + quick.comings.lock().0 == 2);
    let mut leader = bench.lead(&relay.at, 1);
    let held = slow.held.lock();
    let pictures: Vec<_> = (0..FRAMES).map(|frame| leader.walks(frame)).collect();
    let last = pictures.last().unwrap();
    bench.shows(&quick, last);
    drop(held);
    bench.shows(&slow, last);
    let drawn = slow.drawn.lock();
    assert!(drawn.len() < 10, "{} pictures", drawn.len());
    let mut rest = pictures.iter();
    assert!(drawn.iter().all(|drawn| rest.any(|picture| picture == drawn)), "in order, and none is mixed");
    let seen = async {
        let mut seen = 0;
        loop {
            seen += 1;
            if hangs.frames_rx.frame().await.unwrap().start.header.frame() == FrameNumber(FRAMES - 1) {
                return seen;
            }
        }
    };
    let seen = bench.runtime.block_on(seen);
    assert!(seen < FRAMES, "{seen} frames waited for it");
}

#[test]
fn when_the_culler_is_restarted_displays_stay_and_the_walk_goes_on() {
    let bench = Bench::new();
    let (at, culls) = (port(), Arc::default());
    let culler = bench.culler(&at, &culls);
    let relay = bench.relay(&at, "tcp://127.0.0.1:0");
    let watcher = bench.watcher(&relay.at);
    let mut leader = bench.lead(&relay.at, 1);
    let hides = |leader: &mut Leader<'_>, object| {
        leader.changes(ViewState { hidden: [object].into_iter().collect(), ..leader.state.clone() });
    };
    bench.shows(&watcher, &leader.walks(0));
    (0..5).for_each(|object| hides(&mut leader, object));
    bench.shows(&watcher, &leader.walks(1));
    drop(culler);
    leader.asks(2);
    // The camera names the view state before these.
    let asked = (leader.version, leader.state.clone());
    (0..3).for_each(|object| hides(&mut leader, object));
    leader.is_heard();
    let changed = (leader.version, leader.state.clone());
    (leader.version, leader.state) = asked;
    let culler = bench.culler(&at, &culls);
    bench.shows(&watcher, &leader.sees(2));
    (leader.version, leader.state) = changed;
    for frame in 3..6 {
        bench.shows(&watcher, &leader.walks(frame));
    }
    assert_eq!(*culls.lock(), 6, "no frame is culled again");
    assert_eq!(*watcher.comings.lock(), (1, 0));
    drop(culler);
}

#[test]
fn when_the_relay_is_restarted_watchers_stay_and_show_its_next_leader() {
    let bench = Bench::new();
    let (at, culler) = (port(), bench.culler(&anywhere(), &Arc::default()));
    let relay = bench.relay(&culler.at, &at.to_string());
    let watcher = bench.watcher(&at);
    bench.shows(&watcher, &bench.lead(&at, 1).walks(0));
    drop(relay);
    let _relay = bench.relay(&culler.at, &at.to_string());
    // Its view state has the number of the one before.
    bench.shows(&watcher, &bench.try_lead(&at, 2, 128, true).unwrap().walks(0));
    assert_eq!(*watcher.comings.lock(), (2, 1));
}

/// Frames and view states come in lanes of their own.
#[test]
fn a_frame_that_overtakes_its_view_state_is_shown_once_that_has_come() {
    let bench = Bench::new();
    let state = ViewState { hidden: [1, 2].into_iter().collect(), ..settings(32, 2.0).into() };
    let camera = Camera::at_origin(FrameNumber(3));
    let ids = visible(max_frame(&bench.scene), camera);
    let (net, picture) = (Arc::clone(&bench.net), Picture { camera, state, ids });
    let sent = picture.clone();
    let root = bench.serves(Role::Relay, &anywhere(), move |mut link| {
        let (net, Picture { camera, state, ids }) = (Arc::clone(&net), sent.clone());
        async move {
            let version = ViewVersion(1);
            let _sent = send_frame(&mut link, 0, camera.in_view(version), &ids).await;
            sleep_until(&*net, net.now().after(10 * PAUSE)).await;
            for message in state.to_messages(version).unwrap() {
                let _sent = link.messages_tx.send(&message).await;
            }
            let _left = link.frames_rx.recv().await;
        }
    });
    let leaf = bench.relay(&root.at, "tcp://127.0.0.1:0");
    for at in [&root.at, &leaf.at] {
        bench.shows(&bench.watcher(at), &picture);
    }
}

#[test]
fn a_tree_of_relays_shows_the_same_wherever_the_leader_is() {
    let bench = Bench::new();
    let culls = Arc::default();
    let culler = bench.culler(&anywhere(), &culls);
    let root = bench.relay(&culler.at, "tcp://127.0.0.1:0");
    let leaves = [(); 2].map(|()| bench.relay(&root.at, "tcp://127.0.0.1:0"));
    let watchers = [&root, &leaves[0], &leaves[1]].map(|relay| bench.watcher(&relay.at));
    let mut expected = 0;
    for (key, relay) in [&root, &leaves[1], &leaves[0]].into_iter().enumerate() {
        let side = 32 << key;
        let mut leader = bench.try_lead(&relay.at, key as u64, side, true).unwrap();
        for frame in 0..6 {
            if frame == 3 {
                leader.changes(ViewState { hidden: [2].into_iter().collect(), ..leader.state.clone() });
            }
            let picture = leader.walks(frame);
            watchers.iter().for_each(|watcher| bench.shows(watcher, &picture));
            expected += 1;
        }
        leader.leaves();
    }
    assert_eq!(*culls.lock(), expected);
    // One that comes late to a leaf, which itself comes late.
    let late = bench.relay(&leaves[0].at, "tcp://127.0.0.1:0");
    let last = watchers[0].drawn.lock().last().cloned().unwrap();
    bench.shows(&bench.watcher(&late.at), &last);
}

#[test]
fn one_display_leads_and_the_next_one_only_once_it_has_left() {
    let bench = Bench::new();
    let culler = bench.culler(&anywhere(), &Arc::default());
    let relay = bench.relay(&culler.at, "tcp://127.0.0.1:0");
    let watcher = bench.watcher(&relay.at);
    let mut first = bench.lead(&relay.at, 1);
    bench.shows(&watcher, &first.walks(0));
    let told = bench.lead(&relay.at, 2).end();
    assert!(told.contains("Failed") && told.contains("another display leads"), "{told}");
    bench.shows(&watcher, &first.walks(1));
    // It comes again, before its old link is known to be dead.
    let mut again = bench.lead(&relay.at, 1);
    let told = first.end();
    assert!(told.contains("Replaced"), "{told}");
    bench.shows(&watcher, &again.walks(2));
    again.leaves();
    let mut third = bench.try_lead(&relay.at, 3, 128, true).unwrap();
    bench.shows(&watcher, &third.walks(0));
    third.is_heard();
    let refused = bench.try_lead(&relay.at, 4, 64, false);
    let last = trimaran_transport::causes(&*refused.map(drop).unwrap_err());
    assert!(last.contains("give this display the scene"), "{last}");
}

#[test]
fn a_display_is_told_why_it_is_let_go() {
    let bench = Bench::new();
    let culler = bench.culler(&anywhere(), &Arc::default());
    let relay = bench.relay(&culler.at, "tcp://127.0.0.1:0");
    let told = bench.try_lead(&relay.at, 1, REFUSED - 1, true).unwrap().end();
    assert!(told.contains("Failed") && told.contains("the picture is too small"), "{told}");
    let watcher = bench.watcher(&relay.at);
    let mut leader = bench.lead(&relay.at, 2);
    bench.shows(&watcher, &leader.walks(0));
    drop(relay);
    let told = leader.end();
    assert!(told.contains("Interrupted"), "{told}");
}
