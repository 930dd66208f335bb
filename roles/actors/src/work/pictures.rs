//! Drawing a scene's pictures on a device.

use std::{sync::Arc, time::Duration};

use trimaran_cull::{CutRule, DrawOrder, Image, View};
use trimaran_proto::{Camera, DrawableId, Settings, ViewState};
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
    state: ViewState,
    rule: CutRule,
    order: DrawOrder,
    /// The previous set, which stands in for lost ids.
    gaps: Gaps,
    picture: Image,
    /// The device's time for the last picture.
    device_time: Duration,
    /// The see-through drawables of the current frame, farthest first.
    see_through: Vec<DrawableId>,
}

impl<D: PictureDevice> ScenePictures<D> {
    /// Draws `scene` with these `settings`.
    pub fn new(scene: &Arc<Scene>, device: D, settings: &Settings) -> Self {
        Self {
            scene: Arc::clone(scene),
            device,
            state: (*settings).into(),
            rule: CutRule::new(scene, &(*settings).into()),
            order: DrawOrder::default(),
            gaps: Gaps::new(scene),
            picture: Image::default(),
            device_time: Duration::ZERO,
            see_through: Vec::new(),
        }
    }
}

impl<D: PictureDevice> DisplayWork for ScenePictures<D> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.device.cancel_on(&stop.cancel());
    }

    fn change_view(&mut self, state: &ViewState) {
        self.rule = CutRule::new(&self.scene, state);
        self.state = state.clone();
    }

    /// Draws solid drawables front to back, then see-through ones over them from back to front.
    async fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> Result<usize, RoleError> {
        let view = View::of(camera, &self.state);
        let for_loss = if missing == 0 { 0 } else { self.gaps.fill(view, &self.rule, ids)? };
        self.order.sort(&self.scene, &view, ids);
        let solid = self.rule.divide(&self.scene, ids, &mut self.see_through);
        let Self { device, see_through, .. } = self;
        self.device_time = device.draw(&view, &solid, see_through).map_err(RoleError::device(DRAWING))?;
        self.gaps.drawn(ids);
        Ok(for_loss)
    }

    fn device_time(&self) -> Duration {
        self.device_time
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        self.device.read(&mut self.picture).map_err(RoleError::device(DRAWING))?;
        Ok(Some(&self.picture))
    }
}
