//! Whether culling ever changes a pixel: random poses near those of automatic paths, culled by sets that are
//! some frames old, for as long as one likes.
//!
//! `cargo bench --bench exactness -- X.scene [SECONDS [SIDE [SEED]]]`: 60 s at 512 pixels a side, if not
//! given. A frame with a wrong pixel is told with its pose, and culled once more. Each wrong pixel is held
//! against f64: where that shows what culling has left, the driver has drawn something in front of what hides
//! it.
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

use std::{collections::BTreeMap, error::Error, path::Path, sync::Arc, time::Instant};

use glam::{DQuat, DVec3};
use trimaran::vulkan::VulkanCuller;
use trimaran_actors::{CullerDevice, OccluderPolicy};
use trimaran_audit::{CulledFrame, Missing, Placement, causes, rasterize};
use trimaran_cull::{Culler, LodRule, View, Viewport, draw_order, lod_cut, occluder_bias_px};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene, ItemImage, ItemPass, PicturePass};
use trimaran_proto::{Camera, DrawableId, FrameNumber, OcclusionTestKind};
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, auto},
    random::Random,
};

type Outcome<T> = Result<T, Box<dyn Error>>;

const EPSILON_PX: f64 = 2.0;
/// Frames of a path.
const FRAMES: u32 = 120;
/// The oldest set that a frame is culled by, in frames.
const OLDEST: usize = 8;

fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let [scene, rest @ ..] = words.as_slice() else {
        println!(
            "skipped: give a cooked scene: cargo bench --bench exactness -- X.scene [SECONDS [SIDE [SEED]]]"
        );
        return Ok(());
    };
    let number = |place: usize, usual: u32| rest.get(place).map_or(Ok(usual), |word| word.parse());
    let (seconds, side, first) = (number(0, 60)?, number(1, 512)?, number(2, 1)?);
    let size = Viewport::new(side, side)?;
    let mut walk = Walk::new(Arc::new(Scene::open(Path::new(scene))?), size)?;
    let (begun, mut seed) = (Instant::now(), u64::from(first));
    while begun.elapsed().as_secs() < seconds.into() {
        walk.path(seed, size)?;
        seed += 1;
    }
    println!("| frames | wrong frames | of them wrong once more | wrong pixels | right in f64 | of pixels |");
    println!("|---|---|---|---|---|---|");
    let Counts { frames, wrong, again, pixels, right } = walk.counts;
    let all = frames * u64::from(side) * u64::from(side);
    println!("| {frames} | {wrong} | {again} | {pixels} | {right} | {all} |");
    Ok(())
}

#[derive(Default)]
struct Counts {
    frames: u64,
    wrong: u64,
    again: u64,
    pixels: u64,
    /// Wrong pixels that show what f64 shows of the whole cut.
    right: u64,
}

struct Walk {
    scene: Arc<Scene>,
    rule: LodRule,
    culler: Culler,
    device: VulkanCuller,
    pictures: PicturePass,
    items: ItemPass,
    counts: Counts,
}

impl Walk {
    fn new(scene: Arc<Scene>, size: Viewport) -> Outcome<Self> {
        let drawn = GpuScene::new(&Gpu::open(&GpuOptions::default())?, &scene)?;
        Ok(Self {
            rule: LodRule::new(EPSILON_PX)?,
            culler: Culler::new(Arc::clone(&scene)),
            device: VulkanCuller::new(&drawn, size, OcclusionTestKind::Hzb)?,
            pictures: PicturePass::new(&drawn, size)?,
            items: ItemPass::new(&drawn, size)?,
            counts: Counts::default(),
            scene,
        })
    }

    /// One path, each of its poses a little beside where it was.
    fn path(&mut self, seed: u64, size: Viewport) -> Outcome<()> {
        let options = AutoPathOptions { seed, frames: FRAMES, ..AutoPathOptions::default() };
        let path = auto(&self.scene, &options)?.path;
        let near = path.near().ok_or("the path names no near distance")?;
        let mut random = Random::new(seed);
        let mut sets: Vec<Vec<DrawableId>> = Vec::new();
        for (number, pose) in path.frames().iter().enumerate() {
            let camera = pose.camera(path.vfov_deg(), near, FrameNumber(number as u32))?;
            let view = View::new(beside(&camera, &mut random)?, size);
            let age = 1 + random.below(OLDEST);
            let last =
                sets.len().checked_sub(age).and_then(|place| sets.get(place)).cloned().unwrap_or_default();
            let (visible, pixels) = self.frame(&view, &last)?;
            self.counts.frames += 1;
            if pixels > 0 {
                let (_, again) = self.frame(&view, &last)?;
                println!(
                    "{pixels} pixels wrong, once more {again}: seed {seed}, age {age}, {:?}",
                    view.camera()
                );
                self.explain(&view, &last)?;
                self.counts.wrong += 1;
                self.counts.again += u64::from(again > 0);
                self.counts.pixels += pixels;
            }
            sets.push(visible);
        }
        Ok(())
    }

