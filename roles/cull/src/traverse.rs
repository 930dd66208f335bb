//! Hardware culling (HC): the traversal of the tree that keeps the visible nodes (the paper, Algorithm
//! 4.1 and section 4.5.1). A node that is drawn at a level of several pieces is followed by these, which are
//! tested one by one like children.

use std::collections::BTreeSet;
use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_scene::{NodeId, ReadError, Scene};

use crate::boxes::{BoxMaker, Prepared, Untestable};
use crate::cut_rule::NodeAppearance;
use crate::lod_cut::{Choice, LodCut, read_ahead};
use crate::parallel::find_each;
use crate::reached::Reached;
use crate::{Answer, CutRule, OcclusionTest, TestBox, View, WholeTraversal};

/// Counters of one traversal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CullStats {
    /// Those that a culler reports. An interior node without children to visit is counted as visited alone.
    pub counts: CullCounts,
    /// Boxes tested once more, in further rounds.
    pub tested_again: u32,
    /// Of the hidden ones, drawables that were found hidden only then.
    pub hidden_later: u32,
}

/// Why a traversal stopped. The earlier output is valid, but not complete.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CullError<E: std::error::Error + 'static> {
    /// The occlusion test failed.
    #[error("testing boxes against the occluders failed")]
    Test(#[source] E),
    /// Part of the scene cannot be read.
    #[error("the scene cannot be culled")]
    Scene(#[source] ReadError),
    /// The occlusion test broke its contract.
    #[error("the occlusion test gave {answers} answers for {boxes} boxes; it must give one for each")]
    AnswerCount {
        /// The boxes asked about.
        boxes: usize,
        /// The answers.
        answers: usize,
    },
    /// The test's own traversal was compared with one that asks box by box, and differs.
    #[error(
        "the occlusion test's own traversal found {own} drawables, and one that asks box by box {asked}; {}: \
        report the device and its driver", FirstDifference(*first)
    )]
    Differs {
        /// The drawables that the test's own traversal found.
        own: usize,
        /// Those found box by box.
        asked: usize,
        /// The first drawable that only one of them found. None if only counters or steps differ.
        first: Option<DrawableId>,
    },
    /// The rule counts visible pixels, but the occlusion test does not.
    #[error(
        "stopping at few pixels needs an occlusion test that counts pixels; use another one or turn the rule off"
    )]
    NeedsPixelCount,
}

struct FirstDifference(Option<DrawableId>);

impl std::fmt::Display for FirstDifference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(id) => write!(f, "only one of them found {id}"),
            None => f.write_str("their counters differ"),
        }
    }
}

/// A scene, and the traversal's working memory: make one, use it every frame.
#[derive(Debug)]
pub struct Culler {
    scene: Arc<Scene>,
    memory: Memory,
}

#[derive(Debug, Default)]
struct Memory {
    level: Vec<Reached>,
    /// If the test went through the tree: how many drawables each further step gives, in reverse.
    steps: Vec<usize>,
    /// Its drawables, descending.
    rest: Vec<DrawableId>,
    next: Vec<Reached>,
    /// The children of the level's nodes, which follow the pieces in `next`.
    children: Vec<Reached>,
    /// Visible levels in one piece, whose ids wait for the pieces of other nodes of that depth: ids rise.
    held: Vec<DrawableId>,
    candidates: Vec<Candidate>,
    boxes: Vec<TestBox>,
    answers: Vec<u32>,
    /// The visible drawables of the level.
    visible: Vec<DrawableId>,
}

/// A node or a piece of the level in the frustum.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    reached: Reached,
    choice: Choice,
    tested: bool,
}

impl Culler {
    /// A culler of `scene`.
    #[must_use]
    pub fn new(scene: Arc<Scene>) -> Self {
        Self { scene, memory: Memory::default() }
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Begins to traverse the tree, breadth first, for the drawables of `rule`'s cut whose nodes are visible
    /// in front of `test`'s occluders.
    ///
    /// # Errors
    /// If the test does not fit the rule.
    pub fn traverse<T: OcclusionTest>(
        &mut self,
        view: &View,
        rule: impl Into<CutRule>,
        test: &T,
    ) -> Result<Traversal<'_>, CullError<T::Error>> {
        let rule = rule.into();
        if rule.lod().stops_at_few_pixels() && test.answer() != Answer::PixelCount {
            return Err(CullError::NeedsPixelCount);
        }
        let Self { scene, memory } = self;
        memory.level.clear();
        memory.steps.clear();
        memory.held.clear();
        if !scene.nodes().is_empty() {
            memory.level.push(Reached::Node(NodeId(0)));
        }
        let (cut, maker) = (LodCut::new(scene, view, rule), BoxMaker::new(view, test.outline()));
        let stats = CullStats::default();
        Ok(Traversal { scene, memory, view: *view, cut, maker, stats, has_begun: false })
    }

