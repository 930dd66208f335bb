//! How a subject is measured. One round is a new pair of ends, poses, frames one at a time, frames without a
//! pause.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::Instant;

use anyhow::{Context, Result};
use cpu_time::ProcessTime;
use hdrhistogram::Histogram;
use stats_alloc::Region;
use tokio::runtime::{Builder, Runtime};

use crate::ALLOCATOR;
use crate::row::{Round, Row};

/// The number of points in a frame.
pub(crate) const POINTS: u32 = 4000;
/// How many frames may be in flight without an answer.
const WINDOW: u32 = 4;
/// Poses and frames before the measurement.
const WARM_UP: u32 = 50;

/// The contents of a round.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) poses: u32,
    pub(crate) frames: u32,
    /// Each end is a thread beside a worker of its runtime, as in a role, and is not pinned.
    pub(crate) as_roles: bool,
    /// Each end is given to `block_on`, not to a task.
    pub(crate) block_on: bool,
}

/// A way to send poses and frames of points between two threads.
pub(crate) trait Subject: Send + Sync + 'static {
    type Near: Near;
    type Far: Far;
    /// Whether the library has threads of its own: then nothing is pinned, and the runtime is multi-threaded.
    const HAS_THREADS: bool = false;

    /// The listening end; it sends its address to the other one.
    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<Self::Near>;
    /// The connecting end.
    async fn far(&self, whereabouts: &str) -> Result<Self::Far>;
}

/// The sending end.
pub(crate) trait Near {
    /// Sends 72 bytes that carry `number`.
    fn pose(&mut self, number: u32) -> impl Future<Output = Result<()>> + Send;
    /// Sends a frame of [`POINTS`] points.
    fn frame(&mut self, number: u32) -> impl Future<Output = Result<()>> + Send;
    /// Waits for the next answer: the number of the pose or frame. Later ones may replace earlier ones.
    fn answer(&mut self) -> impl Future<Output = Result<u32>> + Send;
    /// Ends the other end's service.
    fn close(self) -> impl Future<Output = Result<()>> + Send;
}

/// The answering end.
pub(crate) trait Far {
    /// Answers each pose, and each frame once its last point is there, with 72 bytes. Frames go to `arrivals`
    /// first. Ends when the other end has closed.
    fn serve(self, arrivals: Arc<Arrivals>) -> impl Future<Output = Result<()>> + Send;
}

/// When the last frame arrived.
pub(crate) struct Arrivals {
    epoch: Instant,
    last: AtomicU64,
}

impl Arrivals {
    pub(crate) fn mark(&self) {
        self.last.store(self.now(), Ordering::Release);
    }

