//! View states that change during a session: the roles that cull and draw a frame use the one that its camera
//! names.

use std::{
    collections::{BTreeMap, BTreeSet},
    convert::Infallible,
    sync::Arc,
    time::Duration,
};

use parking_lot::Mutex;
use trimaran_actors::{
    BoxedError, Cameras, CullerDevice, LocalSession, Observer, PictureDevice, RoleError, Schedule,
    SessionError, ShownFrame, Stop,
};
use trimaran_cull::{
    CutRule, DepthImage, DrawOrder, Image, LodRule, NoOccluders, OcclusionTest, TestBox, View, Viewport,
    lod_cut,
};
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, FrameStats, ObjectSet, OcclusionTestKind, Section, SectionBox, Sections,
    ViewState, ViewVersion,
};
use trimaran_scene::{Scene, random::Random};

const FRAMES: u32 = 24;

/// A camera that turns in the middle of the scene, and another view state every second frame.
struct Changing {
    middle: [f64; 3],
    states: BTreeMap<ViewVersion, Arc<ViewState>>,
}

impl Changing {
    fn new(scene: &Scene) -> Self {
        let (min, max) = scene.nodes().first().unwrap().world_box();
        let objects = u32::try_from(scene.objects().len()).unwrap();
        let mut random = Random::new(7);
        let mut state = |_| {
            let mut some =
                |share: f64| -> ObjectSet { (0..objects).filter(|_| random.chance(share)).collect() };
            let (hidden, see_through, isolated) = (some(0.3), some(0.3), some(0.8));
            let half = (max - min) * random.between(0.3, 0.7);
            let place = random.point(min, max);
            let kept = SectionBox::new((place - half).to_array(), (place + half).to_array()).unwrap();
            let kinds = OcclusionTestKind::ALL;
            Arc::new(ViewState {
                viewport: Viewport::new(16 + random.below(32) as u32, 32).unwrap(),
                lod: LodRule::new(random.between(0.5, 8.0)).unwrap(),
                occlusion_test: random.pick(kinds),
                sections: Sections::new(&[Section::Box(kept)]).unwrap(),
                hidden,
                isolated: random.chance(0.5).then_some(isolated),
                see_through: Some(see_through),
            })
        };
        let mut states: BTreeMap<_, _> = (1..FRAMES).map(|v| (ViewVersion(v), state(v))).collect();
        states.insert(ViewVersion(0), Arc::new(crate::common::settings(32, 2.0).into()));
        Self { middle: crate::common::middle(scene), states }
    }

    fn view(&self, camera: &Camera) -> (View, &ViewState) {
        let state = &self.states[&camera.view()];
        (View::of(*camera, state), state)
    }
}

impl Cameras for Changing {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        let camera = crate::common::turned(self.middle, 0.05 * f64::from(frame.0), 1.0, frame);
        camera.in_view(ViewVersion(frame.0 / 2))
    }

    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        self.states.get(&version).cloned()
    }
}

/// The requests to devices for drawing and testing.
#[derive(Debug, Default)]
struct Log {
    occluders: Vec<(View, OcclusionTestKind, Vec<DrawableId>)>,
    pictures: Vec<(View, Vec<DrawableId>, Vec<DrawableId>)>,
    /// Frames of which all in the frustum was drawn.
    not_culled: BTreeSet<FrameNumber>,
}

struct NotCulled(Arc<Mutex<Log>>);

impl Observer for NotCulled {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        if stats.culling.visited == 0 {
            self.0.lock().not_culled.insert(stats.frame);
        }
    }
}

struct Noting {
    log: Arc<Mutex<Log>>,
    test: OcclusionTestKind,
    view: Option<View>,
}

impl Noting {
    fn new(log: &Arc<Mutex<Log>>) -> Self {
        Self { log: Arc::clone(log), test: OcclusionTestKind::Hzb, view: None }
    }
}

impl OcclusionTest for Noting {
    type Error = Infallible;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        NoOccluders.test(view, boxes, visible)
    }
}

impl CullerDevice for Noting {
    fn change_occlusion_test(&mut self, kind: OcclusionTestKind) {
        self.test = kind;
    }

    fn begin_occluders(&mut self, view: &View) -> Result<(), Infallible> {
        self.view = Some(*view);
        Ok(())
    }

    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Infallible> {
        self.log.lock().occluders.push((self.view.unwrap(), self.test, ids.to_vec()));
        Ok(())
    }