    /// Traverses the whole tree, passing results of [`Traversal::next_level`] to `sink`.
    ///
    /// # Errors
    /// If the test fails, or does not fit the rule.
    pub fn cull<T: OcclusionTest>(
        &mut self,
        view: &View,
        rule: impl Into<CutRule>,
        test: &mut T,
        mut sink: impl FnMut(&[DrawableId]),
    ) -> Result<CullStats, CullError<T::Error>> {
        let mut traversal = self.traverse(view, rule, test)?;
        while let Some(visible) = traversal.next_level(test)? {
            sink(visible);
        }
        Ok(traversal.stats())
    }
}

/// A traversal in progress, which may be paused between two levels.
#[derive(Debug)]
pub struct Traversal<'c> {
    scene: &'c Scene,
    memory: &'c mut Memory,
    view: View,
    cut: LodCut<'c>,
    maker: BoxMaker,
    stats: CullStats,
    has_begun: bool,
}

impl<'c> Traversal<'c> {
    /// The visible drawables of the next level that has any, as soon as that level is decided; `None` at the
    /// end.
    ///
    /// # Errors
    /// If the test fails.
    pub fn next_level<T: OcclusionTest>(
        &mut self,
        test: &mut T,
    ) -> Result<Option<&[DrawableId]>, CullError<T::Error>> {
        if !std::mem::replace(&mut self.has_begun, true)
            && let Some(whole) = test.traverse(&self.view, self.cut.rule()).map_err(CullError::Test)?
        {
            if test.is_checked() {
                self.check(test, &whole)?;
            }
            self.take(whole);
        }
        while let Some(count) = self.memory.steps.pop() {
            let Memory { rest, visible, .. } = &mut *self.memory;
            visible.clear();
            visible.extend(rest.drain(rest.len().saturating_sub(count)..).rev());
            if !visible.is_empty() {
                return Ok(Some(&self.memory.visible));
            }
        }
        self.next_asked_level(test)
    }

    /// The same, asking box by box.
    fn next_asked_level<T: OcclusionTest>(
        &mut self,
        test: &mut T,
    ) -> Result<Option<&[DrawableId]>, CullError<T::Error>> {
        while !self.memory.level.is_empty() {
            let scene = self.scene;
            scene.reading(|| self.judge_level(test)).map_err(CullError::Scene)??;
            let Memory { level, next, visible, .. } = &mut *self.memory;
            std::mem::swap(level, next);
            if !visible.is_empty() {
                return Ok(Some(&self.memory.visible));
            }
        }
        Ok(None)
    }

    /// Tests this traversal's results once more, after more occluders were drawn, and drops those hidden now.
    ///
    /// # Errors
    /// If the test fails.
    pub fn test_again<T: OcclusionTest>(
        &mut self,
        test: &mut T,
        found: &mut Vec<DrawableId>,
    ) -> Result<(), CullError<T::Error>> {
        let Self { scene, maker, memory, .. } = self;
        let prepared = |id: &DrawableId| match maker.prepare(&scene.part(*id)?.1) {
            Prepared::Test(test_box) => Some(test_box),
            Prepared::Outside | Prepared::Visible(_) => None,
        };
        let test_boxes = scene.reading(|| found.iter().map(prepared).collect::<Vec<_>>());
        let test_boxes = test_boxes.map_err(CullError::Scene)?;
        memory.boxes.clear();
        memory.boxes.extend(test_boxes.iter().flatten());
        self.test(test)?;
        let mut is_tested = test_boxes.iter().map(Option::is_some);
        let mut answers = self.memory.answers.iter();
        let before = found.len();
        found.retain(|_| is_tested.next() != Some(true) || answers.next() != Some(&0));
        let hidden = u32::try_from(before - found.len()).unwrap_or(u32::MAX);
        self.stats.tested_again += u32::try_from(self.memory.boxes.len()).unwrap_or(u32::MAX);
        self.stats.hidden_later += hidden;
        self.stats.counts.hidden += hidden;
        self.stats.counts.emitted -= hidden;
        Ok(())
    }

    /// Nothing is left to visit but the results of the test's own traversal.
    fn take(&mut self, whole: WholeTraversal) {
        self.stats = CullStats { counts: whole.counts(), ..CullStats::default() };
        self.memory.level.clear();
        self.memory.steps = whole.given();
        self.memory.steps.reverse();
        self.memory.rest = whole.visible;
        self.memory.rest.sort_unstable_by(|a, b| b.cmp(a));
    }

    /// Compares the test's own traversal with one that asks box by box.
    fn check<T: OcclusionTest>(
        &mut self,
        test: &mut T,
        whole: &WholeTraversal,
    ) -> Result<(), CullError<T::Error>> {
        let (mut asked, mut steps) = (Vec::new(), Vec::new());
        while let Some(level) = self.next_asked_level(test)? {
            asked.extend_from_slice(level);
            steps.push(level.len());
        }
        let given: Vec<usize> = whole.given().into_iter().filter(|count| *count > 0).collect();
        let visible: BTreeSet<DrawableId> = whole.visible.iter().copied().collect();
        let asked: BTreeSet<DrawableId> = asked.into_iter().collect();
        if visible == asked && given == steps && whole.counts() == self.stats.counts {
            return Ok(());
        }
        let first = visible.symmetric_difference(&asked).next().copied();
        Err(CullError::Differs { own: visible.len(), asked: asked.len(), first })
    }

