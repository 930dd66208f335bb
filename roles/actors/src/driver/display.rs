//! The display at work (paper, algorithm 4.3).

use std::{pin::pin, sync::Arc, time::Duration};

use crate::{FrameEvent, Link};
use tokio::runtime::Handle;
use trimaran_cull::{DrawOrder, Image, View, Viewport};
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, SentBytes, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{FrameOutcome, LinkStats, Net, RecvError, SendError, StatsHandle, until};

use super::{
    Cameras, LinkError, RoleError,
    cameras::Handed,
    gaps::Gaps,
    ids::FrameIds,
    pair::sent_bytes,
    parting::{ended, hear_out, leave, left_early},
    rule_of,
    stop::{Stop, Waiting},
    stopped_or,
    turn::Turns,
    wait,
};
use crate::{DisplayMachine, DisplayStep, OrderError, PictureDevice, Seat, Stopwatch};

/// How often the display of a live session looks for a newer pose while it waits for the pair.
const REFRESH: Duration = Duration::from_millis(4);

/// A frame that has been drawn, as the display's observer sees it.
#[derive(Debug)]
pub struct ShownFrame<'f> {
    /// The camera it shows; its number is the frame's.
    pub camera: Camera,
    /// What was drawn, in the order drawn.
    pub ids: &'f [DrawableId],
    /// How many of them were drawn only because ids of the frame were lost on a link with deadlines.
    pub for_loss: u32,
    /// The picture, if it was asked for.
    pub picture: Option<&'f Image>,
    /// When its camera was handed out, since the session's start.
    pub published: Duration,
    /// When its begin arrived.
    pub begun: Duration,
    /// When drawing began.
    pub drawing: Duration,
    /// When the device was done with it. RVG was busy from `drawing` to here.
    pub shown: Duration,
    /// What travelled between the display and the frame's machine, both ways, since that machine's last
    /// frame was shown: the frame, statistics of an earlier one, and a camera.
    pub traffic: SentBytes,
    /// How many ids had come, and when, since the frame's begin: one entry for all batches that came at
    /// once.
    pub arrivals: &'f [(u32, Duration)],
}

/// Why an observer can note no more, such as a full disk.
pub type ObserverError = Box<dyn std::error::Error + Send + Sync>;

/// Sees what the display does. Time spent here is the session's: an observer notes and returns.
pub trait Observer {
    /// Whether this frame's picture is to be read back.
    fn wants_picture(&self, frame: FrameNumber) -> bool;
    /// A frame has been shown.
    ///
    /// # Errors
    /// When it cannot be noted. The session ends with it, and the peers are told.
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), ObserverError>;
    /// What a machine of the pair did for a frame that it has sent.
    fn pair_did(&mut self, stats: &FrameStats);
}

/// The display, joined to the pair.
#[derive(Debug)]
pub struct DisplayRole<D> {
    /// The scene, the same in all three roles.
    pub scene: Arc<Scene>,
    /// Its device.
    pub device: D,
    /// The link to the pair's first machine.
    pub first: Link,
    /// The link to the pair's second machine.
    pub second: Link,
    /// What it has decided for the session.
    pub settings: Settings,
    /// The time it waits by.
    pub net: Arc<dyn Net>,
    /// Started with the session; it goes on when the session goes on with another role after a peer was
    /// lost.
    pub clock: Stopwatch,
    /// Whether it draws while other roles of the process compute.
    pub turns: Turns,
}

/// What the display's links carried, first and second machine.
pub type PairTraffic = [LinkStats; 2];

impl<D: PictureDevice> DisplayRole<D> {
    /// Plays the role until the session's last frame is shown, or `stop` asks. It occupies this thread;
    /// `runtime` drives the links. Returns what the links carried.
    ///
    /// # Errors
    /// When a peer dies, leaves or breaks the order, or the device or the observer fails. The peers are told
    /// before it returns.
    pub fn run(
        self,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        runtime: &Handle,
        stop: &Stop,
    ) -> Result<PairTraffic, RoleError<D::Error>> {
        let turn = self.turns.of_a_role(self.clock);
        let waiting = Waiting { runtime, stop, turn: &turn };
        let mut work = Work::new(self, waiting)?;
        work.device.cancel_on(stop);
        let result = stopped_or(work.frames(cameras, observer), stop);
        turn.give_back();
        let result = hear_out(result, work.links.each_mut(), waiting);
        let counters = work.links.each_ref().map(|link| link.stats.clone());
        leave(runtime, work.links, &result);
        ended(result, stop)?;
        Ok(counters.each_ref().map(StatsHandle::read))
    }
}

