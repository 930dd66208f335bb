//! The LOD cut: which level of detail of which nodes shows the scene within a given error on the screen.
//!
//! From the root downwards, a node is drawn at its coarsest level whose error, projected to the screen, is
//! within the rule's bound. If no level is good enough, its children are considered instead (the paper,
//! section 4.1). The result is a cut through the tree: each leaf has exactly one node of the cut on its path
//! to the root.
//!
//! # The projected error
//! Let `p` and `q` be points in view space, one of the finest geometry and one of a level, no further apart
//! than the level's certified error `e`. Both lie in the node's box, which bounds every level below it. With
//! depths `zp`, `zq` and focal length `f` in pixels, their distance on the screen is
//!
//! ```text
//! f / (zp zq) * |(zq px - zp qx, zq py - zp qy)|
//! ```
//!
//! and the vector is two components of `p x q = p x (q - p)`, so its length is at most `|p| e`: the distance
//! is at most `f e (|p| / zp) / zq`, and just as well `f e (|q| / zq) / zp`. One of the two points is inside
//! the frustum (else the difference is not seen); call it `p`. Then `|p| / zp` is at most `sqrt(1 + tan_x^2 +
//! tan_y^2)`, and at most the greatest such ratio over the box; `zp` is at least the box's smallest depth,
//! and at least the eye's distance from the box over that ratio; `zq` is at least the box's smallest depth,
//! and at least `zp - e`. This holds at any angle off the axis, where a rule by distance alone comes out up
//! to `1 / cos^2` too small.
//!
//! Where `zq` may reach the near plane (the eye is in the box, say) the bound is infinite and the node is
//! refined.
//!
//! # The same bits everywhere
//! OR, HC and RVG may run on different machines and must choose alike. All of this is f64 addition,
//! subtraction, multiplication, division, square root, minimum and maximum in a fixed order, each of which
//! IEEE 754 defines to the last bit and none of which Rust fuses.

use glam::{DMat3, DVec3};
use trimaran_proto::DrawableId;
use trimaran_scene::{Level, Node, NodeId, Scene};

use crate::cut_rule::NodeAppearance;
use crate::frustum::Frustum;
use crate::{CutRule, View};

/// The decision on a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Draw it at this level, or the visible ones of its pieces.
    Draw(Level),
    /// No level of it is good enough: consider its children.
    Refine,
    /// Nothing of it: all objects below it are hidden.
    Nothing,
}

/// The cut of one scene for one view: chooses levels and tests against the frustum. It borrows the scene and
/// holds the view's data for the choice.
#[derive(Debug, Clone)]
pub struct LodCut<'s> {
    scene: &'s Scene,
    frustum: Frustum,
    eye: DVec3,
    to_view: DMat3,
    focal: f64,
    spread: f64,
    near: f64,
    rule: CutRule,
}

impl<'s> LodCut<'s> {
    /// The cut of `scene` in `view` under `rule`.
    #[must_use]
    pub fn new(scene: &'s Scene, view: &View, rule: impl Into<CutRule>) -> Self {
        let (tan_x, tan_y) = (view.tan_half_fov_x(), view.tan_half_fov_y());
        Self {
            scene,
            frustum: Frustum::new(view),
            eye: view.eye(),
            to_view: view.to_view(),
            focal: view.focal_x().max(view.focal_y()),
            spread: (1.0 + tan_x * tan_x + tan_y * tan_y).sqrt(),
            near: f64::from(view.camera().near()),
            rule: rule.into(),
        }
    }

    /// The decision on a node that the cut reaches: the coarsest level that is good enough; without one,
    /// refine; for a leaf without one, its finest level (Algorithm 4.1 would drop it). A level of several
    /// objects is not drawn if their appearances differ.
    #[must_use]
    pub fn choose(&self, id: NodeId, node: &Node) -> Choice {
        match self.rule.appearance(self.scene, id, node) {
            NodeAppearance::Hidden => return Choice::Nothing,
            NodeAppearance::Mixed => return Choice::Refine,
            NodeAppearance::Solid | NodeAppearance::SeeThrough => {}
        }
        let epsilon = self.rule.lod().epsilon_px();
        let magnification = self.magnification(node);
        let levels = self.scene.levels(node);
        for level in levels.clone().rev() {
            if magnification.error_on_screen(self.error(level)) <= epsilon {
                return Choice::Draw(level);
            }
        }
        match levels.clone().next() {
            Some(finest) if node.is_leaf() => Choice::Draw(finest),
            _ => Choice::Refine,
        }
    }

