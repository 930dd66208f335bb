//! Maps the last frame's visible set to the next frame's occluders.
//!
//! HC emits drawables of the cut for *its* camera; OR draws for the next camera, with another cut. An id is
//! mapped to its counterpart in the new cut: the same node at another level, an ancestor, or descendants. So
//! every occluder is part of the picture that will be drawn, and nothing hidden behind it can be visible:
//! this makes culling exact. Any subset of the cut is a valid set of occluders, so fewer may be drawn
//! ([`select_occluders`](crate::select_occluders)) for looser culling.

use std::collections::HashSet;
use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::DrawableId;
use trimaran_scene::{Node, NodeId, ReadError, Scene};

use crate::lod_cut::{Choice, LodCut};
use crate::{CutRule, SubPixelGrid, View};

/// How far the occluders' depth lies behind their surfaces on this grid: by its change over this share of a
/// pixel.
///
/// A device interpolates the depth of a steep triangle with an error, and a surface drawn too near may hide
/// its own box. Occluders slightly too far hide a little less, and never too much. It is four steps.
#[must_use]
pub fn grid_bias_px(grid: SubPixelGrid) -> f32 {
    grid.margin_px() as f32
}

/// The occluder bias for `view`. With sections it is 0, since the depth decides what they cut away.
#[must_use]
pub fn occluder_bias_px(view: &View) -> f32 {
    if view.sections().is_empty() { grid_bias_px(view.grid()) } else { 0.0 }
}

/// Why ids cannot be mapped.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum OccluderError {
    /// An id from another scene.
    #[error("{id} is not in this scene, which has {count}: do all roles hold the same scene?")]
    Unknown {
        /// The id.
        id: DrawableId,
        /// The number of drawables of this scene.
        count: usize,
    },
    /// A device's mapping was compared with the host's, and differs.
    #[error(
        "the device mapped the last frame to {own} occluders and the host to {host}: report the device and \
        its driver"
    )]
    Differs {
        /// The occluders that the device found.
        own: usize,
        /// Those that the host found.
        host: usize,
    },
    /// Part of the scene cannot be read.
    #[error("the occluders of the last frame cannot be found in the scene")]
    Scene(#[source] ReadError),
}

/// The state of a node in this frame. Stored with the frame's stamp in one word, so that a new frame costs
/// nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
enum State {
    /// Not visited yet.
    Unknown,
    /// The cut goes through the node's descendants, some of which may not have been visited.
    Above,
    /// Like `Above`, with all of the cut below it returned.
    AllBelowDue,
    /// The cut is at this node (returned) or above it, or the node is invisible: nothing is left to return.
    Settled,
}

/// Maps batches of ids as they come, each due drawable once per frame. The cost is proportional to the ids
/// and their results.
#[derive(Debug)]
pub struct OccluderMapper {
    scene: Arc<Scene>,
    /// Per node: stamp * 4 + state.
    marks: Vec<u32>,
    /// The levels of the cut of which only the given pieces are returned, by their first piece.
    open: HashSet<DrawableId>,
    /// The returned pieces of these.
    pieces: HashSet<DrawableId>,
    stamp: u32,
    view: View,
    rule: CutRule,
    path: Vec<u32>,
}

impl OccluderMapper {
    const LAST_STAMP: u32 = u32::MAX >> 2;

    /// For the cut of `scene` in `view` under `rule`.
    #[must_use]
    pub fn new(scene: Arc<Scene>, view: View, rule: impl Into<CutRule>) -> Self {
        let marks = vec![0; scene.nodes().len()];
        let (open, pieces) = (HashSet::new(), HashSet::new());
        Self { scene, marks, open, pieces, stamp: 1, view, rule: rule.into(), path: Vec::new() }
    }

