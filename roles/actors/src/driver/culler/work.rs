//! A culler's work on a frame, and the receivers of its ids.

use std::{
    future::{Future, ready},
    rc::Rc,
    time::Duration,
};

use trimaran_cull::View;
use trimaran_proto::{Camera, DrawableId, FrameStats, ViewState};

use super::switch::Switch;
use crate::{
    driver::error::{RoleError, link},
    links::FrameSender,
    stop::Stop,
    supply::CullerEnd,
    turn::Turn,
};

/// A culler's work on a frame: on a device, or as recorded.
pub trait CullerWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// Uses another view state from the next frame on.
    fn change_view(&mut self, state: &ViewState) {
        let _ = state;
    }

    /// The culler is idle until its next camera comes.
    fn awaits_camera(&mut self) {}

    /// A camera has come for the next frame.
    fn has_camera(&mut self, camera: &Camera) {
        let _ = camera;
    }

    /// Begins the occluders of a frame (OR). They come all at once, or in parts if `as_they_come`.
    ///
    /// # Errors
    /// Those of the device.
    fn begin_occluders(
        &mut self,
        camera: Camera,
        as_they_come: bool,
    ) -> impl Future<Output = Result<(), RoleError>>;

    /// Takes the visible set of an earlier frame: all of it, or the next part.
    ///
    /// # Errors
    /// If the scene lacks an id, and those of the device.
    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError>;

    /// All ids are there: completes the occluders of the frame.
    ///
    /// # Errors
    /// Those of the device.
    fn complete_occluders(&mut self, camera: Camera) -> impl Future<Output = Result<(), RoleError>>;

    /// Culls the frame (HC), and passes each drawable to `visible` as soon as it is found.
    ///
    /// # Errors
    /// Those of the device and of `visible`.
    fn cull(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> impl Future<Output = Result<(), RoleError>>;

    /// Finds all of the LOD cut in the frustum, instead of the steps above: a picture of it is the same. Only
    /// for a display that culls for itself, and if [`counted_cost`](Self::counted_cost) gives one.
    ///
    /// # Errors
    /// Those of the device and of `visible`.
    fn find_in_frustum(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> impl Future<Output = Result<(), RoleError>> {
        let _ = (camera, visible);
        ready(Ok(()))
    }

    /// About what the frame just culled costs if these ids are drawn, by counts alone: equal frames cost the
    /// same on each device of a kind. None if this work has to cull each frame.
    fn counted_cost(&self, ids: &[DrawableId]) -> Option<Duration> {
        let _ = ids;
        None
    }

    /// The statistics of the frame just culled.
    fn frame_stats(&mut self) -> FrameStats;
}

/// Takes the ids of a frame during culling: they are sent to all receivers at once, while culling goes on.
#[derive(Debug)]
pub struct VisibleIds<'l> {
    pub(super) found: Vec<DrawableId>,
    pub(super) display: Option<&'l mut FrameSender>,
    pub(super) other: Option<&'l mut Switch>,
    /// For a display that holds no scene.
    pub(super) supply: Option<(&'l CullerEnd, View)>,
    /// The role's turn, if others may get the device in the midst of the frame.
    pub(crate) turn: Option<Rc<Turn>>,
}

impl VisibleIds<'_> {
    /// Keeps the ids, and sends them to nobody.
    #[must_use]
    pub const fn kept() -> Self {
        Self { found: Vec::new(), display: None, other: None, supply: None, turn: None }
    }

    /// Sends visible ids. Waits if a receiver has no room.
    ///
    /// # Errors
    /// When the display is gone or stalls.
    pub async fn push(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        self.found.extend_from_slice(ids);
        // The other culler first: it draws while the display only collects.
        if let Some(other) = &mut self.other {
            other.push(ids).await;
        }
        if let Some(display) = &mut self.display {
            display.push(ids).await.map_err(link("sending ids"))?;
        }
        if let Some((supply, view)) = &self.supply {
            supply.found(view, ids)?;
        }
        Ok(())
    }

    /// All ids found so far.
    pub(crate) fn found(&self) -> &[DrawableId] {
        &self.found
    }

    /// All ids found.
    #[must_use]
    pub fn into_found(self) -> Vec<DrawableId> {
        self.found
    }
}
