//! A pass's submissions to the device: command buffers, submitted in order, waited for together, timed.

use std::sync::Arc;

use ash::vk;
use trimaran_cull::Cancel;
use trimaran_proto::DeviceTimes;

use crate::error::During as _;
use crate::recorder::Recorder;
use crate::timestamps::{PieceTimestamps, Timestamps};
use crate::timing::{Moment, Pass};
use crate::wait::{End, SLICE, Wait};
use crate::{DeviceKind, Gpu, GpuError};

/// Submissions of one pass, in order. Dropping it waits for the device. So an owner that declares its stream
/// before the buffers and images of the stream's work is sound: fields drop in order of declaration. If it
/// gives up waiting, it abandons the device, so that none of them is destroyed.
pub(crate) struct Stream {
    gpu: Arc<Gpu>,
    cancel: Option<Cancel>,
    /// A wait ended before the work was done: its resources must not be touched any more.
    broken: bool,
    pool: vk::CommandPool,
    buffers: Vec<vk::CommandBuffer>,
    timestamps: Timestamps,
    /// Counts finished pieces: piece n signals n.
    timeline: vk::Semaphore,
    submitted: u64,
    /// Used command buffers.
    pieces: usize,
    /// The device may not be done with all of them.
    pending: bool,
    /// Those of timestamps that are read.
    times: DeviceTimes,
}

/// The most pieces whose command buffers are used; the next one waits for them. A frame has a few.
const MAX_PIECES: usize = 64;

