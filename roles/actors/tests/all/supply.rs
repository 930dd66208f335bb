//! A display without the scene shows the same as one with it: with any culler as supplier, any small memory,
//! and cullers that die or lie.

use std::{
    collections::{BTreeMap, BTreeSet},
    future::pending,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicU32, Ordering},
    },
    thread,
    time::Duration,
};

use bytes::Bytes;
use glam::DVec3;
use parking_lot::Mutex;
use trimaran_actors::{
    Arrival, BoxedError, Cameras, CullerDevice, CullerEvent, CullerId, CullerRole, DisplayRole, Expected,
    Link, LocalSession, Meeting, Observer, Pace, Peers, PictureDevice, RoleError, SceneCulling,
    ScenePictures, Schedule, SessionLimits, Sharing, ShownFrame, SlotGuard, Stop, Supplied, Turns,
    WhileLoading, max_frame,
};
use trimaran_audit::{IdBuffer, Placement, ReferenceTest, TriangleId, rasterize};
use trimaran_cook::generate::PlantOptions;
use trimaran_cull::{
    Answer, CutRule, DepthImage, Image, LodCut, OcclusionTest, TestBox, View, Viewport, draw_order, lod_cut,
};
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, Identity, LodRule, NumberList, ObjectSet, Role, Section, SectionBox,
    Sections, SessionKey, Settings, Supply, ViewState, ViewVersion, Walkthrough, put_item,
};
use trimaran_scene::{DrawableEntry, Level, Scene, pack_entries, random::Random};
use trimaran_transport::{Bulk, LinkConfig, Net, Options, TokioNet, causes, inproc, sleep_until};

use crate::common::{Broken, runtime, send_frame};

pub(crate) const SIDE: u32 = 40;
pub(crate) const EPSILON_PX: f64 = 1.0;

pub(crate) static PLANT: LazyLock<Arc<Scene>> = LazyLock::new(|| {
    crate::common::scene(&PlantOptions { objects: 700, triangles: 50_000, ..PlantOptions::small(3) })
});

pub(crate) fn settings() -> Settings {
    crate::common::settings(SIDE, EPSILON_PX)
}

fn supplied(memory: u64, while_loading: WhileLoading) -> Supplied {
    Supplied { scene: Arc::new(Scene::empty(PLANT.outline())), memory, while_loading }
}

/// A device on the CPU, which may fail at a frame.
pub(crate) struct Cpu {
    scene: Arc<Scene>,
    view: View,
    buffer: IdBuffer,
    fails_at: Option<u32>,
}

impl Cpu {
    pub(crate) fn new(scene: &Arc<Scene>, fails_at: Option<u32>) -> Self {
        let viewport = Viewport::new(SIDE, SIDE).unwrap();
        let view = View::new(Camera::at_origin(FrameNumber(0)), viewport);
        Self { scene: Arc::clone(scene), view, buffer: IdBuffer::new(viewport), fails_at }
    }
}

impl OcclusionTest for Cpu {
    type Error = Broken;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Broken> {
        ReferenceTest::new(&self.buffer).test(view, boxes, visible).unwrap_or_else(|never| match never {});
        Ok(())
    }

    fn answer(&self) -> Answer {
        Answer::PixelCount
    }
}

impl CullerDevice for Cpu {
    fn begin_occluders(&mut self, view: &View) -> Result<(), Broken> {
        (self.view, self.buffer) = (*view, IdBuffer::new(view.viewport()));
        match self.fails_at {
            Some(frame) if view.camera().frame().0 >= frame => Err(Broken::Lost),
            _ => Ok(()),
        }
    }

    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Broken> {
        ids.iter().for_each(|id| self.buffer.draw(&self.scene, &self.view, *id, Placement::Exact));
        Ok(())
    }

    fn finish_occluders(&mut self) -> Result<(), Broken> {
        Ok(())
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Broken> {
        panic!("nobody looks at the depth here")
    }
}

/// A picture: solid drawables, and over them pixel by pixel the see-through ones.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Picture {
    pub(crate) camera: Camera,
    solid: IdBuffer,
    through: Vec<(usize, TriangleId)>,
}

