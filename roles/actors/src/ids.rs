//! Checks the ids of a frame from a peer: each is one of the scene's drawables, and occurs once.

use thiserror::Error;
use trimaran_proto::{DrawableId, IdBatch};
use trimaran_scene::Scene;

/// The most ids that a frame of `scene` can have, for
/// [`LinkConfig::max_frame`](trimaran_transport::LinkConfig::max_frame): each drawable once.
#[must_use]
pub fn max_frame(scene: &Scene) -> u32 {
    u32::try_from(scene.drawables().len()).unwrap_or(u32::MAX)
}

/// An id that is invalid in a frame of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IdError {
    /// The scene has no such drawable.
    #[error("{id} is not in this scene, which has {count} drawables: do all roles hold the same scene?")]
    Unknown {
        /// The id.
        id: DrawableId,
        /// How many drawables the scene has.
        count: usize,
    },
    /// It has occurred before in the same frame.
    #[error("{id} came twice in one frame")]
    Twice {
        /// The id.
        id: DrawableId,
    },
}

/// Collects the ids of one frame after the other.
#[derive(Debug)]
pub(crate) struct FrameIds {
    /// Those of this frame.
    ids: Vec<DrawableId>,
    /// For each drawable of the scene whether it is among them.
    came: Vec<bool>,
}

impl FrameIds {
    /// For frames of a scene with this many drawables.
    pub(crate) fn of(drawables: u32) -> Self {
        Self { ids: Vec::new(), came: vec![false; drawables as usize] }
    }

    /// How many there are so far.
    pub(crate) fn count(&self) -> u32 {
        u32::try_from(self.ids.len()).unwrap_or(u32::MAX)
    }

    /// Ends the frame: returns its ids, and the next one can begin.
    pub(crate) fn finish(&mut self) -> Vec<DrawableId> {
        for id in &self.ids {
            if let Some(came) = self.came.get_mut(id.index()) {
                *came = false;
            }
        }
        std::mem::take(&mut self.ids)
    }

    /// Adds a batch; returns its ids.
    ///
    /// # Errors
    /// At the first invalid id; those before it are added.
    pub(crate) fn take(&mut self, batch: &IdBatch) -> Result<&[DrawableId], IdError> {
        let first = self.ids.len();
        let count = self.came.len();
        for id in batch.iter() {
            let came = self.came.get_mut(id.index()).ok_or(IdError::Unknown { id, count })?;
            if std::mem::replace(came, true) {
                return Err(IdError::Twice { id });
            }
            self.ids.push(id);
        }
        Ok(self.ids.get(first..).unwrap_or_default())
    }
}
