//! Options that all transports share.

pub(crate) mod limits;
pub(crate) mod link;
#[cfg(feature = "config")]
pub(crate) mod range;
