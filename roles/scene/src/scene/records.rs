//! The records of a cooked scene, in the same layout in memory, on the GPU and in the file.

use std::ops::Range;

use glam::{DVec3, Mat3, Vec3};
use trimaran_proto::{DrawableId, ObjectSet};

use super::{Coordinates, Geometry, Hierarchy, Normal};

/// An sRGB colour with straight alpha, 8 bits a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Rgba8(pub [u8; 4]);

/// A node of the scene tree: an index into [`Scene::nodes`](crate::Scene::nodes). The root is node 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u32);

/// A node of the scene tree. Nodes stand in breadth-first order, so that children are contiguous and follow
/// their parent.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Node {
    /// World box, lower corner, metres: bounds every level of this node and of all below it.
    pub world_min: [f64; 3],
    /// World box, upper corner, metres.
    pub world_max: [f64; 3],
    /// The origin of the node's local frame in the world, metres.
    pub origin: [f64; 3],
    /// Local frame to world, without the translation; column-major. The identity for nodes of several
    /// objects.
    pub linear: [f32; 9],
    /// Local box, lower corner: bounds every level of this node and of all below it, in the node's own
    /// frame.
    pub local_min: [f32; 3],
    /// Local box, upper corner.
    pub local_max: [f32; 3],
    /// Index of the parent; [`Node::NONE`] for the root.
    pub parent: u32,
    /// Index of the first child; children are contiguous.
    pub first_child: u32,
    /// The number of children; 0 for a leaf.
    pub child_count: u32,
    /// The first drawable of the node's finest level; levels are contiguous, finest first.
    pub first_drawable: u32,
    /// The number of drawables of all its levels. A leaf has at least one; an interior node may have none and
    /// is then always refined.
    pub drawable_count: u32,
    /// The object of the node, or of which it is a part: an index into the scene's objects. [`Node::NONE`]
    /// for nodes of several.
    pub object: u32,
    /// The largest distance of a vertex of this node or its descendants from the origin of its frame, world
    /// metres (measured along the frame's linear part). [`Scene::from_arrays`](crate::Scene::from_arrays)
    /// computes it.
    pub reach: f32,
    /// How many objects the node contains; 1 for an object and for a part of one.
    /// [`Scene::from_arrays`](crate::Scene::from_arrays) computes it.
    pub objects: u32,
    /// How many ancestors it has, at most [`Node::DEEPEST`]; 0 for the root.
    /// [`Scene::from_arrays`](crate::Scene::from_arrays) computes it.
    pub depth: u32,
}

/// A piece of a node at one level of detail: its triangles, and the level's distance bound to the finest
/// geometry. A level is drawn by all of its pieces, and each is culled by its own box.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Drawable {
    /// Certified upper bound of the two-sided Hausdorff distance to the finest geometry of this node, world
    /// metres (the local bound times the largest singular value of the node's matrix, rounded up). 0 for
    /// the finest level of a leaf. Never falls from a level to the next coarser one, nor from a node to
    /// its parent.
    pub error: f32,
    /// The node.
    pub node: u32,
    /// Its triangles: a number of [`Scene::geometry`](crate::Scene::geometry). Instances share it.
    pub geometry: u32,
    /// How many triangles it has.
    pub triangles: u32,
    /// The sides of its triangles that can be visible.
    pub sides: Sides,
    /// Which piece of its level it is, from 0.
    pub piece: u16,
    /// How many pieces its level has, at least 1.
    pub pieces: u16,
}

/// A level of detail of a node: its pieces are consecutive drawables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Level {
    first: u32,
    pieces: u32,
}

/// The visible sides of a drawable's triangles: both to eyes within a box, only the front to others.
///
/// Corners of the front run counter-clockwise in the node's local frame. The box extends the drawable's by a
/// distance at each of its six faces. It is no smaller than requested.
///
/// Four bits a face: at the lower ends of x, y and z first, then at the upper ones. 0 adds nothing, and 15 is
/// unbounded. For any other n the distance is 2^(n - 7) times the diagonal of the drawable's box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Sides(u32);

impl Sides {
    /// Both, to all eyes.
    pub const BOTH: Self = Self(0xff_ffff);
    /// Only the front, to eyes outside of the drawable's box.
    pub const FRONT: Self = Self(0);

    /// Both to eyes within the box from `low` to `high`, in the world, metres. Corners may be infinite.
    /// `own_min` and `own_max` are the drawable's box.
    #[must_use]
    pub fn within(low: DVec3, high: DVec3, own_min: DVec3, own_max: DVec3) -> Self {
        let diagonal = own_min.distance(own_max);
        let reach = |beyond: f64| {
            let reaches = |n: u32| n == ENDLESS || distance(n, diagonal) >= beyond;
            (0..ENDLESS).find(|&n| reaches(n)).unwrap_or(ENDLESS)
        };
        let faces = [own_min - low, high - own_max].map(|faces| faces.to_array());
        Self(faces.as_flattened().iter().rev().fold(0, |bits, &beyond| bits << 4 | reach(beyond)))
    }

