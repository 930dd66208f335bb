//! The display: deals cameras, and shows frames as they come (paper, algorithm 4.3).

use std::{
    collections::{BTreeMap, BTreeSet},
    future::Future,
    mem,
    sync::Arc,
    time::Duration,
};

use futures_util::FutureExt;
use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, RoleMessage, SentBytes, SessionKey};
use trimaran_transport::{Instant, Net, sleep_until, until};

use super::{
    close::{leave, part, reason, worked},
    culler::{CullerWork, VisibleIds},
    culler_link::{Culled, CullerLink, Heard, first_of},
    error::RoleError,
    introduction::{Introduction, Word},
    observer::{CullerEvent, Observer, ShownFrame},
    published::{Cameras, Published},
};
use crate::{
    clock::Stopwatch,
    deal::{CullerId, Dealer, Disorder, Pace, Schedule},
    join::JoinError,
    peers::{Arrival, Peers},
    stop::Stop,
    turn::{Turn, Turns},
};

/// How often the display of a live session looks for a newer pose while it waits for the cullers.
const REFRESH: Duration = Duration::from_millis(4);
/// How long it waits after the last frame for what cullers say of theirs.
const LAST_WORDS: Duration = Duration::from_millis(500);
/// Of how many frames that are not shown yet it keeps what cullers say.
const SAID: usize = 64;

/// What a display does with a frame: on a device, or as it was recorded.
pub trait DisplayWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// Draws a frame (RVG). Of its `ids` so many are `missing`, lost on a link with deadlines. They may be
    /// put into another order, and others may be added for those that were lost: it says how many.
    ///
    /// # Errors
    /// As the device says.
    fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> impl Future<Output = Result<usize, RoleError>>;

    /// The picture drawn last.
    ///
    /// # Errors
    /// As the device says.
    fn picture(&mut self) -> Result<Option<&Image>, RoleError>;
}

/// A display and its cullers.
#[derive(Debug)]
pub struct DisplayRole<W, A> {
    /// What it does with a frame.
    pub work: W,
    /// How it culls a frame itself, where no culler does.
    pub alone: A,
    /// The cullers.
    pub cullers: Peers,
    /// How the session is known to cullers.
    pub session: SessionKey,
    /// How frames are dealt.
    pub schedule: Schedule,
    /// Which frames there are.
    pub pace: Pace,
    /// The frame that comes first: above 0 where a walk goes on.
    pub first: FrameNumber,
    /// How long it waits at the start for all cullers that it connects to. Then it begins with those that
    /// are there, and goes on looking for the others.
    pub patience: Duration,
    /// How many drawables the scene has.
    pub drawables: u32,
    /// The time it waits by.
    pub net: Arc<dyn Net>,
    /// What it measures by, and whether it draws while other roles of the process compute.
    pub turns: Turns,
}

impl<W: DisplayWork, A: CullerWork> DisplayRole<W, A> {
    /// Plays the role until the last frame is shown, or `stop` asks. Where the work is a device's, it
    /// occupies its thread.
    ///
    /// # Errors
    /// When the device or the observer fails. The cullers are told before it returns. A culler that fails
    /// ends nothing.
    pub async fn run(
        mut self,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        stop: &Stop,
    ) -> Result<(), RoleError> {
        self.work.cancel_on(stop);
        self.alone.cancel_on(stop);
        let turn = self.turns.of_a_role();
        let switch = self.schedule == Schedule::Switch;
        let mut session = Session {
            dealer: Dealer::new(self.pace, switch, self.first),
            introduction: switch.then(|| Introduction::new(self.session)),
            cullers: Vec::new(),
            there: BTreeMap::new(),
            published: Published::default(),
            newest: None,
            shown: self.first,
            numbers: BTreeMap::new(),
            said: BTreeMap::new(),
            unheard: BTreeSet::new(),
            last: Vec::new(),
            clock: self.turns.clock(),
            turn: &turn,
            stop,
            cameras,
            observer,
            role: self,
        };
        let result = worked(session.play(), &turn, stop).await;
        let Session { role, cullers, .. } = session;
        // Who leaves looks for nobody any more.
        drop(role);
        let links = cullers.into_iter().map(|culler| culler.link).collect();
        part(links, result, stop).await
    }
}

