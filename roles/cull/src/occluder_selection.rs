//! Occluder selection from the cut. Any subset is valid: fewer occluders are drawn faster and cull less, but
//! never make a hole.

use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::View;
use crate::lod_cut::looks;
use crate::parallel::in_chunks;

/// At most this many triangles of occluders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TriangleBudget(pub u64);

impl TriangleBudget {
    /// This budget plus a quarter of the triangles of the `visible` set. A large visible set gains more from
    /// better culling.
    #[must_use]
    pub fn among(self, scene: &Scene, visible: &[DrawableId]) -> Self {
        Self(self.0.saturating_add(triangles(scene, visible) / 4))
    }
}

/// The triangles of `ids`. Ids that the scene lacks count as none.
#[must_use]
pub fn triangles(scene: &Scene, ids: &[DrawableId]) -> u64 {
    let drawables = ids.iter().filter_map(|id| scene.drawables().get(id.index()));
    drawables.map(|drawable| u64::from(drawable.triangles)).sum()
}

/// Keeps the drawables that hide most per triangle, within the budget: by the squared apparent size (the
/// box's diagonal over its distance) divided by the triangles. Drops ids that the scene lacks.
pub fn select_occluders(scene: &Scene, view: &View, ids: &mut Vec<DrawableId>, budget: TriangleBudget) {
    let eye = view.eye();
    let rank = |&id: &DrawableId| {
        let (drawable, part) = scene.part(id)?;
        let triangles = u64::from(drawable.triangles);
        Some(((looks(&part, eye) / triangles.max(1) as f64) as f32, id, triangles))
    };
    let rank_all = |ids: &[DrawableId]| ids.iter().filter_map(rank).collect::<Vec<_>>();
    let mut ranked: Vec<(f32, DrawableId, u64)> = in_chunks(ids, rank_all).concat();
    ids.clear();
    if ranked.iter().map(|(_, _, triangles)| triangles).sum::<u64>() > budget.0 {
        ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    }
    let mut left = budget.0;
    for (_, id, triangles) in ranked {
        if triangles <= left {
            left -= triangles;
            ids.push(id);
        }
    }
}
