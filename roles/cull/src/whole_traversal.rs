//! The results of a device that traverses the whole tree by itself. It decides as
//! [`Traversal`](crate::Traversal) does, bit by bit.

use bytemuck::{Pod, Zeroable};
use trimaran_proto::{CullCounts, DrawableId};

/// The counts of a step of a traversal: all nodes of one depth, and the pieces of those above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct StepCounts {
    /// As in [`CullCounts`].
    pub visited: u32,
    /// As in [`CullCounts`].
    pub outside: u32,
    /// As in [`CullCounts`].
    pub tested: u32,
    /// As in [`CullCounts`].
    pub eye_inside: u32,
    /// As in [`CullCounts`].
    pub near_visible: u32,
    /// As in [`CullCounts`].
    pub not_finite: u32,
    /// As in [`CullCounts`].
    pub hidden: u32,
    /// As in [`CullCounts`].
    pub refined: u32,
    /// Visible nodes whose level is one piece.
    pub whole: u32,
    /// Visible pieces.
    pub pieces: u32,
    /// Visible nodes whose level has several pieces, which are visited in the next step.
    pub in_pieces: u32,
}

/// The results of a whole traversal.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WholeTraversal {
    /// The visible drawables, in any order.
    pub visible: Vec<DrawableId>,
    /// Its steps.
    pub steps: Vec<StepCounts>,
}

impl WholeTraversal {
    /// The counters of all steps.
    pub(crate) fn counts(&self) -> CullCounts {
        let mut counts = CullCounts::default();
        for step in &self.steps {
            counts.visited += step.visited;
            counts.outside += step.outside;
            counts.tested += step.tested;
            counts.eye_inside += step.eye_inside;
            counts.near_visible += step.near_visible;
            counts.not_finite += step.not_finite;
            counts.hidden += step.hidden;
            counts.refined += step.refined;
            counts.emitted += step.whole + step.pieces;
            counts.batches += u32::from(step.tested > 0);
        }
        counts
    }

    /// How many drawables each step gives, ascending: nodes wait for the pieces of others of their depth.
    pub(crate) fn given(&self) -> Vec<usize> {
        let mut held = 0;
        let given = self.steps.iter().map(|step| {
            let (now, later) = if step.in_pieces == 0 { (step.whole, 0) } else { (0, step.whole) };
            (std::mem::replace(&mut held, later) + step.pieces + now) as usize
        });
        given.collect()
    }
}
