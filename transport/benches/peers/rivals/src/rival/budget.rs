//! The product's own rule of how much repair a frame gets, for the rival that has repair as well.

/// The limits of `trimaran-udp`: shards of a block, and repair shards.
pub(super) const BLOCK: usize = 64;
pub(super) const MOST: usize = 32;

#[allow(dead_code, unreachable_pub, reason = "the product's file, of which a part is used here")]
#[path = "../../../../../udp/src/repair/budget.rs"]
mod rule;

pub(super) use rule::{Budget, Path, Repair};