impl Picture {
    fn draw(scene: &Scene, view: &View, solid: &[DrawableId], through: &[DrawableId]) -> Self {
        let solid = rasterize(scene, view, solid.iter().copied(), Placement::Exact);
        let mut seen = Vec::new();
        for id in through {
            let mut over = solid.clone();
            over.draw(scene, view, *id, Placement::Exact);
            let shown = over.ids().iter().enumerate();
            seen.extend(
                shown.filter_map(|(pixel, shown)| Some((pixel, shown.filter(|s| s.drawable == *id)?))),
            );
        }
        Self { camera: *view.camera(), solid, through: seen }
    }

    /// Without culling, of the whole scene.
    fn exact(view: &View, state: &ViewState) -> Self {
        let rule = CutRule::new(&PLANT, state);
        let mut cut = lod_cut(&PLANT, view, &rule);
        draw_order(&PLANT, view, &mut cut);
        let mut through = Vec::new();
        let solid = rule.divide(&PLANT, &cut, &mut through);
        Self::draw(&PLANT, view, &solid, &through)
    }
}

/// A display's device, which draws the geometry in its scene.
pub(crate) struct Screen {
    pub(crate) scene: Arc<Scene>,
    pub(crate) pictures: Arc<Mutex<Vec<Picture>>>,
}

impl PictureDevice for Screen {
    type Error = Broken;

    fn draw(
        &mut self,
        view: &View,
        solid: &[DrawableId],
        through: &[DrawableId],
    ) -> Result<Duration, Broken> {
        let picture = Picture::draw(&self.scene, view, solid, through);
        assert!(self.scene.fault().is_none(), "it is asked to draw what is not there");
        self.pictures.lock().push(picture);
        Ok(Duration::ZERO)
    }

    fn read(&mut self, _: &mut Image) -> Result<(), Broken> {
        panic!("nobody wants a picture here")
    }
}

/// Cameras on a path through the scene with jumps, and their changing view states.
pub(crate) struct TestPath {
    poses: Vec<(DVec3, [f64; 4])>,
    states: Vec<Arc<ViewState>>,
    /// How many frames were shown, if that ends the walk.
    shown: Option<Arc<AtomicU32>>,
    asked: usize,
}

impl TestPath {
    pub(crate) fn new(seed: u64, frames: usize) -> Self {
        let mut random = Random::new(seed);
        let (min, max) = PLANT.nodes()[0].world_box();
        let mut pose = (random.point(min, max), random.rotation());
        let mut poses = Vec::new();
        for _ in 0..frames {
            pose = match random.chance(0.3) {
                true => (random.point(min, max), random.rotation()),
                false => (pose.0 + 0.5 * random.direction(), pose.1),
            };
            poses.push((pose.0, pose.1.to_array()));
        }
        Self { poses, states: vec![Arc::new(settings().into())], shown: None, asked: 0 }
    }

    /// Another view state every second frame: hidden, see-through and isolated objects, and sections.
    pub(crate) fn with_states(self, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let objects = u32::try_from(PLANT.objects().len()).unwrap();
        let (min, max) = PLANT.nodes()[0].world_box();
        let mut state = |_| {
            let mut some =
                |share: f64| -> ObjectSet { (0..objects).filter(|_| random.chance(share)).collect() };
            let (hidden, see_through, isolated) = (some(0.2), some(0.3), some(0.8));
            let half = (max - min) * random.between(0.3, 0.7);
            let place = random.point(min, max);
            let kept = SectionBox::new((place - half).to_array(), (place + half).to_array()).unwrap();
            Arc::new(ViewState {
                viewport: Viewport::new(16 + random.below(32) as u32, 32).unwrap(),
                lod: LodRule::new(random.between(0.5, 8.0)).unwrap(),
                sections: Sections::new(&[Section::Box(kept)]).unwrap(),
                hidden,
                isolated: random.chance(0.3).then_some(isolated),
                see_through: Some(see_through),
                ..settings().into()
            })
        };
        let states = (1..self.poses.len()).map(&mut state).collect::<Vec<_>>();
        Self { states: [self.states, states].concat(), ..self }
    }

    /// Live: another pose every fifth request, until this many frames were shown.
    fn live(self) -> Self {
        Self { shown: Some(Arc::default()), ..self }
    }

    pub(crate) fn exact(&self, camera: Camera) -> Picture {
        let state = &self.states[camera.view().0 as usize];
        Picture::exact(&View::of(camera, state), state)
    }
}

