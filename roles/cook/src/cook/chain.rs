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

#[cfg(test)]
mod tests {
    use super::*;

    const AIM: Aim = Aim { few: FEW, most: usize::MAX, from_error: 0.0, largest_error: f32::INFINITY };

    #[test]
    fn a_level_is_kept_if_it_is_much_smaller_and_saves_enough() {
        let triangles = |count: usize| [0, 1, 2].repeat(count);
        let rows = [
            ("few are left alone", 24, 1, false),
            ("one more is not few", 25, 5, true),
            ("a reduction to 70 % is worth it", 100, 70, true),
            ("a reduction to 71 % is not", 100, 71, false),
            ("20 triangles are enough", 60, 40, true),
            ("19 are not", 59, 40, false),
            ("no triangles are no level", 100, 0, false),
        ];
        for (name, first, level, kept) in rows {
            let chain = halve(&[Vec3::ZERO, Vec3::X, Vec3::Y], &triangles(first), AIM, |former, _, _| {
                // There is no second level.
                if former.len() == 3 * first { triangles(level) } else { former.to_vec() }
            });
            let counts: Vec<usize> = chain.iter().map(|(level, _)| level.len() / 3).collect();
            assert_eq!(counts, if kept { vec![level] } else { vec![] }, "{name}");
        }
    }

    #[test]
    fn the_error_adds_to_that_of_the_first_triangles_and_ends_the_chain_only_beyond_the_largest() {
        let low = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let positions = [low, low.map(|p| p + 7.0 * Vec3::Z)].concat();
        let both = [[0, 1, 2].repeat(50), [3, 4, 5].repeat(50)].concat();
        let levels = |largest_error| {
            let aim = Aim { from_error: 0.5, largest_error, ..AIM };
            halve(&positions, &both, aim, |_, _, _| [0, 1, 2].repeat(50))
        };
        let [(_, error)] = levels(f32::INFINITY)[..] else { panic!("not one level") };
        assert!((7.5..7.51).contains(&error), "{error}");
        assert_eq!((levels(error).len(), levels(error.next_down()).len()), (1, 0));
    }
}
