//! CHC++ (Mattausch, Bittner and Wimmer, "CHC++: Coherent Hierarchical Culling Revisited", 2008), for
//! comparison: hardware occlusion queries in batches, few of them, by what was visible before.
//!
//! - Nodes that were visible in the last frame are gone through without a query, and drawn. A drawn one is
//!   queried again only every few frames, first after a random number of them.
//! - Nodes that were not are queried, nearest first. One query covers several that were hidden for long, as
//!   they will probably stay hidden; if it sees anything, each is queried alone.
//! - A node that would be refined is queried by the boxes below it where these are hardly larger than its
//!   own.
//!
//! The algorithm draws what was visible while it waits for queries. Here OR draws it first, and HC waits for
//! all queries of a step at once. So later queries have all of these occluders, and no wait is filled.

mod boxes;

use std::sync::Arc;

use trimaran_actors::{RoleError, Stop};
use trimaran_cull::{Choice, CullError, DrawOrder, Prepared, Reached, TestBox, Viewport};
use trimaran_gpu::{GpuError, GpuScene, OccluderPass, VulkanCuller};
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_scene::{Node, NodeId, Scene, random::Random};

use self::boxes::Tests;
use super::{
    failed,
    work::{FrameCuller, Seen},
};

/// The most nodes that share queries: those of one batch.
const BATCH: usize = 50;
/// A drawn node that was queried is taken for visible in so many frames.
const ASSUMED_VISIBLE: u32 = 5;

/// The history of a node or a piece.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    /// The last frame in which it was visible, counted from 1; 0 if it never was.
    visible: u32,
    /// In how many further frames it is not queried.
    assumed: u32,
}

/// A node or a piece that is to be queried.
#[derive(Debug)]
struct Waiting {
    reached: Reached,
    /// Its squared distance from the eye.
    distance: f64,
    boxes: Vec<TestBox>,
    /// It was visible and is drawn: the answer is for the next frames.
    is_drawn: bool,
}

/// Culls as CHC++ does.
pub(super) struct Chc {
    scene: Arc<Scene>,
    pass: OccluderPass,
    order: DrawOrder,
    /// Of all nodes, then of all drawables.
    known: Vec<Known>,
    random: Random,
    frame: u32,
    /// The drawables of the frame.
    drawn: Vec<DrawableId>,
    waiting: Vec<Waiting>,
    counts: CullCounts,
}

impl Chc {
    pub(super) fn new(scene: &Arc<Scene>, drawn: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        let parts = scene.nodes().len() + scene.drawables().len();
        Ok(Self {
            scene: Arc::clone(scene),
            pass: OccluderPass::new(drawn, size)?,
            order: DrawOrder::default(),
            known: vec![Known::default(); parts],
            random: Random::new(1),
            frame: 0,
            drawn: Vec::new(),
            waiting: Vec::new(),
            counts: CullCounts::default(),
        })
    }

    fn known(&mut self, reached: Reached) -> Option<&mut Known> {
        let place = match reached {
            Reached::Node(id) => id.0 as usize,
            Reached::Piece(id) => self.scene.nodes().len() + id.index(),
        };
        self.known.get_mut(place)
    }

    /// Goes on at `reached`: down what was visible in the last frame, and up to what was not, which waits to
    /// be queried. `is_visible` where a query has just seen it.
    fn look(&mut self, tests: &Tests<'_>, reached: Reached, is_visible: bool) {
        let mut open = vec![(reached, is_visible)];
        while let Some((reached, is_seen)) = open.pop() {
            let Some((choice, prepared)) = reached.find(&tests.cut, &tests.maker) else { continue };
            let last = self.frame - 1;
            let was_visible = self.known(reached).is_some_and(|known| last > 0 && known.visible == last);
            if !is_seen {
                self.counts.visited += 1;
            }
            match prepared {
                Prepared::Outside => {
                    self.counts.outside += 1;
                    continue;
                }
                Prepared::Test(_) if !is_seen && !was_visible => {
                    self.wait(tests, (reached, choice), false);
                    continue;
                }
                Prepared::Test(_) | Prepared::Visible(_) => {}
            }
            let is_new = !was_visible || matches!(prepared, Prepared::Visible(_));
            match (choice, reached) {
                (Choice::Draw(level), Reached::Node(_)) if level.pieces().len() > 1 => {
                    open.extend(level.pieces().map(|id| (Reached::Piece(id), false)));
                }
                (Choice::Draw(level), _) => {
                    let id = if let Reached::Piece(id) = reached { id } else { level.first() };
                    self.drawn.push(id);
                    self.draw(tests, (reached, choice), is_new);
                }
                (Choice::Refine, Reached::Node(id)) => {
                    let children = self.scene.nodes().get(id.0 as usize).map(Node::children);
                    let children = children.into_iter().flatten().map(NodeId);
                    open.extend(children.map(|child| (Reached::Node(child), false)));
                }
                _ => {}
            }
        }
    }

