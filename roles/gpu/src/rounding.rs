//! Whether a device rounds f64 as the host does: a test of rounding.wgsl at opening.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_scene::random::Random;

use crate::layout::{BindingSet, Layout};
use crate::memory::HostBuffer;
use crate::pipeline::{Pipeline, shader};
use crate::scope;
use crate::stream::Stream;
use crate::{Gpu, GpuError};

const OPERATION: &str = "comparing the device's arithmetic with the host's";

/// Numbers that are tested.
const CASES: usize = 1 << 16;

/// The results of a pair of numbers: quotient, root of the first, the first in f32, what rounding leaves of
/// sums and products, and quotient and root from poor guesses and from their neighbours.
type Results = [f64; 11];

/// Whether the device has the host's results, bit by bit.
pub(crate) fn rounds_as_the_host(gpu: &Arc<Gpu>) -> Result<bool, GpuError> {
    let layout = Layout::new::<u32>(gpu, 2)?;
    let pipeline = Pipeline::compute(&layout, shader!("cs_round"))?;
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
    let (to_device, to_host) = (MemoryLocation::CpuToGpu, MemoryLocation::GpuToCpu);
    let mut numbers = HostBuffer::<[f64; 2]>::new(gpu, OPERATION, usage, to_device, CASES)?;
    let results = HostBuffer::<Results>::new(gpu, OPERATION, usage, to_host, CASES)?;
    let set = BindingSet::new(&layout, &[numbers.buffer(), results.buffer()])?;
    numbers.elements_mut().iter_mut().zip(cases()).for_each(|(slot, case)| *slot = case);
    let mut stream = Stream::new(gpu)?;
    stream.submit(OPERATION, None, |commands| {
        commands.bind(&pipeline, &0_u32);
        commands.bind_set(&pipeline, &set);
        commands.dispatch([CASES as u32 / 64, 1]);
        commands.barrier(scope::COMPUTE_WRITE, scope::HOST_READ);
    })?;
    stream.wait(OPERATION)?;
    let are_same =
        |(device, [a, b]): (&Results, [f64; 2])| device.map(f64::to_bits) == on_host(a, b).map(f64::to_bits);
    Ok(results.elements().iter().zip(cases()).all(are_same))
}

fn on_host(a: f64, b: f64) -> Results {
    let (sum, quotient, root) = (a + b, a / b, a.abs().sqrt());
    let [narrow, left_of_sum, left_of_product] = [f64::from(a as f32), sum - a, a * b - sum * a];
    let (exact, from_poor) = ([quotient, root, narrow, left_of_sum, left_of_product], [quotient, root]);
    let from_neighbours = [quotient, quotient, root, root];
    let mut all = exact.into_iter().chain(from_poor).chain(from_neighbours);
    std::array::from_fn(|_| all.next().unwrap_or_default())
}

/// Pairs of numbers with random bits, and next to where rounding changes: squares, products, whole numbers.
fn cases() -> impl Iterator<Item = [f64; 2]> {
    let mut random = Random::new(1);
    (0..CASES).map(move |index| {
        // From 2^-30 to 2^31, of either sign.
        let mut number = || {
            let (bits, exponent) = (random.bits(), random.bits() % 62 + 993);
            f64::from_bits(bits & 1 << 63 | exponent << 52 | bits >> 12)
        };
        let (a, b) = (number(), number());
        let next = |x: f64| f64::from_bits(x.to_bits() + (index as u64 / 8) % 3 - 1);
        match index % 8 {
            0 => [next(b * b), b],
            1 => [next(a * b), b],
            2 => [a.abs().trunc() + 1.0, b.abs().trunc() + 1.0],
            3 => [f64::from(a as f32) + 0.5 * f64::from(f32::EPSILON) * f64::from(a as f32), b],
            4 => [next(a), a],
            _ => [a, b],
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::{CheckedGpu, lacks_float64};

    /// Also from poor guesses: CPU drivers' own quotients are right.
    #[test]
    fn the_device_rounds_as_the_host() {
        let Some(gpu) = CheckedGpu::open() else { return };
        if !lacks_float64(&gpu) {
            assert!(rounds_as_the_host(&gpu).unwrap());
        }
    }
}
