//! A display that watches: it draws the frames of another display, as a relay passes them on.

use std::{rc::Rc, sync::Arc, time::Duration};

use trimaran_proto::{FrameNumber, RoleMessage, ViewVersion, Walkthrough};
use trimaran_transport::{KeepLast, LinkStats, Net, WholeFrame, sleep_until};

use super::{
    close::{leave, part, reason, worked},
    display::DisplayWork,
    error::{RoleError, link},
    in_turn::InTurn,
    observer::{CullerEvent, Observer, ShownFrame},
    views::Views,
};
use crate::{
    clock::Stopwatch,
    deal::CullerId,
    ids::FrameIds,
    links::{Link, sent_bytes},
    peers::{Arrival, Peers, SlotGuard},
    stop::Stop,
    turn::Turns,
};

/// How long a relay that broke the protocol is left alone.
const PAUSE: Duration = Duration::from_secs(1);

/// A display without a camera of its own: it shows the newest frame of a relay, from that frame's camera. A
/// slow one skips frames. When the relay is lost, the last picture stays until it is back.
#[derive(Debug)]
pub struct WatcherRole<W> {
    /// Its work on a frame.
    pub work: W,
    /// The relay.
    pub relay: Peers,
    /// How many drawables the scene has.
    pub drawables: u32,
    /// How many objects.
    pub objects: u32,
    /// The network and clock.
    pub net: Arc<dyn Net>,
    /// Its clock, and whether it draws while other roles of the process compute.
    pub turns: Turns,
}

/// A watcher at work.
struct Watching<'o, W> {
    work: InTurn<W>,
    clock: Stopwatch,
    observer: &'o mut dyn Observer,
    /// How many frames were shown.
    shown: FrameNumber,
    /// The view state of the last picture, at the present relay.
    drawn_in: Option<ViewVersion>,
}

/// A relay that has come.
struct Source {
    link: Link,
    views: Views,
    ids: FrameIds,
    /// A frame whose view state has not come yet.
    early: Option<WholeFrame<Walkthrough>>,
    /// The link's traffic at the end of the last frame.
    carried: LinkStats,
    slot: SlotGuard,
}

impl<W: DisplayWork> WatcherRole<W> {
    /// Plays the role until `stop` asks. If the work uses a device, it blocks its thread.
    ///
    /// # Errors
    /// When the device or the observer fails, or the settings rule out a link to the relay. A relay's failure
    /// ends nothing.
    pub async fn run(mut self, observer: &mut dyn Observer, stop: &Stop) -> Result<(), RoleError> {
        self.work.cancel_on(stop);
        let turn = Rc::new(self.turns.of_a_role());
        let Self { work, mut relay, drawables, objects, net, turns } = self;
        let work = InTurn::new(work, &turn);
        let mut watching =
            Watching { work, clock: turns.clock(), observer, shown: FrameNumber(0), drawn_in: None };
        let mut source: Option<Source> = None;
        let watch = async {
            loop {
                let from = match &mut source {
                    Some(from) => from,
                    None => {
                        let arrival = relay.next().await?;
                        watching.welcome(&arrival);
                        source.insert(Source::new(arrival, drawables, objects))
                    }
                };
                match watching.watch(from).await {
                    // The relay, and not this display, is at fault.
                    Err(error @ (RoleError::Link { .. } | RoleError::Ids { .. } | RoleError::View(_))) => {
                        watching.lose(&error);
                        if let Some(Source { link, slot, .. }) = source.take() {
                            leave_later(&net, link, &error, slot);
                        }
                    }
                    Err(error) => return Err(error),
                    Ok(()) => {}
                }
            }
        };
        let result = worked(turn.given_back_while_waiting(watch), stop).await;
        turn.give_back();
        drop(relay);
        part(source.into_iter().map(|source| source.link).collect(), result, stop).await
    }
}

/// Closes the link, and frees the slot after a pause if the relay is there still.
fn leave_later(net: &Arc<dyn Net>, link: Link, error: &RoleError, slot: SlotGuard) {
    let (net_here, why, pause) = (Arc::clone(net), reason(error), !matches!(error, RoleError::Link { .. }));
    net.spawn(Box::pin(async move {
        leave(vec![link], why).await;
        if pause {
            sleep_until(&*net_here, net_here.now().after(PAUSE)).await;
        }
        drop(slot);
    }));
}

