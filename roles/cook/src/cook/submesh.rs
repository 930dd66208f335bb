//! A part of a large mesh that is simplified by itself: vertices shared with its neighbours stay fixed.
//!
//! Its vertices are renumbered and centred on its own middle. So its cost, and the distances that are
//! negligible in it, depend on the part's size and not on the whole mesh's.

use glam::Vec3;
use meshopt::{SimplifyOptions, VertexDataAdapter};

use super::chain::{Aim, Triangles, halve};
use super::linear::bounds;
use super::sets::Sets;
use crate::lists::{at, put};

/// Triangles of a part, with fixed corners.
#[derive(Debug)]
pub(super) struct Submesh {
    /// The mesh's number of each vertex, ascending.
    numbers: Vec<u32>,
    /// About the submesh's middle.
    positions: Vec<Vec3>,
    /// Three per triangle, in the submesh's numbers.
    indices: Vec<u32>,
    held: Vec<bool>,
    /// Whether a vertex is connected to a fixed one. Others may vanish as a whole.
    anchored: Vec<bool>,
}

impl Submesh {
    /// The triangles `indices` of a mesh. `is_held` says whether a vertex must stay.
    pub(super) fn new(positions: &[Vec3], indices: &[u32], is_held: impl Fn(u32) -> bool) -> Self {
        let mut numbers = indices.to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        // Each index is among the numbers.
        let indices = indices.iter().filter_map(|index| Some(numbers.binary_search(index).ok()? as u32));
        let indices: Vec<u32> = indices.collect();
        let own = |&number: &u32| at(positions, number);
        let (min, max) = bounds(numbers.iter().map(own));
        let middle = min.midpoint(max);
        let positions: Vec<Vec3> = numbers.iter().map(|number| own(number) - middle).collect();
        let held: Vec<bool> = numbers.iter().map(|&number| is_held(number)).collect();
        let anchored = anchored(&positions, &indices, &held);
        Self { numbers, positions, indices, held, anchored }
    }

    /// How many vertices must stay.
    pub(super) fn held_count(&self) -> usize {
        self.held.iter().filter(|&&held| held).count()
    }

    /// Levels of the submesh, finest first, in the mesh's numbers.
    pub(super) fn levels(&self, aim: Aim) -> Vec<Triangles> {
        let simplify = |former: &[u32], adapter: &VertexDataAdapter<'_>, target: usize| {
            self.simplify(former, adapter, target, aim.largest_error)
        };
        let mut levels = halve(&self.positions, &self.indices, aim, simplify);
        for (indices, _) in &mut levels {
            meshopt::optimize_vertex_cache_in_place(indices, self.positions.len());
            for index in indices {
                *index = at(&self.numbers, *index);
            }
        }
        levels
    }

    /// Each kind of triangles is reduced in proportion. The simplifier may drop whole small components, even
    /// fixed ones, so anchored triangles are simplified with that disabled.
    fn simplify(
        &self,
        former: &[u32],
        adapter: &VertexDataAdapter<'_>,
        target: usize,
        largest_error: f32,
    ) -> Vec<u32> {
        let is_anchored = |&&[corner, ..]: &&[u32; 3]| self.anchored.get(corner as usize) == Some(&true);
        let (anchored, free): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
            former.as_chunks().0.iter().partition(is_anchored);
        let (anchored, free) = (anchored.as_flattened(), free.as_flattened());
        let share = |some: &[u32]| (target as u64 * some.len() as u64 / former.len() as u64) as usize / 3 * 3;
        let absolute = SimplifyOptions::ErrorAbsolute;
        let mut level = Vec::new();
        if !anchored.is_empty() {
            let target = share(anchored);
            level = meshopt::simplify_with_locks(
                anchored,
                adapter,
                &self.held,
                target,
                largest_error,
                absolute,
                None,
            );
        }
        if !free.is_empty() {
            let options = absolute | SimplifyOptions::Prune;
            level.extend(meshopt::simplify(free, adapter, share(free), largest_error, options, None));
        }
        level
    }
}

/// For each vertex, whether triangles connect it to a fixed one. Vertices at one position are identified.
fn anchored(positions: &[Vec3], indices: &[u32], held: &[bool]) -> Vec<bool> {
    let (count, places) = meshopt::generate_vertex_remap(positions, None);
    let place = |vertex: u32| at(&places, vertex);
    let mut sets = Sets::new(count);
    for &[a, b, c] in indices.as_chunks().0 {
        sets.join(place(a), place(b));
        sets.join(place(b), place(c));
    }
    let mut anchored = vec![false; count];
    for (vertex, _) in (0_u32..).zip(held).filter(|&(_, &held)| held) {
        put(&mut anchored, sets.first(place(vertex)), true);
    }
    (0_u32..)
        .zip(positions)
        .map(|(vertex, _)| anchored.get(sets.first(place(vertex)) as usize) == Some(&true))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hangs_together_with_a_held_vertex_is_anchored() {
        let at = |x: f32| Vec3::new(x, 0.0, 0.0);
        // Two triangles that meet at a position where each has a vertex of its own, and an isolated one.
        let positions = [0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0].map(at);
        let indices: Vec<u32> = (0..9).collect();
        let held = |vertex: u32| {
            anchored(&positions, &indices, &indices.iter().map(|&v| v == vertex).collect::<Vec<_>>())
        };
        assert_eq!(held(0), [true, true, true, true, true, true, false, false, false]);
        assert_eq!(held(5), held(0));
        assert_eq!(held(8), [false, false, false, false, false, false, true, true, true]);
        assert_eq!(held(9), [false; 9]);
    }

    #[test]
    fn levels_are_in_the_meshs_numbers() {
        let side = 20;
        let mut positions: Vec<Vec3> = (0..100).map(|i| Vec3::new(-50.0, i as f32, 0.0)).collect();
        positions.extend((0..side * side).map(|i| Vec3::new((i % side) as f32, 0.0, (i / side) as f32)));
        let square = |a: u32| [a, a + 1, a + side + 1, a, a + side + 1, a + side];
        let corners = (0..side - 1).flat_map(|z| (0..side - 1).map(move |x| 100 + z * side + x));
        let indices: Vec<u32> = corners.flat_map(square).collect();
        let held = 100 + 7 * side + 5;
        let submesh = Submesh::new(&positions, &indices, |vertex| vertex == held);
        let levels = submesh.levels(Aim { few: 24, most: usize::MAX, from_error: 0.5, largest_error: 1.0 });
        assert!(levels.len() > 2, "a flat square has {} levels", levels.len());
        for (level, error) in levels {
            assert!(level.iter().all(|&index| index >= 100) && level.contains(&held));
            assert!((0.5..0.51).contains(&error), "{error}: that of the first triangles and next to nothing");
        }
    }
}