    fn now(&self) -> u64 {
        u64::try_from(self.epoch.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }
}

/// The measurements of one round: each pose, each frame, and the round.
struct Measured {
    poses: Histogram<u64>,
    frames: Histogram<u64>,
    round: Round,
}

/// Measures `subject` once, each end a task of its runtime unless the plan says otherwise.
///
/// A library's own tasks are such. `block_on` polls its future only after another look at the system's events
/// when such a task wakes it. A subject without tasks does not pay that.
pub(crate) fn measure<S>(subject: S, plan: &Plan, row: &mut Row) -> Result<()>
where
    S: Subject<Near: Send + 'static, Far: Send + 'static>,
{
    if plan.as_roles || plan.block_on {
        return measure_blocking(subject, plan, row);
    }
    on_two_threads(
        subject,
        plan,
        row,
        |runtime, near, plan, arrivals| runtime.block_on(runtime.spawn(drive(near, plan, arrivals)))?,
        |runtime, far, arrivals| runtime.block_on(runtime.spawn(far.serve(arrivals)))?,
    )
}

/// As [`measure`], for a subject that blocks its thread and must stay on it.
pub(crate) fn measure_blocking<S: Subject>(subject: S, plan: &Plan, row: &mut Row) -> Result<()> {
    on_two_threads(
        subject,
        plan,
        row,
        |runtime, near, plan, arrivals| runtime.block_on(drive(near, plan, arrivals)),
        |runtime, far, arrivals| runtime.block_on(far.serve(arrivals)),
    )
}

fn on_two_threads<S: Subject>(
    subject: S,
    plan: &Plan,
    row: &mut Row,
    near: impl FnOnce(&Runtime, S::Near, Plan, Arc<Arrivals>) -> Result<Measured> + Send,
    far: impl FnOnce(&Runtime, S::Far, Arc<Arrivals>) -> Result<()> + Send,
) -> Result<()> {
    let arrivals = Arc::new(Arrivals { epoch: Instant::now(), last: AtomicU64::new(0) });
    let (tell, told) = mpsc::channel::<String>();
    let threads = S::HAS_THREADS || plan.as_roles;
    let (subject, at_near, at_far) = (&subject, Arc::clone(&arrivals), arrivals);
    let (client, server) = thread::scope(|scope| {
        let server = scope.spawn(move || {
            let whereabouts = told.recv().context("the near end did not listen")?;
            pin(1, threads);
            let runtime = runtime(threads)?;
            let end = runtime.block_on(subject.far(&whereabouts))?;
            far(&runtime, end, at_far)
        });
        let client = scope.spawn(move || {
            pin(0, threads);
            let runtime = runtime(threads)?;
            let end = runtime.block_on(subject.near(tell))?;
            near(&runtime, end, *plan, at_near)
        });
        (client.join(), server.join())
    });
    let measured = client.map_err(|_| anyhow::anyhow!("the near end panicked"))?.context("near end")?;
    server.map_err(|_| anyhow::anyhow!("the far end panicked"))?.context("far end")?;
    row.there_and_back.add(&measured.poses)?;
    row.frame.add(&measured.frames)?;
    row.rounds.push(measured.round);
    Ok(())
}

async fn drive<N: Near>(mut near: N, plan: Plan, arrivals: Arc<Arrivals>) -> Result<Measured> {
    let mut number = 0;
    for _ in 0..WARM_UP {
        number += 1;
        near.pose(number).await?;
        until(&mut near, number).await?;
        number += 1;
        near.frame(number).await?;
        until(&mut near, number).await?;
    }

    let (mut poses, mut frames) = (Histogram::<u64>::new(3)?, Histogram::<u64>::new(3)?);
    let heap = Region::new(ALLOCATOR);
    for _ in 0..plan.poses {
        number += 1;
        let start = arrivals.now();
        near.pose(number).await?;
        until(&mut near, number).await?;
        poses.record(arrivals.now() - start)?;
    }
    let allocations_a_pose = heap.change().allocations as f64 / f64::from(plan.poses);

    let (heap, cpu) = (Region::new(ALLOCATOR), ProcessTime::now());
    for _ in 0..plan.frames {
        number += 1;
        let start = arrivals.now();
        near.frame(number).await?;
        until(&mut near, number).await?;
        frames.record(arrivals.last.load(Ordering::Acquire).saturating_sub(start))?;
    }
    let cpu_a_frame = cpu.elapsed().as_nanos() as f64 / f64::from(plan.frames);
    let allocations_a_frame = heap.change().allocations as f64 / f64::from(plan.frames);

    let (start, first, mut answered) = (Instant::now(), number, number);
    while number < first + plan.frames {
        number += 1;
        near.frame(number).await?;
        while number - answered >= WINDOW {
            answered = near.answer().await?;
        }
    }
    while answered != number {
        answered = near.answer().await?;
    }
    let ids_a_second = f64::from(plan.frames * POINTS) / start.elapsed().as_secs_f64();

    near.close().await?;

    let round = Round {
        pose_p50: poses.value_at_quantile(0.5) as f64,
        frame_p50: frames.value_at_quantile(0.5) as f64,
        cpu_a_frame,
        allocations_a_pose,
        allocations_a_frame,
        ids_a_second,
    };
    Ok(Measured { poses, frames, round })
}

async fn until(near: &mut impl Near, number: u32) -> Result<()> {
    while near.answer().await? != number {}
    Ok(())
}

fn runtime(threads: bool) -> Result<Runtime> {
    let mut builder = if threads {
        let mut builder = Builder::new_multi_thread();
        builder.worker_threads(1);
        builder
    } else {
        Builder::new_current_thread()
    };
    Ok(builder.enable_all().build()?)
}

/// Pins this thread to a core, unless it has others beside it.
fn pin(core: usize, threads: bool) {
    if let Some(cores) = core_affinity::get_core_ids().filter(|cores| !threads && cores.len() > 1) {
        core_affinity::set_for_current(cores[core % cores.len()]);
    }
}
