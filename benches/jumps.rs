//! The set that culling leaves after a jump, and once the camera has stood still: a camera jumps from place
//! to place, and stands still for three frames at each.
//!
//! The places are those of seeded automatic paths. Beside what is drawn stands what is exactly visible at the
//! same LOD cut. That all of it is drawn is asserted in every frame, but for what f64 does not show anywhere:
//! a driver may draw a triangle that is seen edge on in front of its own box. Times are CPU time of all
//! threads of the process (Linux), one role after the other.
//!
//! `cargo bench --bench jumps -- X.scene [PLACES [SIDE]]`

#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

use std::{collections::HashSet, error::Error, path::Path, sync::Arc};

use trimaran::{vulkan::VulkanCuller, walkthrough::count_objects};
use trimaran_actors::OccluderPolicy;
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{Culler, DrawOrder, LodRule, View, Viewport, lod_cut, triangles};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene, ItemImage, ItemPass, PicturePass};
use trimaran_proto::{DrawableId, FrameNumber, OcclusionTestKind};
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, auto},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

const EPSILON_PX: f64 = 2.0;
/// Frames at a place.
const FRAMES: usize = 3;

fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let [scene, rest @ ..] = words.as_slice() else {
        println!("nothing to measure: name a cooked scene");
        return Ok(());
    };
    let places = rest.first().map_or(Ok(10), |places| places.parse())?;
    let side = rest.get(1).map_or(Ok(1024), |side| side.parse())?;
    let scene = Arc::new(Scene::open(Path::new(scene))?);
    let views = views(&scene, Viewport::new(side, side)?, places)?;
    let mut roles = Roles::new(scene, views.first().ok_or("no places")?)?;
    let mut tables: [Table; FRAMES] = Default::default();
    for view in &views {
        let exact = roles.exactly_visible(view)?;
        for table in &mut tables {
            roles.frame(view, &exact, table)?;
        }
    }
    for (frame, table) in tables.into_iter().enumerate() {
        table.print(if frame == 0 { "after a jump".into() } else { format!("still for {frame} frames") });
    }
    Ok(())
}

/// Two places a seed.
fn views(scene: &Scene, size: Viewport, places: usize) -> Outcome<Vec<View>> {
    let mut views = Vec::new();
    for seed in 1..=places.div_ceil(2) as u64 {
        let path = auto(scene, &AutoPathOptions { seed, frames: 2, ..AutoPathOptions::default() })?.path;
        let near = path.near().ok_or("the path names no near distance")?;
        for pose in path.frames() {
            views.push(View::new(pose.camera(path.vfov_deg(), near, FrameNumber(0))?, size));
        }
    }
    views.truncate(places);
    Ok(views)
}

/// The owners of pixels at the LOD cut, drawn without culling.
struct Exact {
    drawables: Vec<DrawableId>,
    triangles: usize,
}

struct Roles {
    scene: Arc<Scene>,
    rule: LodRule,
    culler: Culler,
    device: VulkanCuller,
    items: ItemPass,
    pictures: PicturePass,
    order: DrawOrder,
    visible: Vec<DrawableId>,
}

impl Roles {
    fn new(scene: Arc<Scene>, first: &View) -> Outcome<Self> {
        let drawn = GpuScene::new(&Gpu::open(&GpuOptions::default())?, &scene)?;
        let size = first.viewport();
        let mut roles = Self {
            rule: LodRule::new(EPSILON_PX)?,
            culler: Culler::new(Arc::clone(&scene)),
            device: VulkanCuller::new(&drawn, size, OcclusionTestKind::Hzb)?,
            items: ItemPass::new(&drawn, size)?,
            pictures: PicturePass::new(&drawn, size)?,
            order: DrawOrder::default(),
            visible: Vec::new(),
            scene,
        };
        // The driver makes its shaders now.
        let exact = roles.exactly_visible(first)?;
        roles.frame(first, &exact, &mut Table::default())?;
        roles.visible.clear();
        Ok(roles)
    }

