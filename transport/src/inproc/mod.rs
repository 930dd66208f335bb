//! Links within one process: values are passed on without encoding.

mod scheme;

#[cfg(feature = "inproc")]
pub(crate) use scheme::Inproc;
#[cfg(any(feature = "inproc", test))]
pub use scheme::pair;
