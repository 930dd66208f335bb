//! A culler's occluder selection, and its rounds.

use std::{collections::BTreeSet, sync::Arc};

use trimaran_cull::{
    CullStats, Culler, CutRule, LodCut, OccluderError, OccluderMapper, RoundRule, Rounds, TriangleBudget,
    View, select_occluders,
};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::{CullerDevice, RoleError};

/// The occluder selection of a culler. Any subset of the LOD cut is a valid set: fewer are drawn sooner and
/// hide less, and never too much.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OccluderPolicy {
    /// Select occluders from an earlier frame's visible set within this budget and a quarter of the set's
    /// triangles.
    pub budget: TriangleBudget,
    /// The most rounds: see [`Rounds`](trimaran_cull::Rounds).
    pub rounds: u32,
}

/// The most nodes refined per level of the tree when occluders are chosen among the LOD cut. Small nodes hide
/// little, and a large scene has too many of them.
const WIDEST: usize = 2048;

impl Default for OccluderPolicy {
    fn default() -> Self {
        Self { budget: TriangleBudget(30_000), rounds: 4 }
    }
}

/// A frame culled by [`OccluderPolicy::cull`].
#[derive(Debug, Clone, Default)]
pub struct CulledFrame {
    /// The visible drawables, in the order found.
    pub visible: Vec<DrawableId>,
    /// The drawn occluders of all rounds.
    pub occluders: Vec<DrawableId>,
    /// The rounds.
    pub rounds: u32,
    /// Counters of the traversal.
    pub stats: CullStats,
}

impl OccluderPolicy {
    /// Culls a frame with `view` on `device`, given the set `last` of the previous frame, like a session. The
    /// order of `last` does not matter.
    ///
    /// # Errors
    /// If the scene has no such id, and those of the device.
    pub fn cull<D: CullerDevice>(
        self,
        culler: &mut Culler,
        device: &mut D,
        view: &View,
        rule: &CutRule,
        last: &[DrawableId],
    ) -> Result<CulledFrame, RoleError> {
        let mut mapper = OccluderMapper::new(Arc::clone(culler.scene()), *view, rule);
        device.begin_occluders(view).map_err(RoleError::of_device::<D>("clearing the depth"))?;
        let mapped = map(device, &mut mapper, (view, rule), last)?;
        let mut occluders = mapped.clone();
        self.choose(culler.scene(), view, rule, last.len(), &mut occluders);
        device.add_occluders(&occluders).map_err(RoleError::of_device::<D>("drawing occluders"))?;
        let mut visible = Vec::new();
        let traversal = culler.traverse(view, rule, device).map_err(RoleError::of_culling::<D>)?;
        let mut rounds = Rounds::new(traversal, &mapped, &occluders, self.rule());
        while let Some(ids) = rounds.next(device, D::add_occluders).map_err(RoleError::of_culling::<D>)? {
            visible.extend_from_slice(ids);
        }
        occluders.extend_from_slice(rounds.occluders());
        Ok(CulledFrame { visible, occluders, rounds: rounds.rounds(), stats: rounds.stats() })
    }

    /// Selects occluders among all that are `due` for the `received` ids of the last frame. If these say
    /// little of this frame (the first one, or after a jump), among the large nodes of the LOD cut.
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

    /// The rule for further rounds of a frame.
    pub(super) fn rule(self) -> RoundRule {
        RoundRule { most: self.rounds, budget: self.budget }
    }
}

/// The counterparts of the `last` visible set in the cut that `mapper` has begun, ascending. The device finds
/// them, or else the host.
pub(super) fn map<D: CullerDevice>(
    device: &mut D,
    mapper: &mut OccluderMapper,
    (view, rule): (&View, &CutRule),
    last: &[DrawableId],
) -> Result<Vec<DrawableId>, RoleError> {
    let own =
        device.map_occluders(view, rule, last).map_err(RoleError::of_device::<D>("mapping occluders"))?;
    let mut own = match own {
        Some(own) if !device.is_checked() => own,
        own => {
            let mut mapped = Vec::new();
            mapper.push(last, &mut mapped)?;
            let differs = own.filter(|own| !same_set(own, &mapped));
            match differs {
                Some(own) => return Err(OccluderError::Differs { own: own.len(), host: mapped.len() }.into()),
                None => mapped,
            }
        }
    };
    own.sort_unstable();
    Ok(own)
}

/// Whether both have the same ids, each once.
fn same_set(a: &[DrawableId], b: &[DrawableId]) -> bool {
    let ids = |set: &[DrawableId]| set.iter().copied().collect::<BTreeSet<_>>();
    a.len() == b.len() && ids(a) == ids(b)
}
