//! Links within one process: values travel as they are, nothing is encoded.

pub(crate) mod lanes;
mod queue;
pub(crate) mod records;
mod scheme;

#[cfg(feature = "inproc")]
pub(crate) use scheme::Inproc;
#[cfg(any(feature = "inproc", test))]
pub use scheme::pair;
