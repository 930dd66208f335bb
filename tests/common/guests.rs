//! A real service, an honest display that walks beside, and attacks on the service.
//!
//! [`Guests::start`] runs `trimaran serve` on a small plant. [`Guests::beside`] lets an honest display walk,
//! runs an attack, and asserts that the honest one lost nothing by it. An attack is any function: it has the
//! service's address ([`Guests::at`]), links of its own ([`Guests::display`], [`Guests::link`]), and sockets
//! of the standard library. It may be run up to three times.

use std::{
    fs::{self, File},
    future::Future,
    io::{BufRead, BufReader},
    process::{Child, Stdio},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use tokio::runtime::{Builder, Runtime};
use trimaran_actors::{FrameEvent, Link};
use trimaran_proto::{
    Camera, FrameNumber, Identity, LodRule, Role, SessionKey, Settings, ViewState, ViewVersion, Viewport,
    Walkthrough,
};
use trimaran_transport::{ConnectError, Net, Options, RecvError, TokioNet, connect};

use super::program::{Bench, signal};

pub(crate) const TOKEN: &str = "0123456789abcdefXYZ";

/// The longest time for which an attack may keep a picture from an honest display.
const LONGEST_GAP: Duration = Duration::from_millis(250);
/// A busy machine has gaps of its own: only this multiple of the gaps without the attack counts.
const LONGER: u32 = 3;
const TRIES: u32 = 3;
/// How long the honest display walks alone before an attack, and how long it is watched after one.
const ALONE: Duration = Duration::from_millis(1500);
const AFTER: Duration = Duration::from_millis(500);
/// In the midst of the plant.
const HERE: [f64; 3] = [0.0, 2.0, 0.0];
/// From one camera to the next.
const PACE: Duration = Duration::from_millis(40);
/// The timeout of everything, for a busy machine.
const AT_MOST: Duration = Duration::from_secs(60);

/// A service of `plant.scene`.
pub(crate) struct Guests {
    pub(crate) bench: Bench,
    service: Option<Child>,
    /// Host and port.
    pub(crate) at: String,
    runtime: Runtime,
    net: Arc<dyn Net>,
}

impl Guests {
    /// A service of a plant of 60 objects, with further flags. `None`, with a message, if the program was
    /// built without its page and none is required.
    pub(crate) fn start(flags: &[&str]) -> Option<Self> {
        Self::of(Bench::with_plant(60), flags)
    }

    /// A service of the `plant.scene` in a folder.
    pub(crate) fn of(bench: Bench, flags: &[&str]) -> Option<Self> {
        let serve = ["serve", "plant.scene", "--listen", "127.0.0.1:0", "--token", TOKEN];
        let mut command = bench.command(&[&serve[..], flags].concat());
        command.stdout(Stdio::piped()).stderr(Stdio::from(File::create(bench.path("serve.log")).unwrap()));
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let Some(at) = line.strip_prefix("http://").and_then(|url| url.split_once('/')) else {
            let _code = child.wait();
            let said = fs::read_to_string(bench.path("serve.log")).unwrap();
            assert!(std::env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "{said}");
            println!("skipped: {said}");
            return None;
        };
        let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let net = Arc::new(TokioNet::new(runtime.handle().clone()));
        Some(Self { at: at.0.to_owned(), bench, service: Some(child), runtime, net })
    }

    /// The page's address.
    pub(crate) fn url(&self) -> String {
        format!("http://{}/?token={TOKEN}", self.at)
    }

    /// The service's output on standard error.
    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.bench.path("serve.log")).unwrap()
    }

    pub(crate) fn is_alive(&mut self) -> bool {
        self.service.as_mut().is_some_and(|child| child.try_wait().unwrap().is_none())
    }

    pub(crate) fn id(&self) -> u32 {
        self.service.as_ref().unwrap().id()
    }

    /// A number of the service's `/proc/PID/status`, such as `VmRSS` (kB) or `Threads`.
    pub(crate) fn status(&self, key: &str) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':')).unwrap();
        line.split_whitespace().next().unwrap().parse().unwrap()
    }

    /// Stops it like systemd: it ends with success, and within 3 s unless the machine is busy.
    pub(crate) fn stops(mut self) {
        let asked = Instant::now();
        signal("TERM", &self.id().to_string());
        let mut child = self.service.take().unwrap();
        let code = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status.code();
            }
            if asked.elapsed() > Duration::from_secs(15) {
                let _ended = child.kill();
                let _ended = child.wait();
                panic!("it was asked to stop 15 s ago: {}", self.log());
            }
            thread::sleep(Duration::from_millis(20));
        };
        assert_eq!(code, Some(0), "{}", self.log());
    }

    /// Runs an attack's future.
    pub(crate) fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.runtime.block_on(future)
    }

    /// A link to the service with this identity.
    pub(crate) fn link(&self, identity: Identity) -> Result<Link, Box<ConnectError>> {
        let at = format!("ws://{}/link?token={TOKEN}", self.at).parse().unwrap();
        let deadline = self.net.now().after(Duration::from_secs(10));
        let options = Options::default();
        self.block_on(connect::<Walkthrough>(&self.net, &at, identity, &options, deadline)).map_err(Box::new)
    }

    /// A display of a new session that holds no scene, with a picture of this size.
    pub(crate) fn display(&self, width: u32, height: u32) -> Result<Display, Box<ConnectError>> {
        self.display_of(SessionKey(self.net.random().unwrap()), width, height)
    }

    /// The same for the session of this key.
    pub(crate) fn display_of(
        &self,
        key: SessionKey,
        width: u32,
        height: u32,
    ) -> Result<Display, Box<ConnectError>> {
        let viewport = Viewport::new(width, height).unwrap();
        let settings = Settings::new(viewport, LodRule::new(2.0).unwrap());
        let identity = Identity { role: Role::Display, scene: None, session: Some((key, settings)) };
        Ok(Display {
            link: self.link(identity)?,
            key,
            settings,
            net: Arc::clone(&self.net),
            version: 0,
            eye: HERE,
        })
    }

    /// Begins an honest walk, which goes on until it is dropped.
    pub(crate) fn walk(&self) -> Walk {
        self.walk_at(HERE)
    }

    /// The same with an eye that turns at this place.
    pub(crate) fn walk_at(&self, eye: [f64; 3]) -> Walk {
        let mut display = self.display(256, 256).unwrap();
        display.eye = eye;
        let arrived = Arc::new(Mutex::new(Vec::new()));
        let over = Arc::new(AtomicBool::new(false));
        let (pictures, ends) = (Arc::clone(&arrived), Arc::clone(&over));
        let thread = thread::spawn(move || {
            let runtime = Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                let mut pace = tokio::time::interval(PACE);
                let mut frame = 0;
                while !ends.load(Ordering::Relaxed) {
                    tokio::select! {
                        _ = pace.tick() => {
                            frame += 1;
                            display.look(frame);
                        }
                        event = display.link.frames_rx.recv() => match event {
                            Ok(FrameEvent::End(_)) => pictures.lock().unwrap().push(Instant::now()),
                            Ok(_) => {}
                            Err(end) => return Some(trimaran_transport::causes(&end)),
                        },
                        _ = display.link.messages_rx.recv() => {}
                    }
                }
                let _unheard = display.link.close(trimaran_proto::CloseCode::Finished.reason()).await;
                None
            })
        });
        Walk { arrived, over, thread: Some(thread) }
    }

    /// Runs an attack while an honest display walks beside. The attack must delay none of its pictures, and
    /// the service must go on. Three runs rule out chance delays of a busy machine.
    pub(crate) fn beside(&mut self, mut attack: impl FnMut(&Self)) {
        let walk = self.walk();
        walk.sees(10, self);
        let mut gaps = Vec::new();
        for _ in 0..TRIES {
            let alone = walk.longest_gap_while(|| thread::sleep(ALONE));
            let gap = walk.longest_gap_while(|| {
                attack(self);
                thread::sleep(AFTER);
            });
            assert!(self.is_alive(), "the service is gone: {}", self.log());
            assert!(!walk.is_over(), "the honest display lost its link: {}", self.log());
            if gap <= LONGEST_GAP.max(alone * LONGER) {
                return walk.ends();
            }
            gaps.push((alone, gap));
        }
        panic!("an honest display's longest gaps, alone and beside the attack: {gaps:?}; {}", self.log());
    }
}

