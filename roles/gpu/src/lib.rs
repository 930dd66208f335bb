//! The Vulkan passes of the three roles. The only crate with `unsafe` graphics code.
