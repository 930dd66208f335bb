//! Whole sessions: a display and two cullers, real devices, a generated plant.

use std::sync::Arc;

use trimaran::report::Frame;
use trimaran::vulkan::VulkanCuller;
use trimaran::walkthrough::{CameraPath, PathChoice, Plan, SceneOnDevices};
use trimaran_actors::Schedule;
use trimaran_audit::cases::with_records;
use trimaran_cull::SURFACE_SLACK_PX;
use trimaran_gpu::{HzbPlace, Optional};
use trimaran_proto::OcclusionTestKind;
use trimaran_scene::Scene;

use crate::common::{
    data::small_plant,
    session::{
        self, assert_no_validation_messages, audit, camera_path, culler, on_devices, uncut_count,
        walk_in_process, walk_with,
    },
};

const FRAMES: u32 = 12;

fn plan(occlusion_test: OcclusionTestKind) -> Plan {
    session::plan([233, 160], 2.0, 16, occlusion_test)
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

/// The largest deviations of outlines and surfaces in a session, pixels.
fn farthest_off(devices: &SceneOnDevices, plan: &Plan) -> [f64; 2] {
    let records = walk_in_process(devices, plan, &automatic(devices, plan));
    let mut farthest = [0.0_f64; 2];
    audit(devices, plan, &records, 1, culler(devices, plan), |_, frame| {
        assert_eq!(frame.cut_mismatch_pixels, Some(0), "culling is not at fault");
        let error = frame.full_detail.unwrap();
        let off = [error.silhouette_max_px.unwrap(), error.surface_max_px.unwrap()];
        farthest = std::array::from_fn(|measure| farthest[measure].max(off[measure]));
    });
    farthest
}

#[test]
fn levels_that_claim_too_much_are_found_out() {
    let Some(honest) = on_devices(&small_plant()) else { return };
    let Some(boasting) = on_devices(&Arc::new(understated(&honest.scene, 20.0))) else { return };
    let plan = plan(OcclusionTestKind::Raster);
    let bound = plan.lod.epsilon_px() + SURFACE_SLACK_PX;
    let [outline, surface] = farthest_off(&honest, &plan);
    assert!(outline <= bound && surface <= bound, "off by {outline} and {surface} px");
    assert!(surface > 0.0, "levels were chosen");
    // The plant has walls all around: no background is visible, and so no outline against it.
    let [_, surface] = farthest_off(&boasting, &plan);
    assert!(surface > bound, "a surface off by {surface} px");
}

#[test]
fn a_picture_that_is_not_exact_yet_is_compared_and_no_fault_of_culling() {
    let Some(devices) = on_devices(&small_plant()) else { return };
    let plan = plan(OcclusionTestKind::Hzb);
    let mut records = walk_in_process(&devices, &plan, &automatic(&devices, &plan));
    // As if a third of it had not come, and a picture that lacks only invisible drawables.
    let [.., hidden, loading] = &mut records[..] else { panic!("a walk of {FRAMES} frames") };
    hidden.lacking = 1;
    (loading.lacking, loading.picture) = (7, None);
    loading.ids = loading.ids.iter().enumerate().filter(|(at, _)| at % 3 > 0).map(|(_, id)| *id).collect();
    let mut frames = Vec::new();
    audit(&devices, &plan, &records, 1, culler(&devices, &plan), |_, frame| frames.push(frame));
    let [exact @ .., hidden, loading] = &frames[..] else { panic!("{} frames", frames.len()) };
    assert!(exact.iter().all(|frame| frame.cut_mismatch_pixels == Some(0) && frame.loading_pixels.is_none()));
    assert_eq!(hidden.loading_pixels, Some(0));
    assert!(loading.loading_pixels > Some(100), "{:?}", loading.loading_pixels);
    for frame in [hidden, loading] {
        let only_loading = Frame {
            loading_pixels: frame.loading_pixels,
            objects_exact_full: frame.objects_exact_full,
            triangles_exact_full: frame.triangles_exact_full,
            ..Frame::default()
        };
        assert_eq!(*frame, only_loading);
        assert!(frame.objects_exact_full > Some(0), "what the camera sees does not depend on the picture");
    }
}

#[test]
fn every_occlusion_test_shows_the_unculled_cut() {
    let Some(devices) = on_devices(&small_plant()) else { return };
    let mut pictures = Vec::new();
    for occlusion_test in OcclusionTestKind::ALL {
        let plan = plan(occlusion_test);
        let records = walk_in_process(&devices, &plan, &automatic(&devices, &plan));
        let mut seen = 0;
        audit(&devices, &plan, &records, 1, culler(&devices, &plan), |record, frame| {
            let at = format!("{occlusion_test}: {}", record.camera.frame());
            assert_eq!(frame.false_culled_pixels, Some(0), "{at}");
            assert_eq!(frame.cut_mismatch_pixels, Some(0), "{at}");
            let exact = frame.nodes_exact.unwrap() as usize;
            assert!(exact > 0, "something shows");
            seen += exact;
        });
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
}

#[test]
fn a_walk_has_the_same_ids_with_the_depth_pyramid_on_the_host_and_on_the_device() {
    let Some(devices) = on_devices(&small_plant()) else { return };
    if devices.display.gpu().info().lacks.contains(&Optional::Float64) {
        println!("skipped: the device has no f64 in shaders");
        return;
    }
    let plan = plan(OcclusionTestKind::Hzb);
    let [host, device] = [HzbPlace::Host, HzbPlace::Device].map(|place| {
        let records = walk_with(&devices, &plan, &automatic(&devices, &plan), |culler| {
            let culler = VulkanCuller::new(devices.drawn_by(culler), plan.viewport, plan.occlusion_test);
            culler.unwrap().with_hzb_at(place)
        });
        records.into_iter().map(|record| (record.ids, record.picture)).collect::<Vec<_>>()
    });
    assert!(host.len() == FRAMES as usize && host.iter().all(|(ids, _)| !ids.is_empty()));
    assert_eq!(device, host);
    assert_no_validation_messages(&devices);
}

/// Culling changes no pixel, for any culler and any occluders.
#[test]
fn pictures_are_the_same_for_every_number_of_cullers_schedule_and_test() {
    let Some(all) = session::with_cullers(&small_plant(), 3) else { return };
    let mut pictures = Vec::new();
    for occlusion_test in OcclusionTestKind::ALL {
        for (cullers, schedule) in [
            (0, Schedule::Independent),
            (1, Schedule::Independent),
            (2, Schedule::Independent),
            (3, Schedule::Independent),
            (2, Schedule::Switch),
        ] {
            let devices = SceneOnDevices {
                scene: Arc::clone(&all.scene),
                cullers: all.cullers.iter().take(cullers).map(Arc::clone).collect(),
                display: Arc::clone(&all.display),
            };
            let plan = Plan { schedule, ..plan(occlusion_test) };
            let walk = || walk_in_process(&devices, &plan, &automatic(&devices, &plan));
            let (records, again) = (walk(), walk());
            let shown: Vec<_> = records.iter().map(|record| record.picture.unwrap()).collect();
            pictures.push(shown);
            for (number, (record, again)) in records.iter().zip(&again).enumerate() {
                let culler = (number % cullers.max(1)) as u32;
                assert_eq!(record.culler.map(|id| id.index() as u32), (cullers > 0).then_some(culler));
                assert_eq!(record.ids, again.ids, "{cullers} {schedule} {occlusion_test} {number}");
            }
        }
    }
    assert!(pictures.windows(2).all(|pair| pair[0] == pair[1]), "{pictures:?}");
    assert_no_validation_messages(&all);
}
