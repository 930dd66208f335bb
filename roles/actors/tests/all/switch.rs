//! The paper's SWITCH, step by step: two cullers, each drawing the other one's visible set, as it comes
//! (paper, section 3.2, algorithms 4.1 to 4.3).

use std::{
    collections::BTreeMap,
    convert::Infallible,
    sync::{Arc, Condvar, Mutex},
    time::Duration,
};

use trimaran_actors::{
    BoxedError, Cameras, CullerDevice, CullerEvent, CullerId, LocalSession, Observer, Pace, Schedule,
    ShownFrame,
};
use trimaran_cull::{DepthImage, LodRule, NoOccluders, OcclusionTest, TestBox, View, Viewport, occluders};
use trimaran_proto::{BatchSize, Camera, DrawableId, FrameNumber, FrameStats, Settings};
use trimaran_scene::Scene;

use crate::common::{Device, large_scene, middle, play, settings, turned};

const FRAMES: u32 = 10;
const SIDE: u32 = 64;
const EPSILON_PX: f64 = 0.5;
/// The level of the tree at which HC waits for OR: every frame has visible nodes above it, and most have some
/// below.
const MIDST: u32 = 5;

/// The steps of both cullers' devices, in order.
#[derive(Default)]
struct Log {
    steps: Mutex<Vec<Step>>,
    more: Condvar,
}

#[derive(Debug, Clone, PartialEq)]
enum Step {
    /// OR clears the depth and sets the camera of this frame.
    Clear(CullerId, u32),
    /// OR draws some of its occluders.
    Draw(CullerId, u32, Vec<DrawableId>),
    /// Its depth is complete: HC begins.
    Complete(CullerId, u32),
    /// HC has tested a level of the tree.
    Test(CullerId, u32),
}

impl Log {
    fn note(&self, step: Step) {
        self.steps.lock().unwrap().push(step);
        self.more.notify_all();
    }

    /// Waits for a step. Fails if it does not come.
    fn wait_for(&self, what: impl Fn(&Step) -> bool) {
        let steps = self.steps.lock().unwrap();
        let missing = |steps: &mut Vec<Step>| !steps.iter().any(&what);
        let (_steps, out) = self.more.wait_timeout_while(steps, Duration::from_secs(60), missing).unwrap();
        assert!(!out.timed_out(), "the cullers do not work at once");
    }
}

struct Logged {
    log: Arc<Log>,
    /// None for the display's own device, which is unused here.
    culler: Option<CullerId>,
    frame: u32,
    tests: u32,
}

impl Logged {
    fn note(&self, step: impl FnOnce(CullerId, u32) -> Step) {
        self.log.note(step(self.culler.unwrap(), self.frame));
    }
}

impl OcclusionTest for Logged {
    type Error = Infallible;

    /// Nothing is hidden. HC of a frame pauses until OR of the next one draws the ids found so far. It would
    /// wait for ever if OR began only after HC.
    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        self.tests += 1;
        let next = self.frame + 1;
        if self.tests == MIDST && next < FRAMES {
            let drawn =
                |step: &Step| matches!(step, Step::Draw(_, frame, ids) if *frame == next && !ids.is_empty());
            self.log.wait_for(drawn);
        }
        self.note(Step::Test);
        NoOccluders.test(view, boxes, visible)
    }
}

impl CullerDevice for Logged {
    fn begin_occluders(&mut self, view: &View) -> Result<(), Infallible> {
        (self.frame, self.tests) = (view.camera().frame().0, 0);
        self.note(Step::Clear);
        Ok(())
    }

    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Infallible> {
        self.note(|culler, frame| Step::Draw(culler, frame, ids.to_vec()));
        Ok(())
    }

