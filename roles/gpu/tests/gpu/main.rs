//! The passes and testers on a Vulkan device, with the validation layer on: a test fails on any message of it.

mod common;
mod device;
mod passes;
mod testers;
mod walks;
