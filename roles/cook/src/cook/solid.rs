//! Finds triangles of solids: closed surfaces whose triangles all face outwards.
//!
//! A ray from outside enters a solid before it leaves it, so it first meets a triangle from its front. Back
//! faces are never visible, and need not be drawn.
//!
//! A surface may lack a face where it stands on another one, as LDraw's studs do. A plane closes such an
//! opening. A ray from the plane's inner side leaves the solid there, and cannot enter it. So to eyes on the
//! inner side of all openings, and outside of the solid, still only the front is visible.
//!
//! Corners are equal if their positions are, to the bit. Triangles connected by edges make a part. A part is
//! a solid if it has a volume, and along each edge as many triangles run one way as the other, including
//! those that close its openings.

use std::collections::HashMap;
use std::ops::Range;

use glam::{DMat3, DVec3, Vec3};
use trimaran_scene::{Sides, Vertex};

use super::linear::WorldBox;
use super::opening::Openings;
use super::sets::Sets;

/// The least volume of a solid, relative to its diagonal cubed: far below any rod's or plate's, and far above
/// the f64 rounding of a sheet folded flat.
const LEAST_VOLUME: f64 = 1e-12;

/// The rounding of a box in the world, relative to its diagonal.
const ROUNDING: f64 = 1e-9;

/// A union of solids: the box around them, and their openings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Solid {
    min: Vec3,
    max: Vec3,
    openings: Openings,
}

/// The parts of a mesh.
pub(super) struct Solids {
    /// For each triangle, its part's first triangle.
    firsts: Vec<u32>,
    /// By their first triangles; `None` for a part that is not solid.
    parts: HashMap<u32, Option<Solid>>,
}

impl Solids {
    /// Finds the parts of a mesh.
    pub(super) fn new(vertices: &[Vertex], indices: &[u32]) -> Self {
        let Some(mesh) = Welded::new(vertices, indices) else { return Self::none() };
        let mut edges: HashMap<[usize; 2], Edge> = HashMap::with_capacity(mesh.triangles.len() * 3 / 2);
        let mut sets = Sets::new(mesh.triangles.len());
        for (index, &[a, b, c]) in (0..).zip(&mesh.triangles) {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                if from == to {
                    continue; // a triangle without area
                }
                let edge =
                    edges.entry([from.min(to), from.max(to)]).or_insert(Edge { balance: 0, triangle: index });
                edge.balance += if from < to { 1 } else { -1 };
                sets.join(edge.triangle, index);
                edge.triangle = index;
            }
        }
        let firsts: Vec<u32> = (0..).zip(&mesh.triangles).map(|(index, _)| sets.first(index)).collect();
        let mut parts: HashMap<u32, Part> = HashMap::new();
        for (&first, triangle) in firsts.iter().zip(&mesh.triangles) {
            let corners = triangle.map(|corner| mesh.position(corner));
            parts.entry(first).or_insert_with(|| Part::about(corners[0])).add(corners);
        }
        for (&[low, high], edge) in &edges {
            let part = firsts.get(edge.triangle as usize).and_then(|first| parts.get_mut(first));
            let Some(part) = part else { continue };
            match edge.balance {
                0 => {}
                1 => part.border.push([low, high]),
                -1 => part.border.push([high, low]),
                _ => part.is_branched = true,
            }
        }
        let parts = parts.into_iter().map(|(first, part)| (first, part.solid(&mesh))).collect();
        Self { firsts, parts }
    }

    fn none() -> Self {
        Self { firsts: Vec::new(), parts: HashMap::new() }
    }

    /// The solids of all triangles.
    pub(super) fn of_all(&self) -> Option<Solid> {
        self.of(0..self.firsts.len())
    }

    /// The solids of these triangles; `None` if one of them belongs to none.
    pub(super) fn of(&self, triangles: Range<usize>) -> Option<Solid> {
        let mut firsts = self.firsts.get(triangles)?.to_vec();
        firsts.sort_unstable();
        firsts.dedup();
        let mut solids = firsts.iter().map(|first| self.parts.get(first).copied().flatten());
        let first = solids.next()??;
        solids.try_fold(first, |all, solid| Some(all.with(solid?)))
    }
}

