//! Messages that may arrive while a culler waits: cameras, view states, other messages of the display, and
//! another culler's ids.

use std::sync::Arc;

use trimaran_proto::{Camera, DrawableId, FrameNumber, LeaderKey, RoleMessage, ViewState};

use super::switch::{News, Switch};
use crate::{
    driver::{
        error::{RoleError, link},
        views::Views,
    },
    links::Link,
    meeting::Meeting,
};

/// Messages that were not asked for yet.
#[derive(Debug)]
pub(super) struct Inbox {
    /// The other culler, if there is one.
    pub(super) other: Switch,
    /// The display's view states.
    views: Views,
    /// A camera whose view state has not come yet.
    early: Option<Camera>,
    /// The key by which others may follow the display, if it has just chosen one.
    lead: Option<LeaderKey>,
    /// The wish of the display to follow another one, if it has just said so.
    follow: Option<Wish>,
}

/// The next thing for a culler to do.
pub(super) enum Next {
    /// To cull.
    Camera(Camera, Arc<ViewState>),
    /// To let others follow the display.
    Lead(LeaderKey),
    /// To follow another display, or not.
    Follow(Wish),
}

/// The wish of a display about a leader.
#[derive(Debug, Clone, Copy)]
pub(super) enum Wish {
    Follow(LeaderKey),
    Unfollow(LeaderKey),
}

/// An event while a culler waits for a camera.
enum Event {
    Camera(Camera),
    Message(RoleMessage),
    Other(News),
}

impl Inbox {
    pub(super) fn new(meeting: Meeting, drawables: u32) -> Self {
        let views = Views::new(meeting.settings, meeting.scene.objects);
        Self { other: Switch::new(meeting, drawables), views, early: None, lead: None, follow: None }
    }

    /// Waits for the display's next camera and its view state, or for a wish to lead or follow. Handles its
    /// other messages meanwhile.
    pub(super) async fn next(&mut self, display: &mut Link) -> Result<Next, RoleError> {
        loop {
            if let Some(leader) = self.lead.take() {
                return Ok(Next::Lead(leader));
            }
            if let Some(wish) = self.follow.take() {
                return Ok(Next::Follow(wish));
            }
            if let Some(camera) = self.early
                && let Some(state) = self.views.get(camera.view())
            {
                self.early = None;
                return Ok(Next::Camera(camera, Arc::clone(state)));
            }
            self.hear_next(display).await?;
        }
    }

    /// Waits until the display, which follows another one, wants something else. Keeps its newest camera.
    pub(super) async fn wish(&mut self, display: &mut Link) -> Result<Wish, RoleError> {
        loop {
            if let Some(wish) = self.follow.take() {
                return Ok(wish);
            }
            self.hear_next(display).await?;
        }
    }

    /// Waits for one message or camera.
    async fn hear_next(&mut self, display: &mut Link) -> Result<(), RoleError> {
        if let Some(message) = self.other.unsaid.take() {
            display.messages_tx.send(&message).await.map_err(link("answering the display"))?;
        }
        let event = tokio::select! {
            biased;
            message = display.messages_rx.recv() => match message {
                Ok(message) => Event::Message(message),
                Err(end) => return Err(link("waiting for a camera")(end)),
            },
            news = self.other.news() => Event::Other(news),
            camera = display.latest_rx.latest() => match camera {
                Ok(camera) => Event::Camera(camera),
                Err(end) => return Err(link("waiting for a camera")(end)),
            },
        };
        match event {
            Event::Camera(camera) => self.early = Some(camera),
            Event::Message(message) => self.hear(message)?,
            Event::Other(news) => self.other.learn(news),
        }
        Ok(())
    }

    /// Waits until the other culler begins the frame before `frame`. Returns whether it does: it may be gone,
    /// or the display may let it go.
    pub(super) async fn begins(&mut self, display: &mut Link, frame: FrameNumber) -> Result<bool, RoleError> {
        while self.other.is_there() {
            match self.other.begins(frame) {
                Some(begins) => return Ok(begins),
                None => self.hear_more(display).await?,
            }
        }
        Ok(false)
    }

    /// The next ids of the other culler's frame, as they come; none at its end. Incomplete frames are useful
    /// as well: fewer occluders only loosen the culling.
    pub(super) async fn ids(&mut self, display: &mut Link) -> Result<Option<Vec<DrawableId>>, RoleError> {
        while self.other.is_there() {
            match self.other.ids() {
                Some(ids) => return Ok(Some(ids).filter(|ids| !ids.is_empty())),
                None => self.hear_more(display).await?,
            }
        }
        Ok(None)
    }

    /// Waits for more messages of the other culler, or of the display about it.
    async fn hear_more(&mut self, display: &mut Link) -> Result<(), RoleError> {
        let message = tokio::select! {
            biased;
            message = display.messages_rx.recv() => message,
            news = self.other.news() => {
                self.other.learn(news);
                return Ok(());
            }
        };
        match message {
            Ok(message) => self.hear(message),
            Err(end) => Err(link("waiting for occluders")(end)),
        }
    }

    fn hear(&mut self, message: RoleMessage) -> Result<(), RoleError> {
        match message {
            RoleMessage::View { version, part, last } => drop(self.views.take(version, &part, last)?),
            RoleMessage::Lead { leader } => self.lead = Some(leader),
            RoleMessage::Follow { leader } => self.follow = Some(Wish::Follow(leader)),
            RoleMessage::Unfollow { leader } => self.follow = Some(Wish::Unfollow(leader)),
            message => self.other.hear(message),
        }
        Ok(())
    }
}
