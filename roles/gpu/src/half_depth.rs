//! The drawn depth on the host, reduced by half on the device.

use ash::vk;
use gpu_allocator::MemoryLocation;

use crate::memory::HostBuffer;
use crate::pass::{OverDepth, ScenePass};
use crate::pyramid::{Halving, Pyramid};
use crate::reuse::reuse_or_make;
use crate::timing::Pass;
use crate::{GpuError, scope};

/// Level 1 of a depth pyramid on the host, kept from frame to frame.
pub(crate) struct HalfDepth {
    halving: Halving,
    made: Option<Made>,
}

/// For pictures of one size.
struct Made {
    pyramid: Pyramid,
    on_host: HostBuffer<f32>,
    /// The version of the depth that it is of.
    version: Option<u64>,
}

const OPERATION: &str = "reading half the depth back";

impl HalfDepth {
    pub(crate) fn new(pass: &ScenePass) -> Result<Self, GpuError> {
        Ok(Self { halving: Halving::new(pass.gpu())?, made: None })
    }

    pub(crate) fn read(&mut self, pass: &mut ScenePass) -> Result<&[f32], GpuError> {
        let (gpu, size, halving) = (pass.gpu(), pass.size(), &self.halving);
        let make = || {
            let pyramid = Pyramid::new(gpu, halving, size)?;
            let usage = vk::BufferUsageFlags::TRANSFER_DST;
            let count = pyramid.half().size as usize / size_of::<f32>();
            let on_host = HostBuffer::new(gpu, OPERATION, usage, MemoryLocation::GpuToCpu, count)?;
            Ok(Made { pyramid, on_host, version: None })
        };
        let made = reuse_or_make(&mut self.made, |made| made.pyramid.size() == size, make)?;
        let OverDepth { stream, depth, version, .. } = pass.over_depth()?;
        if made.version != Some(version) {
            stream.submit(OPERATION, Some(Pass::Pyramid), |commands| {
                made.pyramid.build(commands, halving, depth);
                // A picture of one pixel is its own pyramid, which is copied and not computed.
                commands.barrier(scope::COPY_WRITE, scope::COPY_READ);
                commands.barrier(scope::COMPUTE_WRITE, scope::COPY_READ);
                commands.copy(made.pyramid.texels(), made.on_host.buffer(), &[made.pyramid.half()]);
                commands.barrier(scope::COPY_WRITE, scope::HOST_READ);
            })?;
            stream.wait(OPERATION)?;
            made.version = Some(version);
        }
        Ok(made.on_host.elements())
    }
}
