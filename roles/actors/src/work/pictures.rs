//! Drawing a scene's pictures on a device.

use std::sync::Arc;

use trimaran_cull::{DrawOrder, Image, View, Viewport};
use trimaran_proto::{Camera, IdBatch, Settings};
use trimaran_scene::Scene;
use trimaran_transport::FrameOutcome;

use super::gaps::Gaps;
use crate::{
    device::PictureDevice,
    driver::{DisplayWork, Drawn, RoleError},
    ids::{FrameIds, IdError},
    stop::Stop,
};

const DRAWING: &str = "drawing a picture";

/// A display's work on a scene.
#[derive(Debug)]
pub struct ScenePictures<D> {
    scene: Arc<Scene>,
    device: D,
    viewport: Viewport,
    order: DrawOrder,
    received: FrameIds,
    /// What was drawn before stands in for ids that were lost.
    gaps: Gaps,
    for_loss: usize,
    picture: Image,
}

impl<D: PictureDevice> ScenePictures<D> {
    /// Draws `scene` as `settings` have it.
    pub fn new(scene: &Arc<Scene>, device: D, settings: &Settings) -> Self {
        Self {
            scene: Arc::clone(scene),
            device,
            viewport: settings.viewport,
            order: DrawOrder::default(),
            received: FrameIds::of(scene),
            gaps: Gaps::new(scene, settings.lod),
            for_loss: 0,
            picture: Image::default(),
        }
    }
}

impl<D: PictureDevice> DisplayWork for ScenePictures<D> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.device.cancel_on(stop);
    }

    fn begin(&mut self) {
        self.received.begin();
    }

    fn take(&mut self, batch: &IdBatch) -> Result<(), IdError> {
        self.received.take(batch).map(|_| ())
    }

    /// Draws front to back.
    async fn draw(&mut self, camera: Camera, outcome: FrameOutcome) -> Result<(), RoleError> {
        let view = View::new(camera, self.viewport);
        let ids = &mut self.received.ids;
        let whole = matches!(outcome, FrameOutcome::Complete(_));
        self.for_loss = if whole { 0 } else { self.gaps.fill(view, ids)? };
        self.order.sort(&self.scene, &view, ids);
        self.device.draw(&view, ids).map_err(RoleError::device(DRAWING))?;
        self.gaps.drawn(ids);
        Ok(())
    }

    fn drawn(&mut self, with_picture: bool) -> Result<Drawn<'_>, RoleError> {
        if with_picture {
            self.device.read(&mut self.picture).map_err(RoleError::device(DRAWING))?;
        }
        Ok(Drawn {
            ids: &self.received.ids,
            for_loss: u32::try_from(self.for_loss).unwrap_or(u32::MAX),
            picture: with_picture.then_some(&self.picture),
        })
    }
}
