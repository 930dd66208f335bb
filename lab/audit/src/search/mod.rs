//! A search for a frame whose pixels culling changes: scenes and walks drawn at random, and the smallest of
//! those that fail.
//!
//! ```
//! use trimaran_audit::search::{Trial, judge, shrink};
//! use trimaran_audit::{Fault, Testing};
//!
//! let trial = Trial::draw(1, 12);
//! assert!(judge(&trial, Testing::Pyramid, Fault::None)?.is_sound());
//! # Ok::<(), trimaran_audit::search::TrialError>(())
//! ```

mod cameras;
mod draw;
mod judge;
mod shrink;
mod solids;
mod trial;

pub use judge::{Verdict, judge};
pub use shrink::shrink;
pub use trial::{Shape, Solid, Trial, TrialError, TrialFrame};
