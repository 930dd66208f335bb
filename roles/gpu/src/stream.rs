//! A pass's line to the device: command buffers, submitted in order, waited for together, timed.

use std::sync::Arc;

use ash::vk;

use crate::error::During as _;
use crate::recorder::Recorder;
use crate::{Gpu, GpuError};

/// Submissions of one pass, in order. Dropping it waits for the device, so an owner that declares its stream before the buffers and
/// images that the stream's work uses is sound: fields drop in order of declaration.
pub(crate) struct Stream {
    gpu: Arc<Gpu>,
    pool: vk::CommandPool,
    buffers: Vec<vk::CommandBuffer>,
    /// Two timestamps a piece: before and after it.
    timestamps: vk::QueryPool,
    /// Counts finished pieces: piece n signals n.
    timeline: vk::Semaphore,
    submitted: u64,
    /// Pieces since the last wait.
    pieces: usize,
    busy_ms: f64,
}

/// The most pieces in flight; the next one waits. A frame has a few.
const MAX_PIECES: usize = 64;

impl Stream {
    pub(crate) fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        const OPERATION: &str = "making a command stream";
        // The stream first, with null handles (which Vulkan's destroy functions ignore), so that a failure half-way cleans up.
        let mut stream = Self {
            gpu: Arc::clone(gpu),
            pool: vk::CommandPool::null(),
            buffers: Vec::new(),
            timestamps: vk::QueryPool::null(),
            timeline: vk::Semaphore::null(),
            submitted: 0,
            pieces: 0,
            busy_ms: 0.0,
        };
        let device = gpu.device();
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(gpu.queue_family())
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        let queries = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(2 * MAX_PIECES as u32);
        let mut timeline = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let semaphore = vk::SemaphoreCreateInfo::default().push_next(&mut timeline);
        // SAFETY: the device is alive, has this queue family, and timeline semaphores are enabled.
        unsafe {
            stream.pool = device.create_command_pool(&pool, None).during(OPERATION)?;
            stream.timestamps = device.create_query_pool(&queries, None).during(OPERATION)?;
            stream.timeline = device.create_semaphore(&semaphore, None).during(OPERATION)?;
        }
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(stream.pool)
            .command_buffer_count(MAX_PIECES as u32);
        // SAFETY: the pool is ours; the command buffers go with it.
        stream.buffers = unsafe { device.allocate_command_buffers(&info) }.during(OPERATION)?;
        Ok(stream)
    }

    /// Records one piece of work and submits it. `operation` names it in errors.
    pub(crate) fn submit(
        &mut self,
        operation: &'static str,
        record: impl FnOnce(&Recorder<'_>),
    ) -> Result<(), GpuError> {
        if self.pieces == MAX_PIECES {
            self.wait(operation)?;
        }
        let Some(&buffer) = self.buffers.get(self.pieces) else {
            return Ok(()); // there are MAX_PIECES buffers
        };
        let device = self.gpu.device();
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let timed = self.gpu.limits().timestamp_period_ns > 0.0;
        let first = 2 * self.pieces as u32;
        // SAFETY: the buffer is ours, in its initial state (its pool was reset after the device was done with it), and is recorded by this
        // thread alone; the timestamps lie in the pool and are reset before they are written.
        unsafe {
            device.begin_command_buffer(buffer, &begin).during(operation)?;
            if timed {
                device.cmd_reset_query_pool(buffer, self.timestamps, first, 2);
                let at = vk::PipelineStageFlags2::ALL_COMMANDS;
                device.cmd_write_timestamp2(buffer, at, self.timestamps, first);
            }
        }
        record(&Recorder::new(device, buffer));
        // SAFETY: as above; each `Recorder` method leaves the buffer outside of a render pass.
        unsafe {
            if timed {
                let at = vk::PipelineStageFlags2::ALL_COMMANDS;
                device.cmd_write_timestamp2(buffer, at, self.timestamps, first + 1);
            }
            device.end_command_buffer(buffer).during(operation)?;
        }
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(buffer)];
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.timeline)
            .value(self.submitted + 1)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let submits =
            [vk::SubmitInfo2::default().command_buffer_infos(&buffers).signal_semaphore_infos(&signals)];
        let queue = self.gpu.queue();
        // SAFETY: the queue is locked; the command buffer is complete; the timeline only ever grows, by one a submission.
        unsafe { device.queue_submit2(*queue, &submits, vk::Fence::null()) }.during(operation)?;
        drop(queue);
        self.submitted += 1;
        self.pieces += 1;
        Ok(())
    }

    /// Waits until all that was submitted is done. `operation` names it in errors.
    pub(crate) fn wait(&mut self, operation: &'static str) -> Result<(), GpuError> {
        if self.pieces == 0 {
            return Ok(());
        }
        self.block(operation)?;
        self.busy_ms += self.measure(operation)?;
        self.pieces = 0;
        // SAFETY: the device is done with every buffer of the pool.
        unsafe { self.gpu.device().reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
            .during(operation)
    }

    /// Device milliseconds of all pieces waited for since this was last asked.
    pub(crate) const fn take_busy_ms(&mut self) -> f64 {
        std::mem::replace(&mut self.busy_ms, 0.0)
    }

    fn block(&self, operation: &'static str) -> Result<(), GpuError> {
        let semaphores = [self.timeline];
        let values = [self.submitted];
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is a timeline and a submission that signals the value is in the queue.
        unsafe { self.gpu.device().wait_semaphores(&info, u64::MAX) }.during(operation)
    }

    fn measure(&self, operation: &'static str) -> Result<f64, GpuError> {
        let period = self.gpu.limits().timestamp_period_ns;
        if period <= 0.0 {
            return Ok(0.0);
        }
        let mut ticks = vec![[0_u64; 2]; self.pieces];
        // SAFETY: these queries were written by work that is done; two of them an element.
        unsafe {
            self.gpu.device().get_query_pool_results(
                self.timestamps,
                0,
                ticks.as_flattened_mut(),
                vk::QueryResultFlags::TYPE_64,
            )
        }
        .during(operation)?;
        let ticks: u64 = ticks.iter().map(|[start, end]| end.saturating_sub(*start)).sum();
        Ok(ticks as f64 * period / 1e6)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if self.pieces > 0
            && let Err(error) = self.block("finishing")
        {
            // A lost device runs nothing any more, so freeing is sound all the same.
            tracing::warn!(%error, "a command stream was dropped in trouble");
        }
        let device = self.gpu.device();
        // SAFETY: the device is done with all of them (or lost); each is ours, or null.
        unsafe {
            device.destroy_semaphore(self.timeline, None);
            device.destroy_query_pool(self.timestamps, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}
