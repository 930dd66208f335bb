//! What a culler does with a frame, and where what it finds goes.

use std::{future::Future, time::Duration};

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

/// What a culler does with a frame: on a device, or as it was recorded.
pub trait CullerWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// From the next frame on, another view state holds.
    fn change_view(&mut self, state: &ViewState) {
        let _ = state;
    }

    /// The culler has nothing to do until its next camera comes.
    fn awaits_camera(&mut self) {}

    /// A camera has come, from which the next frame is culled.
    fn has_camera(&mut self, camera: &Camera) {
        let _ = camera;
    }

    /// Begins the occluders of a frame (OR). They come at once, or with `as_they_come` bit by bit.
    ///
    /// # Errors
    /// As the device says.
    fn begin_occluders(&mut self, camera: Camera, as_they_come: bool) -> Result<(), RoleError>;

    /// Takes what was found visible in a frame before: all of it, or some as it comes.
    ///
    /// # Errors
    /// If the scene lacks an id, or as the device says.
    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError>;

    /// All ids are there: completes the occluders of the frame.
    ///
    /// # Errors
    /// As the device says.
    fn complete_occluders(&mut self, camera: Camera) -> impl Future<Output = Result<(), RoleError>>;

    /// Culls the frame (HC), and gives `visible` each drawable as soon as it is found.
    ///
    /// # Errors
    /// As the device says, and as `visible` does.
    fn cull(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> impl Future<Output = Result<(), RoleError>>;

    /// What was done for the frame, all of which has just been found. Since the occluders were complete
    /// others have computed for `away` in this culler's place.
    fn frame_stats(&mut self, away: Duration) -> FrameStats;
}

/// Takes the ids of a frame that is being culled: they leave for all receivers at once, while culling goes
/// on.
#[derive(Debug)]
pub struct VisibleIds<'l> {
    pub(super) found: Vec<DrawableId>,
    pub(super) display: Option<&'l mut FrameSender>,
    pub(super) other: Option<&'l mut Switch>,
    /// For a display that holds no scene.
    pub(super) supply: Option<(&'l CullerEnd, View)>,
    pub(super) turn: Option<&'l Turn>,
}

impl<'l> VisibleIds<'l> {
    /// Keeps what is found, and sends it to nobody.
    #[must_use]
    pub const fn kept() -> Self {
        Self { found: Vec::new(), display: None, other: None, supply: None, turn: None }
    }

    /// The role's turn, where others may have the device in the midst of the frame.
    pub(crate) fn shared_turn(&self) -> Option<&'l Turn> {
        self.turn.filter(|turn| turn.is_shared())
    }

    /// Sends what was found visible. It waits where a receiver has no room.
    ///
    /// # Errors
    /// When the display is gone or stalls.
    pub async fn push(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        self.found.extend_from_slice(ids);
        // The other culler first: it draws while the display only gathers.
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

    /// All that was found.
    #[must_use]
    pub fn into_found(self) -> Vec<DrawableId> {
        self.found
    }
}
