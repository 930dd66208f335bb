//! Trimaran.

pub mod report;
