//! A display that culls for itself draws all that is in the frustum where occlusion culling costs more, and
//! the pictures are the same.

use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock},
    thread,
    time::Duration,
};

use glam::{DVec3, Vec3};
use trimaran_actors::{
    BoxedError, Cameras, CullerDevice, LocalSession, Observer, Pace, ShownFrame, Stop, Turns,
};
use trimaran_audit::cases::{Mesh, Object, build};
use trimaran_cull::{Answer, DepthImage, OcclusionTest, TestBox, View, Viewport, lod_cut};
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, LodRule, Settings};
use trimaran_scene::Scene;

use crate::{
    common::{Broken, play, runtime, turned},
    supply::{Cpu, EPSILON_PX, PLANT, Picture, SIDE, Screen, TestPath, settings},
};

const FRAMES: u32 = 60;

/// Boxes in layers, of which the first hides no part of another one, and a wall before them from the left to
/// `right`.
fn boxes(layers: u8, right: Option<f32>) -> Arc<Scene> {
    let mut objects = Vec::new();
    for (layer, row, column) in
        (0..layers).flat_map(|layer| (0..100_u8).map(move |place| (layer, place / 10, place % 10)))
    {
        let at = DVec3::new(f64::from(column) - 4.5, f64::from(row) - 4.5, -20.0 - f64::from(layer));
        objects.push(Object::new(Mesh::cuboid(Vec3::splat(-0.3), Vec3::splat(0.3), 2)).at(at));
    }
    if let Some(right) = right {
        objects.push(Object::new(Mesh::cuboid(Vec3::new(-9.0, -9.0, -4.1), Vec3::new(right, 9.0, -4.0), 1)));
    }
    Arc::new(build(&objects, true).unwrap())
}

static OPEN: LazyLock<Arc<Scene>> = LazyLock::new(|| boxes(1, None));
static WALLED: LazyLock<Arc<Scene>> = LazyLock::new(|| boxes(20, Some(9.0)));

/// Turns slowly to and fro.
fn looking_about(frame: FrameNumber) -> Camera {
    turned([0.0; 3], 0.04 * (0.3 * f64::from(frame.0)).sin(), 0.3, frame)
}

/// The pictures of a display, and the frames that it did not cull by occlusion.
#[derive(Debug, Default)]
struct Walk {
    ids: Vec<Vec<DrawableId>>,
    stats: BTreeMap<u32, FrameStats>,
    pictures: Vec<Picture>,
}

impl Observer for Walk {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.ids.push(frame.ids.to_vec());
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.stats.insert(stats.frame.0, *stats);
    }
}

impl Walk {
    fn of(scene: &Arc<Scene>, settings: Settings, frames: u32, cameras: &mut dyn Cameras) -> Self {
        let pictures = Arc::default();
        let screen = Screen { scene: Arc::clone(scene), pictures: Arc::clone(&pictures) };
        let session = LocalSession { cullers: 0, ..LocalSession::new(scene, settings, frames) };
        let mut walk = Self::default();
        play(session, |_| Cpu::new(scene, None), screen, cameras, &mut walk);
        assert_eq!((walk.ids.len(), walk.stats.len()), (frames as usize, frames as usize));
        walk.pictures = std::mem::take(&mut pictures.lock());
        walk
    }

    /// For each frame whether all that was in the frustum was drawn.
    fn in_frustum(&self) -> Vec<bool> {
        self.stats.values().map(|stats| stats.culling.visited == 0).collect()
    }
}

fn cut(scene: &Scene, camera: &Camera) -> Vec<DrawableId> {
    let mut cut = lod_cut(
        scene,
        &View::new(*camera, Viewport::new(SIDE, SIDE).unwrap()),
        LodRule::new(EPSILON_PX).unwrap(),
    );
    cut.sort_unstable();
    cut
}

#[test]
fn where_nothing_is_hidden_all_that_is_in_the_frustum_is_drawn() {
    let walk = Walk::of(&OPEN, settings(), FRAMES, &mut looking_about);
    let in_frustum = walk.in_frustum();
    assert!(in_frustum[..8].iter().all(|whole| !whole), "the first frames are culled");
    assert!(in_frustum[11..19].iter().all(|whole| *whole), "{in_frustum:?}");
    let culled = in_frustum.iter().skip(11).filter(|whole| !**whole).count();
    assert!((1..8).contains(&culled), "occlusion culling is tried now and then: {in_frustum:?}");
    for (number, stats) in walk.stats.iter().filter(|(_, stats)| stats.culling.visited == 0) {
        let mut ids = walk.ids[*number as usize].clone();
        ids.sort_unstable();
        assert_eq!(ids, cut(&OPEN, &looking_about(FrameNumber(*number))), "frame {number}");
        assert_eq!((stats.occluders, stats.culling.emitted as usize), (0, ids.len()));
        let source = walk.stats.get(&(number + 1)).and_then(|next| next.occluders_of);
        assert_eq!(source, None, "frame {number} is no frame's source of occluders");
    }
}