    /// The lower and the upper corner of the box around the eyes to which both are visible, in the world,
    /// metres. Corners may be infinite.
    #[must_use]
    pub fn eyes(self, own_min: DVec3, own_max: DVec3) -> [DVec3; 2] {
        let diagonal = own_min.distance(own_max);
        let [x0, y0, z0, x1, y1, z1] =
            [0, 4, 8, 12, 16, 20].map(|bit| distance(self.0 >> bit & 15, diagonal));
        [own_min - DVec3::new(x0, y0, z0), own_max + DVec3::new(x1, y1, z1)]
    }

    /// Whether it is made of solids: the box around the eyes is bounded at all faces.
    #[must_use]
    pub fn are_of_solids(self) -> bool {
        self.is_known() && (0..24).step_by(4).all(|bit| self.0 >> bit & 15 != ENDLESS)
    }

    /// Whether only the bits of the six faces are set.
    pub(super) const fn is_known(self) -> bool {
        self.0 <= Self::BOTH.0
    }
}

/// The number of an unbounded face.
const ENDLESS: u32 = 15;

/// How far a face is moved out, metres.
fn distance(n: u32, diagonal: f64) -> f64 {
    match n {
        0 => 0.0,
        ENDLESS => f64::INFINITY,
        // 2^(n - 7), whose exponent is stored with a bias of 1023.
        n => diagonal * f64::from_bits(u64::from(n + 1016) << 52),
    }
}

/// A vertex in its node's local frame.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Vertex {
    /// Position about the node's origin, before the node's matrix.
    pub position: [f32; 3],
    /// Base colour of the triangles that begin here.
    pub colour: Rgba8,
    /// Normal of the triangles that begin here, in the node's local frame.
    pub normal: Normal,
}

impl Vertex {
    /// A vertex that no triangle begins with yet: [`Shading`](super::Shading) gives it a normal.
    #[must_use]
    pub const fn new(position: [f32; 3], colour: Rgba8) -> Self {
        Self { position, colour, normal: Normal::NONE }
    }
}

/// Of several objects, without children, levels or a parent.
impl Default for Node {
    fn default() -> Self {
        let linear = Mat3::IDENTITY.to_cols_array();
        Self { linear, parent: Self::NONE, object: Self::NONE, ..bytemuck::Zeroable::zeroed() }
    }
}

impl Node {
    /// Stands for "no parent" and "no object".
    pub const NONE: u32 = u32::MAX;

    /// The most ancestors of a node: far more than any tree of boxes needs, and a bound for upward
    /// traversals.
    pub const DEEPEST: u32 = 1024;

    /// The children, as indices of nodes.
    #[must_use]
    pub fn children(&self) -> Range<u32> {
        self.first_child..self.first_child + self.child_count
    }

    /// The drawables of all its levels, those of the finest first.
    pub fn drawables(&self) -> impl DoubleEndedIterator<Item = DrawableId> + ExactSizeIterator + use<> {
        (self.first_drawable..self.first_drawable + self.drawable_count).map(DrawableId)
    }

    /// Whether the node has no children.
    #[must_use]
    pub const fn is_leaf(&self) -> bool {
        self.child_count == 0
    }

    /// The origin of the local frame, world metres.
    #[must_use]
    pub const fn origin(&self) -> DVec3 {
        DVec3::from_array(self.origin)
    }

    /// The linear part of the local-to-world map.
    #[must_use]
    pub const fn linear(&self) -> Mat3 {
        Mat3::from_cols_array(&self.linear)
    }

    /// The local box: lower and upper corner.
    #[must_use]
    pub const fn local_box(&self) -> (Vec3, Vec3) {
        (Vec3::from_array(self.local_min), Vec3::from_array(self.local_max))
    }

    /// The world box: lower and upper corner, metres.
    #[must_use]
    pub const fn world_box(&self) -> (DVec3, DVec3) {
        (DVec3::from_array(self.world_min), DVec3::from_array(self.world_max))
    }

    /// The largest distance of a point of its local box from the origin of its frame, world metres: see
    /// [`Node::reach`].
    #[must_use]
    pub fn own_reach(&self) -> f32 {
        let (min, max) = self.local_box();
        let linear = self.linear().as_dmat3();
        let far = min.abs().max(max.abs()).as_dvec3();
        let per_axis =
            linear.x_axis.abs() * far.x + linear.y_axis.abs() * far.y + linear.z_axis.abs() * far.z;
        per_axis.length() as f32 * (1.0 + f32::EPSILON)
    }

    /// The node with the boxes of a part of it, which has this box in its frame. Its world box is around that
    /// of the part, and within the node's.
    #[must_use]
    pub fn part(&self, local_min: Vec3, local_max: Vec3) -> Self {
        let (linear, origin) = (self.linear().as_dmat3(), self.origin());
        let corners = (0..8_u32).map(|corner| {
            let pick = |axis: u32, low: f32, high: f32| if corner >> axis & 1 == 0 { low } else { high };
            let x = pick(0, local_min.x, local_max.x);
            let y = pick(1, local_min.y, local_max.y);
            let z = pick(2, local_min.z, local_max.z);
            linear * Vec3::new(x, y, z).as_dvec3() + origin
        });
        let (low, high) = corners
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        // Points may be computed with other roundings.
        let margin = 4.0 * f64::EPSILON * low.abs().max(high.abs());
        let (node_min, node_max) = self.world_box();
        let min = (low - margin).clamp(node_min, node_max);
        let max = (high + margin).clamp(node_min, node_max);
        Self {
            world_min: min.to_array(),
            world_max: max.to_array(),
            local_min: local_min.to_array(),
            local_max: local_max.to_array(),
            ..*self
        }
    }

