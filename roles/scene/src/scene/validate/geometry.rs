//! Vertices and indices: finite positions, and triangles that stay within their drawable's vertices.

use rayon::prelude::*;

use super::super::{Drawable, Parts, Vertex};
use super::{SceneError, malformed};

/// Vertices that a thread checks at a time.
const VERTICES: usize = 1 << 14;
/// Drawables that a thread checks at a time: many, so that it meets the instances of a mesh.
const DRAWABLES: usize = 1 << 16;
/// Ranges that a thread remembers as checked, by a hash of their place: two to the power of this.
const KNOWN_BITS: u32 = 14;

pub(super) fn check(parts: &Parts<'_>) -> Result<(), SceneError> {
    check_vertices(parts.vertices)?;
    let runs = parts.drawables.par_chunks(DRAWABLES).enumerate();
    let broken = runs.find_map_first(|(run, drawables)| {
        first_stray(parts.indices, drawables).map(|index| run * DRAWABLES + index)
    });
    match broken {
        Some(index) => Err(malformed("drawable", index)("one of its indices points past its vertices")),
        None => Ok(()),
    }
}

fn check_vertices(vertices: &[Vertex]) -> Result<(), SceneError> {
    let finite = |vertex: &Vertex| vertex.position.iter().all(|c| c.is_finite());
    let broken = vertices.par_chunks(VERTICES).enumerate().find_map_first(|(run, vertices)| {
        // Without an early end the compiler checks several at once; which one it was is asked only if there
        // is one.
        let sound = vertices.iter().fold(true, |sound, vertex| {
            let [x, y, z] = vertex.position.map(f32::is_finite);
            sound & x & y & z
        });
        let first = if sound { None } else { vertices.iter().position(|vertex| !finite(vertex)) };
        first.map(|index| run * VERTICES + index)
    });
    broken.map_or(Ok(()), |index| Err(malformed("vertex", index)("its position is not finite")))
}

/// The first drawable with an index past its vertices. Instances share ranges, so those checked lately are
/// remembered: to forget one costs time, and nothing else.
fn first_stray(indices: &[u32], drawables: &[Drawable]) -> Option<usize> {
    let mut known = vec![(0, 0, 0); 1 << KNOWN_BITS];
    drawables.iter().position(|drawable| {
        let range = (drawable.first_index, drawable.index_count, drawable.vertex_count);
        // Fibonacci hashing: ranges start at multiples of a cluster's size, so their low bits alone would all
        // be the same.
        let slot = drawable.first_index.wrapping_mul(0x9e37_79b1) >> (u32::BITS - KNOWN_BITS);
        let Some(slot) = known.get_mut(slot as usize) else { return true };
        if *slot == range {
            return false;
        }
        let first = drawable.first_index as usize;
        let own = indices.get(first..first + drawable.index_count as usize);
        let sound = own.is_some_and(|own| {
            own.iter().fold(0, |largest: u32, &index| largest.max(index)) < drawable.vertex_count
        });
        if sound {
            *slot = range;
        }
        !sound
    })
}