    /// An upper bound of the screen distance, in pixels, between points of the node that are `error` metres
    /// apart, one of them in the frustum. 0 for an error of 0; infinite if the box reaches the near plane.
    #[must_use]
    pub fn error_on_screen(&self, node: &Node, error: f64) -> f64 {
        self.magnification(node).error_on_screen(error)
    }

    /// The certified error of a level, world metres.
    fn error(&self, level: Level) -> f64 {
        self.scene.drawables().get(level.first().index()).map_or(f64::INFINITY, |first| first.error.into())
    }

    /// Stand-ins for a drawable of the cut, finest first: coarser levels of its node and of its ancestors,
    /// while their screen error is at most `bound_px`. Excludes levels of objects with different appearances.
    pub fn coarser(&self, id: DrawableId, bound_px: f64) -> impl Iterator<Item = Level> + '_ {
        let drawables = self.scene.drawables();
        let node = drawables.get(id.index()).map(|drawable| NodeId(drawable.node));
        let up = node.into_iter().flat_map(|node| self.scene.ancestors(node));
        let alike = up.take_while(|(id, node)| {
            !matches!(
                self.rule.appearance(self.scene, *id, node),
                NodeAppearance::Mixed | NodeAppearance::Hidden
            )
        });
        let levels = alike.flat_map(move |(_, node)| {
            let magnification = self.magnification(node);
            self.scene.levels(node).map(move |level| (level, magnification))
        });
        let coarser = levels.skip_while(move |(level, _)| !level.holds(id)).skip(1);
        coarser
            .take_while(move |(level, magnification)| {
                magnification.error_on_screen(self.error(*level)) <= bound_px
            })
            .map(|(level, _)| level)
    }

    /// All drawables of the cut in the frustum, in breadth-first order: the unculled picture.
    #[must_use]
    pub fn drawables(&self) -> Vec<DrawableId> {
        self.large_drawables(usize::MAX)
    }

    /// The levels of all nodes of the cut in the frustum, in breadth-first order. Some of their pieces may be
    /// outside of it.
    #[must_use]
    pub fn levels(&self) -> Vec<Level> {
        self.descend(usize::MAX)
    }

    /// Those of [`drawables`](Self::drawables) that look large: per level of the tree at most `widest` nodes
    /// are refined, the largest. So it visits a bounded part of a scene of any size.
    #[must_use]
    pub fn large_drawables(&self, widest: usize) -> Vec<DrawableId> {
        self.descend(widest).into_iter().flat_map(|level| self.in_frustum(level)).collect()
    }

    fn descend(&self, widest: usize) -> Vec<Level> {
        let mut drawn = Vec::new();
        let mut refined: Vec<(f64, &Node)> = Vec::new();
        let mut level = vec![NodeId(0)];
        while !level.is_empty() {
            read_ahead(self.scene, level.iter().copied());
            for id in level.drain(..) {
                let Some(node) = self.scene.nodes().get(id.0 as usize).filter(|node| !self.outside(node))
                else {
                    continue;
                };
                match self.choose(id, node) {
                    Choice::Draw(level) => drawn.push(level),
                    Choice::Refine => refined.push((looks(node, self.eye), node)),
                    Choice::Nothing => {}
                }
            }
            if refined.len() > widest {
                refined.select_nth_unstable_by(widest, |a, b| b.0.total_cmp(&a.0));
                refined.truncate(widest);
                refined.sort_unstable_by_key(|(_, node)| node.first_child);
            }
            level.extend(refined.drain(..).flat_map(|(_, node)| node.children().map(NodeId)));
        }
        drawn
    }

    /// The pieces of a level of a node in the frustum that are not certainly outside of it.
    pub(crate) fn in_frustum(&self, level: Level) -> impl Iterator<Item = DrawableId> + '_ {
        let pieces = level.pieces();
        let is_whole = pieces.len() == 1;
        pieces
            .filter(move |id| is_whole || self.scene.part(*id).is_some_and(|(_, part)| !self.outside(&part)))
    }

    /// Whether the node's box is certainly outside the frustum, or cut away by a section.
    #[must_use]
    pub fn outside(&self, node: &Node) -> bool {
        self.frustum.excludes_world_box(node)
    }

    /// The inputs of the cut beside the view.
    #[must_use]
    pub const fn rule(&self) -> &CutRule {
        &self.rule
    }

    /// The scene of this cut.
    #[must_use]
    pub const fn scene(&self) -> &'s Scene {
        self.scene
    }

    /// The focal length in pixels, and the bound of |p| / zp in the frustum.
    pub(crate) const fn focal_and_spread(&self) -> (f64, f64) {
        (self.focal, self.spread)
    }

    fn magnification(&self, node: &Node) -> Magnification {
        let (min, max) = node.world_box();
        let half = (max - min) * 0.5;
        let centre = self.to_view * ((min + max) * 0.5 - self.eye);
        let reach = DVec3::new(
            extent(self.to_view.row(0), half),
            extent(self.to_view.row(1), half),
            extent(self.to_view.row(2), half),
        );
        let nearest = -centre.z - reach.z;
        if !nearest.is_finite() {
            return Magnification {
                focal_spread: f64::NAN,
                nearest: f64::NAN,
                seen: f64::NAN,
                near: self.near,
            };
        }
        // How far off the axis the box goes: a bound of |p| / zp over the box if all of it is before the eye.
        let spread = if nearest > 0.0 {
            let (x, y) = (centre.x.abs() + reach.x, centre.y.abs() + reach.y);
            self.spread.min((1.0 + (x * x + y * y) / (nearest * nearest)).sqrt())
        } else {
            self.spread
        };
        let distance = node.distance_squared(self.eye).sqrt();
        Magnification {
            focal_spread: self.focal * spread,
            nearest,
            seen: nearest.max(distance / spread),
            near: self.near,
        }
    }
}

