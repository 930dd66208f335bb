//! The pure half of the culler: cuts, rounds, occlusion tests, hard cases.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod boxes;
mod hard_cases;
mod hzb;
mod in_sight;
mod lod_cut;
mod occluder_selection;
mod pieces;
mod properties;
mod rounds;
mod view_state;
mod whole_traversal;