    fn finish_occluders(&mut self) -> Result<(), Infallible> {
        self.note(Step::Complete);
        Ok(())
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Infallible> {
        panic!("the depth never travels")
    }
}

/// The frames that RVG showed, with camera and culler.
#[derive(Default)]
struct Shown {
    frames: Vec<(Camera, Option<CullerId>, Vec<DrawableId>)>,
    stats: BTreeMap<u32, FrameStats>,
}

impl Observer for Shown {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.frames.push((frame.camera, frame.culler, frame.ids.to_vec()));
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.stats.insert(stats.frame.0, *stats);
    }
}

fn walk(scene: &Arc<Scene>) -> (Vec<Step>, Shown) {
    let middle = middle(scene);
    let mut turning = |frame: FrameNumber| turned(middle, 0.05 * f64::from(frame.0), 1.0, frame);
    let settings = Settings { batch: BatchSize::new(16).unwrap(), ..settings(SIDE, EPSILON_PX) };
    let (log, mut shown) = (Arc::new(Log::default()), Shown::default());
    let session = LocalSession { schedule: Schedule::Switch, ..LocalSession::new(scene, settings, FRAMES) };
    let device = |culler| Logged { log: Arc::clone(&log), culler, frame: 0, tests: 0 };
    play(session, device, Device::default(), &mut turning, &mut shown);
    let steps = log.steps.lock().unwrap().clone();
    (steps, shown)
}

#[test]
fn the_schedule_is_that_of_the_paper() {
    let scene = large_scene();
    let (steps, shown) = walk(&scene);
    let [one, other] = CullerId::first(2).collect::<Vec<_>>()[..] else { panic!("two cullers") };
    let mut overlapped = 0;
    let place = |step: &Step| steps.iter().position(|other| other == step).unwrap();
    for frame in 0..FRAMES {
        // The roles switch with each frame: its culler draws its occluders (section 3.2).
        let culler = if frame % 2 == 0 { one } else { other };
        let of_frame = |step: &&Step| {
            matches!(step, Step::Clear(_, of) | Step::Draw(_, of, _) | Step::Complete(_, of) | Step::Test(_, of)
                if *of == frame)
        };
        let all: Vec<_> = steps.iter().filter(of_frame).collect();
        let by = |step: &&&Step| {
            matches!(step, Step::Clear(by, _) | Step::Draw(by, ..) | Step::Complete(by, _) | Step::Test(by, _)
                if *by == culler)
        };
        assert_eq!(all.iter().filter(by).count(), all.len(), "frame {frame} is one culler's");

        // Algorithm 4.2, OR: clear the depth, set the camera, draw ids until the end of the frame.
        assert_eq!(all[0], &Step::Clear(culler, frame));
        let complete = all.iter().position(|step| matches!(step, Step::Complete(..))).unwrap();
        let drawing = &all[1..complete];
        assert!(drawing.iter().all(|step| matches!(step, Step::Draw(..))), "{drawing:?}");
        // Algorithm 4.1, HC: the tree is tested level by level against that depth, which stays on the device.
        let culling = &all[complete + 1..];
        assert!(
            culling.len() > 3 && culling.iter().all(|step| matches!(step, Step::Test(..))),
            "{culling:?}"
        );

        // Algorithm 4.3, RVG: HC's visible set is shown from the camera of the frame.
        let (camera, by, ids) = &shown.frames[frame as usize];
        assert_eq!((camera.frame().0, *by), (frame, Some(culler)));
        assert_eq!(u32::try_from(ids.len()).unwrap(), shown.stats[&frame].culling.emitted);

        let Some(before) = frame.checked_sub(1) else { continue };
        // The occluders are the visible set of the previous frame's HC, at the levels of this frame's camera.
        assert_eq!(shown.stats[&frame].occluders_of, Some(FrameNumber(before)));
        let view = View::new(*camera, Viewport::new(SIDE, SIDE).unwrap());
        let found = &shown.frames[before as usize].2;
        let due = occluders(&scene, &view, LodRule::new(EPSILON_PX).unwrap(), found).unwrap();
        let drawn = drawing.iter().flat_map(|step| match step {
            Step::Draw(_, _, ids) => ids.as_slice(),
            _ => &[],
        });
        let drawn: Vec<_> = drawn.collect();
        assert!(!drawn.is_empty() && drawn.iter().all(|id| due.contains(id)));
        // They come in several batches, and OR of this frame works during HC of the previous one.
        let levels = steps.iter().filter(|step| matches!(step, Step::Test(_, of) if *of == before)).count();
        if levels < MIDST as usize {
            continue;
        }
        overlapped += 1;
        assert!(drawing.len() > 2, "{drawing:?}");
        let first_drawn =
            place(drawing.iter().find(|s| matches!(s, Step::Draw(_, _, ids) if !ids.is_empty())).unwrap());
        let last_test =
            steps.iter().rposition(|step| matches!(step, Step::Test(_, of) if *of == before)).unwrap();
        assert!(first_drawn < last_test, "OR of frame {frame} began when HC of frame {before} was complete");
        // HC of this frame begins when that of the previous one is complete.
        assert!(place(&Step::Complete(culler, frame)) > last_test);
    }
    assert!(overlapped > FRAMES / 2, "only {overlapped} frames are deep enough");
    // Ids go to OR and to RVG: as many bytes to the other culler as to the display (section 3.3).
    let sent = |frame: u32| shown.stats[&frame].to_other;
    assert!((0..FRAMES - 1).all(|frame| sent(frame).messages > 0), "nothing was sent to the other culler");
}