    /// The visible set found, and how many pixels differ from the picture without culling.
    fn frame(&mut self, view: &View, last: &[DrawableId]) -> Outcome<(Vec<DrawableId>, u64)> {
        let policy = OccluderPolicy::default();
        let culled = policy.cull(&mut self.culler, &mut self.device, view, &self.rule.into(), last)?;
        let mut cut = lod_cut(&self.scene, view, self.rule);
        draw_order(&self.scene, view, &mut cut);
        let whole = self.picture(view, &cut)?;
        let mut drawn = culled.visible.clone();
        draw_order(&self.scene, view, &mut drawn);
        let shown = self.picture(view, &drawn)?;
        Ok((culled.visible, whole.iter().zip(&shown).filter(|(a, b)| a != b).count() as u64))
    }

    /// Says what is missing, and why.
    fn explain(&mut self, view: &View, last: &[DrawableId]) -> Outcome<()> {
        let (policy, rule) = (OccluderPolicy::default(), self.rule.into());
        let culled = policy.cull(&mut self.culler, &mut self.device, view, &rule, last)?;
        let depth = self.device.read_depth()?.depth().to_vec();
        let mut cut = lod_cut(&self.scene, view, self.rule);
        draw_order(&self.scene, view, &mut cut);
        let mut drawn = culled.visible.clone();
        draw_order(&self.scene, view, &mut drawn);
        let mut missing: BTreeMap<DrawableId, Vec<usize>> = BTreeMap::new();
        let [whole, shown] = [self.items(view, &cut)?, self.items(view, &drawn)?];
        let exact = rasterize(&self.scene, view, cut.iter().copied(), Placement::Exact);
        for (pixel, (owner, other)) in whole.iter().zip(&shown).enumerate().filter(|(_, (a, b))| a != b) {
            let right =
                exact.ids()[pixel].map_or([ItemImage::BACKGROUND; 2], |id| [id.drawable.0, id.triangle]);
            println!("  pixel {pixel} shows {other:?} instead of {owner:?}; {right:?} in f64");
            self.counts.right += u64::from(right == *other);
            if owner[0] != ItemImage::BACKGROUND && !drawn.contains(&DrawableId(owner[0])) {
                missing.entry(DrawableId(owner[0])).or_default().push(pixel);
            }
        }
        let missing: Vec<_> = missing.into_iter().map(|(id, pixels)| Missing { id, pixels }).collect();
        let frame = CulledFrame {
            scene: &self.scene,
            view,
            rule: &rule,
            occluders: &culled.occluders,
            depth: &depth,
            sent: None,
            drawn: &drawn,
            bias_px: occluder_bias_px(view),
            before: &[],
        };
        let causes = causes(&frame, &mut self.device, &missing)?;
        for (missing, cause) in missing.iter().zip(causes) {
            println!("  {}: {cause:?}, {} rounds", missing.id, culled.rounds);
            // The depth that the device draws there of it alone, and the right one.
            self.picture(view, &[missing.id])?;
            let own = self.pictures.read_depth()?.depth().to_vec();
            let right = rasterize(&self.scene, view, [missing.id], Placement::Exact).depth32();
            for &pixel in &missing.pixels {
                let [tested, own, right] = [&depth, &own, &right].map(|depth| depth[pixel]);
                println!("    depth there: {own} of it alone, {right} in f64; tested against {tested}");
            }
        }
        Ok(())
    }

    fn items(&mut self, view: &View, ids: &[DrawableId]) -> Outcome<Vec<[u32; 2]>> {
        self.items.begin(view)?;
        self.items.draw(ids)?;
        self.items.finish()?;
        Ok(self.items.items()?.to_vec())
    }

    fn picture(&mut self, view: &View, ids: &[DrawableId]) -> Outcome<Vec<[u8; 4]>> {
        self.pictures.begin(view)?;
        self.pictures.draw(ids)?;
        self.pictures.finish()?;
        Ok(self.pictures.pixels()?.to_vec())
    }
}

/// The camera moved by up to 20 cm, and turned by up to a tenth of a radian.
fn beside(camera: &Camera, random: &mut Random) -> Outcome<Camera> {
    let eye = DVec3::from_array(camera.eye()) + random.direction() * random.between(0.0, 0.2);
    let turn = DQuat::from_axis_angle(random.direction(), random.between(0.0, 0.1));
    let orientation = (turn * DQuat::from_array(camera.orientation())).normalize();
    let (tan, near) = (camera.tan_half_fov_y(), camera.near());
    Ok(Camera::new(eye.to_array(), orientation.to_array(), tan, near, camera.frame())?)
}
