//! Brings back what a simplifier dropped: whole components that are now far from all that is left.

use glam::Vec3;

use super::bvh::Bvh;

/// Triangles of `whole` to add to `left` so that all corners of `whole` are within `reach` of what is drawn, as corner indices
/// into `positions`.
///
/// Space is cut into cubes whose diagonal is `reach`. Where a corner is too far from what is left, its cube gets the largest of
/// the triangles that have lost a corner there: one triangle for many small parts that stand together. They are triangles of
/// the whole, so nothing is drawn where there was nothing.
pub(super) fn lost_triangles(positions: &[Vec3], whole: &[u32], left: &[u32], reach: f32) -> Vec<u32> {
    let cubes_per_metre = 3.0_f32.sqrt() / reach;
    if !cubes_per_metre.is_finite() {
        return Vec::new();
    }
    let bvh = Bvh::new(positions, left);
    let mut lost = vec![None; positions.len()];
    let mut hint = 0;
    let mut is_lost = |index: u32| {
        let (Some(slot), Some(&point)) = (lost.get_mut(index as usize), positions.get(index as usize)) else {
            return false;
        };
        *slot.get_or_insert_with(|| {
            let nearest = bvh.nearest(point, hint);
            hint = nearest.map_or(0, |nearest| nearest.triangle);
            nearest.is_none_or(|nearest| nearest.distance > reach)
        })
    };
    let mut cubes: Vec<([i32; 3], f32, [u32; 3])> = Vec::new();
    for triangle in whole.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|index| positions.get(index as usize).copied().unwrap_or_default());
        let area = (b - a).cross(c - a).length();
        for (index, corner) in triangle.iter().zip([a, b, c]) {
            if is_lost(*index) {
                let cube = (corner * cubes_per_metre).floor().as_ivec3();
                cubes.push((cube.to_array(), area, *triangle));
            }
        }
    }
    cubes.sort_unstable_by(|x, y| x.0.cmp(&y.0).then(y.1.total_cmp(&x.1)).then(x.2.cmp(&y.2)));
    cubes.dedup_by_key(|(cube, ..)| *cube);
    let mut triangles: Vec<[u32; 3]> = cubes.into_iter().map(|(.., triangle)| triangle).collect();
    triangles.sort_unstable(); // a triangle may stand for several cubes
    triangles.dedup();
    triangles.into_flattened()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A large triangle, and three small ones far from it, two of them side by side.
    fn whole() -> (Vec<Vec3>, Vec<u32>) {
        let small = |at: Vec3, size: f32| [at, at + Vec3::X * size, at + Vec3::Y * size];
        let positions = [
            small(Vec3::ZERO, 10.0),
            small(Vec3::new(0.1, 0.1, 5.0), 0.1),
            small(Vec3::new(0.2, 0.2, 5.0), 0.2),
            small(Vec3::new(3.1, 0.1, 5.0), 0.1),
        ]
        .concat();
        (positions, (0..12).collect())
    }

    #[test]
    fn one_triangle_stands_for_those_that_were_lost_together() {
        let (positions, indices) = whole();
        let lost = lost_triangles(&positions, &indices, &[0, 1, 2], 1.0);
        assert_eq!(lost, [6, 7, 8, 9, 10, 11], "the larger of the pair, and the lone one");
    }

    #[test]
    fn what_is_near_or_still_there_is_not_added_again() {
        let (positions, indices) = whole();
        assert!(lost_triangles(&positions, &indices, &[0, 1, 2], 6.0).is_empty());
        assert!(lost_triangles(&positions, &indices, &indices, 1e-3).is_empty());
        assert!(lost_triangles(&positions, &indices, &[], 0.0).is_empty(), "no reach, no cubes");
    }

    #[test]
    fn of_nothing_left_each_cube_keeps_one() {
        let (positions, indices) = whole();
        assert_eq!(lost_triangles(&positions, &indices, &[], 1000.0), [0, 1, 2]);
    }
}
