//! A pyramid of farthest depths on the device: the levels of `trimaran_cull::DepthPyramid`, bit by bit.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::{ScreenMargins, Viewport};

use crate::layout::{BindingSet, Layout};
use crate::memory::{Buffer, Image};
use crate::pipeline::{Pipeline, shader};
use crate::recorder::Recorder;
use crate::scope;
use crate::timing::Pass;
use crate::{Gpu, GpuError};

/// Makes a pyramid's levels, up to [`LEVELS`] at once from the next finer one.
pub(crate) struct Halving {
    layout: Arc<Layout>,
    pipeline: Pipeline,
}

/// `Finer` of pyramid.wgsl.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct Finer {
    start: u32,
    width: u32,
    height: u32,
}

/// The levels that a dispatch makes.
const LEVELS: usize = 6;

/// Finer texels per workgroup, across and down.
const GROUP: u32 = 1 << LEVELS;

/// `Test` of hzb.wgsl: the pyramid, and how much boxes over it are grown.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
pub(crate) struct Constants {
    margins: ScreenMargins,
    width: u32,
    starts: [u32; MAX_LEVELS],
    /// Of a traversal.
    step: u32,
    capacity: u32,
}

/// Levels over the largest picture, 65,536 pixels wide.
const MAX_LEVELS: usize = 17;

impl Constants {
    pub(crate) const fn of_step(self, step: u32, capacity: u32) -> Self {
        Self { step, capacity, ..self }
    }
}

impl Halving {
    pub(crate) fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let layout = Layout::new::<Finer>(gpu, 1)?;
        let pipeline = Pipeline::compute(&layout, shader!("cs_halve"))?;
        Ok(Self { layout, pipeline })
    }
}

/// All levels in one buffer, one after the other, the depth itself first.
pub(crate) struct Pyramid {
    set: BindingSet,
    texels: Buffer,
    size: Viewport,
    levels: Vec<Level>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Level {
    start: u32,
    width: u32,
    height: u32,
}

impl Pyramid {
    /// Room for a pyramid over a depth of `size`.
    pub(crate) fn new(gpu: &Arc<Gpu>, halving: &Halving, size: Viewport) -> Result<Self, GpuError> {
        let levels = levels(size);
        let texels: u64 = levels.iter().map(|level| u64::from(level.width) * u64::from(level.height)).sum();
        let bytes = texels * size_of::<f32>() as u64;
        let range = gpu.limits().max_storage_range;
        if bytes > range {
            let (width, height) = (size.width(), size.height());
            // A pyramid has a third more texels than its picture, of 4 bytes each.
            return Err(GpuError::ViewportTooLarge { width, height, limit: (range / 6).isqrt() as u32 });
        }
        use vk::BufferUsageFlags as Usage;
        let usage = Usage::STORAGE_BUFFER | Usage::TRANSFER_DST | Usage::TRANSFER_SRC;
        let texels = Buffer::new(gpu, "a depth pyramid", usage, MemoryLocation::GpuOnly, bytes)?;
        Ok(Self { set: BindingSet::new(&halving.layout, &[&texels])?, texels, size, levels })
    }

    pub(crate) const fn size(&self) -> Viewport {
        self.size
    }

    pub(crate) const fn texels(&self) -> &Buffer {
        &self.texels
    }

    /// The bytes of level 1, or of the only one: to the start of a buffer.
    pub(crate) fn half(&self) -> vk::BufferCopy {
        let texel = size_of::<f32>() as u64;
        self.levels.get(1).or(self.levels.first()).map_or_else(Default::default, |level| vk::BufferCopy {
            src_offset: u64::from(level.start) * texel,
            dst_offset: 0,
            size: u64::from(level.width) * u64::from(level.height) * texel,
        })
    }

    /// For tests of boxes that are grown by these margins.
    pub(crate) fn constants(&self, margins: ScreenMargins) -> Constants {
        let mut starts = [0; MAX_LEVELS];
        starts.iter_mut().zip(&self.levels).for_each(|(slot, level)| *slot = level.start);
        Constants { margins, width: self.size.width(), starts, step: 0, capacity: 0 }
    }