    /// The squared distance from a place in the world to the world box, square metres; 0 inside. The same
    /// bits on every machine.
    #[must_use]
    pub fn distance_squared(&self, place: DVec3) -> f64 {
        let (min, max) = self.world_box();
        let outside = (min - place).max(place - max).max(DVec3::ZERO);
        outside.x * outside.x + outside.y * outside.y + outside.z * outside.z
    }
}

impl Drawable {
    /// Its level, if it has this id.
    #[must_use]
    pub const fn level(&self, id: DrawableId) -> Level {
        Level { first: id.0.saturating_sub(self.piece as u32), pieces: self.pieces as u32 }
    }
}

impl Level {
    /// Its pieces, at least one.
    pub fn pieces(self) -> impl DoubleEndedIterator<Item = DrawableId> + ExactSizeIterator + use<> {
        (self.first..self.first.saturating_add(self.pieces)).map(DrawableId)
    }

    /// Its first piece.
    #[must_use]
    pub const fn first(self) -> DrawableId {
        DrawableId(self.first)
    }

    /// Whether the drawable is one of its pieces.
    #[must_use]
    pub fn holds(self, id: DrawableId) -> bool {
        (self.first..self.first.saturating_add(self.pieces)).contains(&id.0)
    }
}

/// The object of a leaf, for reports: its name and its source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ObjectRecord {
    /// Index of the source file.
    pub source: u32,
    /// The object's index in its source file.
    pub source_index: u32,
    /// First byte of the name in the names.
    pub name_start: u32,
    /// Length of the name in bytes (UTF-8).
    pub name_length: u32,
    /// The node of the whole object; [`Node::NONE`] for one without triangles.
    /// [`Scene::from_arrays`](crate::Scene::from_arrays) computes it.
    pub node: u32,
}

/// The arrays of a cooked scene, as cooking makes them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneArrays {
    /// The tree in breadth-first order.
    pub nodes: Vec<Node>,
    /// All levels of all nodes, each in pieces.
    pub drawables: Vec<Drawable>,
    /// The triangles of the drawables. Several drawables may share one: instances.
    pub geometries: Vec<Geometry>,
    /// The objects, in the model's order.
    pub objects: Vec<ObjectRecord>,
    /// The objects' names, one after the other, UTF-8.
    pub names: String,
    /// The source files' names.
    pub sources: Vec<String>,
    /// The objects that the model has see-through, with which a view begins.
    pub see_through: ObjectSet,
    /// The grouping of the objects, and their attributes.
    pub hierarchy: Hierarchy,
    /// The coordinates that people know.
    pub coordinates: Coordinates,
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn corner() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1e3..1e3_f64).prop_map(DVec3::from_array)
    }

    #[test]
    fn sides_of_names() {
        let [min, max] = [DVec3::ZERO, DVec3::new(2.0, 3.0, 6.0)]; // a diagonal of 7
        assert_eq!(Sides::FRONT.eyes(min, max), [min, max]);
        assert_eq!(Sides::BOTH.eyes(min, max), [DVec3::NEG_INFINITY, DVec3::INFINITY]);
        assert_eq!(Sides::within(min, max, min, max), Sides::FRONT);
        assert_eq!(Sides::within(DVec3::NEG_INFINITY, DVec3::INFINITY, min, max), Sides::BOTH);
        let far = Sides::within(min - DVec3::X * 7.0, max + DVec3::Z * 0.1, min, max);
        assert_eq!(far.eyes(min, max), [DVec3::new(-7.0, 0.0, 0.0), max + DVec3::Z * (7.0 / 64.0)]);
        assert_eq!(far, Sides(0x10_0007));
        // Farther than any number can express, and from a point.
        assert!(!Sides::within(min, max + DVec3::X * 1e4, min, max).are_of_solids());
        assert_eq!(Sides::within(min, max, min, min).eyes(min, min)[1], DVec3::INFINITY);
        assert!(far.are_of_solids() && !Sides(1 << 24).is_known());
    }

    proptest! {
        #[test]
        fn the_box_around_the_eyes_is_no_smaller_than_asked([a, b, c, d] in [(); 4].map(|()| corner())) {
            let (low, high, min, max) = (a.min(b), a.max(b), c.min(d), c.max(d));
            let sides = Sides::within(low, high, min, max);
            let [least, most] = sides.eyes(min, max);
            prop_assert!(sides.is_known() && least.cmple(low).all() && most.cmpge(high).all());
            prop_assert!(least.cmple(min).all() && most.cmpge(max).all());
        }
    }
}
