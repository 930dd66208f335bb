//! Coarser drawables that stand in for finer ones until these have come.

use std::collections::{BTreeMap, HashMap};

use trimaran_cull::{CutRule, LodCut, View};
use trimaran_proto::{DrawableId, FrameNumber, NumberList, Supply};
use trimaran_scene::{Level, Scene};

/// The largest error of a stand-in, relative to the bound of the view state.
const COARSER: f64 = 32.0;
/// If fewer new bytes than this are due, they arrive as soon as a stand-in would.
const FEW: u64 = 64 << 10;

/// Stand-ins for drawables being sent, and whether the display knows them.
#[derive(Debug, Default)]
pub(super) struct StandIns {
    /// Drawables without a stand-in yet.
    bare: Vec<(DrawableId, FrameNumber)>,
    /// Stand-ins for drawables, as the display was told or will be.
    known: HashMap<DrawableId, Level>,
    /// By the first drawable of a stand-in: it, and the drawables to tell the display.
    untold: BTreeMap<DrawableId, (Level, Vec<u32>)>,
}

impl StandIns {
    /// A frame needs this one, and it will be sent.
    pub(super) fn add(&mut self, id: DrawableId, frame: FrameNumber) {
        self.bare.push((id, frame));
    }

    /// Finds stand-ins for the added drawables: another level that the display `has`, or else the coarsest.
    /// Returns the drawables to send first: all of a stand-in, or the drawable itself if nothing is coarser.
    pub(super) fn find(
        &mut self,
        scene: &Scene,
        view: &View,
        rule: &CutRule,
        has: impl Fn(DrawableId) -> bool,
    ) -> Vec<(DrawableId, FrameNumber)> {
        let cut = LodCut::new(scene, view, rule);
        let bound_px = COARSER * rule.lod().epsilon_px();
        let few = self.bare.iter().map(|(id, _)| bytes_of(scene, *id)).sum::<u64>() < FEW;
        let mut first = Vec::new();
        for (id, frame) in self.bare.drain(..) {
            let mut coarsest = None;
            let coarser = cut.coarser(id, bound_px).inspect(|level| coarsest = Some(*level));
            let there = finer(scene, id).into_iter().chain(coarser).find(|level| level.pieces().all(&has));
            let stand_in = there.or(coarsest.filter(|_| !few));
            if let Some(level) = stand_in
                && self.known.insert(id, level) != Some(level)
            {
                self.untold.entry(level.first()).or_insert((level, Vec::new())).1.push(id.0);
            }
            if few {
                continue;
            }
            match stand_in {
                Some(level) => first.extend(level.pieces().filter(|id| !has(*id)).map(|id| (id, frame))),
                None => first.extend((!has(id)).then_some((id, frame))),
            }
        }
        first
    }

    /// The messages for the display.
    pub(super) fn tell(&mut self) -> Vec<Supply> {
        let untold = std::mem::take(&mut self.untold).into_iter();
        let parts = untold.flat_map(|(id, (level, drawables))| {
            let pieces = level.pieces().len() as u32;
            let lists: Vec<_> = NumberList::of(drawables).parts().collect();
            lists.into_iter().map(move |drawables| Supply::StandIn { id, pieces, drawables })
        });
        parts.collect()
    }
}

/// Finer levels of the same node, coarsest first.
fn finer(scene: &Scene, id: DrawableId) -> Vec<Level> {
    let drawable = scene.drawables().get(id.index());
    let node = drawable.and_then(|drawable| scene.nodes().get(drawable.node as usize));
    let is_finer = |level: &Level| level.first() < id && !level.holds(id);
    let mut levels: Vec<Level> =
        node.into_iter().flat_map(|node| scene.levels(node).take_while(is_finer)).collect();
    levels.reverse();
    levels
}

/// Bytes of its geometry, packed.
fn bytes_of(scene: &Scene, id: DrawableId) -> u64 {
    let drawable = scene.drawables().get(id.index());
    let place = drawable.and_then(|drawable| scene.places().get(drawable.geometry as usize));
    place.map_or(0, |place| place.length.into())
}

#[cfg(test)]
#[path = "stand_ins_tests.rs"]
mod tests;
