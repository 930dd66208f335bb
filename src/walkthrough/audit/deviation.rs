//! The screen-space distance between the drawn geometry and full detail.
//!
//! Both measures are distances from a pixel's centre to projected surfaces, not to other pixels: parts
//! thinner than a pixel, and partners outside of the picture or hidden, cannot mislead them. The cut rule
//! bounds both by epsilon.
//!
//! - [`silhouette`]: pixels that only the shown picture covers, to the nearest surface of anything at full
//!   detail; pixels that only full detail covers, to the nearest surface that was drawn. It measures
//!   nothing without visible background.
//! - [`surfaces`]: every covered pixel to the surface of the same thing: from a drawable to the leaves that
//!   it stands for, and from a leaf to the drawable that stands for it in the LOD cut.

use std::collections::{BTreeMap, HashMap, HashSet};

use trimaran_audit::{
    distances_to_surfaces,
    metrics::{self, Deviation, IdBufferRef, MetricError},
};
use trimaran_cull::View;
use trimaran_proto::DrawableId;
use trimaran_scene::{Level, NodeId, Scene};

/// How far the border to the background moved: `shown` is the ID buffer of `drawn`, `full` that of full
/// detail.
///
/// # Errors
/// If the images differ in size.
pub(super) fn silhouette(
    scene: &Scene,
    view: &View,
    drawn: &[DrawableId],
    shown: &IdBufferRef<'_>,
    full: &IdBufferRef<'_>,
) -> Result<Deviation, MetricError> {
    let to = |pixels: &[usize], ids: &[DrawableId]| distances_to_surfaces(scene, view, pixels, ids);
    metrics::silhouette(
        &shown.coverage(),
        &full.coverage(),
        // The nearest surface may lie outside the frustum as well.
        |pixels| to(pixels, &finest_below(scene, NodeId(0))),
        |pixels| to(pixels, &whole_levels(scene, drawn)),
    )
}

/// How far surfaces moved: `shown` is the ID buffer of a part of the LOD cut that has the levels `cut`,
/// `full` that of full detail.
pub(super) fn surfaces(
    scene: &Scene,
    view: &View,
    cut: &[Level],
    shown: &IdBufferRef<'_>,
    full: &IdBufferRef<'_>,
) -> Deviation {
    let mut distances = Vec::new();
    let mut zeros = 0;
    let mut measure = |from: DrawableId, pixels: &[usize], to: &[DrawableId]| {
        if to.contains(&from) {
            zeros += pixels.len();
        } else {
            let found = distances_to_surfaces(scene, view, pixels, to);
            distances.extend(found.into_iter().map(|distance| distance.unwrap_or_else(|| diagonal(view))));
        }
    };
    for (owner, pixels) in pixels_by_owner(shown) {
        let finest = node_of(scene, owner).map(|node| finest_below(scene, node)).unwrap_or_default();
        measure(owner, &pixels, &finest);
    }
    let stand_in = StandIns::of(scene, cut);
    for (owner, pixels) in pixels_by_owner(full) {
        measure(owner, &pixels, stand_in.of_leaf(owner));
    }
    Deviation::of(distances, zeros)
}

/// All pieces of the levels of which these drawables are pieces, each once. The nearest point of a surface
/// may be in a piece that is hidden or outside the frustum.
fn whole_levels(scene: &Scene, drawn: &[DrawableId]) -> Vec<DrawableId> {
    let level = |id: &DrawableId| Some(scene.drawables().get(id.index())?.level(*id));
    let levels: HashSet<Level> = drawn.iter().filter_map(level).collect();
    levels.into_iter().flat_map(Level::pieces).collect()
}

/// Maps a leaf to the drawables that stand for it in a LOD cut.
struct StandIns<'s> {
    scene: &'s Scene,
    drawn: HashMap<NodeId, Vec<DrawableId>>,
}

impl<'s> StandIns<'s> {
    fn of(scene: &'s Scene, cut: &[Level]) -> Self {
        let mut drawn: HashMap<NodeId, Vec<DrawableId>> = HashMap::new();
        for id in cut.iter().copied().flat_map(Level::pieces) {
            if let Some(node) = node_of(scene, id) {
                drawn.entry(node).or_default().push(id);
            }
        }
        Self { scene, drawn }
    }

    /// The drawables of the cut that stand for a leaf: on the leaf's path to the root. None if the leaf is
    /// outside the cut.
    fn of_leaf(&self, leaf: DrawableId) -> &[DrawableId] {
        let mut up = node_of(self.scene, leaf).into_iter().flat_map(|node| self.scene.ancestors(node));
        up.find_map(|(node, _)| self.drawn.get(&node)).map_or(&[], Vec::as_slice)
    }
}

/// The pieces of the finest level of every leaf at or below a node.
pub(in crate::walkthrough) fn finest_below(scene: &Scene, node: NodeId) -> Vec<DrawableId> {
    let mut finest = Vec::new();
    let mut open = vec![node];
    while let Some(node) = open.pop().and_then(|id| scene.nodes().get(id.0 as usize)) {
        if node.is_leaf() {
            finest.extend(scene.levels(node).next().into_iter().flat_map(Level::pieces));
        }
        open.extend(node.children().map(NodeId));
    }
    finest
}

fn node_of(scene: &Scene, drawable: DrawableId) -> Option<NodeId> {
    scene.drawables().get(drawable.index()).map(|drawable| NodeId(drawable.node))
}

/// The pixels that each drawable owns, as indices row by row.
pub(super) fn pixels_by_owner(image: &IdBufferRef<'_>) -> BTreeMap<DrawableId, Vec<usize>> {
    let mut pixels = BTreeMap::<_, Vec<usize>>::new();
    for (pixel, owner) in image.owners().enumerate() {
        if let Some(owner) = owner {
            pixels.entry(DrawableId(owner)).or_default().push(pixel);
        }
    }
    pixels
}

fn diagonal(view: &View) -> f64 {
    f64::from(view.viewport().width()).hypot(f64::from(view.viewport().height()))
}
