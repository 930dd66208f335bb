//! A chain of levels, each simplified from the one before, with certified errors.

use std::borrow::Cow;

use glam::Vec3;
use meshopt::VertexDataAdapter;

use super::hausdorff::{self, Surface};

/// A level is kept if it has at most this part of the triangles of the one before.
const WORTH: f32 = 0.7;
/// ... and if it saves at least this many. Drawing a part costs as much as a few dozen triangles, and
/// simplifying a small part is visible: slats that overlap by a millimetre separate by three.
const SAVED: usize = 20;
/// Meshes of this few triangles are not simplified further.
pub(super) const FEW: usize = 24;

/// Levels end when their certified error exceeds this fraction of their mesh's or part's diagonal.
pub(super) const COARSEST: f32 = 0.1;

/// Triangles of a level, three indices each, and its error.
pub(super) type Triangles = (Vec<u32>, f32);

/// The limits of a chain of levels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim {
    /// This few triangles are not simplified further.
    pub(super) few: usize,
    /// Levels of more triangles than this are only a step to the next one.
    pub(super) most: usize,
    /// The error of the chain's first triangles.
    pub(super) from_error: f32,
    /// The chain ends when its error exceeds this.
    pub(super) largest_error: f32,
}

/// Halves the triangles repeatedly; each level is made from the previous one and measured against the first.
/// Returns the new levels, finest first. `simplify` gets the triangles, their vertices and the target number
/// of indices.
pub(super) fn halve(
    positions: &[Vec3],
    first: &[u32],
    aim: Aim,
    simplify: impl Fn(&[u32], &VertexDataAdapter<'_>, usize) -> Vec<u32>,
) -> Vec<Triangles> {
    let mut chain: Vec<Triangles> = Vec::new();
    let Ok(adapter) = VertexDataAdapter::new(bytemuck::cast_slice(positions), size_of::<Vec3>(), 0) else {
        return chain;
    };
    let reference = Surface::new(positions, first);
    let mut former = Cow::Borrowed(first);
    let mut error = aim.from_error;
    while former.len() / 3 > aim.few {
        let level = simplify(&former, &adapter, former.len() / 6 * 3);
        let saved = (former.len() - level.len().min(former.len())) / 3;
        if level.is_empty() || level.len() as f32 > WORTH * former.len() as f32 || saved < SAVED {
            break;
        }
        if level.len() / 3 <= aim.most {
            // The triangle inequality, if the first triangles are not the finest.
            error =
                error.max(aim.from_error + hausdorff::bound(&reference, &Surface::new(positions, &level)));
            if error > aim.largest_error {
                break;
            }
            chain.push((level.clone(), error));
        }
        former = Cow::Owned(level);
    }
    chain
}
