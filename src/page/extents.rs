//! The extents of a scene's parts, for views of them: the box around most of them, and the sides from which
//! they are visible.

use std::ops::Range;

use glam::DVec3;
use serde::Serialize;
use trimaran_scene::{Node, Scene};

/// A box with its sides along the axes, metres in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bounds {
    /// Lower corner.
    pub min: [f64; 3],
    /// Upper corner.
    pub max: [f64; 3],
}

/// How much of an object is hidden from one side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Side {
    /// The direction towards the eye, a unit vector.
    from: [f64; 3],
    /// The share that boxes of other objects hide.
    hidden: f64,
}

/// The share of objects at each end of an axis that may be outliers.
const FEW: f64 = 0.02;
/// An object is far this many times the longest side of all the others beyond their end.
const FAR: f64 = 1.0;

/// The number of azimuths, and the elevations as sines.
const AROUND: u32 = 12;
const HEIGHTS: [f64; 3] = [0.2, 0.5, 0.85];
/// The eye's distance, in half diagonals.
const AWAY: f64 = 2.5;
/// The position of the sample points between the middle of a box and each corner.
const INWARD: f64 = 0.7;

fn boxes(scene: &Scene, objects: Range<u32>) -> impl Iterator<Item = (DVec3, DVec3)> {
    let node = move |id: u32| scene.nodes().get(scene.objects().get(id as usize)?.node as usize);
    objects.filter_map(move |id| Some(node(id)?.world_box()))
}

fn around(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> Option<(DVec3, DVec3)> {
    boxes.reduce(|(a, b), (min, max)| (a.min(min), b.max(max)))
}

/// The box around objects, without the few that lie far from the others. Without objects it is a point.
pub(super) fn core(scene: &Scene, objects: Range<u32>) -> Bounds {
    let all: Vec<_> = boxes(scene, objects).collect();
    let few = (FEW * all.len() as f64) as usize;
    // The quantile of numbers that has this few below it.
    let nth = |mut numbers: Vec<f64>| {
        let few = few.min(numbers.len().saturating_sub(1));
        if numbers.is_empty() { 0.0 } else { *numbers.select_nth_unstable_by(few, f64::total_cmp).1 }
    };
    let low = DVec3::from_array([0, 1, 2].map(|axis| nth(all.iter().map(|(min, _)| min[axis]).collect())));
    let high = DVec3::from_array([0, 1, 2].map(|axis| -nth(all.iter().map(|(_, max)| -max[axis]).collect())));
    // By the longest side, so that a tower on a deck does not count as far.
    let far = DVec3::splat(FAR * (high - low).max_element().max(0.0));
    let is_near = |(min, max): &(DVec3, DVec3)| min.cmpge(low - far).all() && max.cmple(high + far).all();
    let near = around(all.iter().copied().filter(is_near)).or_else(|| around(all.iter().copied()));
    let (min, max) = near.unwrap_or_default();
    Bounds { min: min.to_array(), max: max.to_array() }
}

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

    fn is_about(a: [f64; 3], b: [f64; 3]) -> bool {
        DVec3::from_array(a).distance(DVec3::from_array(b)) < 0.1
    }

    #[test]
    fn a_few_objects_far_away_do_not_count_and_a_tower_does() {
        let crowd = |place: u32| cube(0.5, [f64::from(place % 10), 0.0, f64::from(place / 10)]);
        let mut objects: Vec<Object> = (0..100).map(crowd).collect();
        objects.push(cube(0.5, [4.0, 9.0, 4.0]));
        let compact = build(&objects, true).unwrap();
        let Bounds { min, max } = core(&compact, 0..101);
        assert!(is_about(min, [-0.5; 3]) && is_about(max, [9.5, 9.5, 9.5]), "{min:?} {max:?}");
        objects.push(cube(0.5, [4000.0, 0.0, 0.0]));
        // A ground much larger than everything on it.
        objects.push(Object::new(Mesh::cuboid(
            Vec3::new(-900.0, -1.0, -900.0),
            Vec3::new(900.0, -0.6, 900.0),
            1,
        )));
        let scattered = build(&objects, true).unwrap();
        let Bounds { min, max } = core(&scattered, 0..103);
        assert!(is_about(min, [-0.5; 3]) && is_about(max, [9.5, 9.5, 9.5]), "{min:?} {max:?}");
        // Among few objects none counts as far.
        let Bounds { max, .. } = core(&scattered, 99..102);
        assert!(is_about(max, [4000.5, 9.5, 9.5]), "{max:?}");
        assert_eq!(core(&scattered, 7..7), Bounds { min: [0.0; 3], max: [0.0; 3] });
    }

    #[test]
    fn a_side_behind_a_wall_is_hidden_and_the_others_are_open() {
        let wall = Object::new(Mesh::cuboid(Vec3::new(-9.0, -9.0, 1.0), Vec3::new(9.0, 9.0, 1.2), 1));
        let scene = build(&[cube(0.5, [0.0; 3]), wall], true).unwrap();
        let objects = 0..1;
        let sides = sides(&scene, &core(&scene, objects.clone()), &objects);
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