    fn exactly_visible(&mut self, view: &View) -> Outcome<Exact> {
        let mut cut = lod_cut(&self.scene, view, self.rule);
        self.order.sort(&self.scene, view, &mut cut);
        self.items.begin(view)?;
        self.items.draw(&cut)?;
        self.items.finish()?;
        let items = self.items.items()?.iter().filter(|[drawable, _]| *drawable != ItemImage::BACKGROUND);
        let triangles: HashSet<[u32; 2]> = items.copied().collect();
        let drawables: HashSet<u32> = triangles.iter().map(|[drawable, _]| *drawable).collect();
        let drawables = drawables.into_iter().map(DrawableId).collect();
        Ok(Exact { drawables, triangles: triangles.len() })
    }

    fn frame(&mut self, view: &View, exact: &Exact, table: &mut Table) -> Outcome<()> {
        let before = cpu_ms();
        let policy = OccluderPolicy::default();
        let culled =
            policy.cull(&mut self.culler, &mut self.device, view, &self.rule.into(), &self.visible)?;
        let found = cpu_ms();
        self.visible = culled.visible;
        self.order.sort(&self.scene, view, &mut self.visible);
        self.pictures.begin(view)?;
        self.pictures.draw(&self.visible)?;
        self.pictures.finish()?;
        let drawn = cpu_ms();

        let visible: HashSet<DrawableId> = self.visible.iter().copied().collect();
        let missing = exact.drawables.iter().filter(|id| !visible.contains(id)).copied();
        self.assert_hidden(view, &missing.collect::<Vec<_>>());
        let objects = |ids: &[DrawableId]| count_objects(&self.scene, ids.iter().copied()) as f64;
        let drawn_triangles = triangles(&self.scene, &self.visible) as f64;
        let visible_triangles = triangles(&self.scene, &exact.drawables) as f64;
        let seen = exact.triangles as f64;
        table.add("objects over exactly visible", objects(&self.visible) / objects(&exact.drawables));
        table.add("nodes over exactly visible", visible.len() as f64 / exact.drawables.len() as f64);
        table.add("triangles over exactly visible", drawn_triangles / seen);
        table.add("the same of exactly visible nodes", visible_triangles / seen);
        table.add("triangles drawn, thousands", drawn_triangles / 1e3);
        table.add("rounds", culled.rounds.into());
        table.add("occluder triangles, thousands", triangles(&self.scene, &culled.occluders) as f64 / 1e3);
        table.add("boxes tested", culled.stats.counts.tested.into());
        table.add("boxes tested again", culled.stats.tested_again.into());
        table.add("OR + HC: cpu ms", found - before);
        table.add("RVG: cpu ms", drawn - found);
        table.add("all: cpu ms", drawn - before);
        Ok(())
    }

    /// Asserts that f64 shows nothing of what the device shows and culling left out.
    fn assert_hidden(&self, view: &View, missing: &[DrawableId]) {
        if missing.is_empty() {
            return;
        }
        let cut = lod_cut(&self.scene, view, self.rule);
        let exact = rasterize(&self.scene, view, cut, Placement::Exact);
        let shown: HashSet<DrawableId> = exact.ids().iter().flatten().map(|id| id.drawable).collect();
        let lost: Vec<_> = missing.iter().filter(|id| shown.contains(id)).collect();
        assert!(lost.is_empty(), "{lost:?} are visible and were not drawn: {:?}", view.camera());
    }
}

/// A line a figure, a value a place.
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

    fn print(self, title: String) {
        println!("{title:<36} {:>9} {:>9} {:>9} {:>11}", "median", "mean", "p99", "p99/median");
        for (name, mut values) in self.lines {
            values.sort_by(f64::total_cmp);
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let (median, p99) = (values[values.len() / 2], values[values.len() * 99 / 100]);
            let ratio = p99 / median;
            println!("{name:<36} {median:>9.2} {mean:>9.2} {p99:>9.2} {ratio:>11.2}");
        }
        println!();
    }
}

/// Milliseconds of CPU time of all threads of this process so far; 0 where the system does not tell.
fn cpu_ms() -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = threads.filter_map(|thread| {
        let times = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        times.split_whitespace().next()?.parse::<f64>().ok()
    });
    nanoseconds.sum::<f64>() / 1e6
}
