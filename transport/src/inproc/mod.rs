//! Links within one process: values are passed on without encoding.

mod scheme;

pub(crate) use scheme::Inproc;
pub use scheme::pair;
