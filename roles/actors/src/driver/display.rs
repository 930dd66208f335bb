//! The display: which messages move when (paper, algorithm 4.3).

use std::{future::Future, pin::pin, sync::Arc, time::Duration};

use trimaran_cull::Image;
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, FrameStats, IdBatch, RoleMessage, SentBytes, Settings,
};
use trimaran_transport::{FrameOutcome, LinkStats, Net, RecvError, StatsHandle, until};

use super::{
    cameras::{Cameras, PublishedCameras},
    close::{left_early, part, worked},
    culler::sent_bytes,
    error::{BoxedError, RoleError, link},
};
use crate::{
    clock::Stopwatch,
    ids::IdError,
    links::{FrameEvent, Link},
    machine::{CullerIndex, DisplayMachine, DisplayStep, OrderError},
    stop::Stop,
    turn::{Turn, Turns},
};

/// How often the display of a live session looks for a newer pose while it waits for the cullers.
const REFRESH: Duration = Duration::from_millis(4);

/// What a display does with a frame: on a device, or as it was recorded.
pub trait DisplayWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// A frame has begun to come.
    fn begin(&mut self);

    /// Takes a part of it.
    ///
    /// # Errors
    /// If no frame can have an id.
    fn take(&mut self, batch: &IdBatch) -> Result<(), IdError>;

    /// Draws it, all of which is there but for what `outcome` says (RVG).
    ///
    /// # Errors
    /// As the device says.
    fn draw(&mut self, camera: Camera, outcome: FrameOutcome) -> impl Future<Output = Result<(), RoleError>>;

    /// What was drawn last, with its picture if that is asked for.
    ///
    /// # Errors
    /// As the device says.
    fn drawn(&mut self, with_picture: bool) -> Result<Drawn<'_>, RoleError>;
}

/// What a display drew.
#[derive(Debug, Default)]
pub struct Drawn<'w> {
    /// In the order drawn.
    pub ids: &'w [DrawableId],
    /// How many of them were drawn only because ids of the frame were lost on a link with deadlines.
    pub for_loss: u32,
    /// The picture, if it was asked for.
    pub picture: Option<&'w Image>,
}

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
    /// What travelled between the display and the frame's culler, both ways, since that culler's last
    /// frame was shown: the frame, statistics of an earlier one, and a camera.
    pub traffic: SentBytes,
    /// How many ids had come, and when, since the frame's begin: one entry for all batches that came at
    /// once.
    pub arrivals: &'f [(u32, Duration)],
}

/// Sees what the display does. Time spent here is the session's: an observer notes and returns.
pub trait Observer {
    /// Whether this frame's picture is to be read back.
    fn wants_picture(&self, frame: FrameNumber) -> bool {
        let _ = frame;
        false
    }

    /// A frame has been shown.
    ///
    /// # Errors
    /// When it cannot be noted. The session ends with it, and the peers are told.
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError>;

    /// What a culler did for a frame that it has sent.
    fn culled(&mut self, stats: &FrameStats) {
        let _ = stats;
    }
}

/// The display, joined to the cullers.
#[derive(Debug)]
pub struct DisplayRole<W> {
    /// What it does with a frame.
    pub work: W,
    /// The link to the first culler.
    pub first: Link,
    /// The link to the second culler.
    pub second: Link,
    /// What it has decided for the session.
    pub settings: Settings,
    /// The time it waits by.
    pub net: Arc<dyn Net>,
    /// What it measures by, and whether it draws while other roles of the process compute. The same goes on
    /// when the session does, after a peer was lost.
    pub turns: Turns,
}

/// What the display's links carried, first and second culler.
pub type CullerTraffic = [LinkStats; 2];