impl Drop for Guests {
    fn drop(&mut self) {
        if let Some(mut child) = self.service.take() {
            let _ended = child.kill();
            let _code = child.wait();
        }
    }
}

/// A display played by a test.
pub(crate) struct Display {
    pub(crate) link: Link,
    pub(crate) key: SessionKey,
    pub(crate) settings: Settings,
    /// Its eye.
    pub(crate) eye: [f64; 3],
    net: Arc<dyn Net>,
    version: u32,
}

impl Display {
    /// Publishes the camera of this frame, which turns a little with each.
    pub(crate) fn look(&mut self, frame: u32) {
        let turn = f64::from(frame) * 0.05;
        let orientation = [0.0, turn.sin(), 0.0, turn.cos()];
        let camera = Camera::new(self.eye, orientation, 0.6, 0.1, FrameNumber(frame)).unwrap();
        let _gone = self.link.latest_tx.publish(camera.in_view(ViewVersion(self.version)));
    }

    /// Sends the service a view state for the next cameras.
    pub(crate) async fn change(&mut self, change: impl FnOnce(&mut ViewState)) {
        let mut state = ViewState::from(self.settings);
        change(&mut state);
        self.version += 1;
        for message in state.to_messages(ViewVersion(self.version)).unwrap() {
            let _gone = self.link.messages_tx.send(&message).await;
        }
    }

