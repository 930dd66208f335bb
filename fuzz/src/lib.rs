//! The checks of the fuzz targets.

pub mod checks;
pub mod costs;
pub mod datagrams;
pub mod files;
pub mod handshakes;
pub mod hellos;
pub mod models;
pub mod supply;
pub mod walkthrough;
pub mod wire;