impl Solid {
    fn with(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            openings: self.openings.with(other.openings),
        }
    }

    /// Its visible sides when placed in the world by `linear` and `origin`, in a node of this box.
    pub(super) fn sides(&self, linear: DMat3, origin: DVec3, node: WorldBox) -> Sides {
        let WorldBox { min, max } = WorldBox::placed(self.min, self.max, linear, origin);
        let [mut low, mut high] = [min, max];
        let mut directions = self.openings.in_world(linear);
        if let Some(direction) = directions.next() {
            let Some((axis, is_upper)) = direction.filter(|_| directions.all(|other| other == direction))
            else {
                return Sides::BOTH;
            };
            // All of space, except beyond the end that is not open.
            (low, high) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
            match is_upper {
                true => low[axis] = min[axis],
                false => high[axis] = max[axis],
            }
        }
        // Boxes around the same part are equal except for rounding.
        let slack = DVec3::splat(ROUNDING * node.diagonal());
        Sides::within(low + slack, high - slack, node.min, node.max)
    }
}

/// An edge, directed from its lesser corner.
struct Edge {
    /// Triangles that run along it, minus those that run against it.
    balance: i32,
    /// The last of its triangles.
    triangle: u32,
}

/// Triangles whose corners with equal positions are identified.
pub(super) struct Welded {
    triangles: Vec<[usize; 3]>,
    positions: Vec<DVec3>,
}

impl Welded {
    /// `None` if an index has no vertex.
    fn new(vertices: &[Vertex], indices: &[u32]) -> Option<Self> {
        let mut corners: HashMap<[u32; 3], usize> = HashMap::with_capacity(indices.len() / 6);
        let mut positions = Vec::new();
        let mut corner = |index: u32| {
            let position = vertices.get(index as usize)?.position;
            let next = positions.len();
            // Zero has two signs.
            let corner = *corners.entry(position.map(|x| (x + 0.0).to_bits())).or_insert(next);
            if corner == next {
                positions.push(Vec3::from_array(position).as_dvec3());
            }
            Some(corner)
        };
        let (triples, _) = indices.as_chunks::<3>();
        let triangles = triples
            .iter()
            .map(|&[a, b, c]| Some([corner(a)?, corner(b)?, corner(c)?]))
            .collect::<Option<_>>()?;
        Some(Self { triangles, positions })
    }

    pub(super) fn position(&self, corner: usize) -> DVec3 {
        self.positions.get(corner).copied().unwrap_or_default()
    }
}

/// The data of a part.
struct Part {
    /// One of its corners.
    about: DVec3,
    min: DVec3,
    max: DVec3,
    /// Six times its volume, summed over its triangles about that corner.
    six_fold: f64,
    /// Edges without a partner, in the direction of their triangles.
    border: Vec<[usize; 2]>,
    /// Several edges without a partner coincide.
    is_branched: bool,
}

impl Part {
    const fn about(corner: DVec3) -> Self {
        Self {
            about: corner,
            min: corner,
            max: corner,
            six_fold: 0.0,
            border: Vec::new(),
            is_branched: false,
        }
    }

    fn add(&mut self, corners: [DVec3; 3]) {
        let [a, b, c] = corners.map(|corner| corner - self.about);
        self.six_fold += a.dot(b.cross(c));
        for corner in corners {
            (self.min, self.max) = (self.min.min(corner), self.max.max(corner));
        }
    }

    /// Closes its openings. `None` if it is not solid.
    fn solid(mut self, mesh: &Welded) -> Option<Solid> {
        if self.is_branched {
            return None;
        }
        let diagonal = self.min.distance(self.max);
        let (openings, six_fold) =
            Openings::of(std::mem::take(&mut self.border), self.about, diagonal, mesh)?;
        self.six_fold += six_fold;
        // Not below the rounding, nor below 0, as for an inside-out one.
        let is_solid = self.six_fold > 6.0 * LEAST_VOLUME * diagonal.powi(3);
        is_solid.then(|| Solid { min: self.min.as_vec3(), max: self.max.as_vec3(), openings })
    }
}

#[cfg(test)]
mod tests {
    use trimaran_scene::Rgba8;

    use super::*;

    type Corners = Vec<[f32; 3]>;

    /// A box, its triangles counter-clockwise from outside.
    fn cuboid(at: [f32; 3], size: [f32; 3]) -> Corners {
        let corner = |i: usize| std::array::from_fn(|k| at[k] + if i >> k & 1 == 1 { size[k] } else { 0.0 });
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        faces.iter().flat_map(|&[a, b, c, d]| [a, b, c, c, d, a]).map(corner).collect()
    }