    /// Builds all levels over `depth`, for shaders to read: from there on the work is culling.
    pub(crate) fn build(&self, commands: &Recorder<'_>, halving: &Halving, depth: &mut Image) {
        let read = (
            vk::PipelineStageFlags2::COMPUTE_SHADER,
            vk::AccessFlags2::SHADER_STORAGE_READ | vk::AccessFlags2::SHADER_STORAGE_WRITE,
        );
        commands.copy_image(depth, self.size, &self.texels);
        let mut written = scope::COPY_WRITE;
        // All but the single texel at the end have coarser ones.
        let finer = self.levels.split_last().map(|(_, finer)| finer).unwrap_or_default();
        for &Level { start, width, height } in finer.iter().step_by(LEVELS) {
            commands.barrier(written, read);
            commands.bind(&halving.pipeline, &Finer { start, width, height });
            commands.bind_set(&halving.pipeline, &self.set);
            commands.dispatch([width, height].map(|side| side.div_ceil(GROUP)));
            written = scope::COMPUTE_WRITE;
        }
        commands.begin_pass(Pass::Culling);
        commands.barrier(written, read);
    }
}

/// The levels over a picture, down to a single texel; each is half the size of the one before it, rounded up.
fn levels(size: Viewport) -> Vec<Level> {
    let first = Level { start: 0, width: size.width(), height: size.height() };
    std::iter::successors(Some(first), |&Level { start, width, height }| {
        (width > 1 || height > 1).then(|| Level {
            start: start + width * height,
            width: width.div_ceil(2),
            height: height.div_ceil(2),
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::DVec3;
    use trimaran_cull::{DepthImage, DepthPyramid};
    use trimaran_scene::{FlatObject, random::Random};

    use super::*;
    use crate::OccluderPass;
    use crate::common::{CheckedGpu, depth, ids, triangles, upload, view};
    use crate::memory::HostBuffer;
    use crate::pass::OverDepth;

    /// Slanted triangles of some pixels each, some layers of them over most of the picture, before a slanted
    /// wall: no texel of any level is empty.
    fn crowd(size: Viewport, random: &mut Random) -> FlatObject {
        let count = (size.width() * size.height()).clamp(12, 60_000);
        let px = 2.0 / f64::from(size.height());
        let spread = (6.0 * f64::from(size.width()) * f64::from(size.height()) / f64::from(count)).sqrt();
        let corners: Vec<_> = (0..count)
            .flat_map(|_| {
                let aspect = f64::from(size.aspect());
                let middle = [random.between(-aspect, aspect), random.between(-1.0, 1.0)];
                let depth = random.between(-2.0, 6.0).exp2();
                [(); 3].map(|()| {
                    let [x, y] = middle.map(|at| at + spread * px * random.between(-1.0, 1.0));
                    let depth = depth * random.between(1.0, 1.3);
                    [x * depth, y * depth, -depth].map(|at| at as f32)
                })
            })
            .collect();
        let wall = [[-1e6, -1e6, -300.0], [1e6, -1e6, -200.0], [0.0, 2e6, -400.0]];
        triangles(&[corners, wall.to_vec()].concat())
    }

    /// All levels over the pass's depth, built on the device.
    fn levels_on_device(pass: &mut OccluderPass) -> Vec<f32> {
        let pass = &mut pass.pass;
        let gpu = Arc::clone(pass.gpu());
        let halving = Halving::new(&gpu).unwrap();
        let pyramid = Pyramid::new(&gpu, &halving, pass.size()).unwrap();
        let bytes = pyramid.texels.bytes();
        let (usage, count) = (vk::BufferUsageFlags::TRANSFER_DST, bytes as usize / size_of::<f32>());
        let read = HostBuffer::new(&gpu, "levels", usage, MemoryLocation::GpuToCpu, count).unwrap();
        let OverDepth { stream, depth, .. } = pass.over_depth().unwrap();
        let record = |commands: &Recorder<'_>| {
            pyramid.build(commands, &halving, depth);
            // A picture of one pixel is its own pyramid: there are no further levels.
            commands.barrier(scope::COPY_WRITE, scope::COPY_READ);
            commands.barrier(scope::COMPUTE_WRITE, scope::COPY_READ);
            let all = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes };
            commands.copy(&pyramid.texels, read.buffer(), &[all]);
            commands.barrier(scope::COPY_WRITE, scope::HOST_READ);
        };
        stream.submit("building levels", Some(Pass::Pyramid), record).unwrap();
        stream.wait("building levels").unwrap();
        read.elements().to_vec()
    }

    #[test]
    fn every_texel_is_the_hosts() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let mut random = Random::new(5);
        let sizes = [(1, 1), (1, 2), (1, 9), (9, 1), (64, 64), (65, 63), (333, 77), (1023, 3), (1024, 1024)];
        for (width, height) in sizes.into_iter().chain([(4099, 5)]) {
            let view = view(width, height, DVec3::ZERO);
            let size = view.viewport();
            let scene = upload(&gpu, &[crowd(size, &mut random)]);
            let mut pass = OccluderPass::new(&scene, size).unwrap();
            let mut expected = depth(&mut pass, &view, &ids(1));
            let distinct: BTreeSet<u32> = expected.iter().map(|depth| depth.to_bits()).collect();
            assert!(expected.iter().all(|&depth| depth > 0.0), "{width} x {height}");
            assert!(distinct.len() * 3 > expected.len(), "{} depths at {width} x {height}", distinct.len());
            let pyramid = DepthPyramid::over(DepthImage::new(size, &expected).unwrap());
            (1..=pyramid.last_level()).for_each(|level| expected.extend(pyramid.farthest(level).unwrap()));
            assert!(levels_on_device(&mut pass) == expected, "{width} x {height}");
            let half = pass.read_half_depth().unwrap();
            assert!(half == pyramid.farthest(1).unwrap_or(&expected), "half of {width} x {height}");
        }
    }
}
