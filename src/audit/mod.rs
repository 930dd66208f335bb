//! Whether culling is exact on small scenes: a case of [`trimaran_audit::cases`] is walked by the roles of a
//! session, as users have them, and each frame is compared with the same LOD cut without culling.
//!
//! [`CaseOnDevice`] walks a case on a Vulkan device, [`walk_reference`] on the f64 oracle. Both give the same
//! [`Figures`].

mod depth_formats;
mod device;
mod figures;
mod hard;
mod oracle;
mod search;
mod stability;
mod tables;
mod trial;

pub use device::{CaseOnDevice, CaseWalkError, Way};
pub use figures::Figures;
pub use hard::{Cell, Driver, HardCases, MeasureError, Row, hard, hard_count};
pub use oracle::walk_reference;
pub use search::{KeptTrial, Opening, Search, SearchCounts, Wrong};
pub use stability::{Curve, Curves, Point};
pub use tables::{page, table};
pub use trial::{TrialCulling, TrialOnDevice, TrialWalkError};

pub use crate::walkthrough::Judgement;
