//! Links within one process: values are passed on without encoding.

pub(crate) mod lanes;
mod queue;
pub(crate) mod records;
mod scheme;

#[cfg(feature = "inproc")]
pub(crate) use scheme::Inproc;
#[cfg(any(feature = "inproc", test))]
pub use scheme::pair;