    /// Waits until the service ends the link; returns its reason.
    pub(crate) async fn hears_the_end(&mut self) -> String {
        loop {
            match self.next().await {
                Ok(_) => {}
                Err(end) => return trimaran_transport::causes(&end),
            }
        }
    }

    /// Requests frames one after the other, as fast as they come, until `over`; returns how many have come.
    pub(crate) async fn asks_until(&mut self, over: &AtomicBool) -> u32 {
        let mut frame = 0;
        while !over.load(Ordering::Relaxed) {
            frame += 1;
            self.look(frame);
            self.sees(1).await;
        }
        frame
    }

    /// Waits until this many frames have come whole.
    pub(crate) async fn sees(&mut self, frames: u32) {
        for _ in 0..frames {
            assert!(self.sees_or_ends().await, "its link has ended");
        }
    }

    /// The next event of frames. The service's other messages are read as well.
    async fn next(&mut self) -> Result<FrameEvent, RecvError> {
        let deadline = self.net.now().after(AT_MOST);
        loop {
            tokio::select! {
                event = self.link.frames_rx.recv_by(deadline) => return event,
                said = self.link.messages_rx.recv() => match said {
                    Ok(_) => {}
                    Err(end) => return Err(end),
                },
            }
        }
    }

    /// Waits until a frame has come whole, or the service ends the link; returns whether one came.
    pub(crate) async fn sees_or_ends(&mut self) -> bool {
        loop {
            match self.next().await {
                Ok(FrameEvent::End(_)) => return true,
                Ok(_) => {}
                Err(_) => return false,
            }
        }
    }
}

/// An honest display that walks.
pub(crate) struct Walk {
    /// When each frame was whole.
    arrived: Arc<Mutex<Vec<Instant>>>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<Option<String>>>,
}

impl Walk {
    /// How many frames have come.
    pub(crate) fn frames(&self) -> usize {
        self.arrived.lock().unwrap().len()
    }

    /// Whether its link has ended.
    pub(crate) fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits until it has received this many more frames.
    pub(crate) fn sees(&self, more: usize, guests: &Guests) {
        let (due, begun) = (self.frames() + more, Instant::now());
        while self.frames() < due {
            assert!(begun.elapsed() < AT_MOST && !self.is_over(), "it sees nothing: {}", guests.log());
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// The longest time without a picture during `something`.
    pub(crate) fn longest_gap_while(&self, something: impl FnOnce()) -> Duration {
        let begun = Instant::now();
        something();
        let ended = Instant::now();
        let arrived = self.arrived.lock().unwrap();
        let within = arrived.iter().copied().filter(|at| (begun..ended).contains(at));
        let mut last = begun;
        within.chain([ended]).map(|at| at.duration_since(std::mem::replace(&mut last, at))).max().unwrap()
    }

    /// Ends the walk, whose link has held to the end.
    pub(crate) fn ends(mut self) {
        self.over.store(true, Ordering::Relaxed);
        let ended = self.thread.take().unwrap().join().unwrap();
        assert_eq!(ended, None);
    }
}

impl Drop for Walk {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}
