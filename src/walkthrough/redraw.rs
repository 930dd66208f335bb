//! Draws the pictures of a finished session again, from the records of its frames.

use std::sync::Arc;

use thiserror::Error;
use trimaran_cull::{CutRule, Image, SubPixelGrid, View};
use trimaran_gpu::{GpuError, GpuScene, PicturePass};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_scene::Scene;
use xxhash_rust::xxh3::xxh3_64;

use super::{compose::FrameRecord, view_states::ViewStates};

/// Why a picture could not be drawn again.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RedrawError {
    /// The device failed.
    #[error("drawing a picture again failed")]
    Gpu(#[from] GpuError),
    /// It was cancelled.
    #[error("drawing was given up")]
    GivenUp,
    /// The redrawn picture is not the one that was shown: the device is not deterministic.
    #[error(
        "the picture of {frame} drawn again differs from the one shown: the device does not draw the same twice"
    )]
    NotRepeatable {
        /// The frame.
        frame: FrameNumber,
    },
}

/// Says whether drawing is to be abandoned.
pub type GivesUp = Arc<dyn Fn() -> bool + Send + Sync>;

/// Draws frames of a finished session again, off its clock.
pub struct Redrawer {
    pub(super) scene: Arc<Scene>,
    pub(super) views: ViewStates,
    grid: SubPixelGrid,
    pictures: PicturePass,
    pub(super) is_given_up: Option<GivesUp>,
}

impl Redrawer {
    /// For frames with these view states.
    ///
    /// # Errors
    /// If the device cannot draw that size.
    pub fn new(
        scene: &Arc<Scene>,
        drawn: &Arc<GpuScene>,
        views: impl Into<ViewStates>,
    ) -> Result<Self, GpuError> {
        let views = views.into();
        let size = views.of(&Camera::at_origin(FrameNumber(0))).viewport;
        Ok(Self {
            scene: Arc::clone(scene),
            views,
            grid: drawn.gpu().info().sub_pixel_grid,
            pictures: PicturePass::new(drawn, size)?,
            is_given_up: None,
        })
    }

    /// Abandons drawing with an error as soon as `is_given_up` says so, also while the device draws. After
    /// that nothing more can be drawn.
    pub fn give_up_when(&mut self, is_given_up: GivesUp) {
        let is_cancelled = Arc::clone(&is_given_up);
        self.pictures.cancel_when(move || is_cancelled());
        self.is_given_up = Some(is_given_up);
    }

    #[cfg(feature = "lab")]
    pub(super) fn go_on(&self) -> Result<(), RedrawError> {
        match &self.is_given_up {
            Some(is_given_up) if is_given_up() => Err(RedrawError::GivenUp),
            _ => Ok(()),
        }
    }

    /// Uses these view states for the frames from now on, with the same picture size.
    pub fn see(&mut self, views: impl Into<ViewStates>) {
        self.views = views.into();
    }

    /// The picture of a frame, drawn again.
    ///
    /// # Errors
    /// If the device fails, or draws another picture than before.
    pub fn picture(&mut self, record: &FrameRecord, into: &mut Image) -> Result<(), RedrawError> {
        let (view, rule) = self.seen_from(&record.camera);
        self.draw(&view, &rule, &record.ids, into)?;
        match record.picture {
            Some(hash) if hash != fingerprint(into) => {
                Err(RedrawError::NotRepeatable { frame: record.camera.frame() })
            }
            _ => Ok(()),
        }
    }

    pub(super) fn seen_from(&self, camera: &Camera) -> (View, CutRule) {
        (self.views.view(*camera).on_grid(self.grid), self.views.rule(&self.scene, camera))
    }

    pub(super) fn draw(
        &mut self,
        view: &View,
        rule: &CutRule,
        ids: &[DrawableId],
        into: &mut Image,
    ) -> Result<(), GpuError> {
        let mut see_through = Vec::new();
        let solid = rule.divide(&self.scene, ids, &mut see_through);
        self.pictures.begin(view)?;
        self.pictures.draw(&solid)?;
        self.pictures.draw_see_through(&see_through)?;
        self.pictures.finish()?;
        self.pictures.read(into)
    }
}

/// The fingerprint of a picture: XXH3-64 of its bytes.
pub(super) fn fingerprint(picture: &Image) -> u64 {
    xxh3_64(&picture.rgba)
}
