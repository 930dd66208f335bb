//! The passes and occlusion tests on a Vulkan device, with the validation layer on: a test fails on any
//! message of it.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests end the test, as its own lines do")]

mod common;
mod device;
mod hzb;
mod occlusion_tests;
mod passes;
mod sections;
mod see_through;
mod solids;
mod three_passes;
mod traversal;
mod walks;
mod working_set;
