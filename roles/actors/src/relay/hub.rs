//! The downstream side of a relay: the display that leads, and those that watch.

use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::watch;
use trimaran_proto::{
    Camera, CloseCode, FrameNumber, SceneOutline, SessionKey, ViewState, ViewStateError, ViewVersion,
    Walkthrough,
};
use trimaran_transport::{FrameStart, LinkConfig, Net, Publisher, WhenBehind, WholeFrame};

use super::{
    WatchLink,
    leader::{self, Leader, ToLeader},
    names::{Names, ToldViews},
    watcher,
};
use crate::links::{FrameSender, Link};

/// The displays of a relay.
pub(super) struct Hub {
    pub(super) net: Arc<dyn Net>,
    pub(super) outline: SceneOutline,
    fan: tokio::sync::Mutex<Fan>,
    views: watch::Sender<ToldViews>,
    leader: watch::Sender<Option<Leader>>,
    /// How many have led.
    led: Mutex<u64>,
    /// Whether the relay ends.
    over: watch::Sender<bool>,
    watch: WatchLink,
}

/// The frames to watchers.
struct Fan {
    publisher: Publisher<Walkthrough>,
    next: FrameNumber,
}

impl Hub {
    /// Of a relay of this scene.
    pub(super) fn new(
        net: &Arc<dyn Net>,
        outline: SceneOutline,
        config: &LinkConfig,
        watch: WatchLink,
    ) -> Self {
        let fan = Fan { publisher: Publisher::new(net, config), next: FrameNumber(0) };
        Self {
            net: Arc::clone(net),
            outline,
            fan: tokio::sync::Mutex::new(fan),
            views: watch::Sender::default(),
            leader: watch::Sender::default(),
            led: Mutex::default(),
            over: watch::Sender::default(),
            watch,
        }
    }

    /// A display has come: it leads if it names a session, or else it watches.
    pub(super) fn welcome(self: &Arc<Self>, link: Link) {
        let hello = link.peer.hello;
        match hello.session {
            Some(session) if self.led_by_another(session.0) => self.turn_away(link),
            Some(session) => leader::start(self, link, session),
            // A relay that has asked for the scene.
            None if hello.scene.is_none() => drop(link),
            None => self.net.spawn(Box::pin(watcher::serve(Arc::clone(self), link))),
        }
    }

    fn led_by_another(&self, key: SessionKey) -> bool {
        self.leader.borrow().as_ref().is_some_and(|leader| leader.session.0 != key)
    }

    fn turn_away(&self, link: Link) {
        let why = "another display leads: this one can only watch";
        tracing::warn!(from = %link.peer.address, "turned a display away: {why}");
        self.net.spawn(Box::pin(async move {
            let _unheard = link.close(CloseCode::Failed.because(why)).await;
        }));
    }

    /// Watches a link for the metrics, until the result is dropped.
    pub(super) fn watch(&self, kind: &'static str, link: &Link) -> Box<dyn Send> {
        (self.watch)(kind, link)
    }

    /// The display that leads, as it changes.
    pub(super) fn leaders(&self) -> watch::Receiver<Option<Leader>> {
        self.leader.subscribe()
    }

    /// From now on this one leads. Returns its number.
    pub(super) fn lead(&self, leader: impl FnOnce(u64) -> Leader) -> u64 {
        let number = {
            let mut led = self.led.lock();
            *led += 1;
            *led
        };
        if let Some(before) = self.leader.send_replace(Some(leader(number))) {
            before.say(ToLeader::Close(CloseCode::Replaced.reason()));
        }
        number
    }

    /// The leader with this number is gone.
    pub(super) fn leave(&self, number: u64) {
        self.leader.send_if_modified(|leader| leader.take_if(|leader| leader.number == number).is_some());
    }

    /// View states for watchers, as they change.
    pub(super) fn views(&self) -> watch::Receiver<ToldViews> {
        self.views.subscribe()
    }

    /// Tells watchers a view state. Returns the relay's version of it.
    pub(super) fn tell(&self, state: &ViewState) -> Result<ViewVersion, ViewStateError> {
        let mut version = Ok(ViewVersion(0));
        self.views.send_modify(|views| version = views.add(state));
        version
    }

    /// Gives a watcher all frames to come, and the last one.
    pub(super) async fn subscribe(&self, frames: FrameSender) {
        self.fan.lock().await.publisher.subscribe(frames, WhenBehind::Skip);
    }

    /// Passes a frame on to all watchers. Its view state is one of `names`.
    pub(super) async fn publish(&self, frame: &WholeFrame<Walkthrough>, names: &Mutex<Names>) {
        let camera: Camera = frame.start.header;
        let Some(version) = names.lock().get(camera.view()) else {
            tracing::debug!(frame = %camera.frame(), "left out a frame: its view state is unknown");
            return;
        };
        let ids: Vec<_> = frame.items().collect();
        let mut fan = self.fan.lock().await;
        let start = FrameStart { frame: fan.next, header: camera.in_view(version) };
        fan.next = FrameNumber(fan.next.0.saturating_add(1));
        match fan.publisher.publish(start, &ids).await {
            Ok(published) => {
                for (_, why) in published.left {
                    tracing::debug!(error = &why as &dyn std::error::Error, "a watcher has left");
                }
            }
            Err(error) => tracing::error!(error = &error as &dyn std::error::Error, "a frame was left out"),
        }
    }

    /// Ends once the relay does.
    pub(super) async fn over(&self) {
        let mut over = self.over.subscribe();
        let _over = over.wait_for(|over| *over).await;
    }

    /// Lets all displays go.
    pub(super) fn end(&self) {
        self.over.send_replace(true);
    }
}
