//! Rounds: within a frame, found drawables are drawn as occluders, and the found ones are tested once more.
//!
//! After a jump the depth of the last frame's visible set hides little, and a traversal against it finds many
//! hidden nodes. These are in the LOD cut, and any subset of that is a valid set of occluders. So some are
//! drawn over the depth, and the rest are tested again.
//!
//! Whether a round follows is decided by counting triangles, never by a clock, so that equal frames have
//! equal ids. A triangle is *new* if its drawable was neither found in the last frame nor drawn as an
//! occluder yet.
//! - The second round comes where the new triangles are half a budget at least, and a quarter of all that was
//!   found. In a calm frame little is new, so it has one round.
//! - A further one comes where as many are left, and the last one hid at least half of what it tested.
//!
//! Ids are returned as they are found, level by level, while next to nothing is new: at most a 32nd of a
//! budget. Later ones are held until the last round, and keep their order.

use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::occluder_selection::{TriangleBudget, select_occluders, triangles};
use crate::{CullError, CullStats, CutRule, OcclusionTest, Traversal};

/// How many rounds a frame may have, and the occluder budget of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoundRule {
    /// The most rounds, with the first one.
    pub most: u32,
    /// Triangles of occluders per round, plus a quarter of the candidates', up to as many again. If a jump
    /// finds a million triangles, these hide nearly as much as all of them.
    pub budget: TriangleBudget,
}

impl RoundRule {
    /// Only one round, as in the paper.
    pub const ONE: Self = Self { most: 1, budget: TriangleBudget(0) };
}

/// A traversal in rounds.
#[derive(Debug)]
pub struct Rounds<'c> {
    traversal: Traversal<'c>,
    /// The last frame's counterparts in the cut, ascending.
    last: &'c [DrawableId],
    rule: RoundRule,
    round: u32,
    /// The occluders of all rounds so far, ascending.
    drawn: Vec<DrawableId>,
    /// The occluders of further rounds.
    occluders: Vec<DrawableId>,
    /// The drawables found so far, in order.
    found: Vec<DrawableId>,
    /// How many of them were returned already, and are final.
    given: usize,
    /// New triangles among the found ones.
    new: u64,
}

impl<'c> Rounds<'c> {
    /// Continues a traversal that has just begun. `drawn` are the occluders of its first round. `last` are
    /// the counterparts of the last frame's visible set, ascending.
    #[must_use]
    pub fn new(
        traversal: Traversal<'c>,
        last: &'c [DrawableId],
        drawn: &[DrawableId],
        rule: RoundRule,
    ) -> Self {
        let mut drawn = drawn.to_vec();
        drawn.sort_unstable();
        Self {
            traversal,
            last,
            rule,
            round: 1,
            drawn,
            occluders: Vec::new(),
            found: Vec::new(),
            given: 0,
            new: 0,
        }
    }

    /// The next visible drawables, as soon as they are decided; `None` at the end. They come in the order of
    /// the traversal. `draw` adds occluders to those of `test`.
    ///
    /// # Errors
    /// If testing or drawing fails.
    pub fn next<T: OcclusionTest>(
        &mut self,
        test: &mut T,
        draw: impl FnMut(&mut T, &[DrawableId]) -> Result<(), T::Error>,
    ) -> Result<Option<&[DrawableId]>, CullError<T::Error>> {
        let scene = self.traversal.scene();
        let rule = self.traversal.rule().clone();
        while let Some(level) = self.traversal.next_level(test)? {
            self.new += new_triangles(scene, self.last, &self.drawn, level, &rule);
            self.found.extend_from_slice(level);
            if self.rule.most <= 1 || self.new <= self.rule.budget.0 / 32 {
                return Ok(Some(self.give()));
            }
        }
        if self.given < self.found.len() {
            let quarter = triangles(scene, &self.found) / 4;
            if self.new >= quarter {
                self.further_rounds(test, draw)?;
            }
            return Ok(Some(self.give()));
        }
        Ok(None)
    }

    /// Draws and tests again as long as the rule allows.
    fn further_rounds<T: OcclusionTest>(
        &mut self,
        test: &mut T,
        mut draw: impl FnMut(&mut T, &[DrawableId]) -> Result<(), T::Error>,
    ) -> Result<(), CullError<T::Error>> {
        let scene = self.traversal.scene();
        let mut held = self.found.split_off(self.given);
        let mut tested = triangles(scene, &held);
        while self.round < self.rule.most && self.new >= self.rule.budget.0 / 2 {
            let occluders = self.choose(&held);
            draw(test, &occluders).map_err(CullError::Test)?;
            self.occluders.extend_from_slice(&occluders);
            self.drawn.extend(occluders);
            self.drawn.sort_unstable();
            self.traversal.test_again(test, &mut held)?;
            self.round += 1;
            let left = triangles(scene, &held);
            if left * 2 > tested {
                break;
            }
            tested = left;
            self.new = new_triangles(scene, self.last, &self.drawn, &held, self.traversal.rule());
        }
        self.found.append(&mut held);
        Ok(())
    }

    /// Selects the next occluders from `held`.
    fn choose(&self, held: &[DrawableId]) -> Vec<DrawableId> {
        let (scene, view) = (self.traversal.scene(), self.traversal.view());
        let mut due: Vec<DrawableId> =
            held.iter().copied().filter(|id| self.drawn.binary_search(id).is_err()).collect();
        self.traversal.rule().retain_solid(scene, &mut due);
        let most = TriangleBudget(2 * self.rule.budget.0);
        let budget = self.rule.budget.among(scene, &due).min(most);
        select_occluders(scene, view, &mut due, budget);
        due
    }

    fn give(&mut self) -> &[DrawableId] {
        let from = std::mem::replace(&mut self.given, self.found.len());
        self.found.get(from..).unwrap_or_default()
    }

    /// Counters of the traversal, over all rounds.
    #[must_use]
    pub const fn stats(&self) -> CullStats {
        self.traversal.stats()
    }

    /// Rounds so far.
    #[must_use]
    pub const fn rounds(&self) -> u32 {
        self.round
    }

    /// The occluders drawn in further rounds.
    #[must_use]
    pub fn occluders(&self) -> &[DrawableId] {
        &self.occluders
    }
}

/// The triangles of `level` that could hide something, and are neither of the `last` frame nor drawn as
/// occluders.
fn new_triangles(
    scene: &Scene,
    last: &[DrawableId],
    drawn: &[DrawableId],
    level: &[DrawableId],
    rule: &CutRule,
) -> u64 {
    let new = |id: &&DrawableId| {
        last.binary_search(id).is_err()
            && drawn.binary_search(id).is_err()
            && !rule.is_see_through(scene, **id)
    };
    let drawables = level.iter().filter(new).filter_map(|id| scene.drawables().get(id.index()));
    drawables.map(|drawable| u64::from(drawable.triangles)).sum()
}