    /// Notes that a node or a piece is drawn: visible, or to be queried whether it still is.
    fn draw(&mut self, tests: &Tests<'_>, of: (Reached, Choice), is_new: bool) {
        let random = self.random.below(ASSUMED_VISIBLE as usize + 1) as u32;
        let Some(known) = self.known(of.0) else { return };
        if is_new {
            known.assumed = random;
        } else if known.assumed == 0 {
            self.wait(tests, of, true);
            return;
        } else {
            known.assumed -= 1;
        }
        self.is_visible(of.0);
    }

    /// Marks a node or a piece as visible in this frame, and all nodes above it.
    fn is_visible(&mut self, reached: Reached) {
        let frame = self.frame;
        let node = match reached {
            Reached::Node(id) => Some(id),
            Reached::Piece(id) => {
                if let Some(known) = self.known(reached) {
                    known.visible = frame;
                }
                self.scene.drawables().get(id.index()).map(|drawable| NodeId(drawable.node))
            }
        };
        let scene = Arc::clone(&self.scene);
        for (id, _) in node.into_iter().flat_map(|node| scene.ancestors(node)) {
            match self.known(Reached::Node(id)) {
                Some(known) if known.visible != frame => known.visible = frame,
                _ => break,
            }
        }
    }

    fn wait(&mut self, tests: &Tests<'_>, (reached, choice): (Reached, Choice), is_drawn: bool) {
        let part = match reached {
            Reached::Node(id) => self.scene.nodes().get(id.0 as usize).copied(),
            Reached::Piece(id) => self.scene.part(id).map(|(_, part)| part),
        };
        let Some(part) = part else { return };
        let boxes = match choice {
            Choice::Refine => tests.tight_boxes(&part),
            _ => None,
        };
        let boxes = boxes.or_else(|| match tests.maker.prepare(&part) {
            Prepared::Test(own) => Some(vec![own]),
            Prepared::Outside | Prepared::Visible(_) => None,
        });
        let distance = part.distance_squared(tests.eye);
        self.waiting.push(Waiting { reached, distance, boxes: boxes.unwrap_or_default(), is_drawn });
    }

    /// The probability that a hidden node stays hidden, by how long it was.
    fn stays_hidden(&mut self, reached: Reached) -> f64 {
        let frame = self.frame;
        let hidden = self.known(reached).map_or(0, |known| frame - known.visible);
        0.99 - 0.7 * (-f64::from(hidden)).exp()
    }

    /// Divides a batch into those that share a query each: those that probably stay hidden first, as long as
    /// another one saves more queries than it is expected to cost.
    fn shared(&mut self, batch: Vec<Waiting>) -> Vec<Vec<Waiting>> {
        let mut batch: Vec<(f64, Waiting)> =
            batch.into_iter().map(|waiting| (self.stays_hidden(waiting.reached), waiting)).collect();
        batch.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut queries: Vec<Vec<Waiting>> = Vec::new();
        let (mut all_stay, mut value) = (1.0, 0.0);
        for (stays, waiting) in batch {
            let count = queries.last().map_or(0, Vec::len) as f64 + 1.0;
            let with = count / (1.0 + (1.0 - all_stay * stays) * count);
            match queries.last_mut() {
                Some(query) if with > value => {
                    query.push(waiting);
                    (all_stay, value) = (all_stay * stays, with);
                }
                _ => {
                    queries.push(vec![waiting]);
                    (all_stay, value) = (stays, 1.0 / (2.0 - stays));
                }
            }
        }
        queries
    }