/// The factors that magnify a node's errors: see the module's text.
#[derive(Debug, Clone, Copy)]
struct Magnification {
    /// Focal length times the bound of |p| / zp.
    focal_spread: f64,
    /// The box's smallest depth.
    nearest: f64,
    /// The smallest depth at which a point of the box can be in the frustum.
    seen: f64,
    near: f64,
}

impl Magnification {
    fn error_on_screen(&self, error: f64) -> f64 {
        if error == 0.0 {
            return 0.0;
        }
        let depth = self.nearest.max(self.seen - error);
        // Written so that NaN ends here as well and, conservatively, refines.
        if depth > self.near { self.focal_spread * error / depth } else { f64::INFINITY }
    }
}

/// Half the width of a box of half-size `half` along `direction`.
fn extent(direction: DVec3, half: DVec3) -> f64 {
    direction.x.abs() * half.x + direction.y.abs() * half.y + direction.z.abs() * half.z
}

/// The apparent size of a node: the square of its diagonal over its distance. Infinite if the eye is in its
/// box.
pub(crate) fn looks(node: &Node, eye: DVec3) -> f64 {
    let (min, max) = node.world_box();
    (max - min).length_squared() / node.distance_squared(eye)
}

/// Reads the data of these nodes for the cut, if not in memory yet.
pub(crate) fn read_ahead(scene: &Scene, level: impl Iterator<Item = NodeId> + Clone) {
    let nodes = scene.nodes();
    // If the nodes were in memory, so are nearly all their levels.
    if nodes.read_ahead(level.clone().map(|id| id.0 as usize)) {
        let known = level.filter_map(|id| nodes.get(id.0 as usize));
        scene.drawables().read_ahead(known.map(|node| node.first_drawable as usize));
    }
}

/// The unculled picture: all of the cut in the frustum.
#[must_use]
pub fn lod_cut(scene: &Scene, view: &View, rule: impl Into<CutRule>) -> Vec<DrawableId> {
    LodCut::new(scene, view, rule).drawables()
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};
    use trimaran_scene::{FlatObject, Rgba8, SceneArrays};

    use super::*;

    #[test]
    fn what_is_read_ahead_has_its_levels_in_memory() {
        let object = FlatObject {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            indices: vec![0, 1, 2],
            colour: Rgba8([0; 4]),
            linear: Mat3::IDENTITY,
            origin: DVec3::ZERO,
        };
        // Several pages of nodes, and of drawables.
        let whole = Scene::from_arrays(SceneArrays::flat(&vec![object; 2200])).unwrap();
        let scene = whole.opened_again().unwrap();
        let (nodes, drawables) = (0..scene.nodes().len(), 0..scene.drawables().len());
        read_ahead(&scene, nodes.clone().map(|node| NodeId(node as u32)));
        assert!(!scene.nodes().read_ahead(nodes), "nothing is left to read");
        assert!(!scene.drawables().read_ahead(drawables), "nothing is left to read");
    }
}