#[test]
fn where_cullers_are_independent_nothing_travels_between_them() {
    let scene = large_scene();
    let session = LocalSession::new(&scene, settings(SIDE, EPSILON_PX), FRAMES);
    let middle = middle(&scene);
    let mut still = |frame| turned(middle, 0.0, 1.0, frame);
    let mut shown = Shown::default();
    play(
        LocalSession { cullers: 3, ..session },
        |_| Device::default(),
        Device::default(),
        &mut still,
        &mut shown,
    );
    for (frame, stats) in &shown.stats {
        assert_eq!(stats.to_other.messages, 0);
        let own = frame.checked_sub(3).map(FrameNumber);
        assert_eq!(stats.occluders_of, own, "frame {frame} draws what its culler found three frames before");
    }
    assert_eq!(shown.stats.len(), FRAMES as usize);
}

/// A camera that never rests, until this many frames were requested.
struct Restless {
    asked: u32,
    middle: [f64; 3],
}

impl Cameras for Restless {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.asked += 1;
        turned(self.middle, 1e-4 * f64::from(self.asked), 1.0, frame)
    }

    fn is_over(&self) -> bool {
        self.asked > 3_000
    }
}

/// The lost cullers, and the number of shown frames.
#[derive(Default)]
struct Losses {
    lost: Vec<String>,
    frames: usize,
}

impl Observer for Losses {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.frames += 1;
        Ok(())
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        if let CullerEvent::Left(id, why) = event {
            self.lost.push(format!("{id}: {why}"));
        }
    }
}

/// Live, a frame that waits for its culler gets newer poses. One that arrives after the culler has begun is
/// too late: it must not be culled as another frame.
#[test]
fn a_pose_that_comes_when_its_frame_has_begun_is_no_other_frame() {
    let scene = large_scene();
    let mut cameras = Restless { asked: 0, middle: middle(&scene) };
    let mut losses = Losses::default();
    let session = LocalSession::new(&scene, settings(SIDE, EPSILON_PX), FRAMES);
    let session = LocalSession { schedule: Schedule::Switch, pace: Pace::Live, ..session };
    play(session, |_| Device::default(), Device::default(), &mut cameras, &mut losses);
    assert_eq!(losses.lost, [""; 0], "in {} frames", losses.frames);
    assert!(losses.frames > 20, "{} frames", losses.frames);
}
