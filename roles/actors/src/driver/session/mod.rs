//! A display's loop: deals cameras, takes the cullers' messages, and shows frames that are due.

mod frames;
mod supply;

use std::{collections::BTreeMap, rc::Rc, sync::Arc, time::Duration};

use futures_util::{
    FutureExt,
    future::{OptionFuture, join_all},
};
use trimaran_proto::{Camera, DrawableId, FrameNumber, RoleMessage, ViewVersion};
use trimaran_transport::{Instant, sleep_until, until};

use super::{
    close::{leave, part, reason, worked},
    culler::CullerWork,
    culler_link::{Culled, CullerLink, Heard, first_of},
    display::{DisplayRole, DisplayWork},
    error::RoleError,
    introduction::{Introduction, Word},
    observer::{CullerEvent, Observer},
    published::{Cameras, Published},
    shown_stats::ShownStats,
};
use crate::{
    choice::CullingChoice,
    clock::Stopwatch,
    deal::{CullerId, Dealer, Disorder, Pace, Schedule},
    join::JoinError,
    links::Link,
    peers::Arrival,
    stop::Stop,
};

use supply::Supplies;

/// How often the display of a live session looks for a newer pose while it waits for the cullers.
const REFRESH: Duration = Duration::from_millis(4);
/// How long it waits after the last frame for the cullers' statistics.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// A display with its cullers.
pub(super) struct Session<'r, W, A> {
    role: DisplayRole<W, A>,
    dealer: Dealer,
    /// For the schedule `switch`.
    introduction: Option<Introduction>,
    cullers: Vec<CullerLink>,
    /// Frames that can be shown once their missing geometry has come.
    there: BTreeMap<FrameNumber, Culled>,
    /// The last shown frame, if it is not exact yet.
    loading: Option<Loading>,
    /// If the display has no scene.
    supplies: Option<Supplies>,
    /// Why nothing can be shown any more.
    failed: Option<RoleError>,
    published: Published,
    /// Live: the newest published pose.
    newest: Option<Camera>,
    /// The camera of the last shown frame, if none of its ids were lost.
    shown_whole: Option<Camera>,
    /// The cullers' statistics of frames.
    stats: ShownStats,
    /// The drawables of the last picture.
    last: Vec<DrawableId>,
    /// Whether they are all that was in the frustum.
    last_in_frustum: bool,
    /// How it finds those of a frame that it culls itself.
    choice: CullingChoice,
    /// The view states of the last frames that it culled itself and drew.
    culled_in: ViewVersion,
    drawn_in: ViewVersion,
    clock: Stopwatch,
    stop: &'r Stop,
    cameras: &'r mut dyn Cameras,
    observer: &'r mut dyn Observer,
}

/// A frame shown with stand-ins for missing drawables.
struct Loading {
    frame: FrameNumber,
    culled: Culled,
    /// When its camera was published.
    published: Duration,
    /// How many drawables it lacked when it was drawn.
    lacked: usize,
}

#[expect(clippy::large_enum_variant, reason = "none is kept")]
enum Event {
    Heard(CullerId, Heard),
    Arrived(Box<Result<Arrival, JoinError>>),
    /// Geometry has come.
    Supplied,
    /// Something may be due by the clock.
    Tick,
}

impl<W: DisplayWork, A: CullerWork> DisplayRole<W, A> {
    /// Plays the role until the last frame is shown, or `stop` asks. If the work uses a device, it blocks its
    /// thread.
    ///
    /// # Errors
    /// When the device or the observer fails. The cullers are told before it returns. A culler's failure ends
    /// nothing.
    pub async fn run(
        mut self,
        cameras: &mut dyn Cameras,
        observer: &mut dyn Observer,
        stop: &Stop,
    ) -> Result<(), RoleError> {
        self.work.cancel_on(stop);
        if let Some(alone) = &mut self.alone {
            alone.cancel_on(stop);
        }
        let turn = Rc::new(self.turns.of_a_role());
        let mut session = Session::new(self.in_turn(&turn), stop, cameras, observer);
        let result = worked(turn.given_back_while_waiting(session.play()), stop).await;
        turn.give_back();
        session.tell_ahead_use();
        part(session.into_links().await, result, stop).await
    }
}

