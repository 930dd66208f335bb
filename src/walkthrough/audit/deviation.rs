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

use std::collections::{BTreeMap, HashMap};

use trimaran_audit::{
    distances_to_surfaces,
    metrics::{self, Deviation, IdBufferRef, MetricError},
};
use trimaran_cull::View;
use trimaran_proto::DrawableId;
use trimaran_scene::{NodeId, Scene};

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
        |pixels| to(pixels, drawn),
    )
}

/// How far surfaces moved: `shown` is the ID buffer of a part of the LOD cut `cut`, `full` that of full
/// detail.
pub(super) fn surfaces(
    scene: &Scene,
    view: &View,
    cut: &[DrawableId],
    shown: &IdBufferRef<'_>,
    full: &IdBufferRef<'_>,
) -> Deviation {
    let mut distances = Vec::new();
    let mut zeros = 0;
    let mut measure = |from: DrawableId, pixels: &[usize], to: &[DrawableId]| {
        if to == [from] {
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
        measure(owner, &pixels, stand_in.of_leaf(owner).as_slice());
    }
    Deviation::of(distances, zeros)
}

/// Maps a leaf to the drawable of a LOD cut that stands for it.
struct StandIns<'s> {
    scene: &'s Scene,
    drawn: HashMap<NodeId, DrawableId>,
}

impl<'s> StandIns<'s> {
    fn of(scene: &'s Scene, cut: &[DrawableId]) -> Self {
        Self { scene, drawn: cut.iter().filter_map(|&id| Some((node_of(scene, id)?, id))).collect() }
    }

    /// The drawable of the cut that stands for a leaf: on the leaf's path to the root. `None` if the leaf is
    /// outside the cut.
    fn of_leaf(&self, leaf: DrawableId) -> Option<DrawableId> {
        let mut up = self.scene.ancestors(node_of(self.scene, leaf)?);
        up.find_map(|(node, _)| self.drawn.get(&node).copied())
    }
}

/// The finest level of every leaf at or below a node.
pub(in crate::walkthrough) fn finest_below(scene: &Scene, node: NodeId) -> Vec<DrawableId> {
    let mut finest = Vec::new();
    let mut open = vec![node];
    while let Some(node) = open.pop().and_then(|id| scene.nodes().get(id.0 as usize)) {
        if node.is_leaf() {
            finest.extend(node.levels().next());
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
