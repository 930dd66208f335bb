//! The drawing order of all roles.
//!
//! If two surfaces have equal depth, the one drawn first (or last) wins. For a culled picture to equal the
//! unculled one there as well, any two drawables must be drawn in the same order in any set: a total order
//! independent of the set. This one is front to back, which also saves hidden fragments. Among those at
//! distances within a factor of 1.4, it groups the ones with the same visible sides: a device takes those in
//! one call.

use glam::DVec3;
use rayon::prelude::*;
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::{Facing, Solids, View};

/// Sorts drawables into drawing order, reusing its memory between frames.
#[derive(Debug, Clone, Default)]
pub struct DrawOrder {
    keys: Vec<u64>,
}

/// The least number of keys for a thread: some tens of microseconds' work.
const MIN_KEYS: usize = 256;

impl DrawOrder {
    /// Sorts `ids` by the distance of the eye from their world boxes (0 inside): first by the power of
    /// two of its square, then by the visible sides, and then by all of it, rounded to f32 and by one bit
    /// more. Equal ones are in the order of their ids.
    pub fn sort(&mut self, scene: &Scene, view: &View, ids: &mut [DrawableId]) {
        let (eye, solids) = (view.eye(), Solids::new(view));
        let keys = ids.par_iter().with_min_len(MIN_KEYS).map(|&id| key(scene, eye, &solids, id));
        keys.collect_into_vec(&mut self.keys);
        self.keys.sort_unstable();
        for (slot, key) in ids.iter_mut().zip(&self.keys) {
            *slot = DrawableId((key & u64::from(u32::MAX)) as u32);
        }
    }
}

/// Sorts `ids` into drawing order: see [`DrawOrder::sort`], which keeps its memory.
pub fn draw_order(scene: &Scene, view: &View, ids: &mut [DrawableId]) {
    DrawOrder::default().sort(scene, view, ids);
}

/// The id in the low bits. Above it are the bits of the squared distance, which keep its order, with the
/// sides after its exponent. Ids that the scene lacks come last.
fn key(scene: &Scene, eye: DVec3, solids: &Solids, id: DrawableId) -> u64 {
    let (distance, facing) = scene.part(id).map_or((f32::INFINITY, Facing::Both), |(drawable, part)| {
        (part.distance_squared(eye) as f32, solids.facing(drawable, &part))
    });
    let bits = distance.to_bits();
    let (exponent, mantissa) = (bits >> 23, bits & 0x7f_ffff);
    let word = exponent << 24 | (facing as u32) << 22 | mantissa >> 1;
    u64::from(word) << 32 | u64::from(id.0)
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};
    use trimaran_proto::{Camera, FrameNumber};
    use trimaran_scene::{FlatObject, Rgba8, SceneArrays, Sides};

    use super::*;
    use crate::Viewport;

    #[test]
    fn what_shows_the_same_sides_comes_side_by_side_among_what_is_about_as_far_away() {
        // Squared distances from 100 to 127, and of the last one 16.
        let depths = [10.0, 10.2, 10.4, 10.6, 10.8, 11.0, 11.25, 4.0];
        let objects = depths.map(|depth| FlatObject {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            indices: vec![0, 1, 2],
            colour: Rgba8([0; 4]),
            linear: Mat3::IDENTITY,
            origin: DVec3::new(0.0, 0.0, -depth),
        });
        let mut arrays = SceneArrays::flat(&objects);
        for (drawable, sides) in arrays.drawables.iter_mut().zip([Sides::FRONT, Sides::BOTH].iter().cycle()) {
            drawable.sides = *sides;
        }
        let scene = Scene::from_arrays(arrays).unwrap();
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 0.1, FrameNumber(0)).unwrap();
        let view = View::new(camera, Viewport::new(8, 8).unwrap());
        let mut ids: Vec<_> = (0..9).rev().map(DrawableId).collect();
        draw_order(&scene, &view, &mut ids);
        // Ids that the scene lacks come last.
        assert_eq!(ids.iter().map(|id| id.0).collect::<Vec<_>>(), [7, 1, 3, 5, 0, 2, 4, 6, 8]);
    }
}
