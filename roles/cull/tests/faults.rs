//! Each condition of exact culling, broken on purpose: the checks that find nothing on a sound loop must find that.
//!
//! A box that is grown by half a pixel also comes nearer by about that much, which at these small pictures hides small faults:
//! faults of depth are large ones here.

#![allow(clippy::unwrap_used, reason = "a test or benchmark that cannot be set up fails")]

use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::reference::cases::{Mesh, Object, build, looking, plant, plant_views};
use trimaran_cull::reference::{Fault, Placement, ReferenceWalk, Testing};
use trimaran_cull::{CutRule, Viewport};

/// What a walk through the plant came to under a fault.
#[derive(Debug, Default, PartialEq, Eq)]
struct Errors {
    false_culled: usize,
    pixels: usize,
}

fn walk_plant(fault: Fault, testing: Testing, placement: Placement) -> Errors {
    let viewport = Viewport::new(96, 80).unwrap();
    let scene = plant(21, 300, DVec3::ZERO).unwrap();
    let views = plant_views(21, 300, DVec3::ZERO, viewport, 60).unwrap();
    let mut walk = ReferenceWalk::new(scene, CutRule::new(4.0).unwrap())
        .testing(testing)
        .placing(placement)
        .with_fault(fault);
    let mut errors = Errors::default();
    for view in &views {
        let report = walk.frame(view).unwrap();
        errors.false_culled += report.false_culled.len();
        errors.pixels += report.differing_pixels;
    }
    errors
}

#[test]
fn a_sound_walk_has_no_errors() {
    for testing in [Testing::Rasterized, Testing::Pyramid] {
        for placement in [Placement::Exact, Placement::Single] {
            assert_eq!(
                walk_plant(Fault::None, testing, placement),
                Errors::default(),
                "{testing:?}, {placement:?}"
            );
        }
    }
}

/// From afar a barrel is drawn as its box; nearby it is round, and something shows past its edge. OR must not draw the box.
#[test]
fn occluders_at_other_levels_are_found_out() {
    let barrel =
        Object::new(Mesh::cylinder(1.0, 1.0, 24)).turned(Mat3::from_rotation_z(FRAC_PI_2)).with_box_level();
    let behind =
        Object::new(Mesh::cuboid(Vec3::splat(-0.1), Vec3::splat(0.1), 1)).at(DVec3::new(0.95, 2.0, 0.95));
    let scene = Arc::new(build(&[barrel, behind], false).unwrap());
    let viewport = Viewport::new(96, 96).unwrap();
    let views =
        [-100.0, -20.0].map(|y| looking(DVec3::new(0.0, y, 0.0), DVec3::ZERO, 20.0, viewport, 0).unwrap());
    for (fault, hidden) in [(Fault::None, 0), (Fault::OtherLevels, 1)] {
        let mut walk = ReferenceWalk::new(scene.clone(), CutRule::new(12.0).unwrap()).with_fault(fault);
        let reports = views.map(|view| walk.frame(&view).unwrap());
        assert_eq!(reports[1].false_culled.len(), hidden, "{fault:?}");
        assert_eq!(reports[1].differing_pixels > 0, hidden > 0, "{fault:?}");
    }
}

#[test]
fn a_stale_depth_is_found_out() {
    let errors = walk_plant(Fault::StaleDepth, Testing::Pyramid, Placement::Exact);
    assert!(errors.false_culled > 0 && errors.pixels > 0, "{errors:?}");
}

#[test]
fn boxes_that_are_too_small_are_found_out() {
    let errors = walk_plant(Fault::SmallBoxes(0.9), Testing::Rasterized, Placement::Exact);
    assert!(errors.false_culled > 0 && errors.pixels > 0, "{errors:?}");
}

#[test]
fn boxes_without_inflation_lose_to_their_own_surface() {
    for testing in [Testing::Rasterized, Testing::Pyramid] {
        let errors = walk_plant(Fault::NoInflation(0.03), testing, Placement::Single);
        assert!(errors.false_culled > 0 && errors.pixels > 0, "{testing:?}: {errors:?}");
    }
}

#[test]
fn dropped_ids_are_found_out() {
    let errors = walk_plant(Fault::DroppedIds(9), Testing::Rasterized, Placement::Exact);
    assert!(errors.pixels > 0, "{errors:?}");
}

#[test]
fn occluders_placed_otherwise_are_found_out() {
    for testing in [Testing::Rasterized, Testing::Pyramid] {
        let errors = walk_plant(Fault::NearerOccluders(0.03), testing, Placement::Exact);
        assert!(errors.false_culled > 0 && errors.pixels > 0, "{testing:?}: {errors:?}");
    }
}

/// Without their half pixel, boxes smaller than a pixel are lost between the samples though nothing is before them.
#[test]
fn boxes_without_an_outline_are_found_out() {
    let crates: Vec<Object> = (0..100)
        .map(|index| {
            let mesh = Mesh::cuboid(Vec3::splat(-0.01), Vec3::splat(0.01), 1);
            Object::new(mesh).at(DVec3::new(f64::from(index % 10) * 0.37, 40.0, f64::from(index / 10) * 0.37))
        })
        .collect();
    let scene = Arc::new(build(&crates, false).unwrap());
    let view =
        looking(DVec3::ZERO, DVec3::new(1.0, 40.0, 1.0), 60.0, Viewport::new(96, 96).unwrap(), 0).unwrap();
    let emitted = |fault| {
        let mut walk = ReferenceWalk::new(scene.clone(), CutRule::new(1.0).unwrap()).with_fault(fault);
        walk.frame(&view).unwrap();
        walk.frame(&view).unwrap().emitted.len()
    };
    assert_eq!(emitted(Fault::None), 100);
    assert!(emitted(Fault::NoOutline) < 60, "{}", emitted(Fault::NoOutline));
}
