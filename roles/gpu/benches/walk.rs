//! The cost of a walk through a cooked scene: the start, and each role's part of a frame, as CPU time of all
//! threads of the process (Linux), which other programs disturb least. The roles run one after the other, so
//! that their times do not overlap.
//!
//! The same run gives a lower bound: the display draws only the exactly visible set, as with perfect culling,
//! and an empty frame. `cargo bench -p trimaran-gpu --bench walk -- X.scene WALK.json [SIDE [OCCLUDERS]]`,
//! where OCCLUDERS is the budget of triangles for them.

#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "common/cpu.rs"]
mod cpu;

use std::collections::BTreeSet;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use cpu::cpu_ms;
use trimaran_cull::{
    Culler, DepthPyramid, DrawOrder, HzbTest, LodRule, OccluderMapper, OcclusionTest, Outline, TestBox,
    TriangleBudget, View, Viewport, lod_cut, select_occluders,
};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene, ItemImage, ItemPass, OccluderPass, Optional, PicturePass};
use trimaran_proto::{DrawableId, FrameNumber};
use trimaran_scene::{
    Scene,
    path::{Pose, PosePath},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// The default occluder budget of sessions, but in one round.
const OCCLUDERS: u64 = 30_000;
const EPSILON_PX: f64 = 2.0;

fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let [scene, walk, rest @ ..] = words.as_slice() else {
        println!("nothing to measure: name a cooked scene and a walk");
        return Ok(());
    };
    let side: u32 = rest.first().map_or(Ok(1024), |side| side.parse())?;
    let budget = TriangleBudget(rest.get(1).map_or(Ok(OCCLUDERS), |budget| budget.parse())?);
    let views = views(&PosePath::from_json(&std::fs::read_to_string(walk)?)?, Viewport::new(side, side)?)?;
    let mut stages = start(Path::new(scene), budget, views.first().ok_or("an empty walk")?)?;
    let mut table = Table::default();
    for view in &views {
        stages.frame(view, &mut table)?;
    }
    table.print();
    Ok(())
}

fn views(path: &PosePath, size: Viewport) -> Outcome<Vec<View>> {
    let near = path.near().ok_or("the path names no near distance")?;
    let camera = |(pose, frame): (&Pose, u32)| {
        Ok(View::new(pose.camera(path.vfov_deg(), near, FrameNumber(frame))?, size))
    };
    path.frames().iter().zip(0..).map(camera).collect()
}

/// Everything from the program's start to the first picture, each step timed.
fn start(path: &Path, budget: TriangleBudget, first: &View) -> Outcome<Roles> {
    let mut lap = Lap::begin();
    println!("{:<32} {:>9} {:>9}", "start, ms", "cpu", "wall");
    let scene = Arc::new(Scene::open(path)?);
    lap.print("open the scene");
    let gpu = Gpu::open(&GpuOptions::default())?;
    lap.print("open a device");
    let drawn = GpuScene::new(&gpu, &scene)?;
    lap.print("give it the scene");
    let mut roles = Roles::new(scene, &drawn, budget, first)?;
    lap.print("make the passes");
    roles.frame(first, &mut Table::default())?;
    lap.print("first frame, all passes twice");
    println!(
        "{}: {} bytes of geometry on the device\n",
        gpu.info().driver,
        drawn.working_set().resident_bytes
    );
    Ok(roles)
}

/// The three roles, and the item pass (ID buffer) for the exactly visible set.
struct Roles {
    scene: Arc<Scene>,
    drawn: Arc<GpuScene>,
    rule: LodRule,
    budget: TriangleBudget,
    occluders: OccluderPass,
    pictures: PicturePass,
    items: ItemPass,
    pyramid: DepthPyramid,
    culler: Culler,
    mapper: OccluderMapper,
    order: DrawOrder,
    visible: Vec<DrawableId>,
}

