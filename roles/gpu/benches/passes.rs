//! The cost of passes and occlusion tests, against triangles, draws and boxes: medians in milliseconds, as
//! one table. `cpu` sums all threads of the process (Linux): on a CPU driver it is the most reliable figure,
//! least disturbed by other programs.
//!
//! The scene is a cloud of spheres that share one mesh per size, all in view and of some 3 pictures' area
//! together (overdraw 3), drawn from near to far. `cargo bench -p trimaran-gpu` runs all; a word after `--`
//! runs the lines that contain it.

#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "common/cpu.rs"]
mod cpu;

use std::error::Error;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;
use std::time::Instant;

use cpu::cpu_ms;
use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::{DepthPyramid, HzbTest, OcclusionTest, TestBox, View, Viewport};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene, ItemPass, OccluderPass, Optional, PassTiming, PicturePass};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_scene::{FlatObject, Rgba8, Scene, SceneArrays, random::Random};

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let wanted = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
    let gpu = Gpu::open(&GpuOptions::default())?;
    println!("{} ({})", gpu.info().name, gpu.info().driver);
    println!("{:<44} {:>9} {:>9} {:>9} {:>9}", "median of 9, ms", "cpu", "device", "wall", "host");
    for (draws, triangles) in [(100, 1000), (1000, 100), (1000, 1000), (4000, 25), (4000, 250), (10_000, 12)]
    {
        let scene = Arc::new(cloud(draws, triangles)?);
        let uploaded = GpuScene::new(&gpu, &scene)?;
        for side in [512, 1024] {
            let label = format!("{} triangles in {draws} draws at {side}", triangles * draws);
            time_passes(&uploaded, &label, view(side)?, draws, &wanted)?;
        }
    }
    let scene = GpuScene::new(&gpu, &Arc::new(cloud(100, 1000)?))?;
    for (boxes, edge_px) in [(1000, 4.0), (1000, 32.0), (10_000, 4.0), (10_000, 32.0)] {
        time_occlusion_tests(&scene, boxes, edge_px, &wanted)?;
    }
    Ok(())
}

fn time_passes(scene: &Arc<GpuScene>, label: &str, view: View, draws: u32, wanted: &str) -> Outcome<()> {
    let ids: Vec<_> = (0..draws).map(DrawableId).collect();
    let mut occluders = OccluderPass::new(scene, view.viewport())?;
    report(wanted, &format!("depth   {label}"), || {
        occluders.begin(&view)?;
        occluders.draw(&ids)?;
        Ok(occluders.finish()?)
    })?;
    let mut pictures = PicturePass::new(scene, view.viewport())?;
    report(wanted, &format!("picture {label}"), || {
        pictures.begin(&view)?;
        pictures.draw(&ids)?;
        Ok(pictures.finish()?)
    })?;
    let mut items = ItemPass::new(scene, view.viewport())?;
    report(wanted, &format!("items   {label}"), || {
        items.begin(&view)?;
        items.draw(&ids)?;
        Ok(items.finish()?)
    })
}

fn time_occlusion_tests(scene: &Arc<GpuScene>, count: usize, edge_px: f64, wanted: &str) -> Outcome<()> {
    let view = view(1024)?;
    let mut pass = OccluderPass::new(scene, view.viewport())?;
    pass.begin(&view)?;
    pass.draw(&(0..100).map(DrawableId).collect::<Vec<_>>())?;
    pass.finish()?;
    let boxes = boxes(count, edge_px);
    let mut visible = Vec::new();
    let label = |occlusion_test| format!("{occlusion_test:<11} {count} boxes of {edge_px} px at 1024");
    report(wanted, &label("query"), || {
        pass.query_test()?.test(&view, &boxes, &mut visible)?;
        Ok(PassTiming::default())
    })?;
    report(wanted, &label("raster"), || {
        pass.raster_test()?.test(&view, &boxes, &mut visible)?;
        Ok(PassTiming::default())
    })?;
    if !scene.gpu().info().lacks.contains(&Optional::Float64) {
        report(wanted, &label("hzb, device"), || {
            pass.draw(&[])?;
            pass.hzb_test()?.test(&view, &boxes, &mut visible)?;
            Ok(PassTiming::default())
        })?;
    }
    let mut pyramid = DepthPyramid::default();
    report(wanted, &label("hzb, host"), || {
        // Nothing is drawn, but the depth counts as new: the copy to the host is part of the cost.
        pass.draw(&[])?;
        let image = pass.read_depth()?;
        pyramid.rebuild(image);
        HzbTest::new(image, &pyramid)?.test(&view, &boxes, &mut visible)?;
        Ok(PassTiming::default())
    })
}

