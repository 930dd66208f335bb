//! What the fuzz targets check.

pub mod checks;
pub mod datagrams;
pub mod files;
pub mod handshakes;
