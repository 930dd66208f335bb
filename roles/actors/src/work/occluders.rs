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
    /// Select occluders from the last frame's visible set within this budget, once all its ids are there.
    /// `None` draws all of them, each batch as it comes.
    pub budget: Option<TriangleBudget>,
    /// Where the last frame's set says little of this one (the first frame, or one after a jump), draw the
    /// nearest drawables within this budget as well.
    pub after_a_jump: TriangleBudget,
}

impl Default for OccluderPolicy {
    fn default() -> Self {
        Self { budget: Some(TriangleBudget(30_000)), after_a_jump: TriangleBudget(60_000) }
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
        let jumped = due.len() * 2 <= received;
        if let Some(budget) = self.budget {
            select_occluders(scene, view, due, budget);
        }
        if jumped {
            nearest_occluders(scene, view, rule, self.after_a_jump, due);
        }
    }
}