/// Runs `frame` twice to warm up and nine times for the medians.
fn report(wanted: &str, label: &str, mut frame: impl FnMut() -> Outcome<PassTiming>) -> Outcome<()> {
    if !label.contains(wanted) {
        return Ok(());
    }
    let mut runs = Vec::new();
    for run in 0..11 {
        let (start, cpu_before) = (Instant::now(), cpu_ms());
        let timing = frame()?;
        let (wall, cpu) = (start.elapsed().as_secs_f64() * 1e3, cpu_ms() - cpu_before);
        if run >= 2 {
            runs.push([cpu, timing.device_ms, wall, timing.host_ms]);
        }
    }
    let median = |column: usize| {
        let mut values: Vec<f64> = runs.iter().map(|run| run[column]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let [cpu, device, wall, host] = [0, 1, 2, 3].map(median);
    println!("{label:<44} {cpu:>9.2} {device:>9.2} {wall:>9.2} {host:>9.3}");
    Ok(())
}

/// 90 degrees high and wide, from the origin along -z.
fn view(side: u32) -> Outcome<View> {
    let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 0.1, FrameNumber(0))?;
    Ok(View::new(camera, Viewport::new(side, side)?))
}

/// Spheres of about `triangles` triangles each, near ones first, each its own mesh as in a real scene.
fn cloud(draws: u32, triangles: u32) -> Outcome<Scene> {
    let mut random = Random::new(1);
    // A picture is 2 x 2 at distance 1: `draws` discs of this radius there make up three of it.
    let spread = (3.0 * 4.0 / (f64::from(draws) * std::f64::consts::PI)).sqrt();
    let mut places: Vec<(f64, DVec3)> = (0..draws)
        .map(|_| {
            let distance = random.between(5.0, 50.0);
            let across = random.point(DVec3::new(-0.95, -0.95, -1.0), DVec3::new(0.95, 0.95, -1.0));
            (distance, across * distance)
        })
        .collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let spheres = (0..).zip(places).map(|(index, (distance, centre))| FlatObject {
        colour: Rgba8([(index * 37) as u8, (index * 91) as u8, 200, 255]),
        origin: centre,
        ..sphere((spread * distance) as f32, triangles)
    });
    Ok(Scene::from_arrays(SceneArrays::flat(&spheres.collect::<Vec<_>>()))?)
}

fn sphere(radius: f32, triangles: u32) -> FlatObject {
    // Rings of twice as many sides as there are rings: 2 * rings * sides triangles.
    let rings = ((triangles as f32 / 4.0).sqrt().round() as u32).max(2);
    let sides = (triangles / (2 * rings)).max(3);
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for ring in 0..=rings {
        let (sin, cos) = (PI * ring as f32 / rings as f32).sin_cos();
        for side in 0..=sides {
            let (across, along) = (TAU * side as f32 / sides as f32).sin_cos();
            positions.push(radius * Vec3::new(sin * across, cos, sin * along));
        }
    }
    for ring in 0..rings {
        for side in 0..sides {
            let a = ring * (sides + 1) + side;
            let b = a + sides + 1;
            indices.extend([a, b, a + 1, a + 1, b, b + 1]);
        }
    }
    FlatObject { positions, indices, colour: Rgba8([0; 4]), linear: Mat3::IDENTITY, origin: DVec3::ZERO }
}

/// Cubes whose faces are about `edge_px` pixels wide at 1024 x 1024, at all distances of the cloud.
fn boxes(count: usize, edge_px: f64) -> Vec<TestBox> {
    let mut random = Random::new(2);
    (0..count)
        .map(|_| {
            let distance = random.between(5.0, 50.0);
            let across = random.point(DVec3::new(-0.9, -0.9, -1.0), DVec3::new(0.9, 0.9, -1.0));
            let half = edge_px / 1024.0 * distance;
            TestBox {
                centre: (across * distance).as_vec3(),
                axes: [DVec3::X * half, DVec3::Y * half, DVec3::Z * half].map(|axis| axis.as_vec3()),
            }
        })
        .collect()
}
