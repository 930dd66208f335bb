//! Missing faces of surfaces: openings that a plane across an axis closes.

use std::collections::HashMap;

use glam::{DMat3, DVec3};

use super::solid::Welded;

/// The flatness tolerance of an opening, relative to its part's diagonal; a narrower slit is no opening.
/// Above the rounding of a plane, and less than half a millimetre in a part of 100 m.
const FLAT: f64 = 4e-6;

/// The largest tilt of an opening against the world's axes: the rounding of a quarter turn in f32.
const TILT: f64 = 1e-6;

/// Directions along the axes to which solids are open: towards lower x, y and z in the first three bits, and
/// towards greater ones in the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Openings(u8);

impl Openings {
    pub(super) const NONE: Self = Self(0);

    /// The openings of a part with this border, and six times the volume that their closing planes add about
    /// one of its corners. `None` if no planes across the axes close it.
    pub(super) fn of(
        border: Vec<[usize; 2]>,
        corner: DVec3,
        diagonal: f64,
        mesh: &Welded,
    ) -> Option<(Self, f64)> {
        let (mut openings, mut six_fold) = (Self::NONE, 0.0);
        for points in loops(border, mesh)? {
            let opening = Opening::new(&points);
            if opening.area <= FLAT * diagonal * opening.length {
                continue; // a slit
            }
            let axis = opening.axis_within(FLAT * diagonal)?;
            six_fold += opening.outwards.dot(opening.about - corner);
            openings.add(axis, opening.outwards[axis] > 0.0);
        }
        Some((openings, six_fold))
    }

    /// The union of both.
    pub(super) const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    const fn add(&mut self, axis: usize, is_upper: bool) {
        self.0 |= 1 << (axis + if is_upper { 3 } else { 0 });
    }

    /// The world's axis and end of each opening. `None` for one that is not along an axis.
    pub(super) fn in_world(self, linear: DMat3) -> impl Iterator<Item = Option<(usize, bool)>> {
        let columns = [linear.x_axis, linear.y_axis, linear.z_axis];
        let volume = linear.determinant();
        (0..6_usize).filter(move |bit| self.0 >> bit & 1 == 1).map(move |bit| {
            let [_, one, other] = [0, 1, 2].map(|k| columns[(bit + k) % 3]);
            let outwards = one.cross(other) * volume.signum() * if bit < 3 { -1.0 } else { 1.0 };
            let axis = outwards.abs().max_position();
            let along = outwards[axis];
            let across = (outwards.length_squared() - along * along).max(0.0).sqrt();
            (volume.abs() > 0.0 && across <= TILT * along.abs()).then_some((axis, along > 0.0))
        })
    }
}

/// The loops of a border. Each corner has as many incoming as outgoing edges, since each triangle has.
fn loops(mut border: Vec<[usize; 2]>, mesh: &Welded) -> Option<Vec<Vec<DVec3>>> {
    border.sort_unstable(); // so that what is found does not depend on the order of a map
    let mut onwards: HashMap<usize, Vec<usize>> = HashMap::new();
    border.iter().for_each(|&[from, to]| onwards.entry(from).or_default().push(to));
    let mut loops = Vec::new();
    for &[start, _] in &border {
        let Some(mut at) = onwards.get_mut(&start).and_then(Vec::pop) else { continue };
        let mut points = vec![mesh.position(start)];
        while at != start {
            points.push(mesh.position(at));
            at = onwards.get_mut(&at)?.pop()?;
        }
        loops.push(points);
    }
    Some(loops)
}

/// The closing plane of a border's loop.
struct Opening {
    about: DVec3,
    /// Twice its area, as a normal that points out of the solid.
    outwards: DVec3,
    area: f64,
    length: f64,
    min: DVec3,
    max: DVec3,
}

impl Opening {
    fn new(points: &[DVec3]) -> Self {
        let about = points.first().copied().unwrap_or_default();
        let mut own = Self { about, outwards: DVec3::ZERO, area: 0.0, length: 0.0, min: about, max: about };
        for (&from, &to) in points.iter().zip(points.iter().cycle().skip(1)) {
            // Against the border, like a triangle on its other side.
            own.outwards += (to - about).cross(from - about);
            own.length += from.distance(to);
            (own.min, own.max) = (own.min.min(from), own.max.max(from));
        }
        own.area = 0.5 * own.outwards.length();
        own
    }

    /// The axis perpendicular to it, if it is flat.
    fn axis_within(&self, width: f64) -> Option<usize> {
        (0..3).find(|&axis| self.max[axis] - self.min[axis] <= width)
    }
}