struct Session<'r, W, A> {
    role: DisplayRole<W, A>,
    dealer: Dealer,
    /// For the schedule `switch`.
    introduction: Option<Introduction>,
    cullers: Vec<CullerLink>,
    /// Frames that can be shown.
    there: BTreeMap<FrameNumber, Culled>,
    published: Published,
    /// Live: the newest pose that was handed out.
    newest: Option<Camera>,
    /// How many frames have been shown, with those of the walk before this session.
    shown: FrameNumber,
    /// The numbers under which the last frames were shown, by those under which they were dealt.
    numbers: BTreeMap<FrameNumber, FrameNumber>,
    /// What cullers said of frames that are not shown yet.
    said: BTreeMap<FrameNumber, FrameStats>,
    /// Frames that are shown and whose cullers have not said yet what they did.
    unheard: BTreeSet<FrameNumber>,
    /// What was drawn last.
    last: Vec<DrawableId>,
    clock: Stopwatch,
    turn: &'r Turn,
    stop: &'r Stop,
    cameras: &'r mut dyn Cameras,
    observer: &'r mut dyn Observer,
}

enum Event {
    Heard(CullerId, Heard),
    Arrived(Result<Arrival, JoinError>),
    /// Something may be due by the clock.
    Tick,
}

impl<W: DisplayWork, A: CullerWork> Session<'_, W, A> {
    async fn play(&mut self) -> Result<(), RoleError> {
        self.gather_cullers().await;
        while !self.is_over() {
            if self.stop.requested() {
                return Err(RoleError::Stopped);
            }
            // All that has come, before anything is done that takes long.
            while let Some(event) = self.event(None).now_or_never() {
                self.take(event).await;
            }
            self.deal();
            if let Some(frame) = self.dealer.due() {
                self.show(frame).await?;
            } else if let Some(frame) = self.dealer.to_cull_itself() {
                self.cull_itself(frame).await?;
            } else {
                let event = self.event(Some(self.next_look())).await;
                self.take(event).await;
            }
        }
        self.hear_last_words().await;
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.dealer.is_done() || self.role.pace == Pace::Live && self.cameras.is_over()
    }

    /// Waits for the cullers that are expected.
    async fn gather_cullers(&mut self) {
        let deadline = self.role.net.now().after(self.role.patience);
        while self.cullers.len() < self.role.cullers.expected() && self.role.net.now() < deadline {
            let event = self.event(Some(deadline)).await;
            self.take(event).await;
        }
    }

    /// What happens next, until `look` at the latest. Dropping the future loses nothing.
    async fn event(&mut self, look: Option<Instant>) -> Event {
        let Self { role: DisplayRole { net, cullers: peers, .. }, cullers, clock, .. } = self;
        let tick = async {
            match look {
                Some(look) => sleep_until(&**net, look).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            (id, heard) = first_of(cullers, clock) => Event::Heard(id, heard),
            arrival = peers.next() => Event::Arrived(arrival),
            () = tick => Event::Tick,
        }
    }

    /// When something may be due though nobody says anything.
    fn next_look(&self) -> Instant {
        let now = self.role.net.now();
        let refresh = (self.role.pace == Pace::Live).then(|| now.after(REFRESH));
        let late = self.dealer.late().map(|(_, at)| at);
        refresh.into_iter().chain(late).min().unwrap_or_else(|| now.after(Duration::from_secs(3600)))
    }

    async fn take(&mut self, event: Event) {
        let now = self.role.net.now();
        let (from, lapse) = match event {
            Event::Heard(from, Heard::Began(camera)) => (from, self.began(from, &camera)),
            Event::Heard(from, Heard::Whole(culled)) => {
                let ended = self.dealer.ended(from, now);
                if let Ok(Some(frame)) = ended {
                    self.there.insert(frame, *culled);
                }
                (from, ended.map(drop))
            }
            Event::Heard(from, Heard::Said(said)) => {
                self.hear(from, said).await;
                return;
            }
            Event::Heard(from, Heard::Gone(error)) => {
                self.lose(from, error).await;
                return;
            }
            Event::Arrived(Ok(arrival)) => {
                self.welcome(arrival, now).await;
                return;
            }
            Event::Arrived(Err(error)) => {
                tracing::error!(error = &error as &dyn std::error::Error, "goes on without a culler");
                return;
            }
            Event::Tick => {
                if let Some((id, _)) = self.dealer.late().filter(|(_, at)| *at <= now) {
                    tracing::warn!(%id, "it is late: others cull its frames until it answers");
                    self.observer.culler(CullerEvent::Late(id));
                    self.dealer.pass_over(id);
                    self.arrange().await;
                }
                return;
            }
        };
        match lapse {
            Ok(()) => self.arrange().await,
            Err(cause) => self.lose(from, RoleError::Order { peer: from.to_string(), cause }).await,
        }
    }

    fn began(&mut self, from: CullerId, camera: &Camera) -> Result<(), Disorder> {
        let frame = camera.frame();
        self.dealer.began(from, frame)?;
        // What was shown meanwhile is not looked at any more.
        if frame >= self.dealer.next() && self.published.when(camera).is_none() {
            return Err(Disorder::ForeignCamera(frame));
        }
        Ok(())
    }

    async fn welcome(&mut self, arrival: Arrival, now: Instant) {
        let Some(id) = CullerId::of(arrival.place) else { return };
        tracing::info!(%id, address = %arrival.link.peer.address, "has come");
        let culler = CullerLink::new(id, arrival, self.role.drawables);
        self.observer.culler(CullerEvent::Came(id, &culler.link));
        self.cullers.push(culler);
        self.dealer.join(id, now);
        self.arrange().await;
    }

    /// Lets a culler go, and looks for it again.
    async fn lose(&mut self, id: CullerId, error: RoleError) {
        let Some(place) = self.cullers.iter().position(|culler| culler.id == id) else { return };
        let culler = self.cullers.swap_remove(place);
        tracing::warn!(%id, error = &error as &dyn std::error::Error, "is gone; it is looked for again");
        self.observer.culler(CullerEvent::Left(id, &error));
        self.dealer.leave(id);
        self.arrange().await;
        // Nobody waits until it has heard.
        let why = reason(&error);
        self.role.net.spawn(Box::pin(leave(vec![culler.link], why)));
    }

    async fn hear(&mut self, from: CullerId, said: RoleMessage) {
        if let RoleMessage::Stats(stats) = said {
            self.note(stats);
        } else if let Some(introduction) = &mut self.introduction {
            let words = introduction.hear(from, &said, &mut self.dealer);
            self.say(words).await;
        }
    }

    /// In the schedule `switch`: sees to it that two cullers know each other.
    async fn arrange(&mut self) {
        let begun = self.dealer.fresh() > self.role.first;
        if let Some(introduction) = &mut self.introduction {
            let words = introduction.arrange(&mut self.dealer, &self.cullers, begun);
            self.say(words).await;
        }
    }

    async fn say(&mut self, words: Vec<Word>) {
        for (id, word) in words {
            if let Some(culler) = self.cullers.iter_mut().find(|culler| culler.id == id) {
                // Who is gone is noticed where it is listened to.
                let _unheard = culler.link.messages_tx.send(&word).await;
            }
        }
    }

    /// Hands out the cameras that are due.
    fn deal(&mut self) {
        let now = self.role.net.now();
        for (id, frame) in self.dealer.deal(now) {
            let camera = self.published.newest(frame).unwrap_or_else(|| self.cameras.camera(frame));
            self.publish(id, camera);
        }
        if self.role.pace != Pace::Live {
            return;
        }
        let newer: Vec<_> = self.dealer.refreshable().collect();
        for (id, frame) in newer {
            let camera = self.cameras.camera(frame);
            if self.published.newest(frame) != Some(camera) {
                self.publish(id, camera);
            }
        }
        loop {
            let pose = self.cameras.camera(self.dealer.fresh());
            let news = self.newest.is_none_or(|newest| newest.for_frame(pose.frame()) != pose);
            let Some(id) = self.dealer.wants_camera(news) else { return };
            let frame = self.dealer.hand_out(id, now);
            self.newest = Some(pose);
            self.publish(id, pose.for_frame(frame));
        }
    }

    fn publish(&mut self, id: CullerId, camera: Camera) {
        self.published.note(camera, self.clock.elapsed());
        if let Some(culler) = self.cullers.iter_mut().find(|culler| culler.id == id) {
            // Who is gone is noticed where it is listened to.
            let _unheard = culler.link.latest_tx.publish(camera);
        }
    }

    /// Culls a frame that nobody else does.
    async fn cull_itself(&mut self, frame: FrameNumber) -> Result<(), RoleError> {
        let camera = self.published.newest(frame).unwrap_or_else(|| self.cameras.camera(frame));
        self.published.note(camera, self.clock.elapsed());
        self.turn.take().await;
        let alone = &mut self.role.alone;
        alone.begin_occluders(camera, false)?;
        alone.take_occluders(&self.last)?;
        alone.complete_occluders(camera).await?;
        self.turn.away();
        let begun = self.clock.elapsed();
        let mut visible = VisibleIds::kept();
        alone.cull(camera, &mut visible).await?;
        let occluders_of = self.numbers.last_key_value().map(|(dealt, _)| *dealt);
        self.said.insert(frame, FrameStats { occluders_of, ..alone.frame_stats(self.turn.away()) });
        let culled = Culled {
            camera,
            by: None,
            ids: visible.into_found(),
            missing: 0,
            begun,
            arrivals: Vec::new(),
            traffic: SentBytes::default(),
        };
        self.there.insert(frame, culled);
        self.dealer.culled_itself(frame);
        Ok(())
    }

    /// RVG: draws the frame, and tells the observer.
    async fn show(&mut self, frame: FrameNumber) -> Result<(), RoleError> {
        let older = self.dealer.shown(frame);
        self.there.retain(|there, _| !older.contains(there));
        let Some(culled) = self.there.remove(&frame) else { return Ok(()) };
        let Culled { camera, by, mut ids, missing, begun, arrivals, traffic } = culled;
        // What it does until now is to take messages: that is no computing to wait for.
        self.turn.take().await;
        let drawing = self.clock.elapsed();
        let for_loss = self.role.work.draw(camera, &mut ids, missing).await?;
        let shown = self.clock.elapsed();
        let published = self.published.when(&camera).unwrap_or(begun);
        let number = self.shown;
        self.shown = FrameNumber(number.0.saturating_add(1));
        let picture = match self.observer.wants_picture(number) {
            true => self.role.work.picture()?,
            false => None,
        };
        let seen = ShownFrame {
            camera: camera.for_frame(number),
            culler: by,
            ids: &ids,
            for_loss: u32::try_from(for_loss).unwrap_or(u32::MAX),
            picture,
            published,
            begun,
            drawing,
            shown,
            traffic,
            arrivals: &arrivals,
        };
        self.observer.shown(&seen).map_err(RoleError::Observer)?;
        self.turn.give_back();
        self.last = ids;
        self.published.shown(frame);
        self.numbers.insert(frame, number);
        if self.numbers.len() > SAID {
            self.numbers.pop_first();
        }
        // What was said of frames that are not shown is of no use.
        let mut said = mem::take(&mut self.said);
        self.said = said.split_off(&FrameNumber(frame.0.saturating_add(1)));
        self.unheard.insert(frame);
        if self.unheard.len() > SAID {
            self.unheard.pop_first();
        }
        if let Some(stats) = said.remove(&frame) {
            self.pass_on(stats);
        }
        Ok(())
    }

    /// Notes what a culler says of a frame until that is shown.
    fn note(&mut self, stats: FrameStats) {
        if stats.frame < self.dealer.next() {
            self.pass_on(stats);
        } else {
            self.said.insert(stats.frame, stats);
            if self.said.len() > SAID {
                self.said.pop_last();
            }
        }
    }

    /// Tells the observer, under the number by which the frame was shown.
    fn pass_on(&mut self, stats: FrameStats) {
        self.unheard.remove(&stats.frame);
        if let Some(frame) = self.numbers.get(&stats.frame).copied() {
            let occluders_of = stats.occluders_of.and_then(|of| self.numbers.get(&of).copied());
            self.observer.culled(&FrameStats { frame, occluders_of, ..stats });
        }
    }

    /// After the last frame: what cullers still say of theirs.
    async fn hear_last_words(&mut self) {
        let deadline = self.role.net.now().after(LAST_WORDS);
        while !self.unheard.is_empty() && !self.cullers.is_empty() {
            let net = Arc::clone(&self.role.net);
            match until(&*net, deadline, self.event(None)).await {
                Some(event) => self.take(event).await,
                None => return,
            }
        }
    }
}