#[test]
fn where_nearly_all_is_hidden_each_frame_is_culled() {
    let walk = Walk::of(&WALLED, settings(), FRAMES, &mut looking_about);
    assert_eq!(walk.in_frustum(), [false; FRAMES as usize]);
    assert!(walk.ids[1..].iter().all(|ids| ids.len() == 1), "the wall");
}

#[test]
fn in_lockstep_equal_walks_draw_equal_ids() {
    for scene in [&*OPEN, &*WALLED, &*PLANT] {
        let ids = || Walk::of(scene, settings(), FRAMES, &mut looking_about).ids;
        assert_eq!(ids(), ids());
    }
}

/// With jumps, hidden and see-through objects, sections, and pictures of other sizes.
#[test]
fn pictures_are_those_of_the_lod_cut_in_either_mode() {
    let mut modes = Vec::new();
    for seed in 0..4 {
        let mut path = TestPath::new(seed, FRAMES as usize);
        if seed % 2 == 1 {
            path = path.with_states(seed);
        }
        let walk = Walk::of(&PLANT, settings(), FRAMES, &mut path);
        modes.extend(walk.in_frustum());
        for picture in &walk.pictures {
            assert!(*picture == path.exact(picture.camera), "seed {seed}, {:?}", picture.camera);
        }
    }
    let in_frustum = modes.iter().filter(|whole| **whole).count();
    assert!((20..modes.len() - 20).contains(&in_frustum), "{modes:?}");
}

#[test]
fn a_set_that_stops_at_few_pixels_is_always_culled() {
    let few = LodRule::new(EPSILON_PX).unwrap().stopping_at_few_pixels(true);
    let walk = Walk::of(&OPEN, Settings { lod: few, ..settings() }, FRAMES, &mut looking_about);
    assert_eq!(walk.in_frustum(), [false; FRAMES as usize]);
}

/// A device whose occluders take long, whatever is drawn.
struct Slow(Cpu);

impl OcclusionTest for Slow {
    type Error = Broken;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Broken> {
        self.0.test(view, boxes, visible)
    }

    fn answer(&self) -> Answer {
        self.0.answer()
    }
}

impl CullerDevice for Slow {
    fn begin_occluders(&mut self, view: &View) -> Result<(), Broken> {
        self.0.begin_occluders(view)
    }

    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Broken> {
        self.0.draw_occluders(ids)
    }

    fn finish_occluders(&mut self) -> Result<(), Broken> {
        thread::sleep(Duration::from_millis(50));
        self.0.finish_occluders()
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Broken> {
        self.0.read_depth()
    }
}

/// Walks by the clock until a frame was not culled, and the one after the trial neither.
struct Until {
    looked: u32,
    in_frustum: Arc<parking_lot::Mutex<u32>>,
}

impl Cameras for Until {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.looked += 1;
        assert!(self.looked < 10_000, "the clock decides nothing");
        looking_about(FrameNumber(self.looked)).for_frame(frame)
    }

    fn is_over(&self) -> bool {
        *self.in_frustum.lock() > 6
    }
}

impl Observer for Until {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        let mut seen = self.in_frustum.lock();
        *seen = if stats.culling.visited == 0 { *seen + 1 } else { 0 };
    }
}

/// By counts alone these walks are culled.
#[test]
fn live_the_clock_decides() {
    let scene = boxes(1, Some(0.0));
    let walk = Walk::of(&scene, settings(), FRAMES, &mut looking_about);
    let culled = walk.in_frustum().into_iter().filter(|whole| !whole).count();
    assert!(culled > FRAMES as usize / 2, "{:?}", walk.in_frustum());

    let in_frustum = Arc::default();
    let until = || Until { looked: 0, in_frustum: Arc::clone(&in_frustum) };
    let session = LocalSession {
        cullers: 0,
        pace: Pace::Live,
        turns: Turns::at_once(),
        ..LocalSession::new(&scene, settings(), 0)
    };
    let screen = Screen { scene: Arc::clone(&scene), pictures: Arc::default() };
    let ((_stopper, stop), runtime) = (Stop::new(), runtime());
    let device = |_| Ok(Slow(Cpu::new(&scene, None)));
    session.run(device, screen, &mut until(), &mut until(), runtime.handle(), &stop).unwrap();
}