impl<W: DisplayWork> DisplayRole<W> {
    /// Plays the role until the session's last frame is shown, or `stop` asks. Where the work is a device's,
    /// it occupies its thread. Returns what the links carried.
    ///
    /// # Errors
    /// When a peer dies, leaves or breaks the order, or the device or the observer fails. The peers are told
    /// before it returns.
    pub async fn run(
        mut self,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        stop: &Stop,
    ) -> Result<CullerTraffic, RoleError> {
        self.work.cancel_on(stop);
        let turn = self.turns.of_a_role();
        let links = [self.first, self.second];
        let counters = links.each_ref().map(|link| link.stats.clone());
        let mut session = Session {
            machine: DisplayMachine::new(self.settings.first, self.settings.frames),
            work: self.work,
            carried: counters.each_ref().map(StatsHandle::read),
            links,
            lockstep: self.settings.lockstep,
            stop,
            turn: &turn,
            net: self.net,
            clock: self.turns.clock(),
            published: PublishedCameras::new(self.turns.clock()),
            arrivals: Vec::new(),
            said: Vec::new(),
            cameras,
            observer,
        };
        let result = worked(session.frames(), &turn, stop).await;
        part(session.links, result, stop).await?;
        Ok(counters.each_ref().map(StatsHandle::read))
    }
}

struct Session<'r, W> {
    machine: DisplayMachine,
    work: W,
    links: [Link; 2],
    lockstep: bool,
    stop: &'r Stop,
    turn: &'r Turn,
    net: Arc<dyn Net>,
    clock: Stopwatch,
    published: PublishedCameras,
    /// What the links had carried when their last frames were shown.
    carried: CullerTraffic,
    arrivals: Vec<(u32, Duration)>,
    /// What cullers said of frames that are not shown yet.
    said: Vec<RoleMessage>,
    cameras: &'r mut dyn Cameras,
    observer: &'r mut dyn Observer,
}

/// A frame that a culler has begun to send.
#[derive(Debug, Clone, Copy)]
struct Begun {
    camera: Camera,
    /// When its camera was handed out.
    published: Duration,
    /// When the begin arrived.
    at: Duration,
}

