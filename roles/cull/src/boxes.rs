//! Makes the box that is tested in place of a node.
//!
//! A box must be visible wherever anything in it is visible. Four effects could break this, and each has its
//! allowance here:
//! - *rounding*: vertices are placed by f32 arithmetic about the eye, so they lie up to some ulp of their
//!   distance outside the exact box ([`POSITION_ULPS`]);
//! - *depth ties*: the rasterizer interpolates depth in f32, with an error of some ulp of a triangle's
//!   *greatest* depth value, which in metres grows with the square of the distance; a surface on the box's
//!   own face must still pass ([`DEPTH_ULPS`]). A constant bias of the depth value would be too little near
//!   the eye and far too much away from it;
//! - *samples*: a box smaller than a pixel may lie between the pixel centres, and the rasterizer moves
//!   corners by its sub-pixel step ([`SubPixelGrid::outline_px`](crate::SubPixelGrid::outline_px));
//! - *flatness*: a box without thickness has no front. Growing it by the allowances above gives it one in
//!   every direction.
//!
//! All are allowances in view space, in metres.

use glam::{DMat3, DVec3, Vec3};
use trimaran_scene::Node;

use crate::frustum::Frustum;
use crate::{Outline, TestBox, View};

/// The allowance for rounding, in ulp (2^-24) of the largest number in the computation of a vertex's
/// position. The vertex stage rounds a translation, nine matrix entries, three products and three sums; the
/// box's own corners are computed alike.
pub const POSITION_ULPS: f64 = 16.0;

/// The allowance for depth interpolation, in ulp (2^-24) of the greatest depth value in the box.
pub const DEPTH_ULPS: f64 = 16.0;

const ULP: f64 = 1.0 / (1 << 24) as f64;
pub(crate) const POSITION_SLACK: f64 = POSITION_ULPS * ULP;
pub(crate) const DEPTH_SLACK: f64 = DEPTH_ULPS * ULP;

/// The near plane counts as a little farther than it is, so that the rasterizer's clipping never decides.
const NEAR_SLACK: f64 = 1e-5;

/// The classification of a node before any test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prepared {
    /// Certainly outside the frustum.
    Outside,
    /// To be tested.
    Test(TestBox),
    /// Conservatively visible, with the reason.
    Visible(Untestable),
}

/// Why a node is conservatively visible: its box cannot be tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Untestable {
    /// The eye is in the inflated box.
    EyeInside,
    /// A corner is nearer than the near plane.
    AcrossNear,
    /// A coordinate is NaN, infinite, or too large for f32.
    NotFinite,
}

/// Makes the boxes of nodes for one view.
#[derive(Debug, Clone, Copy)]
pub struct BoxMaker {
    frustum: Frustum,
    eye: DVec3,
    to_view: DMat3,
    near: f64,
    /// Growth of the outline in metres per metre of depth, right and up.
    growth: (f64, f64),
}

impl BoxMaker {
    /// For boxes of `view`, with the outline convention of the occlusion test.
    #[must_use]
    pub fn new(view: &View, outline: Outline) -> Self {
        let growth = match outline {
            Outline::InBox => {
                let outline = view.grid().outline_px();
                (outline / view.focal_x(), outline / view.focal_y())
            }
            Outline::OnScreen => (0.0, 0.0),
        };
        Self {
            frustum: Frustum::new(view),
            eye: view.eye(),
            to_view: view.to_view(),
            near: f64::from(view.camera().near()),
            growth,
        }
    }

    /// The box of `node`.
    #[must_use]
    pub fn prepare(&self, node: &Node) -> Prepared {
        let exact = OrientedBox::new(node, self.eye, self.to_view);
        let farthest = exact.depths().1;
        let slack = self.slack_of(&exact, node);
        if !(slack.is_finite() && slack <= f64::from(f32::MAX)) {
            return Prepared::Visible(Untestable::NotFinite);
        }
        if self.frustum.excludes(exact.centre, &exact.axes(), slack) {
            return Prepared::Outside;
        }
        let grown = exact.grown(slack, self.growth, farthest + slack);
        if grown.holds_eye() {
            return Prepared::Visible(Untestable::EyeInside);
        }
        if grown.depths().0 <= self.nearest_tested() {
            return Prepared::Visible(Untestable::AcrossNear);
        }
        match grown.narrow() {
            Some(narrow) => Prepared::Test(narrow),
            None => Prepared::Visible(Untestable::NotFinite),
        }
    }