impl Stream {
    pub(crate) fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        const OPERATION: &str = "making a command stream";
        // The stream first, with null handles (which Vulkan's destroy functions ignore), so that a failure
        // half-way cleans up.
        let mut stream = Self {
            gpu: Arc::clone(gpu),
            cancel: None,
            broken: false,
            pool: vk::CommandPool::null(),
            buffers: Vec::new(),
            timestamps: Timestamps::new(gpu, MAX_PIECES as u32)?,
            timeline: vk::Semaphore::null(),
            submitted: 0,
            pieces: 0,
            pending: false,
            times: DeviceTimes::default(),
        };
        let device = gpu.device();
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(gpu.queue_family())
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        let mut timeline = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let semaphore = vk::SemaphoreCreateInfo::default().push_next(&mut timeline);
        // SAFETY: the device is alive, has this queue family, and timeline semaphores are enabled.
        unsafe {
            stream.pool = device.create_command_pool(&pool, None).during(OPERATION)?;
            stream.timeline = device.create_semaphore(&semaphore, None).during(OPERATION)?;
        }
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(stream.pool)
            .command_buffer_count(MAX_PIECES as u32);
        // SAFETY: the pool is ours; the command buffers go with it.
        stream.buffers = unsafe { device.allocate_command_buffers(&info) }.during(OPERATION)?;
        Ok(stream)
    }

    /// Waits end early when `cancel` says so.
    pub(crate) fn cancel_when(&mut self, cancel: &Cancel) {
        self.cancel = Some(Arc::clone(cancel));
    }

    /// Whether waits are to end early.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancel.as_ref().is_some_and(|cancel| cancel())
    }

    /// Whether the stream is usable: not on a hung device, nor after a wait that ended early.
    pub(crate) fn check(&self, operation: &'static str) -> Result<(), GpuError> {
        if self.gpu.is_hung() {
            Err(GpuError::DeviceHung { operation, timeout: self.gpu.timeout() })
        } else if self.broken {
            Err(GpuError::Cancelled { operation })
        } else {
            Ok(())
        }
    }

    /// Records one piece of work and submits it. `operation` names it in errors. Its time counts as that of
    /// `pass`, if it has one, until the recorder [begins](Recorder::begin_pass) another.
    pub(crate) fn submit(
        &mut self,
        operation: &'static str,
        pass: Option<Pass>,
        record: impl FnOnce(&Recorder<'_>),
    ) -> Result<(), GpuError> {
        self.submit_between(operation, pass, None, record)
    }

    /// The same, where the piece begins its transfers once the first semaphore is signalled, and signals the
    /// second one when done. Both are binary, and live until the piece is done.
    pub(crate) fn submit_between(
        &mut self,
        operation: &'static str,
        pass: Option<Pass>,
        semaphores: Option<(vk::Semaphore, vk::Semaphore)>,
        record: impl FnOnce(&Recorder<'_>),
    ) -> Result<(), GpuError> {
        self.check(operation)?;
        if self.pieces == MAX_PIECES {
            self.add_times(operation)?;
        }
        let Some(&buffer) = self.buffers.get(self.pieces) else {
            return Ok(()); // there are MAX_PIECES buffers
        };
        let device = self.gpu.device();
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer is ours, in its initial state (its pool was reset after the device was done with
        // it), and is recorded by this thread alone.
        unsafe { device.begin_command_buffer(buffer, &begin) }.during(operation)?;
        let timestamps = self.timestamps.begin(buffer, pass);
        record(&Recorder::new(device, buffer, timestamps.as_ref()));
        let timestamps = timestamps.map(PieceTimestamps::end);
        // SAFETY: as above; each `Recorder` method leaves the buffer outside of a render pass.
        unsafe { device.end_command_buffer(buffer) }.during(operation)?;
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(buffer)];
        let done = |semaphore| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(semaphore)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        let waits = semaphores.map(|(before, _)| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(before)
                .stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
        });
        let mine = done(self.timeline).value(self.submitted + 1);
        let both = semaphores.map(|(_, after)| [mine, done(after)]);
        let signals = both.as_ref().map_or(std::slice::from_ref(&mine), |both| &both[..]);
        let submits = [vk::SubmitInfo2::default()
            .command_buffer_infos(&buffers)
            .wait_semaphore_infos(waits.as_slice())
            .signal_semaphore_infos(signals)];
        let queue = self.gpu.queue();
        // SAFETY: the queue is locked; the command buffer is complete; the timeline only ever grows, by one a
        // submission.
        unsafe { device.queue_submit2(*queue, &submits, vk::Fence::null()) }.during(operation)?;
        drop(queue);
        self.timestamps.submitted(timestamps.unwrap_or_default());
        self.submitted += 1;
        self.pieces += 1;
        self.pending = true;
        Ok(())
    }

    /// Waits until all submissions are done. `operation` names it in errors.
    pub(crate) fn wait(&mut self, operation: &'static str) -> Result<(), GpuError> {
        if self.pending {
            self.block(operation)?;
            self.pending = false;
        }
        Ok(())
    }

    /// Waits, forgets the times of all pieces, and makes their command buffers ready for others.
    pub(crate) fn restart(&mut self, operation: &'static str) -> Result<(), GpuError> {
        self.wait(operation)?;
        self.times = DeviceTimes::default();
        self.timestamps.forget();
        self.reuse(operation)
    }

    /// Makes all command buffers ready for others. The device is done with them.
    fn reuse(&mut self, operation: &'static str) -> Result<(), GpuError> {
        if self.pieces == 0 {
            return Ok(());
        }
        self.pieces = 0;
        // SAFETY: the device is done with every buffer of the pool.
        unsafe { self.gpu.device().reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
            .during(operation)
    }

    /// All pieces submitted so far.
    #[cfg(test)]
    pub(crate) const fn submissions(&self) -> u64 {
        self.submitted
    }

    /// Waits, and returns the device's times of all pieces since the last call or restart.
    pub(crate) fn take_times(&mut self, operation: &'static str) -> Result<DeviceTimes, GpuError> {
        self.add_times(operation)?;
        Ok(std::mem::take(&mut self.times))
    }

    /// The same if the last wait was for all pieces. Otherwise no times, and those of all pieces later.
    pub(crate) fn take_times_if_done(&mut self, operation: &'static str) -> Result<DeviceTimes, GpuError> {
        if self.pending { Ok(DeviceTimes::default()) } else { self.take_times(operation) }
    }

    /// Waits, and adds the times of all pieces.
    fn add_times(&mut self, operation: &'static str) -> Result<(), GpuError> {
        self.wait(operation)?;
        self.timestamps.read(&mut self.times, operation)?;
        self.reuse(operation)
    }

    /// Waits until the device is done or [`Wait`] ends it.
    fn block(&mut self, operation: &'static str) -> Result<(), GpuError> {
        self.check(operation)?;
        if self.is_done_soon(operation)? {
            return Ok(());
        }
        let device = self.gpu.device();
        let semaphores = [self.timeline];
        let values = [self.submitted];
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        let (mut done, mut wait) = (0, Wait::new(self.gpu.timeout()));
        let end = loop {
            // SAFETY: the semaphore is a timeline and a submission that signals the value is in the queue.
            match unsafe { device.wait_semaphores(&info, SLICE.as_nanos() as u64) } {
                Err(vk::Result::TIMEOUT) => {}
                result => return result.during(operation),
            }
            // SAFETY: the semaphore is a timeline.
            let now = unsafe { device.get_semaphore_counter_value(self.timeline) }.during(operation)?;
            let progress = now > std::mem::replace(&mut done, now);
            if let Some(end) = wait.slice(progress, self.is_cancelled()) {
                break end;
            }
        };
        self.broken = true;
        self.gpu.abandon(end == End::Hung);
        Err(match end {
            End::Hung => GpuError::DeviceHung { operation, timeout: self.gpu.timeout() },
            End::Cancelled => GpuError::Cancelled { operation },
        })
    }

    /// Looks again and again for a moment whether the device is done: that is sooner than being woken up. A
    /// device that is this machine's processors needs them for its work.
    fn is_done_soon(&self, operation: &'static str) -> Result<bool, GpuError> {
        if self.gpu.info().kind == DeviceKind::Cpu {
            return Ok(false);
        }
        let moment = Moment::now();
        while !moment.is_over() {
            // SAFETY: the semaphore is a timeline.
            let done = unsafe { self.gpu.device().get_semaphore_counter_value(self.timeline) };
            if done.during(operation)? >= self.submitted {
                return Ok(true);
            }
            std::hint::spin_loop();
        }
        Ok(false)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if self.pending
            && self.gpu.to_destroy().is_some()
            && let Err(error) = self.block("finishing")
        {
            // A lost device runs nothing any more, so freeing is still sound.
            tracing::warn!(%error, "a command stream was dropped in trouble");
        }
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: the device is done with all of them (or lost); each is ours, or null.
        unsafe {
            device.destroy_semaphore(self.timeline, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use glam::{DVec3, Vec3};
    use trimaran_cull::{OcclusionTest, TestBox, View};

    use super::*;
    use crate::common::{self, CheckedGpu, NEAR, ids, upload, view};
    use crate::{GpuOptions, GpuScene, OccluderPass};

    /// A submission that waits for a semaphore which only the host signals: later submissions never begin.
    struct Jam {
        gpu: Arc<Gpu>,
        semaphore: vk::Semaphore,
    }

    impl Jam {
        fn new(gpu: &Arc<Gpu>) -> Self {
            let mut timeline =
                vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
            let info = vk::SemaphoreCreateInfo::default().push_next(&mut timeline);
            // SAFETY: timeline semaphores are enabled.
            let semaphore = unsafe { gpu.device().create_semaphore(&info, None) }.unwrap();
            let waits = [vk::SemaphoreSubmitInfo::default()
                .semaphore(semaphore)
                .value(1)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
            let submits = [vk::SubmitInfo2::default().wait_semaphore_infos(&waits)];
            let queue = gpu.queue();
            // SAFETY: the queue is locked, and the semaphore lives until the queue is idle.
            unsafe { gpu.device().queue_submit2(*queue, &submits, vk::Fence::null()) }.unwrap();
            drop(queue);
            Self { gpu: Arc::clone(gpu), semaphore }
        }

        /// Lets the device go on, and waits until it has done everything.
        fn clear(self) {
            let signal = vk::SemaphoreSignalInfo::default().semaphore(self.semaphore).value(1);
            let device = self.gpu.device();
            let queue = self.gpu.queue();
            // SAFETY: the value only grows; the queue is locked, and idle when the semaphore goes.
            unsafe {
                device.signal_semaphore(&signal).unwrap();
                device.queue_wait_idle(*queue).unwrap();
                device.destroy_semaphore(self.semaphore, None);
            }
        }
    }

    /// A wall 2 m away, and its pass, for abandoning.
    fn wall(gpu: &Arc<Gpu>) -> (Arc<GpuScene>, OccluderPass) {
        let scene = upload(gpu, &[common::wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0)]);
        let pass = OccluderPass::new(&scene, small().viewport()).unwrap();
        (scene, pass)
    }

    fn small() -> View {
        view(8, 8, DVec3::ZERO)
    }

    /// A box behind the wall.
    const BEHIND: TestBox = TestBox { centre: Vec3::new(0.0, 0.0, -4.0), axes: [Vec3::X, Vec3::Y, Vec3::Z] };

    /// The error of a test of that box.
    fn error_of(mut test: impl OcclusionTest<Error = GpuError>) -> GpuError {
        test.test(&small(), &[BEHIND], &mut Vec::new()).unwrap_err()
    }

    fn draw(pass: &mut OccluderPass) -> Result<Vec<f32>, GpuError> {
        pass.begin(&small())?;
        pass.draw(&ids(1))?;
        pass.finish()?;
        Ok(pass.read_depth()?.depth().to_vec())
    }

    fn open(timeout: Duration) -> Option<CheckedGpu> {
        CheckedGpu::with(GpuOptions { timeout, ..GpuOptions::default() })
    }

    #[test]
    fn a_device_that_hangs_is_given_up_after_the_timeout_and_nothing_of_it_is_destroyed() {
        let timeout = Duration::from_millis(200);
        let Some(gpu) = open(timeout) else { return };
        let (scene, mut pass) = wall(&gpu);
        let jam = Jam::new(&gpu);
        let error = draw(&mut pass).unwrap_err();
        let hung = |error: &GpuError| {
            matches!(error, GpuError::DeviceHung { operation: "drawing the occluders", timeout: waited }
                if *waited == timeout)
        };
        assert!(hung(&error), "{error}");
        assert!(
            error.to_string().contains("no progress within 200ms while drawing the occluders"),
            "{error}"
        );
        // All later use fails at once: of the same pass, a box test, another pass.
        assert!(hung(&draw(&mut pass).unwrap_err()));
        assert!(hung(&error_of(pass.query_test().unwrap())));
        assert!(hung(&error_of(pass.raster_test().unwrap())));
        if !common::lacks_float64(&gpu) {
            assert!(hung(&error_of(pass.hzb_test().unwrap())));
        }
        let mut other = OccluderPass::new(&scene, small().viewport()).unwrap();
        assert!(hung(&draw(&mut other).unwrap_err()));
        // Resources in use are neither waited for nor destroyed; the validation layer would report that.
        drop((pass, other, scene));
        jam.clear();
    }

    #[test]
    fn a_wait_ends_when_it_is_cancelled_and_another_pass_can_use_the_device() {
        let Some(gpu) = open(Duration::from_secs(3600)) else { return };
        let (scene, mut pass) = wall(&gpu);
        assert_eq!(draw(&mut pass).unwrap(), [NEAR / 2.0; 64]);
        pass.cancel_when(|| true);
        let jam = Jam::new(&gpu);
        for _ in 0..2 {
            let error = draw(&mut pass).unwrap_err();
            assert!(matches!(error, GpuError::Cancelled { operation: "drawing the occluders" }), "{error}");
        }
        drop(pass);
        jam.clear();
        let mut other = OccluderPass::new(&scene, small().viewport()).unwrap();
        assert_eq!(draw(&mut other).unwrap(), [NEAR / 2.0; 64]);
        if common::lacks_float64(&gpu) {
            return;
        }
        // A device that stops during a box test.
        other.cancel_when(|| true);
        let jam = Jam::new(&gpu);
        let error = error_of(other.hzb_test().unwrap());
        let testing = "testing boxes against the depth pyramid";
        assert!(matches!(error, GpuError::Cancelled { operation } if operation == testing), "{error}");
        drop(other);
        jam.clear();
    }

    #[test]
    fn a_pass_that_is_dropped_while_the_device_hangs_waits_no_longer_than_the_timeout() {
        let Some(gpu) = open(Duration::from_millis(200)) else { return };
        let (scene, mut pass) = wall(&gpu);
        // Never cleared: this process must end nevertheless.
        let _jam = Jam::new(&gpu);
        pass.begin(&small()).unwrap();
        pass.draw(&ids(1)).unwrap();
        pass.flush().unwrap();
        drop((pass, scene));
        assert!(gpu.is_hung());
    }
}
