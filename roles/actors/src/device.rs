//! The GPU interface of the roles.

pub use trimaran_cull::{CullerDevice, PictureDevice};