impl Cameras for TestPath {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        let at = if self.shown.is_some() { self.asked / 5 } else { frame.0 as usize };
        self.asked += 1;
        let (eye, orientation) = self.poses[at % self.poses.len()];
        let camera = Camera::new(eye.to_array(), orientation, 0.8, 0.1, frame).unwrap();
        camera.in_view(ViewVersion(if self.states.len() > 1 { frame.0 / 2 } else { 0 }))
    }

    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        self.states.get(version.0 as usize).cloned()
    }

    fn is_over(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.load(Ordering::SeqCst) as usize >= self.poses.len())
    }
}

/// The frames that a display showed, and the events of its cullers.
#[derive(Debug, Default)]
struct Seen {
    by: Vec<Option<usize>>,
    /// For each picture: how many drawables it lacked, and whether it showed a frame again.
    lacking: Vec<(u32, bool)>,
    left: Vec<(usize, String)>,
    count: Arc<AtomicU32>,
}

impl Observer for Seen {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.by.push(frame.culler.map(CullerId::index));
        assert_eq!(frame.camera.frame().0 as usize, self.lacking.len(), "pictures are counted");
        self.lacking.push((frame.lacking, frame.again));
        self.count.fetch_add(1, Ordering::SeqCst);
        Ok(())
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        if let CullerEvent::Left(id, why) = event {
            self.left.push((id.index(), causes(why)));
        }
    }
}

/// A walk with all roles in this process.
#[derive(Debug, Clone, Copy)]
struct Walk {
    cullers: usize,
    schedule: Schedule,
    /// The display's memory, if it begins without the scene.
    memory: Option<u64>,
    while_loading: WhileLoading,
    /// The frame at which the first culler's device fails.
    dies_at: Option<u32>,
}

const WHOLE: Walk = Walk {
    cullers: 1,
    schedule: Schedule::Independent,
    memory: None,
    while_loading: WhileLoading::Wait,
    dies_at: None,
};
const EMPTY: Walk = Walk { memory: Some(1 << 30), ..WHOLE };

impl Walk {
    fn walk(self, path: &mut TestPath) -> (Vec<Picture>, Seen) {
        let Self { cullers, schedule, memory, while_loading, dies_at } = self;
        let frames = u32::try_from(path.poses.len()).unwrap();
        let supplied = memory.map(|memory| supplied(memory, while_loading));
        let scene = supplied.as_ref().map_or(&*PLANT, |supplied| &supplied.scene);
        let pictures = Arc::default();
        let screen = Screen { scene: Arc::clone(scene), pictures: Arc::clone(&pictures) };
        let (_stopper, stop) = Stop::new();
        let pace = if path.shown.is_some() { Pace::Live } else { Pace::Lockstep { frames: Some(frames) } };
        let mut seen = Seen { count: path.shown.clone().unwrap_or_default(), ..Seen::default() };
        let session = LocalSession::new(&PLANT, settings(), frames);
        let device = |id: Option<CullerId>| {
            let dies = dies_at.filter(|_| id.is_some_and(|id| id.index() == 0));
            Ok(Cpu::new(&PLANT, dies))
        };
        LocalSession { cullers, schedule, supplied, pace, ..session }
            .run(device, screen, path, &mut seen, runtime().handle(), &stop)
            .unwrap();
        let pictures = std::mem::take(&mut *pictures.lock());
        (pictures, seen)
    }
}

/// Compares pictures without printing them.
fn assert_alike(pictures: &[Picture], exact: &[Picture], what: impl std::fmt::Debug) {
    assert_eq!(pictures.len(), exact.len(), "{what:?}");
    for (frame, (picture, exact)) in pictures.iter().zip(exact).enumerate() {
        assert_eq!(picture.camera, exact.camera, "{what:?}: frame {frame}");
        assert_eq!(picture.solid.differing_pixels(&exact.solid), 0, "{what:?}: frame {frame}");
        assert!(picture == exact, "{what:?}: frame {frame}");
    }
}

