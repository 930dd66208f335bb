//! Hardware culling (HC): the traversal of the tree that keeps what shows (the paper, Algorithm 4.1 and
//! section 4.5.1).

use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::DrawableId;
use trimaran_scene::{NodeId, Scene};

use crate::boxes::{BoxMaker, Prepared, Untestable, reaches};
use crate::lod_cut::{Choice, LodCut, LodRule};
use crate::{Answer, OcclusionTest, TestBox, View};

/// What one traversal did. Each node it came to is counted once among `frustum_culled`, `hidden`, `emitted`
/// and `refined`, or is an interior node without children to go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CullStats {
    /// Nodes the traversal came to.
    pub visited: u32,
    /// Nodes outside the frustum.
    pub frustum_culled: u32,
    /// Boxes given to the occlusion test.
    pub tested: u32,
    /// Boxes found hidden; with each its whole subtree was dropped.
    pub hidden: u32,
    /// Conservatively visible: a corner is nearer than the near plane.
    pub near_visible: u32,
    /// Conservatively visible: the eye is in the inflated box.
    pub eye_inside: u32,
    /// Conservatively visible: a coordinate is NaN, infinite or too large for f32.
    pub not_finite: u32,
    /// Drawables given to the sink.
    pub emitted: u32,
    /// Visible nodes that were too coarse, so that their children were visited.
    pub refined: u32,
    /// Nodes drawn too coarsely because they show at few pixels (section 4.5.2 of the paper, if the rule
    /// asks for it).
    pub stopped_at_few_pixels: u32,
    /// Batches of occlusion tests: levels of the tree at which there was something to test.
    pub batches: u32,
}

/// Why a traversal stopped. What the sink got before is valid, but not all that is visible.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CullError<E: std::error::Error + 'static> {
    /// The occlusion test failed.
    #[error("testing boxes against the occluders failed")]
    Test(#[source] E),
    /// The occlusion test broke its contract.
    #[error("the occlusion test gave {answers} answers for {boxes} boxes; it must give one for each")]
    AnswerCount {
        /// The boxes asked about.
        boxes: usize,
        /// The answers.
        answers: usize,
    },
    /// The rule counts visible pixels and the occlusion test does not.
    #[error(
        "stopping at few pixels needs an occlusion test that counts pixels; use another one or turn the rule off"
    )]
    NeedsPixelCount,
}

/// A scene made ready for culling, and the traversal's working memory: make one, use it every frame.
#[derive(Debug)]
pub struct Culler {
    scene: Arc<Scene>,
    reach: Vec<f32>,
    level: Vec<NodeId>,
    next: Vec<NodeId>,
    candidates: Vec<Candidate>,
    boxes: Vec<TestBox>,
    answers: Vec<u32>,
    /// The level's drawables that show.
    visible: Vec<DrawableId>,
}

/// A node of the level that is not outside the frustum.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    node: NodeId,
    choice: Choice,
    tested: bool,
}

impl Culler {
    /// Makes `scene` ready; goes through it once.
    #[must_use]
    pub fn new(scene: Arc<Scene>) -> Self {
        let reach = reaches(scene.nodes());
        Self {
            scene,
            reach,
            level: Vec::new(),
            next: Vec::new(),
            candidates: Vec::new(),
            boxes: Vec::new(),
            answers: Vec::new(),
            visible: Vec::new(),
        }
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Traverses the tree breadth first, a level at a time, and gives `sink` the drawables of `rule`'s cut
    /// whose nodes show in front of the test's occluders: those of a level at once, as soon as that level is
    /// decided, and none for a level without.
    ///
    /// # Errors
    /// If the test fails, or does not fit the rule.
    pub fn cull<T: OcclusionTest>(
        &mut self,
        view: &View,
        rule: LodRule,
        test: &mut T,
        mut sink: impl FnMut(&[DrawableId]),
    ) -> Result<CullStats, CullError<T::Error>> {
        if rule.stops_at_few_pixels() && test.answer() != Answer::PixelCount {
            return Err(CullError::NeedsPixelCount);
        }
        let scene = Arc::clone(&self.scene);
        let cut = LodCut::new(&scene, view, rule);
        let maker = BoxMaker::new(view, test.outline());
        let mut stats = CullStats::default();
        self.level.clear();
        if !scene.nodes().is_empty() {
            self.level.push(NodeId(0));
        }
        while !self.level.is_empty() {
            self.prepare_level(&cut, &maker, &mut stats);
            self.answers.clear();
            if !self.boxes.is_empty() {
                test.test(view, &self.boxes, &mut self.answers).map_err(CullError::Test)?;
                stats.batches += 1;
            }
            if self.answers.len() != self.boxes.len() {
                return Err(CullError::AnswerCount { boxes: self.boxes.len(), answers: self.answers.len() });
            }
            self.decide_level(rule, &mut stats);
            if !self.visible.is_empty() {
                sink(&self.visible);
            }
            std::mem::swap(&mut self.level, &mut self.next);
        }
        Ok(stats)
    }

    /// Sorts the level's nodes into those outside the frustum, those to test and those conservatively
    /// visible.
    fn prepare_level(&mut self, cut: &LodCut<'_>, maker: &BoxMaker, stats: &mut CullStats) {
        self.candidates.clear();
        self.boxes.clear();
        for &id in &self.level {
            let (Some(node), Some(&reach)) =
                (self.scene.nodes().get(id.0 as usize), self.reach.get(id.0 as usize))
            else {
                continue;
            };
            stats.visited += 1;
            if cut.outside(node) {
                stats.frustum_culled += 1;
                continue;
            }
            let tested = match maker.prepare(node, f64::from(reach)) {
                Prepared::Outside => {
                    stats.frustum_culled += 1;
                    continue;
                }
                Prepared::Test(test_box) => {
                    self.boxes.push(test_box);
                    stats.tested += 1;
                    true
                }
                Prepared::Visible(reason) => {
                    *match reason {
                        Untestable::EyeInside => &mut stats.eye_inside,
                        Untestable::AcrossNear => &mut stats.near_visible,
                        Untestable::NotFinite => &mut stats.not_finite,
                    } += 1;
                    false
                }
            };
            self.candidates.push(Candidate { node: id, choice: cut.choose(node), tested });
        }
    }

    /// Emits, refines or drops the level's candidates by the test's answers.
    fn decide_level(&mut self, rule: LodRule, stats: &mut CullStats) {
        self.next.clear();
        self.visible.clear();
        let mut answers = self.answers.iter();
        for candidate in &self.candidates {
            let pixels = if candidate.tested { answers.next().copied() } else { None };
            if pixels == Some(0) {
                stats.hidden += 1;
                continue;
            }
            let Some(node) = self.scene.nodes().get(candidate.node.0 as usize) else { continue };
            let few = pixels
                .is_some_and(|count| rule.stops_at_few_pixels() && f64::from(count) < rule.epsilon_px());
            match (candidate.choice, node.levels().next()) {
                (Choice::Draw(id), _) => {
                    stats.emitted += 1;
                    self.visible.push(id);
                }
                (Choice::Refine, Some(finest)) if few => {
                    stats.stopped_at_few_pixels += 1;
                    stats.emitted += 1;
                    self.visible.push(finest);
                }
                (Choice::Refine, _) => {
                    stats.refined += 1;
                    self.next.extend(node.children().map(NodeId));
                }
            }
        }
    }
}