impl<W: DisplayWork> Session<'_, W> {
    async fn frames(&mut self) -> Result<(), RoleError> {
        for frame in self.machine.first_cameras() {
            self.hand_out(frame)?;
        }
        while let DisplayStep::Await { from, .. } = self.machine.step() {
            if self.stop.requested() {
                return Err(RoleError::Stopped);
            }
            if !self.lockstep && self.cameras.is_over() {
                return Ok(());
            }
            let begun = self.await_begin(from).await?;
            let outcome = self.gather(from, begun.at).await?;
            // What it does until now is to take messages: that is no computing to wait for.
            self.turn.take().await;
            self.show(begun, outcome).await?;
            self.turn.give_back();
        }
        self.last_words().await
    }

    fn hand_out(&mut self, frame: FrameNumber) -> Result<(), RoleError> {
        let camera = self.cameras.camera(frame);
        self.machine.hand_out(camera);
        let to = &mut self.links[CullerIndex::of(frame).index()].latest_tx;
        self.published.publish(camera, to).map_err(link(HANDING_OUT))
    }

    /// Waits for the frame's begin, and hands its culler the camera of the frame after next.
    async fn await_begin(&mut self, from: CullerIndex) -> Result<Begun, RoleError> {
        let FrameEvent::Begin(start) = self.receive(from).await? else {
            return Err(out_of_order(from, "its begin"));
        };
        let published = self.published.taken(&start.header);
        let begun = Begun { camera: start.header, published, at: self.clock.elapsed() };
        if let Some(frame) = self.machine.began(start.header, self.lockstep).map_err(by(from))? {
            self.hand_out(frame)?;
        }
        Ok(begun)
    }

    /// Gathers the ids of a frame that has begun at `begun`, up to its end.
    async fn gather(&mut self, from: CullerIndex, begun: Duration) -> Result<FrameOutcome, RoleError> {
        self.work.begin();
        self.arrivals.clear();
        let mut count = 0;
        loop {
            let there = self.links[from.index()].frames_rx.try_recv().map_err(link(RECEIVING))?;
            // What is there without waiting came with what was before it.
            let at_once = there.is_some();
            let event = match there {
                Some(event) => event,
                None => self.receive(from).await?,
            };
            match event {
                FrameEvent::Batch(batch) => {
                    self.work.take(&batch).map_err(|cause| RoleError::Ids { peer: from.name(), cause })?;
                    count += u32::try_from(batch.count()).unwrap_or(u32::MAX);
                    match self.arrivals.last_mut().filter(|_| at_once) {
                        Some((before, _)) => *before = count,
                        None => self.arrivals.push((count, self.clock.elapsed().saturating_sub(begun))),
                    }
                }
                FrameEvent::End(outcome) => {
                    self.machine.ended().map_err(by(from))?;
                    return Ok(outcome);
                }
                FrameEvent::Begin(_) => return Err(out_of_order(from, "its end")),
            }
        }
    }

    /// RVG: draws the frame, and tells the observer.
    async fn show(&mut self, begun: Begun, outcome: FrameOutcome) -> Result<(), RoleError> {
        let Begun { camera, published, at: begun } = begun;
        let drawing = self.clock.elapsed();
        self.work.draw(camera, outcome).await?;
        let shown = self.clock.elapsed();
        let culler = CullerIndex::of(camera.frame()).index();
        let carried = self.links[culler].stats.read();
        let since = carried - std::mem::replace(&mut self.carried[culler], carried);
        let traffic = sent_bytes(since.sent + since.received);
        let Drawn { ids, for_loss, picture } =
            self.work.drawn(self.observer.wants_picture(camera.frame()))?;
        let arrivals = &self.arrivals;
        let frame = ShownFrame {
            camera,
            ids,
            for_loss,
            picture,
            published,
            begun,
            drawing,
            shown,
            traffic,
            arrivals,
        };
        self.observer.shown(&frame).map_err(RoleError::Observer)?;
        self.hear(camera.frame());
        Ok(())
    }

    /// After the last frame: what the cullers still say of their work, up to their closes.
    async fn last_words(&mut self) -> Result<(), RoleError> {
        for from in CullerIndex::ALL {
            let Link { frames_rx, messages_rx, .. } = &mut self.links[from.index()];
            match frames_rx.recv().await {
                Ok(_) => return Err(out_of_order(from, "its close")),
                Err(RecvError::Closed { .. }) => {}
                Err(cause) => return Err(link(RECEIVING)(cause)),
            }
            loop {
                match messages_rx.recv().await {
                    Ok(said) => self.said.push(said),
                    Err(RecvError::Closed { .. }) => break,
                    Err(cause) => return Err(link(RECEIVING)(cause)),
                }
            }
        }
        self.pass_on(None);
        Ok(())
    }

    /// Hears what the cullers say of their work. What ends a link shows on its frames.
    fn hear(&mut self, shown: FrameNumber) {
        for link in &mut self.links {
            self.said.extend(std::iter::from_fn(|| link.messages_rx.try_recv().ok().flatten()));
        }
        self.pass_on(Some(shown));
    }

    /// Tells the observer what was said of frames up to `shown`, or of all: it hears of a frame once that is
    /// shown, and messages may overtake frames.
    fn pass_on(&mut self, shown: Option<FrameNumber>) {
        let observer = &mut *self.observer;
        self.said.retain(|said| match said {
            RoleMessage::Stats(stats) if shown.is_none_or(|shown| stats.frame <= shown) => {
                observer.culled(stats);
                false
            }
            RoleMessage::Stats(_) => true,
            _ => false,
        });
    }

    /// Waits for the next message of a culler, while none of the two leaves: the one that is due may itself
    /// wait for the one that left. In a live session newer poses go out meanwhile, for frames that have
    /// not begun.
    async fn receive(&mut self, from: CullerIndex) -> Result<FrameEvent, RoleError> {
        let [first, second] = &mut self.links;
        let lane = match from {
            CullerIndex::First => &mut first.frames_rx,
            CullerIndex::Second => &mut second.frames_rx,
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
        if self.lockstep {
            return next.await.map_err(link(RECEIVING));
        }
        let cells = [&mut first.latest_tx, &mut second.latest_tx];
        loop {
            let look = self.net.now().after(REFRESH);
            if let Some(event) = until(&*self.net, look, next.as_mut()).await {
                return event.map_err(link(RECEIVING));
            }
            for culler in CullerIndex::ALL {
                if let Some(camera) = self.published.newer(culler, self.cameras) {
                    self.machine.hand_out(camera);
                    self.published.publish(camera, cells[culler.index()]).map_err(link(HANDING_OUT))?;
                }
            }
        }
    }
}

const RECEIVING: &str = "receiving a frame";
const HANDING_OUT: &str = "handing out a camera";

fn by(from: CullerIndex) -> impl FnOnce(OrderError) -> RoleError {
    move |cause| RoleError::Order { peer: from.name(), cause }
}

fn out_of_order(from: CullerIndex, state: &'static str) -> RoleError {
    by(from)(OrderError::Unexpected { what: "a part of a frame", state })
}
