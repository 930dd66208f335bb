//! Draws sets into the window's images.

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
    /// The rule with the see-through objects.
    rule: CutRule,
    order: DrawOrder,
    ids: Vec<DrawableId>,
    /// The see-through ones of these, farthest first.
    see_through: Vec<DrawableId>,
}

impl Pictures {
    /// Draws with `pass`, and `rule` decides which objects are see-through.
    pub(super) fn new(scene: &Arc<Scene>, pass: PicturePass, rule: CutRule) -> Self {
        let (order, ids, see_through) = (DrawOrder::default(), Vec::new(), Vec::new());
        Self { scene: Arc::clone(scene), pass, rule, order, ids, see_through }
    }

    /// Draws the newest set, or the union of recent sets that may be visible, and presents it in the image
    /// that `presenter` has acquired.
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
            // Recently received geometry may have been evicted.
            ids.retain(|id| scene.has(*id).unwrap_or(false));
        }
        // The culled view is wider than the shown one.
        retain_in_sight(scene, view, ids);
        order.sort(scene, view, ids);
        let solid = rule.divide(scene, ids, see_through);
        pass.begin(view)?;
        let drawn = pass.draw(&solid).and_then(|()| match see_through.is_empty() {
            true => Ok(()),
            false => pass.draw_see_through(see_through),
        });
        match drawn {
            // It was evicted just now. The next picture is drawn without it.
            Err(GpuError::Scene(_)) if !scene.is_whole() => Ok(()),
            drawn => drawn.and_then(|()| pass.present(presenter)),
        }
    }

    /// The drawables of the last picture.
    pub(super) fn ids(&self) -> &[DrawableId] {
        &self.ids
    }

    /// Depth of the last picture at fractions of its width and height, from the upper left: near distance
    /// divided by the distance along the gaze, 0 for the background.
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