impl<'r, W: DisplayWork, A: CullerWork> Session<'r, W, A> {
    pub(super) fn new(
        role: DisplayRole<W, A>,
        stop: &'r Stop,
        cameras: &'r mut dyn Cameras,
        observer: &'r mut dyn Observer,
    ) -> Self {
        let switch = role.schedule == Schedule::Switch;
        Self {
            dealer: Dealer::new(role.pace, switch, role.first),
            introduction: switch.then(|| Introduction::new(role.session)),
            cullers: Vec::new(),
            there: BTreeMap::new(),
            loading: None,
            supplies: role
                .supplied
                .as_ref()
                .map(|supplied| Supplies::new(supplied, role.pace, role.net.now())),
            failed: None,
            published: Published::default(),
            newest: None,
            shown_whole: None,
            stats: ShownStats::from(role.first),
            last: Vec::new(),
            last_in_frustum: false,
            choice: CullingChoice::default(),
            culled_in: ViewVersion(0),
            drawn_in: ViewVersion(0),
            clock: role.turns.clock(),
            stop,
            cameras,
            observer,
            role,
        }
    }

    /// The links to the cullers, at the end. No links are made any more.
    pub(super) async fn into_links(self) -> Vec<Link> {
        let Self { role, cullers, .. } = self;
        // First, so that the cullers' slots, which are freed now, are not filled again.
        drop(role);
        join_all(cullers.into_iter().map(CullerLink::into_link)).await
    }

    /// Shows frames until the last one, or until it is asked to stop.
    pub(super) async fn play(&mut self) -> Result<(), RoleError> {
        self.gather_cullers().await;
        while !self.is_over() {
            if self.stop.requested() {
                return Err(RoleError::Stopped);
            }
            // Handles all pending messages before anything that takes long.
            while let Some(event) = self.event(None).now_or_never() {
                self.take(event);
            }
            if let Some(error) = self.failed.take() {
                return Err(error);
            }
            self.deal()?;
            if let Some(frame) = self.due() {
                self.show(frame).await?;
            } else if self.has_more() {
                self.show_again().await?;
            } else if let Some(frame) = self.itself_to_cull() {
                self.cull_itself(frame).await?;
            } else {
                let event = self.event(Some(self.next_look())).await;
                self.take(event);
            }
        }
        self.hear_last_words().await;
        Ok(())
    }

    fn itself_to_cull(&mut self) -> Option<FrameNumber> {
        let frame = self.dealer.to_cull_itself().filter(|_| self.role.alone.is_some())?;
        let rests = self.role.pace == Pace::Live && {
            let pose = self.cameras.camera(frame);
            self.is_seen(&pose)
        };
        (!rests).then_some(frame)
    }

    fn is_over(&self) -> bool {
        self.dealer.is_done() || self.role.pace == Pace::Live && self.cameras.is_over()
    }

    /// Waits for the expected cullers.
    async fn gather_cullers(&mut self) {
        let deadline = self.role.net.now().after(self.role.join_timeout);
        while self.cullers.len() < self.role.cullers.expected() && self.role.net.now() < deadline {
            let event = self.event(Some(deadline)).await;
            self.take(event);
        }
    }

    /// The next event, until `look` at the latest. Dropping the future loses nothing.
    async fn event(&mut self, look: Option<Instant>) -> Event {
        let Self { role: DisplayRole { net, cullers: peers, .. }, cullers, supplies, clock, .. } = self;
        let came = supplies.as_ref().map(|supplies| supplies.holdings.came.notified());
        let tick = look.map(|look| sleep_until(&**net, look));
        tokio::select! {
            biased;
            (id, heard) = first_of(cullers, clock) => Event::Heard(id, heard),
            Some(()) = OptionFuture::from(came) => Event::Supplied,
            arrival = peers.next() => Event::Arrived(Box::new(arrival)),
            Some(()) = OptionFuture::from(tick) => Event::Tick,
        }
    }

    /// The next time when something may be due without a message.
    fn next_look(&self) -> Instant {
        let now = self.role.net.now();
        let refresh = (self.role.pace == Pace::Live).then(|| now.after(REFRESH));
        let late = self.dealer.late().map(|(_, at)| at);
        let meeting = self.introduction.as_ref().and_then(Introduction::late);
        refresh
            .into_iter()
            .chain(late)
            .chain(meeting)
            .chain(self.supplier_late())
            .chain(self.stands_in())
            .min()
            .unwrap_or_else(|| now.after(Duration::from_secs(3600)))
    }

