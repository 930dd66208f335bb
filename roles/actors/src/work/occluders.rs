//! Which occluders a culler draws.

use std::sync::Arc;

use trimaran_cull::{
    LodRule, OccluderError, TriangleBudget, View, nearest_occluders, occluders, select_occluders,
};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

/// Which occluders a culler draws. Any subset of the LOD cut is a valid set: fewer are drawn sooner and
/// hide less, and never too much.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OccluderPolicy {
    /// Select occluders from an earlier frame's visible set within this budget.
    pub budget: TriangleBudget,
    /// Where the last frame's set says little of this one (the first frame, or one after a jump), draw the
    /// nearest drawables within this budget as well.
    pub after_a_jump: TriangleBudget,
}

impl Default for OccluderPolicy {
    fn default() -> Self {
        Self { budget: TriangleBudget(30_000), after_a_jump: TriangleBudget(60_000) }
    }
}

impl OccluderPolicy {
    /// What is drawn for a frame seen from `view`, where `last` was found visible in the frame before: the
    /// same set as a session draws, in whatever order `last` comes.
    ///
    /// # Errors
    /// If an id is not of this scene.
    pub fn occluders(
        self,
        scene: &Arc<Scene>,
        view: &View,
        rule: LodRule,
        last: &[DrawableId],
    ) -> Result<Vec<DrawableId>, OccluderError> {
        let mut due = occluders(scene, view, rule, last)?;
        self.choose(scene, view, rule, last.len(), &mut due);
        Ok(due)
    }

    /// Chooses among all that is `due` for the `received` ids of the last frame, and makes up for those that
    /// a jump has made useless.
    pub(super) fn choose(
        self,
        scene: &Scene,
        view: &View,
        rule: LodRule,
        received: usize,
        due: &mut Vec<DrawableId>,
    ) {
        let found = due.len();
        select_occluders(scene, view, due, self.budget);
        if found * 2 <= received {
            nearest_occluders(scene, view, rule, self.after_a_jump, due);
        }
    }

    /// Makes up for those of the `received` ids that a jump has made useless, where the rest was chosen as
    /// it came.
    pub(super) fn make_up(
        self,
        scene: &Scene,
        view: &View,
        rule: LodRule,
        received: usize,
        due: &mut Vec<DrawableId>,
    ) {
        if due.is_empty() && received > 0 {
            nearest_occluders(scene, view, rule, self.after_a_jump, due);
        }
    }
}
