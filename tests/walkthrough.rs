//! Whole sessions: three roles, real devices, a generated plant.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

mod common;

use std::{error::Error, sync::Arc};

use common::session::{assert_no_validation_messages, camera_path, on_devices, uncut_count, walk_in_process};
use trimaran::vulkan::VulkanCuller;
use trimaran::{
    report::Frame,
    walkthrough::{Auditor, CameraPath, Pace, PathChoice, Plan, SceneOnDevices},
};
use trimaran_audit::{SURFACE_SLACK_PX, cases::with_records};
use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_cull::LodRule;
use trimaran_proto::{BatchSize, IdCoding, OcclusionTestKind, Viewport};
use trimaran_scene::Scene;

const FRAMES: u32 = 12;

fn plan(occlusion_test: OcclusionTestKind) -> Plan {
    Plan {
        viewport: Viewport::new(233, 160).unwrap(),
        lod: LodRule::new(2.0).unwrap(),
        batch: BatchSize::new(16).unwrap(),
        coding: IdCoding::Changes,
        occlusion_test,
        pace: Pace::Lockstep,
        audit_every: 1,
        visible: false,
        alone: false,
    }
}

fn plant_on_devices() -> Option<SceneOnDevices> {
    let model = plant(&PlantOptions { objects: 700, triangles: 70_000, ..PlantOptions::small(3) });
    on_devices(&Arc::new(cook(&model, &CookOptions::default(), &()).unwrap()))
}

fn automatic(devices: &SceneOnDevices, plan: &Plan) -> CameraPath {
    camera_path(devices, plan, &PathChoice::Auto { seed: 7 }, FRAMES)
}

/// The scene with every certified error divided by `by`: levels that claim to be closer than they are.
fn understated(scene: &Scene, by: f32) -> Scene {
    let mut drawables = scene.drawables().to_vec();
    drawables.iter_mut().for_each(|level| level.error /= by);
    with_records(scene, scene.nodes().to_vec(), drawables).unwrap()
}

/// The farthest that an outline and a surface are off in a session, pixels.
fn farthest_off(devices: &SceneOnDevices, plan: &Plan) -> Result<[f64; 2], Box<dyn Error>> {
    let [_, _, display] = &devices.drawn;
    let rule = plan.lod;
    let mut auditor = Auditor::new(&devices.scene, display, plan.viewport, rule)?;
    let mut machine = VulkanCuller::new(display, plan.viewport, plan.occlusion_test)?;
    let mut farthest = [0.0_f64; 2];
    let records = walk_in_process(devices, plan, &automatic(devices, plan));
    for index in 0..records.len() {
        let mut frame = Frame::default();
        auditor.audit(&mut machine, &records[..=index], false, &mut frame, &mut Default::default())?;
        assert_eq!(frame.cut_mismatch_pixels, Some(0), "culling is not at fault");
        let error = frame.full_detail.unwrap();
        let off = [error.silhouette_max_px.unwrap(), error.surface_max_px.unwrap()];
        farthest = std::array::from_fn(|measure| farthest[measure].max(off[measure]));
    }
    Ok(farthest)
}

#[test]
fn levels_that_claim_too_much_are_found_out() -> Result<(), Box<dyn Error>> {
    let Some(honest) = plant_on_devices() else { return Ok(()) };
    let Some(boasting) = on_devices(&Arc::new(understated(&honest.scene, 20.0))) else { return Ok(()) };
    let plan = plan(OcclusionTestKind::Raster);
    let bound = plan.lod.epsilon_px() + SURFACE_SLACK_PX;
    let [outline, surface] = farthest_off(&honest, &plan)?;
    assert!(outline <= bound && surface <= bound, "off by {outline} and {surface} px");
    assert!(surface > 0.0, "levels were chosen");
    // The plant has walls all around: no background shows, and no outline against it.
    let [_, surface] = farthest_off(&boasting, &plan)?;
    assert!(surface > bound, "a surface off by {surface} px");
    Ok(())
}

#[test]
fn every_occlusion_test_shows_the_unculled_cut() -> Result<(), Box<dyn Error>> {
    let Some(devices) = plant_on_devices() else { return Ok(()) };
    let mut pictures = Vec::new();
    for occlusion_test in OcclusionTestKind::ALL {
        let plan = plan(occlusion_test);
        let records = walk_in_process(&devices, &plan, &automatic(&devices, &plan));
        let rule = plan.lod;
        let [_, _, display] = &devices.drawn;
        let mut auditor = Auditor::new(&devices.scene, display, plan.viewport, rule)?;
        let mut machine = VulkanCuller::new(display, plan.viewport, occlusion_test)?;
        let mut seen = 0;
        for (index, record) in records.iter().enumerate() {
            let mut frame = Frame::default();
            auditor.audit(&mut machine, &records[..=index], false, &mut frame, &mut Default::default())?;
            assert_eq!(frame.false_culled_pixels, Some(0), "{occlusion_test}: {}", record.camera.frame());
            assert_eq!(frame.cut_mismatch_pixels, Some(0), "{occlusion_test}: {}", record.camera.frame());
            let exact = frame.nodes_exact.unwrap() as usize;
            assert!(exact > 0, "something shows");
            seen += exact;
        }
        pictures.push(records.iter().map(|record| record.picture).collect::<Vec<_>>());
        let drawn: usize = records.iter().map(|record| record.ids.len()).sum();
        let cut: usize = records.iter().map(|r| uncut_count(&devices, &plan, r)).sum();
        // The walk looks where there is most to see: of 2544 drawables 1550 own a pixel, and culling leaves
        // 300 of the others.
        let (hidden, culled) = (cut - seen, cut - drawn);
        assert!(culled * 5 > hidden * 3, "{occlusion_test} culled {culled} of {hidden} that are hidden");
    }
    assert!(
        pictures.windows(2).all(|pair| pair[0] == pair[1]),
        "the occlusion tests differ in what they draw, not in what shows"
    );
    assert_no_validation_messages(&devices);
    Ok(())
}