#[test]
fn what_a_display_without_the_scene_shows_is_what_one_that_holds_it_shows() {
    const FRAMES: usize = 16;
    let (whole, _) = WHOLE.walk(&mut TestPath::new(1, FRAMES));
    assert_eq!(whole.len(), FRAMES);
    let shown: BTreeSet<_> = whole.iter().flat_map(|picture| picture.solid.seen()).collect();
    assert!(shown.len() > 100, "{} drawables are seen", shown.len());
    let cases = [
        (1, Schedule::Independent),
        (2, Schedule::Independent),
        (3, Schedule::Independent),
        (2, Schedule::Switch),
    ];
    for (cullers, schedule) in cases {
        let (pictures, seen) = Walk { cullers, schedule, ..EMPTY }.walk(&mut TestPath::new(1, FRAMES));
        assert_alike(&pictures, &whole, (cullers, schedule));
        let by: BTreeSet<_> = seen.by.iter().copied().collect();
        assert_eq!(by, (0..cullers).map(Some).collect(), "all of them cull");
        assert!(seen.left.is_empty(), "{seen:?}");
    }
}

#[test]
fn view_states_hold_for_a_display_without_the_scene() {
    const FRAMES: usize = 16;
    let path = || TestPath::new(2, FRAMES).with_states(3);
    let (whole, _) = WHOLE.walk(&mut path());
    let through: usize = whole.iter().map(|picture| picture.through.len()).sum();
    assert!(through > 500, "{through} pixels are seen through");
    for (cullers, schedule) in [(1, Schedule::Independent), (2, Schedule::Switch)] {
        let (pictures, _) = Walk { cullers, schedule, ..EMPTY }.walk(&mut path());
        assert_alike(&pictures, &whole, (cullers, schedule));
    }
}

#[test]
fn however_little_a_display_keeps_it_shows_the_same() {
    for seed in 0..8 {
        let mut random = Random::stream(seed, 1, 1);
        let (whole, _) = WHOLE.walk(&mut TestPath::new(seed, 12));
        let memory = random.pick([1, 1 << 10, 16 << 10, 64 << 10]);
        let cullers = 1 + random.below(3);
        let (pictures, _) =
            Walk { cullers, memory: Some(memory), ..EMPTY }.walk(&mut TestPath::new(seed, 12));
        assert_alike(&pictures, &whole, (seed, memory, cullers));
    }
}

#[test]
fn if_the_culler_that_supplies_dies_another_one_goes_on() {
    const FRAMES: usize = 14;
    let (whole, _) = WHOLE.walk(&mut TestPath::new(5, FRAMES));
    for (cullers, dies_at, memory) in [(2, 0, 1 << 30), (2, 6, 1 << 30), (3, 6, 1), (2, 11, 1 << 30)] {
        let walk = Walk { cullers, dies_at: Some(dies_at), memory: Some(memory), ..EMPTY };
        let (pictures, seen) = walk.walk(&mut TestPath::new(5, FRAMES));
        assert_alike(&pictures, &whole, walk);
        let left: BTreeSet<_> = seen.left.iter().map(|(id, _)| *id).collect();
        assert_eq!(left, BTreeSet::from([0]), "{seen:?}");
    }
}

#[test]
fn a_live_display_without_the_scene_shows_complete_frames_alone() {
    for (seed, memory, cullers) in [(1, 1 << 30, 1), (2, 1 << 30, 2), (3, 1, 2)] {
        let mut path = TestPath::new(seed, 20).live();
        let (pictures, _) = Walk { memory: Some(memory), cullers, ..EMPTY }.walk(&mut path);
        assert!(pictures.len() >= 20);
        let exact: Vec<_> = pictures.iter().map(|picture| path.exact(picture.camera)).collect();
        assert_alike(&pictures, &exact, (seed, memory, cullers));
    }
}

#[test]
fn a_live_display_shows_exact_pictures_where_nothing_is_lacking() {
    for (seed, memory, cullers) in [(1, 1 << 30, 1), (2, 1 << 30, 2), (3, 1, 2), (4, 16 << 10, 3)] {
        let mut path = TestPath::new(seed, 40).live();
        let walk = Walk { memory: Some(memory), cullers, while_loading: WhileLoading::Coarser, ..EMPTY };
        let (pictures, seen) = walk.walk(&mut path);
        assert!(pictures.len() >= 40);
        let exact = pictures.iter().zip(&seen.lacking).filter(|(_, (lacking, _))| *lacking == 0);
        let pictures: Vec<_> = exact.map(|(picture, _)| picture.clone()).collect();
        let exact: Vec<_> = pictures.iter().map(|picture| path.exact(picture.camera)).collect();
        assert_alike(&pictures, &exact, walk);
    }
}