    /// Queries all that waits: together what probably stays hidden, then alone what was seen together.
    /// Returns what is visible.
    fn query(&mut self, seen: Seen<'_>) -> Result<Vec<Waiting>, GpuError> {
        let mut waiting = std::mem::take(&mut self.waiting);
        waiting.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let (drawn, mut hidden): (Vec<_>, Vec<_>) = waiting.into_iter().partition(|one| one.is_drawn);
        let mut queries: Vec<Vec<Waiting>> = Vec::new();
        while !hidden.is_empty() {
            let rest = hidden.split_off(BATCH.min(hidden.len()));
            queries.extend(self.shared(std::mem::replace(&mut hidden, rest)));
        }
        queries.extend(drawn.into_iter().map(|one| vec![one]));
        let mut visible = Vec::new();
        while !queries.is_empty() {
            let boxes: Vec<TestBox> = queries.iter().flatten().flat_map(|one| &one.boxes).copied().collect();
            let sizes = queries.iter().map(|query| query.iter().map(|one| one.boxes.len()).sum());
            let mut pixels = Vec::new();
            self.pass.query_test()?.test_together(seen.view, &boxes, sizes, &mut pixels)?;
            self.counts.batches += 1;
            self.counts.tested += u32::try_from(queries.len()).unwrap_or(u32::MAX);
            let mut alone = Vec::new();
            for (query, pixels) in std::mem::take(&mut queries).into_iter().zip(pixels) {
                if pixels == 0 {
                    let hidden = query.iter().filter(|one| !one.is_drawn).count();
                    self.counts.hidden += u32::try_from(hidden).unwrap_or(u32::MAX);
                } else if query.len() == 1 {
                    visible.extend(query);
                } else {
                    alone.extend(query.into_iter().map(|one| vec![one]));
                }
            }
            queries = alone;
        }
        Ok(visible)
    }

    /// Draws the frame's drawables from this place on as occluders, nearest first.
    fn draw_from(&mut self, first: usize, seen: Seen<'_>) -> Result<(), GpuError> {
        let mut solid = self.drawn.get(first..).unwrap_or_default().to_vec();
        seen.rule.retain_solid(&self.scene, &mut solid);
        self.order.sort(&self.scene, seen.view, &mut solid);
        self.pass.draw(&solid)?;
        self.pass.finish()?;
        Ok(())
    }
}

impl FrameCuller for Chc {
    fn cancel_on(&mut self, stop: &Stop) {
        let stop = stop.clone();
        self.pass.cancel_when(move || stop.requested());
    }

    /// This one remembers what was visible before, so `last` is not needed.
    fn draw_occluders(&mut self, seen: Seen<'_>, _: &[DrawableId]) -> Result<&[DrawableId], RoleError> {
        self.frame += 1;
        self.drawn.clear();
        self.waiting.clear();
        self.counts = CullCounts::default();
        let scene = Arc::clone(&self.scene);
        let tests = Tests::new(&scene, seen);
        let looked = scene.reading(|| self.look(&tests, Reached::Node(NodeId(0)), false));
        looked.map_err(unreadable)?;
        self.pass.begin(seen.view).map_err(failed("drawing occluders"))?;
        self.draw_from(0, seen).map_err(failed("drawing occluders"))?;
        Ok(&self.drawn)
    }

    fn cull(&mut self, seen: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError> {
        let scene = Arc::clone(&self.scene);
        let tests = Tests::new(&scene, seen);
        while !self.waiting.is_empty() {
            let visible = self.query(seen).map_err(failed("querying"))?;
            let first = self.drawn.len();
            for Waiting { reached, is_drawn, .. } in visible {
                if is_drawn && let Some(known) = self.known(reached) {
                    known.assumed = ASSUMED_VISIBLE;
                }
                if !is_drawn {
                    scene.reading(|| self.look(&tests, reached, true)).map_err(unreadable)?;
                }
                self.is_visible(reached);
            }
            if !self.waiting.is_empty() && self.drawn.len() > first {
                self.draw_from(first, seen).map_err(failed("drawing occluders"))?;
            }
        }
        found.extend_from_slice(&self.drawn);
        let emitted = u32::try_from(found.len()).unwrap_or(u32::MAX);
        Ok(CullCounts { emitted, ..self.counts })
    }
}

fn unreadable(fault: trimaran_scene::ReadError) -> RoleError {
    RoleError::of_culling::<VulkanCuller>(CullError::Scene(fault))
}