impl Source {
    fn new(Arrival { mut link, slot, .. }: Arrival, drawables: u32, objects: u32) -> Self {
        link.frames_rx = link.frames_rx.keep_last(KeepLast::default());
        let (views, ids, carried) = (Views::none(objects), FrameIds::of(drawables), link.stats.read());
        Self { link, views, ids, early: None, carried, slot }
    }

    /// Waits for the newest frame and its view state.
    async fn frame(&mut self) -> Result<WholeFrame<Walkthrough>, RoleError> {
        loop {
            let is_ready =
                |frame: &mut WholeFrame<Walkthrough>| self.views.get(frame.start.header.view()).is_some();
            if let Some(frame) = self.early.take_if(is_ready) {
                return Ok(frame);
            }
            tokio::select! {
                biased;
                message = self.link.messages_rx.recv() => {
                    if let RoleMessage::View { version, part, last } = message.map_err(link("watching"))? {
                        self.views.take(version, &part, last)?;
                    }
                }
                frame = self.link.frames_rx.frame() => self.early = Some(frame.map_err(link("watching"))?),
            }
        }
    }
}

impl<W: DisplayWork> Watching<'_, W> {
    /// Shows the relay's frames until it is lost, or the display fails.
    async fn watch(&mut self, from: &mut Source) -> Result<(), RoleError> {
        loop {
            let frame = from.frame().await?;
            self.show(from, &frame).await?;
        }
    }

    fn welcome(&mut self, arrival: &Arrival) {
        tracing::info!(address = %arrival.link.peer.address, "the relay has come");
        self.drawn_in = None;
        if let Some(id) = CullerId::of(arrival.place) {
            self.observer.culler(CullerEvent::Came(id, &arrival.link));
        }
    }

    fn lose(&mut self, error: &RoleError) {
        tracing::warn!(error = error as &dyn std::error::Error, "the relay is gone; it is looked for again");
        if let Some(id) = CullerId::of(0) {
            self.observer.culler(CullerEvent::Left(id, error));
        }
    }

    /// RVG: draws the frame, and tells the observer.
    async fn show(&mut self, from: &mut Source, frame: &WholeFrame<Walkthrough>) -> Result<(), RoleError> {
        let camera = frame.start.header;
        let Some(state) = from.views.get(camera.view()) else { return Ok(()) };
        let begun = self.clock.elapsed().saturating_sub(frame.age);
        for batch in &frame.batches {
            let peer = || from.link.peer.name.to_string();
            from.ids.take(batch).map_err(|cause| RoleError::Ids { peer: peer(), cause })?;
        }
        let mut ids = from.ids.finish();
        self.work.begin_frame().await;
        let drawing = self.clock.elapsed();
        if self.drawn_in.replace(camera.view()) != Some(camera.view()) {
            self.work.change_view(state);
        }
        let for_loss = self.work.draw(camera, &mut ids, 0).await?;
        let shown = self.clock.elapsed();
        let on_device = self.work.device_time();
        let picture = match self.observer.wants_picture(self.shown) {
            true => self.work.picture()?,
            false => None,
        };
        let carried = from.link.stats.read();
        let since = carried - std::mem::replace(&mut from.carried, carried);
        let seen = ShownFrame {
            camera,
            culler: None,
            ids: &ids,
            for_loss: u32::try_from(for_loss).unwrap_or(u32::MAX),
            lacking: 0,
            queued: 0,
            again: false,
            picture,
            published: begun,
            begun,
            drawing,
            shown,
            on_device,
            traffic: sent_bytes(since.sent + since.received),
            arrivals: &[],
        };
        self.observer.shown(&seen).map_err(RoleError::Observer)?;
        self.work.end_frame();
        if self.shown.0 == 0 {
            tracing::info!(frame = %camera.frame(), "the first picture is shown");
        }
        self.shown = FrameNumber(self.shown.0.wrapping_add(1));
        Ok(())
    }
}
