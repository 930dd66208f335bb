//! Roles of one process that compute in turn: no role's reported time contains another role's work.

use std::{
    collections::BTreeMap,
    convert::Infallible,
    sync::{
        Arc,
        atomic::{AtomicU32, Ordering},
    },
    time::Duration,
};

use trimaran_actors::{
    BoxedError, CullerDevice, LocalSession, Observer, PictureDevice, Schedule, ShownFrame, Stopwatch, Turns,
};
use trimaran_cull::{DepthImage, Image, NoOccluders, OcclusionTest, TestBox, View, Viewport};
use trimaran_proto::{BatchSize, DeviceTimes, DrawableId, FrameNumber, FrameStats, Settings};
use trimaran_scene::Scene;

use crate::supply::{Cpu, PLANT, Screen, TestPath, settings};

const FRAMES: u32 = 30;
const SIZE: u32 = 8;
/// The duration of each call of a device.
const WORK: Duration = Duration::from_micros(200);
/// The times of a device by its own clock.
const CULLER_TIMES: DeviceTimes = DeviceTimes { drawing_ns: 3, pyramid_ns: 0, culling_ns: 5 };
const PICTURE_TIME: Duration = Duration::from_nanos(7);

/// A device that is busy for a while in each call, and counts how many devices are busy at once.
struct Busy {
    devices: Arc<Count>,
    depth: Vec<f32>,
}

#[derive(Default)]
struct Count {
    now: AtomicU32,
    most: AtomicU32,
}

impl Busy {
    fn new(devices: &Arc<Count>) -> Self {
        Self { devices: Arc::clone(devices), depth: vec![0.0; (SIZE * SIZE) as usize] }
    }

    fn work(&self) {
        let now = 1 + self.devices.now.fetch_add(1, Ordering::SeqCst);
        self.devices.most.fetch_max(now, Ordering::SeqCst);
        let clock = Stopwatch::start();
        while clock.elapsed() < WORK {
            std::thread::yield_now();
        }
        self.devices.now.fetch_sub(1, Ordering::SeqCst);
    }
}

impl OcclusionTest for Busy {
    type Error = Infallible;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        self.work();
        NoOccluders.test(view, boxes, visible)
    }
}

impl CullerDevice for Busy {
    fn begin_occluders(&mut self, _: &View) -> Result<(), Infallible> {
        self.work();
        Ok(())
    }

    fn draw_occluders(&mut self, _: &[DrawableId]) -> Result<(), Infallible> {
        self.work();
        Ok(())
    }

    fn finish_occluders(&mut self) -> Result<(), Infallible> {
        self.work();
        Ok(())
    }

    fn take_times(&mut self) -> Result<DeviceTimes, Infallible> {
        Ok(CULLER_TIMES)
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Infallible> {
        Ok(DepthImage::new(Viewport::new(SIZE, SIZE).unwrap(), &self.depth).unwrap())
    }
}

impl PictureDevice for Busy {
    type Error = Infallible;

    fn draw(&mut self, _: &View, _: &[DrawableId], _: &[DrawableId]) -> Result<Duration, Infallible> {
        self.work();
        Ok(PICTURE_TIME)
    }

    fn read(&mut self, _: &mut Image) -> Result<(), Infallible> {
        Ok(())
    }
}

/// The record of a session: begin and end of each role's work on each frame, on one clock, and the ids shown.
#[derive(Default)]
struct Record {
    occluders: Vec<[u64; 2]>,
    culling: Vec<[u64; 2]>,
    drawing: Vec<[u64; 2]>,
    on_device: Vec<DeviceTimes>,
    pictures_on_device: Vec<Duration>,
    ids: Vec<Vec<u32>>,
}

impl Observer for Record {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.drawing.push([frame.drawing, frame.shown].map(|at| at.as_nanos() as u64));
        self.pictures_on_device.push(frame.on_device);
        self.ids.push(frame.ids.iter().map(|id| id.0).collect());
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.occluders.push([stats.or_end_ns - stats.or_busy_ns, stats.or_end_ns]);
        self.culling.push([stats.hc_start_ns, stats.hc_end_ns]);
        self.on_device.push(stats.device);
    }
}

impl Record {
    /// All the work, by when it began.
    fn work(&self) -> Vec<[u64; 2]> {
        let mut all = [&self.occluders[..], &self.culling, &self.drawing].concat();
        all.sort_unstable();
        all
    }
}

/// A whole session, and the most devices that were busy at once.
fn session(scene: &Arc<Scene>, batch: u32, turns: &Turns) -> (Record, u32) {
    let batch = BatchSize::new(batch).unwrap();
    let settings = Settings { batch, ..crate::common::settings(SIZE, 0.01) };
    let middle = crate::common::middle(scene);
    let mut turning =
        |frame: FrameNumber| crate::common::turned(middle, 0.05 * f64::from(frame.0), 2.0, frame);
    let devices = Arc::new(Count::default());
    let mut record = Record::default();
    let session = LocalSession { turns: turns.clone(), ..LocalSession::new(scene, settings, FRAMES) };
    let device = |_| Busy::new(&devices);
    crate::common::play(session, device, Busy::new(&devices), &mut turning, &mut record);
    (record, devices.most.load(Ordering::SeqCst))
}