    /// Boxes that reach nearer than this are not tested, metres.
    pub(crate) fn nearest_tested(&self) -> f64 {
        self.near * (1.0 + NEAR_SLACK)
    }

    /// How far the box of `node` is inflated for rounding and depth ties, metres.
    #[must_use]
    pub fn slack(&self, node: &Node) -> f64 {
        self.slack_of(&OrientedBox::new(node, self.eye, self.to_view), node)
    }

    fn slack_of(&self, exact: &OrientedBox, node: &Node) -> f64 {
        let (nearest, farthest) = exact.depths();
        let far = exact.centre.length() + exact.half.length() + f64::from(node.reach);
        let position = POSITION_SLACK * far;
        // Clamped to the near plane: nothing nearer is ever rasterized.
        let depth = DEPTH_SLACK * farthest * farthest / nearest.max(self.near);
        position + depth.max(0.0)
    }
}

/// A box in view space with orthogonal axes.
#[derive(Debug, Clone, Copy)]
struct OrientedBox {
    centre: DVec3,
    /// Unit vectors.
    directions: [DVec3; 3],
    half: DVec3,
}

impl OrientedBox {
    /// The box around the node's local box. A sheared local box is skewed in the world. The result is the
    /// smallest box around it whose first direction is its longest edge, and whose second lies in the plane
    /// of the two longest.
    fn new(node: &Node, eye: DVec3, to_view: DMat3) -> Self {
        let (min, max) = node.local_box();
        let (min, max) = (min.as_dvec3(), max.as_dvec3());
        let (middle, half) = ((min + max) * 0.5, (max - min) * 0.5);
        let linear = to_view * node.linear().as_dmat3();
        let centre = to_view * (node.origin() - eye) + linear * middle;
        let edges = [linear.x_axis * half.x, linear.y_axis * half.y, linear.z_axis * half.z];
        let directions = frame_of(edges);
        let half = DVec3::from_array(directions.map(|u| edges.iter().map(|edge| u.dot(*edge).abs()).sum()));
        Self { centre, directions, half }
    }

    fn axes(&self) -> [DVec3; 3] {
        let [a, b, c] = self.directions;
        [a * self.half.x, b * self.half.y, c * self.half.z]
    }

    /// The smallest and the greatest depth in the box.
    fn depths(&self) -> (f64, f64) {
        let thickness: f64 = self.axes().iter().map(|axis| axis.z.abs()).sum();
        (-self.centre.z - thickness, -self.centre.z + thickness)
    }

    /// The box around this one moved by up to `slack` in any direction, and by up to `growth` times `depth`
    /// right and up.
    fn grown(self, slack: f64, growth: (f64, f64), depth: f64) -> Self {
        let right = growth.0 * depth.max(0.0);
        let up = growth.1 * depth.max(0.0);
        let more = DVec3::from_array(self.directions.map(|u| slack + u.x.abs() * right + u.y.abs() * up));
        Self { half: self.half + more, ..self }
    }

    fn holds_eye(&self) -> bool {
        self.directions.iter().zip(self.half.to_array()).all(|(u, half)| u.dot(self.centre).abs() <= half)
    }

    /// The box in f32; `None` if it does not fit.
    fn narrow(&self) -> Option<TestBox> {
        let centre = self.centre.as_vec3();
        let axes: [Vec3; 3] = self.axes().map(|axis| axis.as_vec3());
        (centre.is_finite() && axes.iter().all(|axis| axis.is_finite())).then_some(TestBox { centre, axes })
    }
}