    fn finish_occluders(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Infallible> {
        panic!("nobody looks at the depth here")
    }
}

impl PictureDevice for Noting {
    type Error = Infallible;

    fn draw(
        &mut self,
        view: &View,
        solid: &[DrawableId],
        through: &[DrawableId],
    ) -> Result<Duration, Infallible> {
        self.log.lock().pictures.push((*view, solid.to_vec(), through.to_vec()));
        Ok(Duration::ZERO)
    }

    fn read(&mut self, _: &mut Image) -> Result<(), Infallible> {
        panic!("nobody wants a picture here")
    }
}

fn walk(
    scene: &Arc<Scene>,
    cullers: usize,
    schedule: Schedule,
    cameras: &mut Changing,
) -> (Log, Result<(), SessionError>) {
    let runtime = crate::common::runtime();
    let (_stopper, stop) = Stop::new();
    let log = Arc::new(Mutex::new(Log::default()));
    let session = LocalSession {
        cullers,
        schedule,
        ..LocalSession::new(scene, crate::common::settings(32, 2.0), FRAMES)
    };
    let device = |_| Ok(Noting::new(&log));
    let walked = session.run(
        device,
        Noting::new(&log),
        cameras,
        &mut NotCulled(Arc::clone(&log)),
        runtime.handle(),
        &stop,
    );
    let log = std::mem::take(&mut *log.lock());
    (log, walked)
}

#[test]
fn all_who_work_for_a_frame_obey_the_view_state_that_its_camera_names() {
    let scene = crate::common::small_scene();
    let cases = [
        (0, Schedule::Independent),
        (1, Schedule::Independent),
        (3, Schedule::Independent),
        (2, Schedule::Switch),
    ];
    for (cullers, schedule) in cases {
        let mut cameras = Changing::new(&scene);
        let (log, walked) = walk(&scene, cullers, schedule, &mut cameras);
        walked.unwrap();
        let (mut seen_through, mut drawn) = (0, 0);
        assert_eq!(log.pictures.len(), FRAMES as usize);
        for (view, solid, through) in &log.pictures {
            let (due, state) = cameras.view(view.camera());
            assert_eq!(*view, due, "{cullers} {schedule:?}");
            let rule = CutRule::new(&scene, state);
            let mut cut = lod_cut(&scene, &due, &rule);
            DrawOrder::default().sort(&scene, &due, &mut cut);
            let is_through = |id: &DrawableId| rule.is_see_through(&scene, *id);
            let back_to_front: Vec<_> = through.iter().rev().copied().collect();
            let of = |through: bool| -> Vec<_> {
                cut.iter().copied().filter(|id| is_through(id) == through).collect()
            };
            assert_eq!(*solid, of(false), "{cullers} {schedule:?}: {}", view.camera().frame());
            assert_eq!(back_to_front, of(true), "{cullers} {schedule:?}: {}", view.camera().frame());
            (seen_through, drawn) = (seen_through + through.len(), drawn + solid.len());
        }
        assert!(seen_through > 100 && drawn > 100, "{seen_through} {drawn}");
        let mut frames = BTreeSet::new();
        for (view, test, ids) in &log.occluders {
            let (due, state) = cameras.view(view.camera());
            assert_eq!((*view, *test), (due, state.occlusion_test), "{cullers} {schedule:?}");
            let rule = CutRule::new(&scene, state);
            let cut: BTreeSet<_> = lod_cut(&scene, &due, &rule).into_iter().collect();
            assert!(ids.iter().all(|id| cut.contains(id) && !rule.is_see_through(&scene, *id)));
            frames.insert(view.camera().frame());
        }
        // A display that culls for itself draws no occluders for a frame that it does not cull.
        let not_culled = log.not_culled.len();
        assert!(cullers == 0 || not_culled == 0, "{cullers} {schedule:?}");
        assert_eq!(frames.len() + not_culled, FRAMES as usize, "{cullers} {schedule:?}");
    }
}

#[test]
fn a_camera_whose_view_state_nobody_has_ends_the_walk() {
    let scene = crate::common::small_scene();
    for cullers in [0, 2] {
        let mut cameras = Changing::new(&scene);
        cameras.states.remove(&ViewVersion(3));
        let (log, walked) = walk(&scene, cullers, Schedule::Independent, &mut cameras);
        let Err(SessionError::Role(RoleError::UnknownView(version))) = walked else { panic!("{walked:?}") };
        assert_eq!(version, ViewVersion(3));
        assert!(log.pictures.len() <= 6);
    }
}
