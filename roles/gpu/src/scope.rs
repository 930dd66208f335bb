//! The scopes that barriers order: stages of the device, with their accesses to memory.

use ash::vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stage};

/// Stages and accesses.
pub(crate) type Scope = (Stage, Access);

pub(crate) const NOTHING: Scope = (Stage::NONE, Access::NONE);
pub(crate) const COPY_READ: Scope = (Stage::COPY, Access::TRANSFER_READ);
pub(crate) const COPY_WRITE: Scope = (Stage::COPY, Access::TRANSFER_WRITE);
/// Versions of Vulkan differ in whether filling a buffer is a clear or a copy.
pub(crate) const FILL: Scope = (Stage::ALL_TRANSFER, Access::TRANSFER_WRITE);
pub(crate) const HOST_READ: Scope = (Stage::HOST, Access::HOST_READ);
/// The shaders of a traversal and the dispatches whose workgroups they count.
pub(crate) const TRAVERSAL: Scope = (
    Stage::from_raw(Stage::COMPUTE_SHADER.as_raw() | Stage::DRAW_INDIRECT.as_raw()),
    Access::from_raw(
        Access::SHADER_STORAGE_READ.as_raw()
            | Access::SHADER_STORAGE_WRITE.as_raw()
            | Access::INDIRECT_COMMAND_READ.as_raw(),
    ),
);
pub(crate) const COMPUTE_WRITE: Scope = (Stage::COMPUTE_SHADER, Access::SHADER_STORAGE_WRITE);
