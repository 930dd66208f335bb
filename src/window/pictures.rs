//! Draws what was found into the window's images.

use std::sync::Arc;

use glam::DVec2;
use trimaran_cull::{CutRule, DrawOrder, View, retain_in_sight};
use trimaran_gpu::{GpuError, PicturePass, Presenter};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use super::recent_sets::RecentSets;

/// Draws a scene in a window.
pub(super) struct Pictures {
    scene: Arc<Scene>,
    pass: PicturePass,
    /// Which objects are see-through.
    rule: CutRule,
    order: DrawOrder,
    ids: Vec<DrawableId>,
    /// Of these: what is seen through, farthest first.
    see_through: Vec<DrawableId>,
}

impl Pictures {
    /// Draws with `pass`, and as `rule` says of objects that are see-through.
    pub(super) fn new(scene: &Arc<Scene>, pass: PicturePass, rule: CutRule) -> Self {
        let (order, ids, see_through) = (DrawOrder::default(), Vec::new(), Vec::new());
        Self { scene: Arc::clone(scene), pass, rule, order, ids, see_through }
    }

    /// Draws the newest set, or of all that came lately what may show as well, and shows the picture in the
    /// image that `presenter` has acquired.
    pub(super) fn show(
        &mut self,
        view: &View,
        recent: &RecentSets,
        newest_alone: bool,
        presenter: &mut Presenter,
    ) -> Result<(), GpuError> {
        let Self { scene, pass, rule, order, ids, see_through } = self;
        ids.clear();
        match recent.newest() {
            Some(newest) if newest_alone => ids.extend_from_slice(&newest.ids),
            _ => recent.union(scene, ids),
        }
        if !scene.is_whole() {
            // What came lately may have gone again.
            ids.retain(|id| scene.has(*id).unwrap_or(false));
        }
        // What was culled for is wider than what is shown.
        retain_in_sight(scene, view, ids);
        order.sort(scene, view, ids);
        let solid = rule.divide(scene, ids, see_through);
        pass.begin(view)?;
        let drawn = pass.draw(&solid).and_then(|()| match see_through.is_empty() {
            true => Ok(()),
            false => pass.draw_see_through(see_through),
        });
        match drawn {
            // It has gone in this moment. The next picture is drawn without it.
            Err(GpuError::Scene(_)) if !scene.is_whole() => Ok(()),
            drawn => drawn.and_then(|()| pass.present(presenter)),
        }
    }

    /// What was drawn last.
    pub(super) fn ids(&self) -> &[DrawableId] {
        &self.ids
    }

    /// Depth of the picture shown last at shares of its width and height, from the upper left: the near
    /// distance over that along the gaze, 0 where nothing is.
    pub(super) fn depth_at(&mut self, share: DVec2) -> Result<f32, GpuError> {
        self.pass.finish()?;
        let depth = self.pass.read_depth()?;
        let size = depth.viewport();
        let pixel = |share: f64, side: u32| ((share * f64::from(side)) as usize).min(side as usize - 1);
        let (x, y) = (pixel(share.x, size.width()), pixel(share.y, size.height()));
        let place = y * size.width() as usize + x;
        Ok(depth.depth().get(place).copied().unwrap_or_default())
    }
}