/// The culler sends stand-ins, and more whenever a picture was shown.
#[test]
fn what_stands_in_is_shown_until_the_rest_has_come() {
    let mut random = Random::new(3);
    let (min, max) = PLANT.nodes()[0].world_box();
    let camera =
        Camera::new(random.point(min, max).to_array(), [0.0, 0.0, 0.0, 1.0], 0.8, 0.1, FrameNumber(0));
    let view = View::new(camera.unwrap(), settings().viewport);
    let cut = lod_cut(&PLANT, &view, settings().lod);
    let lods = LodCut::new(&PLANT, &view, settings().lod);
    let stand_ins: BTreeMap<_, _> =
        cut.iter().filter_map(|id| Some((*id, lods.coarser(*id, 64.0).last()?))).collect();
    let instead = |id: &DrawableId| -> Vec<DrawableId> {
        stand_ins.get(id).map_or(vec![*id], |level: &Level| level.pieces().collect())
    };
    let first: BTreeSet<_> = cut.iter().flat_map(instead).collect();
    let rest: Vec<_> = stand_ins.keys().copied().collect();
    assert!(rest.len() > 20, "{} drawables have something that stands in", rest.len());
    let words = stand_ins.iter().map(|(finer, level)| {
        let (id, pieces) = (level.first(), level.pieces().len() as u32);
        Supply::StandIn { id, pieces, drawables: NumberList::of(vec![finer.0]) }
    });
    let first_blocks = whole(&first).into_iter().chain(words.map(|word| block(&[word])));
    let (some, others) = rest.split_at(rest.len() * 3 / 4);
    let sent = vec![first_blocks.collect(), whole(some), whole(others)];

    let mut still = Still { view, shown: Arc::default(), until: 3 };
    let count = Arc::clone(&still.shown);
    let far = [Far::SendsAsShown(sent, Arc::clone(&count))];
    let (played, pictures, seen) = try_play(&far, Pace::Live, &mut still, Seen { count, ..Seen::default() });
    played.unwrap();
    let lacking: Vec<_> = seen.lacking.iter().map(|(lacking, _)| *lacking as usize).collect();
    assert_eq!(lacking, [rest.len(), others.len(), 0]);
    assert_eq!(seen.lacking.iter().map(|(_, again)| *again).collect::<Vec<_>>(), [false, true, true]);
    let shown = |coarser: &[DrawableId]| {
        let there = cut.iter().filter(|id| !coarser.contains(id)).copied();
        let ids: BTreeSet<_> = there.chain(coarser.iter().flat_map(instead)).collect();
        let mut ids: Vec<_> = ids.into_iter().collect();
        draw_order(&PLANT, &view, &mut ids);
        Picture::draw(&PLANT, &view, &ids, &[])
    };
    let expected = [shown(&rest), shown(others), Picture::exact(&view, &settings().into())];
    assert_ne!(expected[0], expected[2], "it shows which was drawn");
    assert_alike(&pictures, &expected, "while loading");
}

/// A fixed pose, until this many pictures were shown.
struct Still {
    view: View,
    shown: Arc<AtomicU32>,
    until: u32,
}

impl Cameras for Still {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.view.camera().for_frame(frame)
    }

    fn is_over(&self) -> bool {
        self.shown.load(Ordering::SeqCst) >= self.until
    }
}

/// Blocks with all data for drawing these; only the last one completes any of them.
fn whole<'i>(ids: impl IntoIterator<Item = &'i DrawableId>) -> Vec<Bytes> {
    let entries: Vec<_> =
        ids.into_iter().map(|id| DrawableEntry::of(&PLANT, *id).unwrap().unwrap()).collect();
    let numbers: BTreeSet<_> = entries.iter().map(|entry| entry.geometry).collect();
    let pieces = numbers.into_iter().flat_map(|number| {
        let bytes = Bytes::from(PLANT.packed_geometry(number).unwrap());
        let length = bytes.len() as u32;
        (0..length).step_by(16_000).map(move |offset| {
            let part = bytes.slice(offset as usize..(offset + 16_000).min(length) as usize);
            block(&[Supply::Geometry { number, length, offset, part }])
        })
    });
    pieces.chain([block(&[records(&entries)])]).collect()
}

