//! The roles' devices on Vulkan.

pub use trimaran_gpu::{PicturePass as VulkanDisplay, VulkanCuller, VulkanCullerError};
