//! Four rays from one point, cast together: neighbours on the screen hit much the same.

use glam::{Mat3A, Vec3A, Vec4};
use obvhs::{aabb::Aabb, rt_triangle::RtTriangle};

/// Four vectors, one per lane.
#[derive(Debug, Clone, Copy)]
struct Vectors {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

/// Four rays from one point. Distances are counted in lengths of their directions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Packet {
    origin: Vec3A,
    directions: Vectors,
    /// One over each component of the directions.
    reciprocals: Vectors,
    /// The distance at which each ray begins.
    begin: Vec4,
}

/// How far a triangle is widened at its edges, relative to its size. Otherwise rounding would let a ray
/// through between two triangles.
const EDGE: f32 = 1e-6;

/// The limit of reciprocals. That of zero must not be infinite: infinity times zero is NaN.
const STEEPEST: f32 = 1e30;

impl Packet {
    pub(crate) fn new(origin: Vec3A, directions: [Vec3A; 4], begin: Vec4) -> Self {
        let [a, b, c, d] = directions;
        let directions = Vectors {
            x: Vec4::new(a.x, b.x, c.x, d.x),
            y: Vec4::new(a.y, b.y, c.y, d.y),
            z: Vec4::new(a.z, b.z, c.z, d.z),
        };
        Self::along(origin, directions, begin)
    }

    fn along(origin: Vec3A, directions: Vectors, begin: Vec4) -> Self {
        let inverse = |v: Vec4| v.recip().clamp(Vec4::splat(-STEEPEST), Vec4::splat(STEEPEST));
        let reciprocals =
            Vectors { x: inverse(directions.x), y: inverse(directions.y), z: inverse(directions.z) };
        Self { origin, directions, reciprocals, begin }
    }

    /// The same rays in another frame: `turn` maps directions, and `origin` is their origin there. Distances
    /// along them do not change.
    #[inline]
    pub(crate) fn seen_from(&self, origin: Vec3A, turn: &Mat3A) -> Self {
        let Vectors { x, y, z } = self.directions;
        let row = |a: f32, b: f32, c: f32| x * a + y * b + z * c;
        let Mat3A { x_axis: i, y_axis: j, z_axis: k } = *turn;
        let directions = Vectors { x: row(i.x, j.x, k.x), y: row(i.y, j.y, k.y), z: row(i.z, j.z, k.z) };
        Self::along(origin, directions, self.begin)
    }

    /// The distance to a box for the ray that enters it first; infinite if none does by `end`.
    #[inline]
    pub(crate) fn enters(&self, bounds: &Aabb, end: Vec4) -> f32 {
        let (low, high) = (bounds.min - self.origin, bounds.max - self.origin);
        let Vectors { x, y, z } = self.reciprocals;
        let (x, y, z) = ((x * low.x, x * high.x), (y * low.y, y * high.y), (z * low.z, z * high.z));
        let enter = x.0.min(x.1).max(y.0.min(y.1)).max(z.0.min(z.1)).max(self.begin);
        let leave = x.0.max(x.1).min(y.0.max(y.1)).min(z.0.max(z.1)).min(end);
        Vec4::select(enter.cmple(leave), enter, Vec4::INFINITY).min_element()
    }

    /// The distance to a triangle along each ray; infinite without a hit by `end`, or from behind if only its
    /// `front` counts. After Möller and Trumbore (1997).
    #[inline]
    pub(crate) fn meets(&self, triangle: &RtTriangle, front: bool, end: Vec4) -> Vec4 {
        // The crate's edges are v0 - v1 and v2 - v0, so that its normal points to the back.
        let RtTriangle { v0, e1, e2, ng } = *triangle;
        let to_corner = v0 - self.origin;
        let Vectors { x, y, z } = self.directions;
        let dot = |v: Vec3A| x * v.x + y * v.y + z * v.z;
        let facing = dot(ng);
        let scale = facing.recip();
        // r . e, where r is the cross product of the ray's direction and the vector to the corner.
        let along = |e: Vec3A| dot(to_corner.cross(e)) * scale;
        let (u, v) = (along(e2), along(e1));
        let distance = scale * ng.dot(to_corner);
        let inside = u.min(v).min(Vec4::ONE - u - v).cmpge(Vec4::splat(-EDGE));
        let meets = inside & distance.cmpge(self.begin) & distance.cmple(end);
        let shows = if front { meets & facing.cmpgt(Vec4::ZERO) } else { meets };
        Vec4::select(shows, distance, Vec4::INFINITY)
    }
}
