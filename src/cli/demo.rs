//! `trimaran demo`: generates a model, walks through it and writes a report.

use trimaran::page::Preparation;
use trimaran_cook::CookOptions;
use trimaran_cook::generate::{PlantOptions, plant};
use trimaran_gpu::GpuOptions;

use super::{
    Failure,
    args::{Coding, DemoArgs, OcclusionTestArg, RunArgs, Size, WalkArgs},
    cooking, output, run,
};

pub(super) fn run(args: &DemoArgs) -> Result<(), Failure> {
    let scene = match &args.scene {
        Some(scene) => scene.clone(),
        None => {
            std::fs::create_dir_all(&args.out).map_err(|cause| {
                Failure::bad_input(format!("cannot create the folder {}: {cause}", args.out.display()))
            })?;
            let output = args.out.join("plant.scene");
            output::check(&output, &output::SCENE, &[]).map_err(Failure::bad_input)?;
            println!("generating a plant of 4 thousand objects and cooking it into {}", output.display());
            cooking::cook_and_save(
                &plant(&PlantOptions::small(1)),
                &CookOptions::default(),
                &output,
                &Preparation::default(),
            )?;
            output
        }
    };
    println!("walking through it: two cullers find out what is visible, and a display shows it");
    let walk = WalkArgs {
        frames: Some(120),
        path: "auto".to_owned(),
        seed: 1,
        size: Size { width: 1024, height: 1024 },
        batch: 1024,
        coding: Coding::Changes,
        occlusion_test: OcclusionTestArg::Hzb,
        few_pixels: false,
        device: None,
        gpu_memory: None,
        device_timeout: GpuOptions::TIMEOUT.as_secs_f64(),
        check_device: false,
        alone: false,
        audit_every: WalkArgs::AUDIT_EVERY,
    };
    run::run(&RunArgs::of(scene, walk, args.out.clone()))
}