    fn take(&mut self, event: Event) {
        let now = self.role.net.now();
        let (from, lapse) = match event {
            Event::Heard(from, Heard::Began(camera)) => (from, self.began(from, &camera)),
            Event::Heard(from, Heard::Whole(culled)) => {
                let ended = self.dealer.ended(from, now);
                if let Ok(Some(frame)) = ended
                    && let Err(cause) = self.note_whole(frame, *culled, now)
                {
                    self.lose_supplier(cause);
                }
                (from, ended.map(drop))
            }
            Event::Heard(from, Heard::Message(message)) => {
                self.hear(from, message);
                return;
            }
            Event::Heard(_, Heard::Gone(RoleError::Supplied { peer, cause }))
                if cause.doubts_what_is_there() =>
            {
                self.failed = Some(RoleError::Supplied { peer, cause });
                return;
            }
            Event::Heard(from, Heard::Gone(error)) => {
                self.lose(from, error);
                return;
            }
            Event::Arrived(arrival) => {
                match *arrival {
                    Ok(arrival) => self.welcome(arrival, now),
                    Err(error) => {
                        tracing::error!(error = &error as &dyn std::error::Error, "goes on without a culler");
                    }
                }
                return;
            }
            Event::Supplied => {
                if let Err(cause) = self.note_supplied(now) {
                    self.lose_supplier(cause);
                }
                return;
            }
            Event::Tick => {
                if self.supplier_late().is_some_and(|at| at <= now) {
                    self.change_supplier(now);
                }
                if let Some((id, _)) = self.dealer.late().filter(|(_, at)| *at <= now) {
                    tracing::warn!(%id, "it is late: others cull its frames until it answers");
                    self.observer.culler(CullerEvent::Late(id));
                    self.dealer.pass_over(id);
                    self.arrange();
                }
                if let Some(introduction) = &mut self.introduction
                    && introduction.late().is_some_and(|at| at <= now)
                {
                    let words = introduction.overdue(&mut self.dealer);
                    self.say(words);
                }
                return;
            }
        };
        match lapse {
            Ok(()) => self.arrange(),
            Err(cause) => self.lose(from, RoleError::Order { peer: from.to_string(), cause }),
        }
    }

    fn began(&mut self, from: CullerId, camera: &Camera) -> Result<(), Disorder> {
        let frame = camera.frame();
        self.dealer.began(from, frame)?;
        // Cameras of frames shown meanwhile do not matter any more.
        if frame >= self.dealer.next() && self.published.when(camera).is_none() {
            return Err(Disorder::ForeignCamera(frame));
        }
        Ok(())
    }

    fn welcome(&mut self, arrival: Arrival, now: Instant) {
        let Some(id) = CullerId::of(arrival.place) else { return };
        tracing::info!(%id, address = %arrival.link.peer.address, "has come");
        if let Some(why) = self.foreign_scene(&arrival) {
            tracing::error!(%id, why, "is let go, and looked for again");
            self.turn_away(arrival, &why);
            return;
        }
        let mut culler = CullerLink::new(id, arrival, self.role.drawables);
        if let Some(supplies) = &self.supplies {
            culler.take_supply(&self.role.net, &supplies.holdings);
        }
        self.observer.culler(CullerEvent::Came(id, &culler.link));
        self.cullers.push(culler);
        self.dealer.join(id, now);
        self.choose_supplier(now);
        self.arrange();
    }

    /// Drops a culler, and reconnects to it.
    fn lose(&mut self, id: CullerId, error: RoleError) {
        let Some(place) = self.cullers.iter().position(|culler| culler.id == id) else { return };
        let culler = self.cullers.swap_remove(place);
        tracing::warn!(%id, error = &error as &dyn std::error::Error, "is gone; it is looked for again");
        self.observer.culler(CullerEvent::Left(id, &error));
        self.dealer.leave(id);
        self.arrange();
        // The close is not waited for.
        let why = reason(&error);
        self.role.net.spawn(Box::pin(async move { leave(vec![culler.into_link().await], why).await }));
        self.choose_supplier(self.role.net.now());
    }

    fn hear(&mut self, from: CullerId, message: RoleMessage) {
        if let RoleMessage::Stats(stats) = message {
            if let Some(stats) = self.stats.note(stats) {
                self.observer.culled(&stats);
            }
        } else if let Some(introduction) = &mut self.introduction {
            let now = self.role.net.now();
            let words = introduction.hear(from, &message, &mut self.dealer, now);
            self.say(words);
        }
    }

    /// In the schedule `switch`: introduces two cullers to each other.
    fn arrange(&mut self) {
        let (begun, now) = (self.dealer.fresh() > self.role.first, self.role.net.now());
        if let Some(introduction) = &mut self.introduction {
            let words = introduction.arrange(&mut self.dealer, &self.cullers, begun, now);
            self.say(words);
        }
    }

    fn say(&mut self, words: Vec<Word>) {
        for (id, word) in words {
            if let Some(culler) = self.cullers.iter_mut().find(|culler| culler.id == id) {
                culler.say(word);
            }
        }
    }

    /// After the last frame: waits for the cullers' statistics.
    async fn hear_last_words(&mut self) {
        let deadline = self.role.net.now().after(LAST_WORDS);
        while self.stats.awaits() && !self.cullers.is_empty() {
            let net = Arc::clone(&self.role.net);
            match until(&*net, deadline, self.event(None)).await {
                Some(event) => self.take(event),
                None => return,
            }
        }
    }
}