/// The behaviour of a culler played by the test.
enum Far {
    /// A correct culler.
    Sound,
    /// It culls correctly, and on the request for geometry sends these blocks and nothing else.
    Sends(Vec<Bytes>),
    /// It culls one frame. On the request for geometry it sends the first of these, and the next ones as
    /// pictures are shown.
    SendsAsShown(Vec<Vec<Bytes>>, Arc<AtomicU32>),
    /// It culls correctly, and holds another scene.
    Foreign,
}

/// The pictures of a display without the scene, with these cullers; the first one is the first supplier.
fn play(cullers: &[Far], path: &mut TestPath) -> (Vec<Picture>, Seen) {
    let pace = Pace::Lockstep { frames: Some(u32::try_from(path.poses.len()).unwrap()) };
    let (played, pictures, seen) = try_play(cullers, pace, path, Seen::default());
    played.unwrap();
    (pictures, seen)
}

/// The same, and how its walk ends.
fn try_play(
    cullers: &[Far],
    pace: Pace,
    path: &mut dyn Cameras,
    mut seen: Seen,
) -> (Result<(), RoleError>, Vec<Picture>, Seen) {
    let runtime = runtime();
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    let (turns, supplied) = (Turns::at_once(), supplied(1 << 30, WhileLoading::Coarser));
    let mut peers = Peers::none();
    let mut far = Vec::new();
    for (place, culler) in cullers.iter().enumerate() {
        let (link, other) = match culler {
            Far::Foreign => foreign_link(&net),
            _ => crate::common::link(&net, &PLANT, Role::Display, Role::Culler),
        };
        peers.put_back(Arrival { place, link, at: None, slot: SlotGuard::once() });
        far.push((culler, other));
    }
    let pictures = Arc::default();
    let screen = Screen { scene: Arc::clone(&supplied.scene), pictures: Arc::clone(&pictures) };
    let work = ScenePictures::new(&supplied.scene, screen, &settings());
    let role = DisplayRole {
        alone: None::<SceneCulling<Cpu>>,
        supplied: Some(supplied),
        pace,
        turns,
        ..DisplayRole::new(work, peers, SessionKey(1), settings(), max_frame(&PLANT), &net)
    };
    let (_stopper, stop) = Stop::new();
    let played = thread::scope(|scope| {
        for (culler, link) in far {
            let (net, stop, runtime) = (&net, &stop, &runtime);
            scope.spawn(move || match culler {
                Far::Sound => runtime.block_on(sound(net, link, stop)),
                Far::Sends(blocks) => runtime.block_on(sends(net, link, std::slice::from_ref(blocks), None)),
                Far::SendsAsShown(parts, shown) => runtime.block_on(sends(net, link, parts, Some(shown))),
                Far::Foreign => runtime.block_on(culls(link, u32::MAX)),
            });
        }
        runtime.block_on(role.run(path, &mut seen, &stop))
    });
    let pictures = std::mem::take(&mut *pictures.lock());
    (played, pictures, seen)
}

/// A link to a culler that holds a scene of another fingerprint.
fn foreign_link(net: &Arc<dyn Net>) -> (Link, Link) {
    let identity = |role, scene| Identity { role, scene: Some(scene), session: None };
    let mut outline = PLANT.outline();
    outline.drawables += 1;
    let config = LinkConfig::default().with_max_frame(max_frame(&PLANT));
    let (ours, theirs) = (identity(Role::Display, outline), identity(Role::Culler, outline));
    inproc::pair::<Walkthrough>(net, ours, theirs, &config).unwrap()
}

async fn sound(net: &Arc<dyn Net>, display: Link, stop: &Stop) {
    let turns = Turns::at_once();
    let meeting = Meeting {
        net: Arc::clone(net),
        scene: PLANT.outline(),
        settings: settings(),
        options: Options::default(),
        cullers: [].into(),
        expected: Expected::default(),
    };
    let role = CullerRole {
        work: SceneCulling::new(&PLANT, Cpu::new(&PLANT, None), &settings(), &turns),
        display,
        meeting,
        turns,
        drawables: max_frame(&PLANT),
        scene: Some(Arc::clone(&PLANT)),
        lease: SessionLimits::none().lease(settings().viewport).unwrap(),
        sharing: Sharing::default(),
    };
    // The display ends the session.
    let _ended = role.run(stop).await;
}