struct Work<'r, D> {
    machine: DisplayMachine,
    scene: Arc<Scene>,
    device: D,
    links: [Link; 2],
    viewport: Viewport,
    lockstep: bool,
    waiting: Waiting<'r>,
    net: Arc<dyn Net>,
    clock: Stopwatch,
    handed: Handed,
    /// What the links had carried when their last frames were shown.
    carried: [LinkStats; 2],
    order: DrawOrder,
    received: FrameIds,
    arrivals: Vec<(u32, Duration)>,
    /// Ids of the frame were lost.
    lossy: bool,
    gaps: Gaps,
    picture: Image,
}

/// A frame that a machine of the pair has begun to send.
#[derive(Debug, Clone, Copy)]
struct Begun {
    camera: Camera,
    /// When its camera was handed out.
    published: Duration,
    /// When the begin arrived.
    at: Duration,
}

const fn peer(seat: Seat) -> &'static str {
    match seat {
        Seat::First => "first machine of the pair",
        Seat::Second => "second machine of the pair",
    }
}

impl<'r, D: PictureDevice> Work<'r, D> {
    fn new(role: DisplayRole<D>, waiting: Waiting<'r>) -> Result<Self, RoleError<D::Error>> {
        let DisplayRole { scene, device, first, second, settings, net, clock, .. } = role;
        let gaps = Gaps::new(&scene, rule_of(&settings)?);
        let received = FrameIds::of(&scene);
        Ok(Self {
            machine: DisplayMachine::new(settings.first, settings.frames),
            scene,
            device,
            carried: [first.stats.read(), second.stats.read()],
            links: [first, second],
            viewport: settings.size,
            lockstep: settings.lockstep,
            waiting,
            net,
            clock,
            handed: Handed::new(clock),
            order: DrawOrder::default(),
            received,
            arrivals: Vec::new(),
            lossy: false,
            gaps,
            picture: Image::default(),
        })
    }

    fn frames(
        &mut self,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
    ) -> Result<(), RoleError<D::Error>> {
        for frame in self.machine.first_cameras() {
            self.hand_out(cameras.camera(frame))?;
        }
        while let DisplayStep::Await { from, .. } = self.machine.step() {
            if self.waiting.stop.requested() {
                return Err(RoleError::Stopped);
            }
            if !self.lockstep && cameras.is_over() {
                return Ok(());
            }
            let begun = self.await_begin(from, cameras, observer)?;
            self.gather(from, begun.at, cameras)?;
            // What it does until now is to take messages: that is no computing to wait for.
            self.waiting.turn.take();
            self.show(begun, observer)?;
            self.waiting.turn.give_back();
        }
        self.last_words(observer)
    }

    fn hand_out(&mut self, camera: Camera) -> Result<(), RoleError<D::Error>> {
        self.machine.hand_out(camera);
        let link = &mut self.links[Seat::of(camera.frame()).index()];
        self.handed.hand_out(camera, &mut link.latest_tx).map_err(handing_out)
    }

    /// Waits for the frame's begin, and hands its machine the camera of the frame after next.
    fn await_begin(
        &mut self,
        from: Seat,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
    ) -> Result<Begun, RoleError<D::Error>> {
        loop {
            match self.receive(from, cameras)? {
                FrameEvent::Begin(start) => {
                    let published = self.handed.taken(&start.header);
                    let begun = Begun { camera: start.header, published, at: self.clock.elapsed() };
                    let order = |cause| RoleError::Order { peer: peer(from), cause };
                    let next = self.machine.began(start.header, self.lockstep).map_err(order)?;
                    if let Some(frame) = next {
                        self.hand_out(cameras.camera(frame))?;
                    }
                    return Ok(begun);
                }
                FrameEvent::Note(stats) => observer.pair_did(&stats),
                FrameEvent::Batch(_) | FrameEvent::End(_) => return Err(out_of_order(from, "its begin")),
            }
        }
    }

    /// Gathers the ids of a frame that has begun at `begun`, up to its end.
    fn gather(
        &mut self,
        from: Seat,
        begun: Duration,
        cameras: &mut dyn Cameras,
    ) -> Result<(), RoleError<D::Error>> {
        self.received.begin();
        self.arrivals.clear();
        loop {
            let there = self.try_receive(from)?;
            // What is there without waiting came with what was before it.
            let at_once = there.is_some();
            let event = match there {
                Some(event) => event,
                None => self.receive(from, cameras)?,
            };
            match event {
                FrameEvent::Batch(batch) => {
                    let ids = |cause| RoleError::Ids { peer: peer(from), cause };
                    self.received.take(&batch).map_err(ids)?;
                    let count = u32::try_from(self.received.ids.len()).unwrap_or(u32::MAX);
                    match self.arrivals.last_mut().filter(|_| at_once) {
                        Some((before, _)) => *before = count,
                        None => self.arrivals.push((count, self.clock.elapsed().saturating_sub(begun))),
                    }
                }
                FrameEvent::End(outcome) => {
                    self.lossy = !matches!(outcome, FrameOutcome::Complete(_));
                    return self
                        .machine
                        .ended()
                        .map_err(|cause| RoleError::Order { peer: peer(from), cause });
                }
                FrameEvent::Begin(_) | FrameEvent::Note(_) => return Err(out_of_order(from, "its end")),
            }
        }
    }