#[test]
fn no_two_busy_times_of_roles_that_take_turns_overlap() {
    let (record, most) = session(&crate::common::large_scene(), 1024, &Turns::alone());
    assert_eq!(most, 1, "a device was busy while another one was");
    let work = record.work();
    assert_eq!(work.len(), 3 * FRAMES as usize);
    for pair in work.windows(2) {
        assert!(pair[0][1] <= pair[1][0], "{:?} overlaps {:?}", pair[0], pair[1]);
    }
}

#[test]
fn a_busy_time_holds_all_that_a_role_does_for_a_frame() {
    let (record, _) = session(&crate::common::large_scene(), 1024, &Turns::alone());
    // Clearing, drawing and completing; at least one test; a picture.
    for (work, calls) in [(&record.occluders, 3), (&record.culling, 1), (&record.drawing, 1)] {
        for [start, end] in work {
            assert!(u128::from(end - start) >= calls * WORK.as_nanos(), "{} ns", end - start);
        }
    }
}

#[test]
fn the_times_of_devices_are_told_with_each_frame() {
    for turns in [Turns::alone(), Turns::at_once()] {
        let (record, _) = session(&crate::common::large_scene(), 1024, &turns);
        assert_eq!(record.on_device, [CULLER_TIMES; FRAMES as usize]);
        assert_eq!(record.pictures_on_device, [PICTURE_TIME; FRAMES as usize]);
    }
}

#[test]
fn a_session_shows_the_same_whether_its_roles_take_turns_or_not() {
    let scene = crate::common::large_scene();
    let (at_once, _) = session(&scene, 1024, &Turns::at_once());
    let (alone, _) = session(&scene, 1024, &Turns::alone());
    assert_eq!(alone.ids, at_once.ids);
}

/// Of a culler's frames: the occluders drawn, and the nodes hidden.
#[derive(Default)]
struct Culled {
    shown: Vec<Vec<DrawableId>>,
    stats: BTreeMap<u32, [u32; 2]>,
}

impl Observer for Culled {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.shown.push(frame.ids.to_vec());
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.stats.insert(stats.frame.0, [stats.occluders, stats.culling.hidden]);
    }
}

/// Each draws what the other one finds, batch by batch, also where it is drawn only when all has come.
#[test]
fn with_the_schedule_switch_a_session_shows_the_same_too() {
    let walk = |turns: Turns, schedule: Schedule| {
        let settings = Settings { batch: BatchSize::new(16).unwrap(), ..settings() };
        let session = LocalSession { turns, schedule, ..LocalSession::new(&PLANT, settings, FRAMES) };
        let screen = Screen { scene: Arc::clone(&PLANT), pictures: Arc::default() };
        let mut culled = Culled::default();
        let mut path = TestPath::new(1, FRAMES as usize);
        crate::common::play(session, |_| Cpu::new(&PLANT, None), screen, &mut path, &mut culled);
        culled
    };
    let [at_once, alone] = [Turns::at_once(), Turns::alone()].map(|turns| walk(turns, Schedule::Switch));
    assert_eq!(alone.stats, at_once.stats);
    assert_eq!(alone.shown, at_once.shown);
    assert!(alone.stats.values().map(|[occluders, _]| occluders).sum::<u32>() > 100);
    assert!(alone.stats.values().map(|[_, hidden]| hidden).sum::<u32>() > 100);
    // Before frame 2 the path jumps: the set before says little of it and is replaced, as under the other
    // schedule.
    let independent = walk(Turns::alone(), Schedule::Independent);
    let [switch, independent] = [&alone, &independent].map(|culled| culled.stats[&2][0]);
    assert!(independent > 200 && switch * 10 > independent * 9, "{switch} {independent}");
}

/// One id per message: far more than a link within a process holds, so the culler waits for the receiver.
#[test]
fn who_has_the_turn_lets_others_go_on_where_it_has_to_wait_for_them() {
    let scene = crate::common::large_scene();
    let (record, most) = session(&scene, 1, &Turns::alone());
    assert_eq!(most, 1);
    let ids = record.ids.iter().map(Vec::len);
    assert!(ids.clone().min().unwrap() > 512, "{:?}", ids.collect::<Vec<_>>());
    // The time of others is in no time of this role: all together took no longer than the session.
    let work = record.work();
    let busy: u64 = work.iter().map(|[start, end]| end - start).sum();
    let whole = work.iter().map(|[_, end]| end).max().unwrap() - work[0][0];
    assert!(busy <= whole, "{busy} ns of work in {whole} ns");
}