    /// The solids of triangles, given by their corners in sequence.
    fn found(corners: &[[f32; 3]]) -> Option<Solid> {
        let vertices: Vec<Vertex> =
            corners.iter().map(|&corner| Vertex::new(corner, Rgba8([0, 0, 0, 255]))).collect();
        Solids::new(&vertices, &(0..corners.len() as u32).collect::<Vec<_>>()).of(0..corners.len() / 3)
    }

    /// Whether they are solids without an opening.
    fn solid(corners: &[[f32; 3]]) -> bool {
        found(corners).is_some_and(|solid| solid.openings == Openings::NONE)
    }

    fn turned(corners: &[[f32; 3]], triangle: usize) -> Corners {
        let mut corners = corners.to_vec();
        corners.swap(3 * triangle, 3 * triangle + 1);
        corners
    }

    const UNIT: [f32; 3] = [1.0; 3];

    #[test]
    fn boxes_rods_and_plates_are_solid_apart_or_touching() {
        let unit = || cuboid([0.0; 3], UNIT);
        assert!(solid(&unit()));
        assert!(solid(&cuboid([700.0, 0.0, -3.0], [100.0, 0.005, 0.005])));
        assert!(solid(&cuboid([0.0; 3], [30.0, 30.0, 0.001])));
        // Side by side, with an edge in common, with a face in common, and one in the other.
        for (at, size) in
            [([5.0; 3], UNIT), ([1.0, 1.0, 0.0], UNIT), ([1.0, 0.0, 0.0], UNIT), ([0.2; 3], [0.5; 3])]
        {
            assert!(solid(&[unit(), cuboid(at, size)].concat()), "{at:?}");
        }
    }

    /// A box without its face at that end of an axis, which is at 0 or 1.
    fn open_box(axis: usize, end: f32) -> Corners {
        let unit = cuboid([0.0; 3], UNIT);
        let (triangles, _) = unit.as_chunks::<3>();
        let is_left = |corners: &&[[f32; 3]; 3]| corners.iter().any(|corner| corner[axis] != end);
        triangles.iter().filter(is_left).flatten().copied().collect()
    }

    /// The box around a unit box's eyes, by its node.
    fn eyes(solid: Solid, linear: DMat3) -> [DVec3; 2] {
        let node = WorldBox::placed(Vec3::ZERO, Vec3::ONE, linear, DVec3::ZERO);
        solid.sides(linear, DVec3::ZERO, node).eyes(node.min, node.max)
    }

    #[test]
    fn a_box_without_a_face_is_seen_into_from_the_side_of_that_face_alone() {
        for (axis, end) in [(0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0)] {
            let open = found(&open_box(axis, end)).unwrap();
            let [low, high] = eyes(open, DMat3::IDENTITY);
            for other in 0..3 {
                let [is_below, is_above] = [low[other], high[other]].map(|x| x.is_infinite());
                assert_eq!(is_below, other != axis || end == 0.0, "{axis} at {end}, along {other}");
                assert_eq!(is_above, other != axis || end == 1.0, "{axis} at {end}, along {other}");
            }
            let closed_end = if end == 0.0 { high } else { low };
            assert!((closed_end[axis] - (1.0 - f64::from(end))).abs() < 1e-9, "{axis} at {end}");
        }
    }