    /// RVG: draws the frame front to back.
    fn show(&mut self, begun: Begun, observer: &mut dyn Observer) -> Result<(), RoleError<D::Error>> {
        let Begun { camera, published, at } = begun;
        let view = View::new(camera, self.viewport);
        let drawing = self.clock.elapsed();
        let ids = &mut self.received.ids;
        let for_loss = if self.lossy { self.gaps.fill(view, ids)? } else { 0 };
        self.order.sort(&self.scene, &view, ids);
        let device = |cause| RoleError::Device { doing: "drawing a picture", cause };
        self.device.draw(&view, ids).map_err(device)?;
        self.gaps.drawn(ids);
        let shown = self.clock.elapsed();
        let machine = Seat::of(camera.frame()).index();
        let carried = self.links[machine].stats.read();
        let LinkStats { sent, received, .. } =
            carried - std::mem::replace(&mut self.carried[machine], carried);
        let traffic = sent_bytes(sent + received);
        let wanted = observer.wants_picture(camera.frame());
        if wanted {
            self.device.read(&mut self.picture).map_err(device)?;
        }
        let noted = observer.shown(&ShownFrame {
            camera,
            ids: &self.received.ids,
            for_loss: u32::try_from(for_loss).unwrap_or(u32::MAX),
            picture: wanted.then_some(&self.picture),
            published,
            begun: at,
            drawing,
            shown,
            traffic,
            arrivals: &self.arrivals,
        });
        noted.map_err(RoleError::Observer)
    }

    /// After the last frame: what the machines still say of their work, up to their closes.
    fn last_words(&mut self, observer: &mut dyn Observer) -> Result<(), RoleError<D::Error>> {
        for seat in [Seat::First, Seat::Second] {
            loop {
                let next = self.links[seat.index()].frames_rx.recv();
                match wait(self.waiting, "receiving a frame", next) {
                    Ok(FrameEvent::Note(stats)) => observer.pair_did(&stats),
                    Ok(_) => return Err(out_of_order(seat, "its close")),
                    Err(RoleError::Link { cause: LinkError::Receive(RecvError::Closed { .. }), .. }) => {
                        break;
                    }
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(())
    }

    /// What has come, if anything has.
    fn try_receive(&mut self, from: Seat) -> Result<Option<FrameEvent>, RoleError<D::Error>> {
        let link = &mut self.links[from.index()];
        let doing = "receiving a frame";
        link.frames_rx.try_recv().map_err(|cause| RoleError::Link { doing, cause: cause.into() })
    }

    /// Waits for the next message of a machine, while none of the two leaves: the one that is due may itself
    /// wait for the one that left. In a live session newer poses go out meanwhile, for frames that have
    /// not begun.
    fn receive(&mut self, from: Seat, cameras: &mut dyn Cameras) -> Result<FrameEvent, RoleError<D::Error>> {
        let doing = "receiving a frame";
        let [first, second] = &mut self.links;
        let lane = match from {
            Seat::First => &mut first.frames_rx,
            Seat::Second => &mut second.frames_rx,
        };
        let [of_first, of_second] = [&mut first.latest_rx, &mut second.latest_rx];
        let mut next = pin!(async {
            tokio::select! {
                biased;
                event = lane.recv() => event,
                end = left_early(of_first) => Err(end),
                end = left_early(of_second) => Err(end),
            }
        });
        let cells = [&mut first.latest_tx, &mut second.latest_tx];
        if self.lockstep {
            return wait(self.waiting, doing, next);
        }
        loop {
            let look = self.net.now().after(REFRESH);
            match self.waiting.on(until(&*self.net, look, next.as_mut())) {
                None => return Err(RoleError::Stopped),
                Some(Some(event)) => {
                    return event.map_err(|cause| RoleError::Link { doing, cause: cause.into() });
                }
                Some(None) => {}
            }
            for seat in [Seat::First, Seat::Second] {
                if let Some(camera) = self.handed.newer(seat, cameras) {
                    self.machine.hand_out(camera);
                    self.handed.hand_out(camera, cells[seat.index()]).map_err(handing_out)?;
                }
            }
        }
    }
}

fn handing_out<D: std::error::Error>(cause: SendError) -> RoleError<D> {
    RoleError::Link { doing: "handing out a camera", cause: cause.into() }
}

fn out_of_order<D: std::error::Error>(from: Seat, state: &'static str) -> RoleError<D> {
    let cause = OrderError::Unexpected { what: "a part of a frame", state };
    RoleError::Order { peer: peer(from), cause }
}