    fn judge_level<T: OcclusionTest>(&mut self, test: &mut T) -> Result<(), CullError<T::Error>> {
        self.prepare_level().map_err(CullError::Scene)?;
        self.test(test)?;
        self.decide_level();
        Ok(())
    }

    /// The counters so far.
    #[must_use]
    pub const fn stats(&self) -> CullStats {
        self.stats
    }

    /// The traversed scene.
    pub(crate) const fn scene(&self) -> &'c Scene {
        self.scene
    }

    /// The inputs of the cut beside the view.
    pub(crate) const fn rule(&self) -> &CutRule {
        self.cut.rule()
    }

    /// The view.
    pub(crate) const fn view(&self) -> &View {
        &self.view
    }

    /// Tests the prepared boxes.
    fn test<T: OcclusionTest>(&mut self, test: &mut T) -> Result<(), CullError<T::Error>> {
        let Memory { boxes, answers, .. } = &mut *self.memory;
        answers.clear();
        if !boxes.is_empty() {
            test.test(&self.view, boxes, answers).map_err(CullError::Test)?;
            self.stats.counts.batches += 1;
        }
        if answers.len() != boxes.len() {
            return Err(CullError::AnswerCount { boxes: boxes.len(), answers: answers.len() });
        }
        Ok(())
    }

    /// Sorts the level's nodes and pieces into those outside the frustum, those to test and those
    /// conservatively visible.
    fn prepare_level(&mut self) -> Result<(), ReadError> {
        let Self { scene, cut, maker, stats: CullStats { counts, .. }, .. } = self;
        let Memory { level, candidates, boxes, .. } = &mut *self.memory;
        candidates.clear();
        boxes.clear();
        let nodes = level.iter().filter_map(|reached| match reached {
            Reached::Node(id) => Some(*id),
            Reached::Piece(_) => None,
        });
        read_ahead(scene, nodes);
        let found = find_each(scene, level, |reached| reached.find(cut, maker))?;
        for (&reached, found) in level.iter().zip(found) {
            let Some((choice, prepared)) = found else { continue };
            counts.visited += 1;
            let tested = match prepared {
                Prepared::Outside => {
                    counts.outside += 1;
                    continue;
                }
                Prepared::Test(test_box) => {
                    boxes.push(test_box);
                    counts.tested += 1;
                    true
                }
                Prepared::Visible(reason) => {
                    *match reason {
                        Untestable::EyeInside => &mut counts.eye_inside,
                        Untestable::AcrossNear => &mut counts.near_visible,
                        Untestable::NotFinite => &mut counts.not_finite,
                    } += 1;
                    false
                }
            };
            candidates.push(Candidate { reached, choice, tested });
        }
        Ok(())
    }

    /// Emits, refines or drops the level's candidates by the test's answers.
    fn decide_level(&mut self) {
        let Self { cut, stats: CullStats { counts, .. }, .. } = self;
        let lod = cut.rule().lod();
        let Memory { next, children, held, visible, answers, candidates, .. } = &mut *self.memory;
        next.clear();
        visible.clear();
        visible.append(held);
        let mut answers = answers.iter();
        for candidate in &*candidates {
            let pixels = if candidate.tested { answers.next().copied() } else { None };
            if pixels == Some(0) {
                counts.hidden += 1;
                continue;
            }
            let id = match candidate.reached {
                Reached::Node(id) => id,
                Reached::Piece(id) => {
                    counts.emitted += 1;
                    visible.push(id);
                    continue;
                }
            };
            let Some(node) = self.scene.nodes().get(id.0 as usize) else { continue };
            let is_mixed = || cut.rule().appearance(self.scene, id, node) == NodeAppearance::Mixed;
            let few = lod.stops_at_few_pixels()
                && pixels.is_some_and(|count| f64::from(count) < lod.epsilon_px())
                && !is_mixed();
            let level = match candidate.choice {
                Choice::Draw(level) => Some(level),
                Choice::Refine if few => self.scene.levels(node).next().inspect(|_| counts.few_pixels += 1),
                Choice::Refine | Choice::Nothing => None,
            };
            match level {
                Some(level) if level.pieces().len() == 1 => {
                    counts.emitted += 1;
                    held.push(level.first());
                }
                Some(level) => {
                    counts.refined += 1;
                    next.extend(level.pieces().map(Reached::Piece));
                }
                None => {
                    counts.refined += 1;
                    children.extend(node.children().map(|id| Reached::Node(NodeId(id))));
                }
            }
        }
        visible.sort_unstable();
        if next.is_empty() {
            visible.append(held);
        }
        next.append(children);
    }
}
