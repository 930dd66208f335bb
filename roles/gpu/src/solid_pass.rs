//! Shared by the passes that draw lists of solid drawables.

use std::sync::Arc;

use trimaran_cull::{Cancel, View};
use trimaran_proto::DrawableId;

use crate::pass::ScenePass;
use crate::{GpuError, PassTiming};

/// A pass that draws lists of solid drawables, and keeps `K` with the result.
pub struct SolidPass<K> {
    // Before all other fields: its stream waits for work that uses the rest.
    pub(crate) pass: ScenePass,
    pub(crate) kept: K,
}

impl<K> SolidPass<K> {
    /// Ends waits for the device when `cancel` says so, with [`GpuError::Cancelled`]. The pass is unusable
    /// then.
    pub fn cancel_when(&mut self, cancel: impl Fn() -> bool + Send + Sync + 'static) {
        self.pass.cancel_when(&(Arc::new(cancel) as Cancel));
    }

    /// Starts a frame of the view's size.
    ///
    /// # Errors
    /// If the device fails, or cannot draw the view's size.
    pub fn begin(&mut self, view: &View) -> Result<(), GpuError> {
        self.pass.begin(view)
    }

    /// Adds draws, in this order: of equal depths the first one wins. The device starts on them at the next
    /// [`flush`](Self::flush).
    ///
    /// # Errors
    /// If an id is not the scene's (those before it may have been added), before [`begin`](Self::begin), or
    /// without memory.
    pub fn draw(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        self.pass.draw(ids)
    }

    /// Submits the added draws to the device, which draws while the host goes on. Each flush costs a
    /// submission (tens of microseconds): worth it for hundreds of draws.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn flush(&mut self) -> Result<(), GpuError> {
        self.pass.flush()
    }

    /// Waits until all is drawn.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn finish(&mut self) -> Result<PassTiming, GpuError> {
        self.pass.finish()
    }
}