impl Roles {
    fn new(scene: Arc<Scene>, drawn: &Arc<GpuScene>, budget: TriangleBudget, first: &View) -> Outcome<Self> {
        let (size, rule) = (first.viewport(), LodRule::new(EPSILON_PX)?);
        Ok(Self {
            occluders: OccluderPass::new(drawn, size)?,
            pictures: PicturePass::new(drawn, size)?,
            items: ItemPass::new(drawn, size)?,
            pyramid: DepthPyramid::default(),
            culler: Culler::new(Arc::clone(&scene)),
            mapper: OccluderMapper::new(Arc::clone(&scene), *first, rule),
            order: DrawOrder::default(),
            visible: Vec::new(),
            scene,
            drawn: Arc::clone(drawn),
            rule,
            budget,
        })
    }

    fn frame(&mut self, view: &View, table: &mut Table) -> Outcome<()> {
        let (mut lap, mut whole) = (Lap::begin(), Lap::begin());
        let due = self.due(view)?;
        table.add("OR, choosing: cpu ms", lap.cpu());
        self.occluders.begin(view)?;
        self.occluders.draw(&due)?;
        self.occluders.finish()?;
        table.add("OR, drawing: cpu ms", lap.cpu());
        self.pyramid.rebuild(self.occluders.read_depth()?);
        table.add("OR, pyramid: cpu ms", lap.cpu());
        let mut occlusion_test = HzbTest::new(self.occluders.read_depth()?, &self.pyramid)?;
        let visible = &mut self.visible;
        visible.clear();
        self.culler.cull(view, self.rule, &mut occlusion_test, |ids| visible.extend_from_slice(ids))?;
        table.add("HC: wall ms", lap.wall());
        table.add("HC: cpu ms", lap.cpu());
        self.cull_on_device(view, table)?;
        lap = Lap::begin();
        self.order.sort(&self.scene, view, &mut self.visible);
        table.add("RVG, sorting: cpu ms", lap.cpu());
        let all = std::mem::take(&mut self.visible);
        self.picture(view, &all)?;
        table.add("RVG, drawing: cpu ms", lap.cpu());
        table.add("all roles: cpu ms", whole.cpu());

        let (exact, exact_triangles) = self.exactly_visible(view, &all)?;
        lap = Lap::begin();
        self.picture(view, &exact)?;
        table.add("floor: RVG of the exactly visible: cpu ms", lap.cpu());
        self.picture(view, &[])?;
        table.add("floor: RVG of nothing: cpu ms", lap.cpu());
        table.add("nodes drawn", all.len() as f64);
        table.add("nodes exactly visible", exact.len() as f64);
        table.add("triangles drawn", self.triangles(&all));
        table.add("triangles of the exactly visible", self.triangles(&exact));
        table.add("triangles exactly visible", exact_triangles as f64);
        table.add("occluder triangles", self.triangles(&due));
        self.visible = all;
        Ok(())
    }

    /// The occluders of a frame, from the last visible set.
    fn due(&mut self, view: &View) -> Outcome<Vec<DrawableId>> {
        let mut due = Vec::new();
        self.mapper.begin(*view, self.rule);
        self.mapper.push(&self.visible, &mut due)?;
        let jumped = 2 * due.len() <= self.visible.len();
        if jumped {
            due = lod_cut(&self.scene, view, self.rule);
            select_occluders(&self.scene, view, &mut due, self.budget);
        } else {
            let budget = self.budget.among(&self.scene, &due);
            select_occluders(&self.scene, view, &mut due, budget);
        }
        Ok(due)
    }