/// Sends the parts in order, each after as many shown pictures as there are parts before it.
async fn sends(net: &Arc<dyn Net>, mut link: Link, parts: &[Vec<Bytes>], shown: Option<&AtomicU32>) {
    let Bulk { mut tx, mut rx } = link.bulk.take().unwrap();
    let supply = async {
        if rx.recv().await.is_ok() {
            for (before, part) in (0..).zip(parts) {
                while shown.is_some_and(|shown| shown.load(Ordering::SeqCst) < before) {
                    sleep_until(&**net, net.now().after(Duration::from_millis(1))).await;
                }
                for block in part {
                    if tx.send(block.clone()).await.is_err() {
                        break;
                    }
                }
            }
        }
        while rx.recv().await.is_ok() {}
        pending::<()>().await;
    };
    tokio::select! {
        () = culls(link, if shown.is_some() { 1 } else { u32::MAX }) => {}
        () = supply => {}
    }
}

/// Finds everything visible in this many frames, until the display ends it.
async fn culls(mut link: Link, frames: u32) {
    let rule = settings().lod;
    for sent in 0..frames {
        let Ok(camera) = link.latest_rx.latest().await else { return };
        let ids = lod_cut(&PLANT, &View::new(camera, settings().viewport), rule);
        if send_frame(&mut link, sent, camera, &ids).await.is_none() {
            return;
        }
    }
    while link.messages_rx.recv().await.is_ok() {}
}

fn block(items: &[Supply]) -> Bytes {
    let mut block = Vec::new();
    items.iter().for_each(|item| assert!(put_item(&mut block, item)));
    block.into()
}

fn records(entries: &[DrawableEntry]) -> Supply {
    Supply::Entries { packed: pack_entries(entries).into() }
}

fn part(number: u32, length: u32, offset: u32, part: &'static [u8]) -> Supply {
    Supply::Geometry { number, length, offset, part: Bytes::from_static(part) }
}

#[test]
fn a_culler_that_sends_what_cannot_be_taken_is_let_go_and_the_walk_goes_on() {
    let (whole, _) = WHOLE.walk(&mut TestPath::new(7, 8));
    let entry = DrawableEntry::of(&PLANT, DrawableId(0)).unwrap().unwrap();
    let beyond = DrawableEntry { id: max_frame(&PLANT), ..entry };
    let inside_out = DrawableEntry { world_min: entry.world_max, world_max: entry.world_min, ..entry };
    for (sent, why) in [
        (Bytes::from_static(&[0xff; 9]), "an item of the bulk lane cannot be read"),
        (block(&[Supply::Entries { packed: Bytes::from_static(b"\x01\0no") }]), "cannot be unpacked"),
        (block(&[part(0, 3, 0, b"abc")]), "the geometry 0 is malformed"),
        (block(&[part(0, 9, 3, b"abc")]), "a part of the geometry 0 came where that was not due"),
        (block(&[part(0, u32::MAX, 0, b"abc")]), "is said to have 4294967295 bytes"),
        (block(&[part(u32::MAX, 3, 0, b"abc")]), "it has geometry 4294967295"),
        (block(&[records(&[beyond])]), "it has drawable"),
        (block(&[records(&[inside_out])]), "its box is inside out"),
    ] {
        let cullers = [Far::Sends(vec![sent]), Far::Sound];
        let (pictures, seen) = play(&cullers, &mut TestPath::new(7, 8));
        assert_alike(&pictures, &whole, why);
        let [(0, said)] = &seen.left[..] else { panic!("{why}: {seen:?}") };
        assert!(said.contains("sent geometry that cannot be taken") && said.contains(why), "{said}");
    }
}

#[test]
fn a_display_ends_that_cannot_tell_who_has_sent_it_false_records() {
    let all = (0..max_frame(&PLANT)).filter_map(|id| DrawableEntry::of(&PLANT, DrawableId(id)).unwrap());
    let lies: Vec<_> = all.map(|entry| DrawableEntry { triangles: entry.triangles + 1, ..entry }).collect();
    let sent = lies.chunks(64).map(|lies| block(&[records(lies)])).collect();
    let pace = Pace::Lockstep { frames: Some(8) };
    let cullers = [Far::Sends(sent), Far::Sound];
    let (played, ..) = try_play(&cullers, pace, &mut TestPath::new(7, 8), Seen::default());
    let error = played.unwrap_err();
    assert!(matches!(&error, RoleError::Supplied { cause, .. } if cause.doubts_what_is_there()), "{error:?}");
}

