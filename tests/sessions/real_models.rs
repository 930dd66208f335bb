//! Whole sessions through real models: no false cull, the unculled picture, and outlines within the error
//! bound.

use std::path::PathBuf;

use trimaran::walkthrough::{FrameRecord, PathChoice, Plan, SceneOnDevices};
use trimaran_cull::SURFACE_SLACK_PX;
use trimaran_proto::OcclusionTestKind;

use crate::common::{
    data::Data,
    scenes::scene_of,
    session::{assert_no_validation_messages, audit, camera_path, culler, on_devices, plan, walk_in_process},
};

/// One frame in this many is audited.
const AUDIT_EVERY: usize = 5;

/// Queries are the slowest by far on a CPU driver.
const fn frames(occlusion_test: OcclusionTestKind) -> u32 {
    if matches!(occlusion_test, OcclusionTestKind::Query) { 6 } else { 21 }
}

/// Walks through a model with every occlusion test at two error bounds, and audits.
fn walks(files: &[PathBuf], path: &PathChoice) {
    let Some(devices) = on_devices(&scene_of(files)) else { return };
    println!("test   epsilon  frames  audited  drawn  outline off  surface off");
    for epsilon in [2.0, 10.0] {
        let mut pictures = Vec::new();
        for occlusion_test in OcclusionTestKind::ALL {
            let plan = plan([384, 384], epsilon, 256, occlusion_test);
            let records =
                walk_in_process(&devices, &plan, &camera_path(&devices, &plan, path, frames(occlusion_test)));
            assert_eq!(records.len(), frames(occlusion_test) as usize);
            let [outline, surface] = farthest_off(&devices, &plan, &records);
            let drawn: usize = records.iter().map(|record| record.ids.len()).sum();
            println!(
                "{occlusion_test:6} {epsilon:7} {:7} {:8} {:6} {outline:9.2} px {surface:9.2} px",
                records.len(),
                records.len().div_ceil(AUDIT_EVERY),
                drawn / records.len(),
            );
            pictures.push(records.iter().map(|record| record.picture).collect::<Vec<_>>());
        }
        for (frame, (raster, hzb)) in pictures[1].iter().zip(&pictures[2]).enumerate() {
            assert_eq!(raster, hzb, "frame {frame} at {epsilon} px: occlusion tests differ in what shows");
        }
    }
    assert_no_validation_messages(&devices);
}

/// Audits frames of a session and returns the largest deviations of outlines and surfaces, in pixels.
fn farthest_off(devices: &SceneOnDevices, plan: &Plan, records: &[FrameRecord]) -> [f64; 2] {
    let bound = plan.lod.epsilon_px() + SURFACE_SLACK_PX;
    let mut farthest = [0.0_f64; 2];
    audit(devices, plan, records, AUDIT_EVERY, culler(devices, plan), |record, frame| {
        let at =
            format!("{} at {} px, {}", plan.occlusion_test, plan.lod.epsilon_px(), record.camera.frame());
        assert_eq!(frame.false_culled_pixels, Some(0), "{at}");
        assert_eq!(frame.cut_mismatch_pixels, Some(0), "{at}");
        let error = frame.full_detail.unwrap();
        let (outline, surface) = (error.silhouette_max_px.unwrap(), error.surface_max_px.unwrap());
        assert!(outline <= bound, "{at}: an outline is off by {outline} px");
        assert!(surface <= bound, "{at}: a surface is off by {surface} px");
        farthest = [farthest[0].max(outline), farthest[1].max(surface)];
    });
    farthest
}

#[test]
fn platform() {
    let Some(data) = Data::find() else { return };
    walks(&data.platform(), &PathChoice::Auto { seed: 1 });
}

#[test]
fn platform_in_14_copies() {
    let Some(data) = Data::find() else { return };
    let path = PathChoice::File(data.truth("huldra_x14_13Mtri.walk.json"));
    walks(&[data.unpacked("huldra_x14_13Mtri.glb")], &path);
}

#[test]
fn town_hall() {
    let Some(data) = Data::find() else { return };
    let path = PathChoice::File(data.truth("ldraw_town_hall_1.3Mtri.walk.json"));
    walks(&[data.unpacked("ldraw_town_hall_1.3Mtri.glb")], &path);
}
