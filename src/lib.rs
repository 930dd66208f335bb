//! Trimaran walks through 3D models that are too large for one GPU: two machines take turns culling a frame
//! and drawing the occluders of the next, a third shows what is visible.
//!
//! This crate joins the parts for the command line and for programs that want a walkthrough as a whole; the
//! parts stand for themselves: [`trimaran_proto`] the wire, [`trimaran_transport`] the links,
//! [`trimaran_scene`] models, [`trimaran_cook`] cooking, [`trimaran_cull`] what is drawn, [`trimaran_audit`]
//! what checks it, [`trimaran_gpu`] drawing it, [`trimaran_actors`] the roles.

pub mod config;
pub mod metrics;
pub mod netem;
pub mod report;
pub mod simulate;
pub mod trace;
pub mod vulkan;
pub mod walkthrough;
