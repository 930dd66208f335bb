//! Drawing a scene's pictures on a device.

use std::sync::Arc;

use trimaran_cull::{DrawOrder, Image, View, Viewport};
use trimaran_proto::{Camera, DrawableId, Settings};
use trimaran_scene::Scene;

use super::gaps::Gaps;
use crate::{
    device::PictureDevice,
    driver::{DisplayWork, RoleError},
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
    /// What was drawn before stands in for ids that were lost.
    gaps: Gaps,
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
            gaps: Gaps::new(scene, settings.lod),
            picture: Image::default(),
        }
    }
}

impl<D: PictureDevice> DisplayWork for ScenePictures<D> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.device.cancel_on(stop);
    }

    /// Draws front to back.
    async fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> Result<usize, RoleError> {
        let view = View::new(camera, self.viewport);
        let for_loss = if missing == 0 { 0 } else { self.gaps.fill(view, ids)? };
        self.order.sort(&self.scene, &view, ids);
        self.device.draw(&view, ids).map_err(RoleError::device(DRAWING))?;
        self.gaps.drawn(ids);
        Ok(for_loss)
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        self.device.read(&mut self.picture).map_err(RoleError::device(DRAWING))?;
        Ok(Some(&self.picture))
    }
}
