//! A walkthrough as a library: generate a plant, cook it, walk through it with two cullers and a display in
//! this process, and print the result.
//!
//!     cargo run --release --example a_walkthrough

use std::{error::Error, sync::Arc};

use trimaran::walkthrough::{CameraPath, PathChoice, Plan, Recorder, SceneOnDevices};
use trimaran_actors::Stop;
use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_gpu::GpuOptions;
use trimaran_proto::{LodRule, Settings, Viewport};

fn main() -> Result<(), Box<dyn Error>> {
    let model = plant(&PlantOptions { seed: 1, objects: 1_000, triangles: 100_000 });
    let scene = Arc::new(cook(&model, &CookOptions::default(), &())?);
    println!("{} objects, {} nodes", model.objects.len(), scene.nodes().len());

    let plan = Plan::new(Settings::new(Viewport::new(512, 512)?, LodRule::new(2.0)?));
    let path = CameraPath::find(&PathChoice::Auto { seed: 1 }, &scene, plan.settings().into(), Some(30))?;
    let devices = SceneOnDevices::open(&scene, 2, &GpuOptions::default())?;
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let (_stopper, stop) = Stop::new(); // whoever keeps the stopper can end the walk early

    let mut progress = |_| {};
    let mut recorder = Recorder::new(0, &mut progress);
    devices.walk(&plan, &path, &mut recorder, runtime.handle(), &stop)?;

    let frames = recorder.into_frames();
    let drawn: usize = frames.iter().map(|frame| frame.ids.len()).sum();
    let hidden: u32 = frames.iter().filter_map(|frame| frame.stats).map(|stats| stats.culling.hidden).sum();
    let count = frames.len().max(1);
    println!(
        "{count} frames: {} nodes drawn a frame, {} boxes hidden",
        drawn / count,
        hidden as usize / count
    );
    Ok(())
}