    /// HC again on the device: level by level, and the whole tree at once. All give the same.
    fn cull_on_device(&mut self, view: &View, table: &mut Table) -> Outcome<()> {
        let Self { culler, occluders, rule, visible, .. } = self;
        if self.drawn.gpu().info().lacks.contains(&Optional::Float64) {
            return Ok(());
        }
        let mut test = occluders.hzb_test()?;
        let mut lap = Lap::begin();
        let mut found = Vec::new();
        culler.cull(view, *rule, &mut LevelByLevel(&mut test), |ids| found.extend_from_slice(ids))?;
        table.add("HC, level by level on the device: wall ms", lap.wall());
        table.add("HC, level by level on the device: cpu ms", lap.cpu());
        let is_same = found == *visible;
        found.clear();
        lap = Lap::begin();
        culler.cull(view, *rule, &mut test, |ids| found.extend_from_slice(ids))?;
        table.add("HC, the whole tree on the device: wall ms", lap.wall());
        table.add("HC, the whole tree on the device: cpu ms", lap.cpu());
        if is_same && found == *visible { Ok(()) } else { Err("the device culls differently".into()) }
    }

    fn picture(&mut self, view: &View, ids: &[DrawableId]) -> Outcome<()> {
        self.pictures.begin(view)?;
        self.pictures.draw(ids)?;
        self.pictures.finish()?;
        Ok(())
    }

    /// Those of `ids` that are visible at a pixel, in their order, and how many triangles are.
    fn exactly_visible(&mut self, view: &View, ids: &[DrawableId]) -> Outcome<(Vec<DrawableId>, usize)> {
        self.items.begin(view)?;
        self.items.draw(ids)?;
        self.items.finish()?;
        let items = self.items.items()?.iter().filter(|[drawable, _]| *drawable != ItemImage::BACKGROUND);
        let triangles: BTreeSet<[u32; 2]> = items.copied().collect();
        let drawables: BTreeSet<u32> = triangles.iter().map(|[drawable, _]| *drawable).collect();
        let exact = ids.iter().copied().filter(|id| drawables.contains(&id.0)).collect();
        Ok((exact, triangles.len()))
    }

    fn triangles(&self, ids: &[DrawableId]) -> f64 {
        let drawables = self.scene.drawables();
        ids.iter().map(|id| f64::from(drawables[id.index()].triangles)).sum()
    }
}

/// The same test without its own traversal.
struct LevelByLevel<'t, T>(&'t mut T);

impl<T: OcclusionTest> OcclusionTest for LevelByLevel<'_, T> {
    type Error = T::Error;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), T::Error> {
        self.0.test(view, boxes, visible)
    }

    fn outline(&self) -> Outline {
        self.0.outline()
    }
}

/// One line per figure, one value per frame.
#[derive(Default)]
struct Table {
    lines: Vec<(&'static str, Vec<f64>)>,
}

impl Table {
    fn add(&mut self, name: &'static str, value: f64) {
        match self.lines.iter_mut().find(|(known, _)| *known == name) {
            Some((_, values)) => values.push(value),
            None => self.lines.push((name, vec![value])),
        }
    }

    fn print(mut self) {
        println!("{:<44} {:>9} {:>9} {:>9}", "a frame", "median", "mean", "p95");
        for (name, values) in &mut self.lines {
            values.sort_by(f64::total_cmp);
            let count = values.len();
            let mean = values.iter().sum::<f64>() / count as f64;
            println!("{name:<44} {:>9.2} {mean:>9.2} {:>9.2}", values[count / 2], values[count * 95 / 100]);
        }
    }
}

/// Time since the last lap.
struct Lap {
    cpu: f64,
    wall: Instant,
}

impl Lap {
    fn begin() -> Self {
        Self { cpu: cpu_ms(), wall: Instant::now() }
    }

    /// CPU milliseconds of the lap, and the next begins.
    fn cpu(&mut self) -> f64 {
        let ended = std::mem::replace(self, Self::begin());
        self.cpu - ended.cpu
    }

    /// Wall milliseconds of the lap so far.
    fn wall(&self) -> f64 {
        self.wall.elapsed().as_secs_f64() * 1e3
    }

    fn print(&mut self, name: &str) {
        let ended = std::mem::replace(self, Self::begin());
        let wall = (self.wall - ended.wall).as_secs_f64() * 1e3;
        println!("{name:<32} {:>9.1} {wall:>9.1}", self.cpu - ended.cpu);
    }
}