/// Three orthogonal unit vectors, the first along the longest of `edges`, the second as near as possible to
/// the next longest one that is not parallel to it. Any frame suits a point.
fn frame_of(edges: [DVec3; 3]) -> [DVec3; 3] {
    let mut order = [0, 1, 2];
    let length_squared = edges.map(|edge| edge.length_squared());
    // Of equally long ones the first.
    order.sort_by(|&a: &usize, &b| length_squared[b].total_cmp(&length_squared[a]));
    let [longest, middle, shortest] = order.map(|index| edges[index]);
    let Some(first) = longest.try_normalize() else { return [DVec3::X, DVec3::Y, DVec3::Z] };
    let second = [middle, shortest]
        .into_iter()
        .find_map(|edge| {
            let rest = edge - first * first.dot(edge);
            // The remainder of a parallel edge is rounding, with a random direction.
            let parallel = rest.length_squared() <= 1e-24 * edge.length_squared();
            // Once more, so that rounding in the first subtraction does not tilt it.
            if parallel { None } else { (rest - first * first.dot(rest)).try_normalize() }
        })
        .unwrap_or_else(|| first.any_orthonormal_vector());
    // The order of the edges does not matter: a box does not depend on the names of its axes.
    [first, second, first.cross(second)]
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Camera, FrameNumber};
    use trimaran_scene::random::Random;

    use super::*;
    use crate::Viewport;

    /// Eight pixels to the metre at a depth of one metre, down -z.
    fn maker(near: f32, outline: Outline) -> BoxMaker {
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, near, FrameNumber(0)).unwrap();
        BoxMaker::new(&View::new(camera, Viewport::new(16, 8).unwrap()), outline)
    }

    /// An upright node of these half-edges.
    fn node(origin: [f64; 3], half: Vec3, reach: f32) -> Node {
        Node { origin, local_min: (-half).to_array(), local_max: half.to_array(), reach, ..Node::default() }
    }

    #[test]
    fn the_slack_grows_with_the_numbers_and_with_the_square_of_the_depth() {
        // The centre is 5 m away, a corner 3 m from it, and a vertex up to 7 m from the origin: 15 m in all.
        // Depths go from 2 to 6 m, so the ties take 6 x 6 / 2 m, or less if the near plane is beyond 2 m.
        let node = node([3.0, 0.0, -4.0], Vec3::new(1.0, 2.0, 2.0), 7.0);
        let ulps = |near| maker(near, Outline::OnScreen).slack(&node) * f64::from(1 << 24);
        assert_eq!([0.25, 4.0].map(ulps), [16.0 * (15.0 + 18.0), 16.0 * (15.0 + 9.0)]);
    }

    #[test]
    fn a_box_is_grown_by_the_outline_at_its_greatest_depth_after_it_was_inflated() {
        // Vertices 2^20 m from the origin: all sides are inflated by a metre, so the box ends 11 m deep.
        let node = node([0.0, 0.0, -8.0], Vec3::new(1.0, 2.0, 2.0), (1 << 20) as f32);
        let Prepared::Test(grown) = maker(0.25, Outline::InBox).prepare(&node) else { panic!("testable") };
        let half: Vec3 = grown.axes.iter().map(|axis| axis.abs()).sum();
        // Half a pixel and a 256th, of which a metre has eight at a depth of one metre.
        let outline = 11.0 * (0.5 + 1.0 / 256.0) / 8.0;
        assert!(half.abs_diff_eq(Vec3::new(2.0 + outline, 3.0 + outline, 3.0), 1e-4), "{half}");
    }

    #[test]
    fn a_box_is_tested_from_a_hundred_thousandth_beyond_the_near_plane() {
        // A point is inflated by two millionths there.
        for (depth, tested) in [(1.000_011, false), (1.000_013, true)] {
            let found = maker(1.0, Outline::OnScreen).prepare(&node([0.0, 0.0, -depth], Vec3::ZERO, 0.0));
            let across = found == Prepared::Visible(Untestable::AcrossNear);
            assert_eq!((across, matches!(found, Prepared::Test(_))), (!tested, tested), "{depth}: {found:?}");
        }
    }

    #[test]
    fn a_frame_follows_the_longest_edge_and_the_next_one_that_is_not_parallel() {
        let mut random = Random::new(7);
        for _ in 0..100 {
            let along = random.direction();
            let side = along.cross(random.direction()).normalize();
            let other = along.cross(side);
            let size = random.between(-40.0, 40.0).exp2();
            for (edges, expected) in [
                ([along * 3.0, side * 2.0 + along, other], Some(side)),
                ([along * 3.0, other, side * 2.0 + along], Some(side)),
                ([along * 3.0, along * 2.0, side + along * 0.5], Some(side)),
                // Hardly slanted: rounding of the edge turns its side a little.
                ([along * 3.0, along * 2.0 + side * 1e-9, other], Some(side)),
                ([along * 3.0, along * 2.0, -along], None),
            ] {
                let [first, second, third] = frame_of(edges.map(|edge| edge * size));
                assert!(first.abs_diff_eq(along, 1e-14), "{first}, not {along}");
                assert!(expected.is_none_or(|side| second.abs_diff_eq(side, 1e-6)), "{second}: {edges:?}");
                let products = [first.dot(second), second.dot(third), third.dot(first)];
                assert!(products.iter().all(|product| product.abs() < 1e-14), "{products:?}: {edges:?}");
                assert!([second, third].iter().all(|u| (u.length() - 1.0).abs() < 1e-14), "{edges:?}");
            }
        }
    }
}
