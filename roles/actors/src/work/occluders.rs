//! Which occluders a culler draws, and in how many rounds.

use std::sync::Arc;

use trimaran_cull::{
    CullStats, Culler, CutRule, LodCut, OccluderMapper, RoundRule, Rounds, TriangleBudget, View,
    select_occluders,
};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::{CullerDevice, RoleError};

/// Which occluders a culler draws. Any subset of the LOD cut is a valid set: fewer are drawn sooner and
/// hide less, and never too much.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OccluderPolicy {
    /// Select occluders from an earlier frame's visible set within this budget and a quarter of the set's
    /// triangles.
    pub budget: TriangleBudget,
    /// Rounds at most: see [`Rounds`](trimaran_cull::Rounds).
    pub rounds: u32,
}

/// Where occluders are chosen among the LOD cut, so many nodes of each level of the tree are refined at most.
/// Small things hide little, and to look at all of them takes long in a large scene.
const WIDEST: usize = 2048;

impl Default for OccluderPolicy {
    fn default() -> Self {
        Self { budget: TriangleBudget(30_000), rounds: 4 }
    }
}

/// A frame culled by [`OccluderPolicy::cull`].
#[derive(Debug, Clone, Default)]
pub struct CulledFrame {
    /// What shows, in the order found.
    pub visible: Vec<DrawableId>,
    /// What was drawn as occluders, in all rounds.
    pub occluders: Vec<DrawableId>,
    /// The rounds.
    pub rounds: u32,
    /// What the traversal did.
    pub stats: CullStats,
}

impl OccluderPolicy {
    /// Culls a frame seen from `view` on `device`, where `last` was found visible in the frame before: just
    /// as a session does, in whatever order `last` comes.
    ///
    /// # Errors
    /// If an id is not of this scene, or as the device says.
    pub fn cull<D: CullerDevice>(
        self,
        culler: &mut Culler,
        device: &mut D,
        view: &View,
        rule: &CutRule,
        last: &[DrawableId],
    ) -> Result<CulledFrame, RoleError> {
        let mut mapper = OccluderMapper::new(Arc::clone(culler.scene()), *view, rule);
        let mut occluders = Vec::new();
        mapper.push(last, &mut occluders)?;
        self.choose(culler.scene(), view, rule, last.len(), &mut occluders);
        device.begin_occluders(view).map_err(RoleError::of_device::<D>("clearing the depth"))?;
        device.add_occluders(&occluders).map_err(RoleError::of_device::<D>("drawing occluders"))?;
        let mut visible = Vec::new();
        let traversal = culler.traverse(view, rule, device).map_err(RoleError::of_culling::<D>)?;
        let mut rounds = Rounds::new(traversal, &mapper, &occluders, self.rule());
        while let Some(ids) = rounds.next(device, D::add_occluders).map_err(RoleError::of_culling::<D>)? {
            visible.extend_from_slice(ids);
        }
        occluders.extend_from_slice(rounds.occluders());
        Ok(CulledFrame { visible, occluders, rounds: rounds.rounds(), stats: rounds.stats() })
    }

    /// Chooses among all that is `due` for the `received` ids of the last frame. Where they say little of
    /// this frame (the first one, or one after a jump), among what looks large of the LOD cut.
    pub(super) fn choose(
        self,
        scene: &Scene,
        view: &View,
        rule: &CutRule,
        received: usize,
        due: &mut Vec<DrawableId>,
    ) {
        if due.len() * 2 <= received {
            *due = LodCut::new(scene, view, rule).large_drawables(WIDEST);
            rule.retain_solid(scene, due);
            select_occluders(scene, view, due, self.budget);
        } else {
            rule.retain_solid(scene, due);
            select_occluders(scene, view, due, self.budget.among(scene, due));
        }
    }

    /// When a frame goes on in further rounds.
    pub(super) fn rule(self) -> RoundRule {
        RoundRule { most: self.rounds, budget: self.budget }
    }
}
