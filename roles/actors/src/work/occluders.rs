//! A culler's occluder selection, and its rounds.

use std::sync::Arc;

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
    /// Whether large nodes of the LOD cut replace a set that says little of this frame.
    pub replaces: bool,
}

/// The most nodes refined per level of the tree when occluders are chosen among the LOD cut. Small nodes hide
/// little, and a large scene has too many of them.
const WIDEST: usize = 2048;

impl Default for OccluderPolicy {
    fn default() -> Self {
        Self { budget: TriangleBudget(30_000), rounds: 4, replaces: true }
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
    /// The paper's (section 4.2): all that was visible in the last frame, in one round.
    pub const PAPER: Self = Self { budget: TriangleBudget(u64::MAX), rounds: 1, replaces: false };

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
        if self.is_useless(due.len(), received) {
            *due = Self::large(scene, view, rule, self.budget);
        } else {
            rule.retain_solid(scene, due);
            select_occluders(scene, view, due, self.budget.among(scene, due));
        }
    }

    /// Whether a last frame of `received` ids, of which that many were mapped, says little of this frame and
    /// is replaced: it is the first one, or the camera has jumped.
    pub(super) const fn is_useless(self, mapped: usize, received: usize) -> bool {
        self.replaces && mapped * 2 <= received
    }

    /// The large nodes of the LOD cut, within `budget`.
    pub(super) fn large(
        scene: &Scene,
        view: &View,
        rule: &CutRule,
        budget: TriangleBudget,
    ) -> Vec<DrawableId> {
        let mut large = LodCut::new(scene, view, rule).large_drawables(WIDEST);
        rule.retain_solid(scene, &mut large);
        select_occluders(scene, view, &mut large, budget);
        large
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
    let mut own =
        device.map_occluders(view, rule, last).map_err(RoleError::of_device::<D>("mapping occluders"))?;
    own.iter_mut().for_each(|ids| ids.sort_unstable());
    match own {
        Some(own) if !device.is_checked() => Ok(own),
        own => {
            let mut host = Vec::new();
            mapper.push(last, &mut host)?;
            host.sort_unstable();
            match own.filter(|own| *own != host) {
                Some(own) => Err(OccluderError::Differs { own: own.len(), host: host.len() }.into()),
                None => Ok(host),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_cull::{DepthImage, LodRule, NoOccluders, OcclusionTest, TestBox, Viewport, lod_cut};
    use trimaran_proto::{Camera, FrameNumber};

    use super::*;

    /// A device that maps every set to the same drawables.
    struct Maps {
        to: Option<Vec<DrawableId>>,
        is_checked: bool,
    }

    impl OcclusionTest for Maps {
        type Error = Infallible;

        fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
            NoOccluders.test(view, boxes, visible)
        }

        fn is_checked(&self) -> bool {
            self.is_checked
        }
    }

    impl CullerDevice for Maps {
        fn begin_occluders(&mut self, _: &View) -> Result<(), Infallible> {
            Ok(())
        }

        fn map_occluders(
            &mut self,
            _: &View,
            _: &CutRule,
            _: &[DrawableId],
        ) -> Result<Option<Vec<DrawableId>>, Infallible> {
            Ok(self.to.clone())
        }

        fn draw_occluders(&mut self, _: &[DrawableId]) -> Result<(), Infallible> {
            Ok(())
        }

        fn finish_occluders(&mut self) -> Result<(), Infallible> {
            Ok(())
        }

        fn read_depth(&mut self) -> Result<DepthImage<'_>, Infallible> {
            panic!("nobody looks at the depth here")
        }
    }

    #[test]
    fn a_device_maps_in_place_of_the_host_and_is_compared_with_it_where_it_is_checked() {
        let model = plant(&PlantOptions { objects: 20, triangles: 2000, ..PlantOptions::small(5) });
        let scene = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
        let (min, max) = scene.nodes()[0].world_box();
        let eye = ((min + max) * 0.5).to_array();
        let camera = Camera::new(eye, [0.0, 0.0, 0.0, 1.0], 1.0, 0.1, FrameNumber(0)).unwrap();
        let view = View::new(camera, Viewport::new(64, 64).unwrap());
        let rule = CutRule::from(LodRule::new(1.0).unwrap());
        let mut cut = lod_cut(&scene, &view, &rule);
        cut.sort_unstable();
        assert!(cut.len() > 2);
        let mapped = |to: Option<Vec<DrawableId>>, is_checked| {
            let mut mapper = OccluderMapper::new(Arc::clone(&scene), view, &rule);
            map(&mut Maps { to, is_checked }, &mut mapper, (&view, &rule), &cut)
        };
        let some: Vec<_> = cut[1..].iter().rev().copied().collect();
        assert_eq!(mapped(Some(some.clone()), false).unwrap(), cut[1..], "the device's, ascending");
        assert_eq!(mapped(None, true).unwrap(), cut, "the host's");
        assert_eq!(mapped(Some(cut.iter().rev().copied().collect()), true).unwrap(), cut);
        let Err(RoleError::Cull(cause)) = mapped(Some(some), true) else {
            panic!("nobody notices that one is missing");
        };
        let expected = format!("the device mapped the last frame to {} occluders", cut.len() - 1);
        assert!(cause.to_string().starts_with(&expected), "{cause}");
    }
}
