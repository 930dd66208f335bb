//! Trimaran walks through CAD models of process plants with tens of millions of triangles: two machines take
//! turns to find out what is visible in a frame, and a third shows it.
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
