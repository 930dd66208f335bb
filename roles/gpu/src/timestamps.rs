//! Timestamps of the device where passes begin and end.

use std::cell::RefCell;
use std::sync::Arc;

use ash::vk;
use trimaran_proto::DeviceTimes;

use crate::error::During as _;
use crate::timing::Pass;
use crate::{Gpu, GpuError};

/// The timestamps of a stream.
pub(crate) struct Timestamps {
    gpu: Arc<Gpu>,
    pool: vk::QueryPool,
    /// Of all submitted pieces.
    begins: Vec<Option<Pass>>,
}

/// The timestamps of a piece of work that is being recorded.
pub(crate) struct PieceTimestamps<'a> {
    of: &'a Timestamps,
    commands: vk::CommandBuffer,
    /// For each timestamp the pass that begins there, or `None` where the piece ends.
    begins: RefCell<Vec<Option<Pass>>>,
}

/// The most timestamps of a piece: its beginning, a change of pass, its end.
const MOST_OF_PIECE: u32 = 3;

impl Timestamps {
    /// Room for the timestamps of this many pieces.
    pub(crate) fn new(gpu: &Arc<Gpu>, pieces: u32) -> Result<Self, GpuError> {
        let queries = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(MOST_OF_PIECE * pieces);
        // SAFETY: the device is alive and the count is above 0.
        let pool = unsafe { gpu.device().create_query_pool(&queries, None) }.during("making timestamps")?;
        Ok(Self { gpu: Arc::clone(gpu), pool, begins: Vec::new() })
    }

    /// Begins a piece with this pass. `None` without a pass, or on a device without timestamps.
    pub(crate) fn begin(
        &self,
        commands: vk::CommandBuffer,
        pass: Option<Pass>,
    ) -> Option<PieceTimestamps<'_>> {
        let pass = pass.filter(|_| self.period_ns() > 0.0)?;
        let first = self.begins.len() as u32;
        // SAFETY: the commands are being recorded, outside of a render pass; the pool has queries for all
        // pieces of a stream.
        unsafe { self.gpu.device().cmd_reset_query_pool(commands, self.pool, first, MOST_OF_PIECE) };
        let piece = PieceTimestamps { of: self, commands, begins: RefCell::default() };
        piece.begin(Some(pass));
        Some(piece)
    }

    /// Adds the timestamps of a piece that was submitted.
    pub(crate) fn submitted(&mut self, begins: Vec<Option<Pass>>) {
        self.begins.extend(begins);
    }

    /// Forgets the timestamps so far. The device is done with them.
    pub(crate) fn forget(&mut self) {
        self.begins.clear();
    }

    /// Adds the times between the timestamps so far to `times`, and forgets them. The device is done with
    /// them. Some drivers wait here for all of their work, so nothing is read where there are none.
    pub(crate) fn read(&mut self, times: &mut DeviceTimes, operation: &'static str) -> Result<(), GpuError> {
        let begins = std::mem::take(&mut self.begins);
        if begins.is_empty() {
            return Ok(());
        }
        let mut ticks = vec![0_u64; begins.len()];
        let flags = vk::QueryResultFlags::TYPE_64;
        // SAFETY: these queries were written by work that is done; the slice has one element for each, of the
        // type asked for.
        unsafe { self.gpu.device().get_query_pool_results(self.pool, 0, &mut ticks, flags) }
            .during(operation)?;
        add(times, &begins, &ticks, self.period_ns());
        Ok(())
    }

    fn period_ns(&self) -> f64 {
        self.gpu.limits().timestamp_period_ns
    }
}

impl PieceTimestamps<'_> {
    /// Writes a timestamp once all commands so far are done: this pass begins there, or the piece ends.
    pub(crate) fn begin(&self, pass: Option<Pass>) {
        let Timestamps { gpu, pool, begins } = self.of;
        let mut here = self.begins.borrow_mut();
        let query = (begins.len() + here.len()) as u32;
        let at = vk::PipelineStageFlags2::ALL_COMMANDS;
        // SAFETY: the commands are being recorded, outside of a render pass; the query was reset for the
        // piece.
        unsafe { gpu.device().cmd_write_timestamp2(self.commands, at, *pool, query) };
        here.push(pass);
    }

    /// Ends the piece.
    pub(crate) fn end(self) -> Vec<Option<Pass>> {
        self.begin(None);
        self.begins.into_inner()
    }
}

/// Adds the time from each tick at which a pass begins to the next tick.
fn add(times: &mut DeviceTimes, begins: &[Option<Pass>], ticks: &[u64], period_ns: f64) {
    for (pass, ticks) in begins.iter().zip(ticks.windows(2)) {
        if let (Some(pass), [start, end]) = (pass, ticks) {
            let nanoseconds = end.saturating_sub(*start) as f64 * period_ns;
            let sum = match pass {
                Pass::Drawing => &mut times.drawing_ns,
                Pass::Pyramid => &mut times.pyramid_ns,
                Pass::Culling => &mut times.culling_ns,
            };
            *sum = sum.saturating_add(nanoseconds as u64);
        }
    }
}

impl Drop for Timestamps {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: ours, and the stream waited for its work before it dropped this.
        unsafe { device.destroy_query_pool(self.pool, None) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::CheckedGpu;

    #[test]
    fn a_device_without_timestamps_writes_none() {
        let Some(mut gpu) = CheckedGpu::open() else { return };
        Arc::get_mut(&mut gpu).unwrap().forget_timestamps();
        let timestamps = Timestamps::new(&gpu, 1).unwrap();
        assert!(timestamps.begin(vk::CommandBuffer::null(), Some(Pass::Drawing)).is_none());
    }

    #[test]
    fn the_times_of_passes_are_all_time_between_the_ends_of_pieces() {
        use Pass::{Culling, Drawing, Pyramid};
        let begins = [Some(Drawing), None, Some(Pyramid), Some(Culling), None, Some(Culling), None];
        // Between pieces nothing is timed: 7 ticks, and 100.
        let ticks = [10, 13, 20, 31, 60, 160, 161];
        let mut times = DeviceTimes { drawing_ns: 5, ..DeviceTimes::default() };
        add(&mut times, &begins, &ticks, 2.0);
        assert_eq!(times, DeviceTimes { drawing_ns: 5 + 6, pyramid_ns: 22, culling_ns: 58 + 2 });
        // A counter that was set back is no time.
        let before = times;
        add(&mut times, &[Some(Drawing), None], &[9, 3], 2.0);
        assert_eq!(times, before);
    }
}
