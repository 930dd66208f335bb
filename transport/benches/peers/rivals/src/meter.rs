//! The workload, sixty frames a second, and when its frames arrive.

use std::sync::{Arc, LazyLock};
use std::time::Duration;

use parking_lot::Mutex;
use trimaran_net::{Instant, Net, sleep_until};

/// Ids of a frame, and their bytes.
pub(crate) const POINTS: u32 = 4000;
pub(crate) const FRAME_BYTES: usize = 4 * POINTS as usize;
/// A frame that is incomplete after this time is late.
pub(crate) const DEADLINE: Duration = Duration::from_millis(50);
/// How long the last frames may take.
const LINGER: Duration = Duration::from_secs(5);

/// When each frame began and came. Both ends share one clock.
#[derive(Debug, Default)]
pub(crate) struct Meter {
    frames: Mutex<Vec<Frame>>,
}

#[derive(Debug, Clone, Copy)]
struct Frame {
    begun: Instant,
    /// When it was delivered, and whether it was complete.
    came: Option<(Instant, bool)>,
}

/// The latencies of frames.
#[derive(Debug, Default, Clone)]
pub(crate) struct Latencies {
    /// Each frame from its beginning to its delivery, in order; those that never came are missing.
    pub(crate) all: Vec<Duration>,
    /// Frames that were not delivered whole within the deadline.
    pub(crate) late: usize,
}

impl Meter {
    /// Begins the next frame.
    pub(crate) fn begin(&self, now: Instant) {
        self.frames.lock().push(Frame { begun: now, came: None });
    }

    /// Frame `number` has come.
    pub(crate) fn came(&self, number: u32, now: Instant, complete: bool) {
        if let Some(frame) = self.frames.lock().get_mut(number as usize) {
            frame.came.get_or_insert((now, complete));
        }
    }

    /// How many frames have come.
    pub(crate) fn count(&self) -> usize {
        self.frames.lock().iter().filter(|frame| frame.came.is_some()).count()
    }

    /// The latencies. A frame is delivered after those before it, as links promise it.
    pub(crate) fn latencies(&self) -> Latencies {
        let (mut latencies, mut last) = (Latencies::default(), Instant::from_nanos(0));
        for frame in &*self.frames.lock() {
            let Some((came, complete)) = frame.came else {
                latencies.late += 1;
                continue;
            };
            last = last.max(came);
            let took = last.since(frame.begun);
            latencies.late += usize::from(!complete || took > DEADLINE);
            latencies.all.push(took);
        }
        latencies
    }
}

/// Two ends, before they are connected.
#[derive(Clone)]
pub(crate) struct Ends {
    pub(crate) sender: Arc<dyn Net>,
    pub(crate) receiver: Arc<dyn Net>,
    /// The sender's name for the receiver; the sender listens.
    pub(crate) host: &'static str,
    pub(crate) frames: u32,
    pub(crate) meter: Arc<Meter>,
}

impl Ends {
    /// When the frames begin: now, at the sender.
    pub(crate) fn beat(&self) -> Beat {
        Beat::starting(self.sender.now(), self.frames)
    }

    /// Waits until all frames have come, but not for ever.
    pub(crate) async fn finish(&self) {
        let last = self.sender.now().after(LINGER);
        while self.meter.count() < self.frames as usize && self.sender.now() < last {
            sleep_until(&*self.sender, self.sender.now().after(Duration::from_millis(10))).await;
        }
    }
}

/// The times of the frames.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beat {
    start: Instant,
    next: u32,
    frames: u32,
}

impl Beat {
    /// So many frames, from now on.
    pub(crate) const fn starting(start: Instant, frames: u32) -> Self {
        Self { start, next: 0, frames }
    }

    /// When the next frame is due, if there is one.
    pub(crate) fn due(&self) -> Option<Instant> {
        let after = Duration::from_nanos(1_000_000_000 / 60 * u64::from(self.next));
        (self.next < self.frames).then(|| self.start.after(after))
    }

    /// The number of the next frame, which is due.
    pub(crate) fn take(&mut self) -> u32 {
        self.next += 1;
        self.next - 1
    }
}

/// The bytes of a frame: its number, and its ids.
pub(crate) fn frame_bytes(number: u32) -> Vec<u8> {
    [&number.to_le_bytes(), &IDS[..]].concat()
}

/// The number of a received frame, if its ids are those that were sent.
pub(crate) fn frame_number(bytes: &[u8]) -> Option<u32> {
    let (number, ids) = bytes.split_first_chunk()?;
    (ids == &IDS[..]).then_some(u32::from_le_bytes(*number))
}

/// Ids in no order, which are the same in each frame.
static IDS: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let ids = (0..POINTS).map(|id| (id ^ (id >> 3)).wrapping_mul(2_654_435_761));
    ids.flat_map(u32::to_le_bytes).collect()
});