    /// Starts the next frame: maps to the cut in `view` under `rule` from now on.
    pub fn begin(&mut self, view: View, rule: impl Into<CutRule>) {
        (self.view, self.rule) = (view, rule.into());
        if self.stamp == Self::LAST_STAMP {
            self.marks.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
        self.open.clear();
        self.pieces.clear();
    }

    /// Appends the cut's counterparts of `ids` to `due`, except those already returned in this frame.
    ///
    /// # Errors
    /// At the first id that the scene lacks, after mapping those before it; and if part of the scene cannot
    /// be read.
    pub fn push(&mut self, ids: &[DrawableId], due: &mut Vec<DrawableId>) -> Result<(), OccluderError> {
        let scene = Arc::clone(&self.scene);
        scene.reading(|| self.map(&scene, ids, due)).map_err(OccluderError::Scene)?
    }

    fn map(
        &mut self,
        scene: &Scene,
        ids: &[DrawableId],
        due: &mut Vec<DrawableId>,
    ) -> Result<(), OccluderError> {
        let (drawables, cut) = (scene.drawables(), LodCut::new(scene, &self.view, &self.rule));
        for &id in ids {
            let unknown = || OccluderError::Unknown { id, count: drawables.len() };
            let drawable = drawables.get(id.index()).ok_or_else(unknown)?;
            if self.open.contains(&drawable.level(id).first()) {
                self.add_piece(&cut, id, due);
            } else if self.settle_path(&cut, drawable.node, id, due) == State::Above {
                self.descend(&cut, drawable.node, due);
            }
        }
        Ok(())
    }

    /// Settles the nodes from the root down to `node`, which has the drawable `id`. Returns the node's state.
    fn settle_path(
        &mut self,
        cut: &LodCut<'_>,
        node: u32,
        id: DrawableId,
        due: &mut Vec<DrawableId>,
    ) -> State {
        let nodes = cut.scene().nodes();
        self.path.clear();
        let mut state = State::Above;
        // Up to the first ancestor with a known state.
        for (NodeId(above), _) in cut.scene().ancestors(NodeId(node)) {
            let known = self.state(above);
            if known != State::Unknown {
                state = known;
                break;
            }
            self.path.push(above);
        }
        // And down again: below a settled node all is settled.
        while let Some(below) = self.path.pop() {
            let Some(record) = nodes.get(below as usize) else { break };
            if state == State::Above {
                state = self.ask(cut, NodeId(below), record, (below == node).then_some(id), due);
            }
            self.mark(below, state);
        }
        state
    }

    /// Returns all of the cut below `top`, which is above the cut.
    fn descend(&mut self, cut: &LodCut<'_>, top: u32, due: &mut Vec<DrawableId>) {
        let nodes = cut.scene().nodes();
        self.path.clear();
        self.path.push(top);
        while let Some(at) = self.path.pop() {
            let Some(record) = nodes.get(at as usize) else { continue };
            let state = match self.state(at) {
                State::Unknown => self.ask(cut, NodeId(at), record, None, due),
                known => known,
            };
            if state == State::Above {
                self.mark(at, State::AllBelowDue);
                self.path.extend(record.children());
            } else {
                self.mark(at, state);
            }
        }
    }

    /// Decides a node that the cut reaches. `own` is a drawable of the node: if it is a piece of the chosen
    /// level, only the given pieces of that are due, and else all.
    fn ask(
        &mut self,
        cut: &LodCut<'_>,
        id: NodeId,
        node: &Node,
        own: Option<DrawableId>,
        due: &mut Vec<DrawableId>,
    ) -> State {
        if cut.outside(node) {
            return State::Settled;
        }
        match cut.choose(id, node) {
            Choice::Draw(level) => {
                match own.filter(|own| level.holds(*own) && level.pieces().len() > 1) {
                    Some(own) => {
                        self.open.insert(level.first());
                        self.add_piece(cut, own, due);
                    }
                    None => due.extend(cut.in_frustum(level)),
                }
                State::Settled
            }
            Choice::Refine => State::Above,
            Choice::Nothing => State::Settled,
        }
    }

    /// Returns a piece of an open level, once, if it is in the frustum.
    fn add_piece(&mut self, cut: &LodCut<'_>, id: DrawableId, due: &mut Vec<DrawableId>) {
        if self.pieces.insert(id) && cut.scene().part(id).is_some_and(|(_, part)| !cut.outside(&part)) {
            due.push(id);
        }
    }

    fn state(&self, node: u32) -> State {
        match self.marks.get(node as usize) {
            Some(mark) if mark >> 2 == self.stamp => match mark & 3 {
                1 => State::Above,
                2 => State::AllBelowDue,
                3 => State::Settled,
                _ => State::Unknown,
            },
            _ => State::Unknown,
        }
    }

    fn mark(&mut self, node: u32, state: State) {
        if let Some(mark) = self.marks.get_mut(node as usize) {
            *mark = self.stamp << 2 | state as u32;
        }
    }
}

/// The counterparts of `ids` in the cut of `view` under `rule`, each once: see [`OccluderMapper`], which
/// takes batches.
///
/// # Errors
/// If the scene lacks one of them.
pub fn occluders(
    scene: &Arc<Scene>,
    view: &View,
    rule: impl Into<CutRule>,
    ids: &[DrawableId],
) -> Result<Vec<DrawableId>, OccluderError> {
    let mut due = Vec::new();
    OccluderMapper::new(Arc::clone(scene), *view, rule).push(ids, &mut due)?;
    Ok(due)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_audit::cases::{plant, plant_views};
    use trimaran_proto::{Camera, FrameNumber, Section, SectionPlane, Sections};

    use super::*;
    use crate::LodRule;
    use crate::Viewport;
    use crate::lod_cut::lod_cut;

    #[test]
    fn occluders_lie_four_steps_of_the_grid_behind_but_with_sections_where_they_are() {
        let view = View::new(Camera::at_origin(FrameNumber(0)), Viewport::new(8, 8).unwrap());
        let half = SectionPlane::new([0.0; 3], [1.0, 0.0, 0.0]).unwrap();
        let cut = view.with_sections(Sections::new(&[Section::Plane(half)]).unwrap());
        for (bits, bias) in [(8, 4.0 / 256.0), (4, 4.0 / 16.0)] {
            let grid = SubPixelGrid::of_bits(bits);
            assert_eq!([view, cut].map(|view| occluder_bias_px(&view.on_grid(grid))), [bias, 0.0]);
        }
    }

    /// When the stamps wrap around, old marks must not count for this frame.
    #[test]
    fn frames_past_the_last_stamp_start_clean() {
        let scene = plant(1, 100, DVec3::ZERO).unwrap();
        let viewport = Viewport::new(32, 32).unwrap();
        // `trimaran-audit` links this crate built without tests: its views are of another type, its cameras
        // are not.
        let audit_view = plant_views(1, 100, DVec3::ZERO, viewport, 1).unwrap()[0];
        let view = View::new(*audit_view.camera(), viewport);
        let rule = LodRule::new(1.0).unwrap();
        let cut = lod_cut(&scene, &view, rule);
        let mut mapper = OccluderMapper::new(scene, view, rule);
        assert_eq!(OccluderMapper::LAST_STAMP.leading_zeros(), 2, "beside the bits of a state");
        mapper.stamp = OccluderMapper::LAST_STAMP - 1;
        for stamp in [OccluderMapper::LAST_STAMP, 1, 2, 3] {
            mapper.begin(view, rule);
            assert_eq!(mapper.stamp, stamp);
            let mut due = Vec::new();
            mapper.push(&cut, &mut due).unwrap();
            assert_eq!(due.len(), cut.len(), "stamp {stamp}");
            mapper.push(&cut, &mut due).unwrap();
            assert_eq!(due.len(), cut.len(), "each once");
        }
    }
}
