//! Displays that others follow: each frame is put together and coded once, for all followers.

use std::{
    collections::{HashMap, hash_map::Entry},
    sync::Arc,
};

use parking_lot::Mutex;
use thiserror::Error;
use tokio::sync::watch;
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, LeaderKey, RoleMessage, Settings, ViewState, ViewStateError, Walkthrough,
};
use trimaran_transport::{Batching, FrameOrderError, LinkConfig, SharedFrame, SharedFrames};

use crate::links::FrameStart;

/// Why a display's frame cannot be passed on to its followers.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LeadError {
    /// Its ids.
    #[error("the frame cannot be put together for followers")]
    Frame(#[from] FrameOrderError),
    /// Its view state.
    #[error("the view state cannot be sent to followers")]
    View(#[from] ViewStateError),
}

/// The displays of a service that lead. Clones are the same object.
#[derive(Debug, Clone, Default)]
pub(crate) struct Leads(Arc<Mutex<HashMap<LeaderKey, Arc<Stage>>>>);

/// A display that leads. Its followers see it end when this is dropped.
#[derive(Debug)]
pub(crate) struct Lead {
    leads: Leads,
    key: LeaderKey,
    stage: Arc<Stage>,
}

/// The newest frame of a leader, for one follower. It ends with the leader.
pub(crate) type Following = watch::Receiver<Option<Arc<LedFrame>>>;

/// A frame of a leader.
#[derive(Debug)]
pub(crate) struct LedFrame {
    /// In the leader's own numbers of frames and view states.
    pub(crate) camera: Camera,
    pub(crate) view: Arc<LedView>,
    pub(crate) ids: Arc<[DrawableId]>,
    pub(crate) frame: SharedFrame<Walkthrough>,
}

/// A view state of a leader.
#[derive(Debug)]
pub(crate) struct LedView {
    pub(crate) state: Arc<ViewState>,
    /// The messages that tell a follower.
    pub(crate) messages: Vec<RoleMessage>,
}

/// Shared by a leader and its followers.
#[derive(Debug)]
struct Stage {
    frames: Mutex<Frames>,
    newest: watch::Sender<Option<Arc<LedFrame>>>,
}

#[derive(Debug)]
struct Frames {
    shared: SharedFrames<Walkthrough>,
    next: FrameNumber,
    view: Option<Arc<LedView>>,
    /// A frame that nobody has followed yet, so it was not put together.
    unseen: Option<(Camera, Arc<LedView>, Arc<[DrawableId]>)>,
}

impl Leads {
    /// Lets others follow the display with these settings, by this key. Nothing if another display has it.
    pub(crate) fn lead(&self, key: LeaderKey, settings: &Settings, drawables: u32) -> Option<Lead> {
        let mut leads = self.0.lock();
        let Entry::Vacant(place) = leads.entry(key) else { return None };
        let batching = Batching { size: settings.batch, coded: true };
        let config = LinkConfig::default().with_batching(batching).with_max_frame(drawables);
        let shared = SharedFrames::new(&config);
        let frames = Mutex::new(Frames { shared, next: FrameNumber(0), view: None, unseen: None });
        let stage = Arc::new(Stage { frames, newest: watch::Sender::new(None) });
        place.insert(Arc::clone(&stage));
        Some(Lead { leads: self.clone(), key, stage })
    }

    /// The frames of the display that leads by this key, the present one first.
    ///
    /// # Errors
    /// If the present frame cannot be put together.
    pub(crate) fn follow(&self, key: LeaderKey) -> Result<Option<Following>, LeadError> {
        let Some(stage) = self.0.lock().get(&key).cloned() else { return Ok(None) };
        let mut frames = stage.frames.lock();
        let mut following = stage.newest.subscribe();
        stage.put_together(&mut frames)?;
        following.mark_changed();
        Ok(Some(following))
    }
}

impl Lead {
    /// The key by which it is followed.
    pub(crate) const fn key(&self) -> LeaderKey {
        self.key
    }

    /// The leader sees this set from this camera in this view state.
    ///
    /// # Errors
    /// If the frame cannot be put together.
    pub(crate) fn publish(
        &self,
        camera: Camera,
        state: &Arc<ViewState>,
        ids: &[DrawableId],
    ) -> Result<(), LeadError> {
        let mut frames = self.stage.frames.lock();
        let view = frames.view(camera, state)?;
        frames.unseen = Some((camera, view, ids.into()));
        if self.stage.newest.receiver_count() > 0 {
            self.stage.put_together(&mut frames)?;
        }
        Ok(())
    }
}

impl Drop for Lead {
    fn drop(&mut self) {
        self.leads.0.lock().remove(&self.key);
    }
}

impl Stage {
    fn put_together(&self, frames: &mut Frames) -> Result<(), FrameOrderError> {
        let Some((camera, view, ids)) = frames.unseen.take() else { return Ok(()) };
        let frame = frames.shared.put(FrameStart { frame: frames.next, header: camera }, &ids)?;
        frames.next = FrameNumber(frames.next.0.wrapping_add(1));
        self.newest.send_replace(Some(Arc::new(LedFrame { camera, view, ids, frame })));
        Ok(())
    }
}

impl Frames {
    fn view(&mut self, camera: Camera, state: &Arc<ViewState>) -> Result<Arc<LedView>, ViewStateError> {
        let known = self.view.as_ref().filter(|view| Arc::ptr_eq(&view.state, state));
        let view = match known {
            Some(view) => Arc::clone(view),
            None => {
                let messages = state.to_messages(camera.view())?;
                Arc::new(LedView { state: Arc::clone(state), messages })
            }
        };
        self.view = Some(Arc::clone(&view));
        Ok(view)
    }
}
