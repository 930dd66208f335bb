//! Trimaran.
