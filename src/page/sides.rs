//! The sides from which a scene's parts are visible.

use std::ops::Range;

use glam::DVec3;
use serde::Serialize;
use trimaran_scene::{Bounds, Node, Scene};

/// How much of an object is hidden from one side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Side {
    /// The direction towards the eye, a unit vector.
    from: [f64; 3],
    /// The share that boxes of other objects hide.
    hidden: f64,
}

/// The number of azimuths, and the elevations as sines.
const AROUND: u32 = 12;
const HEIGHTS: [f64; 3] = [0.2, 0.5, 0.85];
/// The eye's distance, in half diagonals.
const AWAY: f64 = 2.5;
/// The position of the sample points between the middle of a box and each corner.
const INWARD: f64 = 0.7;

/// How much of a box is hidden from each side. The `objects` themselves hide nothing.
pub(super) fn sides(scene: &Scene, of: &Bounds, objects: &Range<u32>) -> Vec<Side> {
    let (min, max) = (DVec3::from_array(of.min), DVec3::from_array(of.max));
    let (middle, half) = (0.5 * (min + max), 0.5 * (max - min));
    let sign = |corner: u32, axis: u32| if corner >> axis & 1 == 1 { INWARD } else { -INWARD };
    let corner = |corner| middle + half * DVec3::new(sign(corner, 0), sign(corner, 1), sign(corner, 2));
    let points: Vec<DVec3> = (0..8).map(corner).chain([middle]).collect();
    let side = |(height, way): (f64, u32)| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(way) / f64::from(AROUND)).sin_cos();
        let level = (1.0 - height * height).sqrt();
        let from = DVec3::new(level * sin, height, level * cos);
        let eye = middle + AWAY * half.length() * from;
        let hidden = points.iter().filter(|point| is_hidden(scene, **point, eye, objects)).count();
        Side { from: from.to_array(), hidden: hidden as f64 / points.len() as f64 }
    };
    HEIGHTS.into_iter().flat_map(|height| (0..AROUND).map(move |way| (height, way))).map(side).collect()
}

/// Whether the box of another object lies between a point and an eye. A box around the point does not count:
/// neighbouring boxes would hide it from everywhere.
fn is_hidden(scene: &Scene, point: DVec3, eye: DVec3, objects: &Range<u32>) -> bool {
    let nodes = scene.nodes();
    let mut open: Vec<&Node> = nodes.first().into_iter().collect();
    while let Some(node) = open.pop() {
        let (min, max) = node.world_box();
        if objects.contains(&node.object) || !meets(min, max, point, eye) {
            continue;
        }
        if node.is_leaf() {
            if !(point.cmpge(min).all() && point.cmple(max).all()) {
                return true;
            }
        } else {
            open.extend(node.children().filter_map(|id| nodes.get(id as usize)));
        }
    }
    false
}

/// Whether a box intersects the segment between two points.
fn meets(min: DVec3, max: DVec3, from: DVec3, to: DVec3) -> bool {
    let way = to - from;
    let (mut near, mut far) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        if way[axis] == 0.0 {
            if from[axis] < min[axis] || from[axis] > max[axis] {
                return false;
            }
            continue;
        }
        let (a, b) = ((min[axis] - from[axis]) / way[axis], (max[axis] - from[axis]) / way[axis]);
        (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
    }
    near <= far
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use trimaran_audit::cases::{Mesh, Object, build};

    use super::*;

    fn cube(half: f32, at: [f64; 3]) -> Object {
        Object::new(Mesh::cuboid(Vec3::splat(-half), Vec3::splat(half), 1)).at(DVec3::from_array(at))
    }

    #[test]
    fn a_side_behind_a_wall_is_hidden_and_the_others_are_open() {
        let wall = Object::new(Mesh::cuboid(Vec3::new(-9.0, -9.0, 1.0), Vec3::new(9.0, 9.0, 1.2), 1));
        let scene = build(&[cube(0.5, [0.0; 3]), wall], true).unwrap();
        let objects = 0..1;
        let sides = sides(&scene, &Bounds::of_most(&scene, objects.clone()), &objects);
        assert_eq!(sides.len(), 36);
        for Side { from, hidden } in sides {
            let (shows, is_low) = (from[2] <= 1e-9, from[1] < 0.4);
            assert!((hidden == 0.0) == shows || !is_low, "{from:?}: {hidden}");
            assert!(!shows || hidden == 0.0, "{from:?}: {hidden}");
        }
    }

    #[test]
    fn a_way_meets_a_box_that_it_enters_and_no_other() {
        let (min, max) = (DVec3::splat(-1.0), DVec3::splat(1.0));
        let to =
            |from: [f64; 3], to: [f64; 3]| meets(min, max, DVec3::from_array(from), DVec3::from_array(to));
        assert!(to([-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]) && to([0.0; 3], [0.1; 3]));
        assert!(!to([-2.0, 0.0, 0.0], [-1.5, 0.0, 0.0]) && !to([-2.0, 1.5, 0.0], [2.0, 1.5, 0.0]));
        assert!(!to([-2.0, 0.0, 0.0], [0.0, 2.5, 0.0]));
    }
}
