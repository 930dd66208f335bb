//! Whole sessions through real models: no false cull, the unculled picture, and no outline farther off than
//! was promised.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

mod common;

use std::{error::Error, path::PathBuf};

use common::{
    data::{Data, cooked, imported},
    session::{assert_no_validation_messages, camera_path, on_devices, walk_in_process},
};
use trimaran::vulkan::VulkanCuller;
use trimaran::{
    report::Frame,
    walkthrough::{Auditor, FrameRecord, Pace, PathChoice, Plan, SceneOnDevices},
};
use trimaran_audit::SURFACE_SLACK_PX;
use trimaran_cull::LodRule;
use trimaran_proto::{BatchSize, IdCoding, OcclusionTestKind, Viewport};

/// Every so many frames one is audited.
const AUDIT_EVERY: u32 = 5;

fn plan(occlusion_test: OcclusionTestKind, epsilon_px: f64) -> Plan {
    Plan {
        viewport: Viewport::new(384, 384).unwrap(),
        lod: LodRule::new(epsilon_px).unwrap(),
        batch: BatchSize::new(256).unwrap(),
        coding: IdCoding::Changes,
        occlusion_test,
        pace: Pace::Lockstep,
        audit_every: AUDIT_EVERY,
        visible: false,
        alone: false,
    }
}

/// Queries are the slowest by far on a CPU driver.
const fn frames(occlusion_test: OcclusionTestKind) -> u32 {
    if matches!(occlusion_test, OcclusionTestKind::Query) { 11 } else { 41 }
}

/// Walks through a model with every occlusion test at two error bounds, and audits.
fn walks(files: &[PathBuf], path: &PathChoice) -> Result<(), Box<dyn Error>> {
    let Some(devices) = on_devices(&cooked(&imported(files))) else { return Ok(()) };
    println!("test   epsilon  frames  audited  drawn  outline off  surface off");
    for epsilon in [2.0, 10.0] {
        let mut pictures = Vec::new();
        for occlusion_test in OcclusionTestKind::ALL {
            let plan = plan(occlusion_test, epsilon);
            let records =
                walk_in_process(&devices, &plan, &camera_path(&devices, &plan, path, frames(occlusion_test)));
            assert_eq!(records.len(), frames(occlusion_test) as usize);
            let [outline, surface] = audit(&devices, &plan, &records)?;
            let drawn: usize = records.iter().map(|record| record.ids.len()).sum();
            println!(
                "{occlusion_test:6} {epsilon:7} {:7} {:8} {:6} {outline:9.2} px {surface:9.2} px",
                records.len(),
                records.len().div_ceil(AUDIT_EVERY as usize),
                drawn / records.len(),
            );
            pictures.push(records.iter().map(|record| record.picture).collect::<Vec<_>>());
        }
        for (frame, (raster, hzb)) in pictures[1].iter().zip(&pictures[2]).enumerate() {
            assert_eq!(raster, hzb, "frame {frame} at {epsilon} px: occlusion tests differ in what shows");
        }
    }
    assert_no_validation_messages(&devices);
    Ok(())
}

/// Audits frames of a session and returns how far an outline and a surface were off at most, in pixels.
fn audit(devices: &SceneOnDevices, plan: &Plan, records: &[FrameRecord]) -> Result<[f64; 2], Box<dyn Error>> {
    let [_, _, display] = &devices.drawn;
    let rule = plan.lod;
    let mut auditor = Auditor::new(&devices.scene, display, plan.viewport, rule)?;
    let mut machine = VulkanCuller::new(display, plan.viewport, plan.occlusion_test)?;
    let mut farthest = [0.0_f64; 2];
    for (index, record) in records.iter().enumerate().step_by(AUDIT_EVERY as usize) {
        let mut frame = Frame::default();
        auditor.audit(&mut machine, &records[..=index], false, &mut frame, &mut Default::default())?;
        let at =
            format!("{} at {} px, {}", plan.occlusion_test, plan.lod.epsilon_px(), record.camera.frame());
        assert_eq!(frame.false_culled_pixels, Some(0), "{at}");
        assert_eq!(frame.cut_mismatch_pixels, Some(0), "{at}");
        let error = frame.full_detail.unwrap();
        let (outline, surface) = (error.silhouette_max_px.unwrap(), error.surface_max_px.unwrap());
        let bound = plan.lod.epsilon_px() + SURFACE_SLACK_PX;
        assert!(outline <= bound, "{at}: an outline is off by {outline} px");
        assert!(surface <= bound, "{at}: a surface is off by {surface} px");
        farthest = [farthest[0].max(outline), farthest[1].max(surface)];
    }
    Ok(farthest)
}

#[test]
fn platform() -> Result<(), Box<dyn Error>> {
    let Some(data) = Data::find() else { return Ok(()) };
    walks(&data.platform(), &PathChoice::Auto { seed: 1 })
}

#[test]
fn platform_in_14_copies() -> Result<(), Box<dyn Error>> {
    let Some(data) = Data::find() else { return Ok(()) };
    let path = PathChoice::File(data.truth("huldra_x14_13Mtri.walk.json"));
    walks(&[data.unpacked("huldra_x14_13Mtri.glb")], &path)
}

#[test]
fn town_hall() -> Result<(), Box<dyn Error>> {
    let Some(data) = Data::find() else { return Ok(()) };
    let path = PathChoice::File(data.truth("ldraw_town_hall_1.3Mtri.walk.json"));
    walks(&[data.unpacked("ldraw_town_hall_1.3Mtri.glb")], &path)
}