    #[test]
    fn openings_turn_with_what_they_are_in_and_lead_nowhere_if_it_is_tilted_or_flat() {
        let below = found(&open_box(1, 0.0)).unwrap();
        let is_open_towards = |linear: DMat3| {
            let [low, high] = eyes(below, linear);
            [low, high].map(|corner| corner.to_array().map(f64::is_infinite))
        };
        let all = [[true; 3]; 2];
        let down = [[true; 3], [true, false, true]];
        assert_eq!(is_open_towards(DMat3::IDENTITY), down);
        assert_eq!(is_open_towards(DMat3::from_rotation_y(0.7)), down);
        assert_eq!(is_open_towards(DMat3::from_diagonal(DVec3::new(-3.0, 2.0, 1.0))), down);
        // Upside down, in a mirror, and lying on its side.
        let up = [[true, false, true], [true; 3]];
        assert_eq!(is_open_towards(DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0))), up);
        let quarter = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
        assert_eq!(is_open_towards(quarter), [[false, true, true], [true; 3]]);
        assert_eq!(is_open_towards(DMat3::from_rotation_x(1e-3)), all);
        assert_eq!(is_open_towards(DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0))), all);
    }

    #[test]
    fn what_is_open_to_several_sides_is_seen_into_from_everywhere() {
        // A tube, and a box that lacks two faces beside each other.
        for faces in [[(1, 0.0), (1, 1.0)], [(0, 0.0), (1, 0.0)]] {
            let unit = cuboid([0.0; 3], UNIT);
            let (triangles, _) = unit.as_chunks::<3>();
            let is_left = |corners: &&[[f32; 3]; 3]| {
                faces.iter().all(|&(axis, end)| corners.iter().any(|corner| corner[axis] != end))
            };
            let open: Corners = triangles.iter().filter(is_left).flatten().copied().collect();
            let seen_into = found(&open)
                .is_none_or(|solid| eyes(solid, DMat3::IDENTITY) == [DVec3::NEG_INFINITY, DVec3::INFINITY]);
            assert!(seen_into, "{faces:?}");
        }
    }

    #[test]
    fn a_stud_on_a_brick_is_open_to_where_it_stands() {
        // Its rim lies in the brick's top, which has no hole.
        let stud: Corners =
            open_box(1, 0.0).into_iter().map(|[x, y, z]| [3.0 + x, 2.0 + y, 3.0 + z]).collect();
        let brick = found(&[cuboid([0.0; 3], [8.0, 2.0, 8.0]), stud].concat()).unwrap();
        let node = WorldBox { min: DVec3::ZERO, max: DVec3::new(8.0, 3.0, 8.0) };
        let [low, high] = brick.sides(DMat3::IDENTITY, DVec3::ZERO, node).eyes(node.min, node.max);
        assert_eq!(low, DVec3::NEG_INFINITY);
        assert!(high.x.is_infinite() && (high.y - 3.0).abs() < 1e-9 && high.z.is_infinite());
    }

    #[test]
    fn a_part_of_a_solid_reaches_as_far_as_all_of_it() {
        let vertices: Vec<Vertex> = cuboid([0.0; 3], [4.0, 1.0, 1.0])
            .into_iter()
            .map(|corner| Vertex::new(corner, Rgba8([0, 0, 0, 255])))
            .collect();
        let indices: Vec<u32> = (0..vertices.len() as u32).collect();
        // The two triangles at its lower end along x.
        let solid = Solids::new(&vertices, &indices).of(0..2).unwrap();
        let node = WorldBox { min: DVec3::ZERO, max: DVec3::new(0.0, 1.0, 1.0) };
        let [low, high] = solid.sides(DMat3::IDENTITY, DVec3::ZERO, node).eyes(node.min, node.max);
        assert!(low.abs_diff_eq(DVec3::ZERO, 0.1) && high.x >= 4.0 && high.x < 8.0, "{low} {high}");
    }

    #[test]
    fn nothing_is_solid_that_lacks_a_triangle_or_has_one_turned_over() {
        let unit = cuboid([0.0; 3], UNIT);
        for triangle in 0..12 {
            let mut open = unit.clone();
            open.drain(3 * triangle..3 * triangle + 3);
            assert!(!solid(&open), "without {triangle}");
            assert_eq!(found(&turned(&unit, triangle)), None, "{triangle} turned over");
        }
    }

    #[test]
    fn what_is_inside_out_or_flat_is_not_solid() {
        let inverted =
            |corners: Corners| (0..corners.len() / 3).fold(corners, |corners, i| turned(&corners, i));
        assert!(!solid(&inverted(cuboid([0.0; 3], UNIT))));
        // Beside a larger one that is not.
        let both = [cuboid([0.0; 3], [9.0; 3]), inverted(cuboid([20.0; 3], UNIT))].concat();
        assert!(!solid(&both));
        let sheet = [[0.1, 0.2, 0.3], [5.1, 0.7, 0.3], [0.4, 3.3, 9.3]];
        assert!(!solid(&[sheet, [sheet[1], sheet[0], sheet[2]]].concat()));
    }

    #[test]
    fn corners_are_the_same_where_their_positions_are() {
        let mut unit = cuboid([0.0; 3], UNIT);
        for zero in unit.iter_mut().step_by(2).flatten().filter(|x| **x == 0.0) {
            *zero = -0.0;
        }
        // And a triangle without area along an edge.
        unit.extend([[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        assert!(solid(&unit));
        // A slit is no opening, and a gap is an opening that no plane closes.
        unit[0][0] = 1e-20;
        assert!(solid(&unit));
        unit[0] = [0.01, 0.01, 0.01];
        assert_eq!(found(&unit), None);
    }

    #[test]
    fn an_index_without_a_vertex_or_no_triangle_is_no_solid_and_no_panic() {
        assert_eq!(Solids::new(&[], &[0, 1, 2]).of(0..1), None);
        assert_eq!(found(&[]), None);
    }
}