#[test]
fn a_culler_that_sends_nothing_of_what_is_lacking_is_passed_over() {
    let (whole, _) = WHOLE.walk(&mut TestPath::new(7, 8));
    let (pictures, seen) = play(&[Far::Sends(vec![]), Far::Sound], &mut TestPath::new(7, 8));
    assert_alike(&pictures, &whole, "it sends nothing");
    assert!(seen.left.is_empty(), "{seen:?}");
    assert!(seen.by.contains(&Some(0)), "it culls all the same: {seen:?}");
}

#[test]
fn a_culler_of_another_scene_is_let_go() {
    let (whole, _) = WHOLE.walk(&mut TestPath::new(7, 8));
    let (pictures, seen) = play(&[Far::Foreign, Far::Sound], &mut TestPath::new(7, 8));
    assert_alike(&pictures, &whole, "one is of another scene");
    assert_eq!(seen.by, [Some(1)].repeat(8));
}

/// Drawing an empty scene that was given everything equals drawing the whole one.
#[test]
fn a_scene_that_was_given_all_is_drawn_as_the_whole_one() {
    let empty = Scene::empty(PLANT.outline());
    let all: Vec<_> = (0..PLANT.drawables().len() as u32).map(DrawableId).collect();
    for id in &all {
        empty.give(&DrawableEntry::of(&PLANT, *id).unwrap().unwrap()).unwrap();
    }
    for number in 0..PLANT.places().len() as u32 {
        empty.give_geometry(number, PLANT.packed_geometry(number).unwrap().into()).unwrap();
    }
    assert_eq!(empty.outline(), PLANT.outline());
    for id in &all {
        assert_eq!(empty.has(*id), Ok(true));
        let ((ours, node), (theirs, whole)) = (empty.part(*id).unwrap(), PLANT.part(*id).unwrap());
        assert_eq!(ours.level(*id), theirs.level(*id));
        assert_eq!(
            (node.world_box(), node.origin, node.linear),
            (whole.world_box(), whole.origin, whole.linear)
        );
        assert_eq!((ours.triangles, ours.sides), (theirs.triangles, theirs.sides));
        assert_eq!(empty.geometry(ours.geometry).unwrap(), PLANT.geometry(theirs.geometry).unwrap());
    }
    let merged = |id: &DrawableId| PLANT.nodes()[PLANT.drawables()[id.index()].node as usize].objects > 1;
    let (mut levels, mut through) = (0, 0);
    let mut path = TestPath::new(9, 40).with_states(4);
    // All but a few of these are see-through, so that coarse levels are.
    let objects = u32::try_from(PLANT.objects().len()).unwrap();
    for state in path.states.iter_mut().skip(1).step_by(2) {
        let (lod, see_through) = (LodRule::new(30.0).unwrap(), Some((5..objects).collect()));
        *state = Arc::new(ViewState { lod, see_through, ..settings().into() });
    }
    for frame in 0..40 {
        let camera = path.camera(FrameNumber(frame));
        let state = &path.states[camera.view().0 as usize];
        let view = View::of(camera, state);
        let [mut ours, mut theirs] = [all.clone(), all.clone()];
        draw_order(&empty, &view, &mut ours);
        draw_order(&PLANT, &view, &mut theirs);
        assert_eq!(ours, theirs);
        let whole = CutRule::new(&PLANT, state);
        let given = CutRule::new(&empty, state);
        let cut = lod_cut(&PLANT, &view, &whole);
        let [mut ours, mut theirs] = [Vec::new(), Vec::new()];
        assert_eq!(given.divide(&empty, &cut, &mut ours), whole.divide(&PLANT, &cut, &mut theirs));
        assert_eq!(ours, theirs);
        levels += ours.iter().filter(|id| merged(id)).count();
        through += ours.len();
    }
    assert!(levels > 20 && through > 100, "of {through} seen through {levels} are of several objects");
}
