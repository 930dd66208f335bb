//! Each condition of exact culling, broken on purpose: the checks, which find nothing in a correct loop, must
//! find and name the fault.

#![allow(clippy::unwrap_used, reason = "a test or benchmark that cannot be set up fails")]

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use trimaran_audit::cases::{
    Mesh, Object, build, looking, plant, plant_in_pieces, plant_views, with_halved_boxes,
};
use trimaran_audit::{Fault, FrameReport, Placement, ReferenceWalkthrough, Testing};
use trimaran_cull::{DEPTH_ULPS, FalseCullCause, LodRule, POSITION_ULPS, Viewport};
use trimaran_scene::Scene;

/// Faults of depth in the plant, as a fraction of the distance. Boxes get nearer by half a pixel over the
/// focal length (see `ScreenProjection` in `screen_box.rs`; a box that is grown in space gets as much
/// nearer), which is 0.6 % at this small size: a smaller fault has no effect. At 0.3 % the pyramid loses
/// nothing, at 1 % some 1800 pixels.
const PLANT_FRACTION: f64 = 0.01;

/// The errors of a walkthrough of the plant under a fault.
#[derive(Debug, Default, PartialEq, Eq)]
struct Errors {
    /// Wrong pixels of the picture.
    differing: usize,
    /// Pixels of drawables that were not drawn, by cause.
    lost: BTreeMap<FalseCullCause, usize>,
}

impl Errors {
    fn of(reports: impl IntoIterator<Item = FrameReport>) -> Self {
        let mut errors = Self::default();
        for report in reports {
            errors.differing += report.differing_pixels;
            for lost in report.false_culled {
                *errors.lost.entry(lost.cause).or_default() += lost.pixels;
            }
        }
        errors
    }

    fn causes(&self) -> Vec<FalseCullCause> {
        self.lost.keys().copied().collect()
    }
}

fn walk_plant(fault: Fault, testing: Testing, placement: Placement) -> Errors {
    let rule = LodRule::new(4.0).unwrap();
    walk_by(rule, plant(21, 300, DVec3::ZERO).unwrap(), fault, testing, placement)
}

fn walk_by(rule: LodRule, scene: Arc<Scene>, fault: Fault, testing: Testing, placement: Placement) -> Errors {
    let viewport = Viewport::new(96, 80).unwrap();
    let views = plant_views(21, 300, DVec3::ZERO, viewport, 60).unwrap();
    let mut walk =
        ReferenceWalkthrough::new(scene, rule).testing(testing).placing(placement).with_fault(fault);
    let errors = Errors::of(views.iter().map(|view| walk.frame(view).unwrap()));
    println!("{fault:?}, {testing:?}, {placement:?}: {errors:?}");
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

/// From afar a barrel is drawn as its box; nearby it is round, and things beyond its edge are visible. OR
/// must not draw the box.
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
        let mut walk =
            ReferenceWalkthrough::new(scene.clone(), LodRule::new(12.0).unwrap()).with_fault(fault);
        let [_, report] = views.map(|view| walk.frame(&view).unwrap());
        assert_eq!(report.false_culled.len(), hidden, "{fault:?}");
        assert!(report.false_culled.iter().all(|lost| lost.cause == FalseCullCause::LevelMismatch));
        let lost: usize = report.false_culled.iter().map(|lost| lost.pixels).sum();
        assert_eq!((report.differing_pixels, lost > 0), (lost, hidden > 0), "{fault:?}");
    }
}

#[test]
fn levels_that_were_not_sent_are_found_out() {
    let errors = walk_plant(Fault::OtherLevelsShown(3), Testing::Pyramid, Placement::Exact);
    assert_eq!(errors.causes(), [FalseCullCause::LevelMismatch]);
    assert!(errors.lost[&FalseCullCause::LevelMismatch] > 1000, "{errors:?}");
}

/// The paper's section 4.5.2 draws other levels than the cut, and is named as the cause.
#[test]
fn stopping_at_few_pixels_is_found_out() {
    let rule = LodRule::new(16.0).unwrap().stopping_at_few_pixels(true);
    let scene = plant(21, 300, DVec3::ZERO).unwrap();
    let errors = walk_by(rule, scene, Fault::None, Testing::Rasterized, Placement::Exact);
    assert_eq!(errors.causes(), [FalseCullCause::PixelCountRule]);
    assert!(errors.lost[&FalseCullCause::PixelCountRule] > 0, "{errors:?}");
}

#[test]
fn a_stale_depth_is_found_out() {
    for testing in [Testing::Rasterized, Testing::Pyramid] {
        let errors = walk_plant(Fault::StaleDepth, testing, Placement::Exact);
        assert_eq!(errors.lost, BTreeMap::from([(FalseCullCause::StaleCamera, errors.differing)]));
        assert!(errors.differing > 1000, "{errors:?}");
    }
}

/// A test that shrinks boxes loses drawables level with their faces, and some that stick out in front.
#[test]
fn an_occlusion_test_of_smaller_boxes_is_found_out() {
    let errors = walk_plant(Fault::SmallBoxes(0.9), Testing::Rasterized, Placement::Exact);
    assert_eq!(errors.causes(), [FalseCullCause::DepthTie, FalseCullCause::TestHid]);
    assert_eq!(errors.lost.values().sum::<usize>(), errors.differing, "{errors:?}");
}

/// Boxes of half the size, in the scene itself.
#[test]
fn boxes_that_hold_too_little_are_found_out() {
    let scene = plant(21, 300, DVec3::ZERO).unwrap();
    let scene = Arc::new(with_halved_boxes(&scene).unwrap());
    let views = plant_views(21, 300, DVec3::ZERO, Viewport::new(96, 80).unwrap(), 60).unwrap();
    let mut walk = ReferenceWalkthrough::new(scene, LodRule::new(4.0).unwrap()).testing(Testing::Pyramid);
    let errors = Errors::of(views.iter().map(|view| walk.frame(view).unwrap()));
    assert_eq!(errors.causes(), [FalseCullCause::BoxTooSmall], "{errors:?}");
    assert!(errors.lost[&FalseCullCause::BoxTooSmall] > 1000, "{errors:?}");
}

/// Of whole objects, whose faces lie on their boxes. A piece of a round one may be within its box.
#[test]
fn boxes_without_inflation_lose_to_their_own_surface() {
    let (rule, fault) = (LodRule::new(4.0).unwrap(), Fault::NoInflation(PLANT_FRACTION as f32));
    for testing in [Testing::Rasterized, Testing::Pyramid] {
        let scene = plant_in_pieces(21, 300, DVec3::ZERO, usize::MAX).unwrap();
        let errors = walk_by(rule, scene, fault, testing, Placement::Single);
        assert!(errors.lost[&FalseCullCause::DepthTie] * 100 > errors.differing * 95, "{errors:?}");
        assert_eq!(errors.lost.values().sum::<usize>(), errors.differing, "{errors:?}");
    }
}

#[test]
fn dropped_ids_are_found_out() {
    let errors = walk_plant(Fault::DroppedIds(9), Testing::Rasterized, Placement::Exact);
    assert_eq!(errors.lost, BTreeMap::from([(FalseCullCause::LostIds, errors.differing)]));
    assert!(errors.differing > 1000, "{errors:?}");
}

#[test]
fn occluders_placed_otherwise_are_found_out() {
    for testing in [Testing::Rasterized, Testing::Pyramid] {
        let errors = walk_plant(Fault::NearerOccluders(PLANT_FRACTION), testing, Placement::Exact);
        assert_eq!(errors.lost, BTreeMap::from([(FalseCullCause::OccluderTooNear, errors.differing)]));
        assert!(errors.differing > 1000, "{errors:?}");
    }
}

/// A wall of 8 x 8 panels, faced squarely, so that only the allowance for ties saves a panel from its own
/// surface and its neighbours'. Three times the allowance hides all panels but those at the wall's border;
/// half of it changes nothing.
#[test]
fn faults_of_depth_are_found_out_from_the_size_of_the_allowance_on() {
    let panels: Vec<Object> = (0..64)
        .map(|index| {
            let mesh = Mesh::rectangle(Vec3::ZERO, Vec3::X * 0.25, Vec3::Z * 0.25, 1);
            let (column, row) = (f64::from(index % 8), f64::from(index / 8));
            Object::new(mesh).at(DVec3::new(column * 0.5 - 1.75, 5.0, row * 0.5 - 1.75))
        })
        .collect();
    let scene = Arc::new(build(&panels, false).unwrap());
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, Viewport::new(97, 97).unwrap(), 0).unwrap();
    let lost = |fault, testing, placement| {
        let mut walk = ReferenceWalkthrough::new(scene.clone(), LodRule::new(1.0).unwrap())
            .testing(testing)
            .placing(placement)
            .with_fault(fault);
        walk.frame(&view).unwrap();
        Errors::of([walk.frame(&view).unwrap()])
    };
    let rounding = (POSITION_ULPS + DEPTH_ULPS) / f64::from(1 << 24);
    for (testing, allowance) in [
        (Testing::Rasterized, rounding),
        (Testing::Pyramid, rounding + view.grid().outline_px() / view.focal_x()),
    ] {
        for placement in [Placement::Exact, Placement::Single] {
            for (fault, cause) in [
                ((|by| Fault::NearerOccluders(by)) as fn(f64) -> Fault, FalseCullCause::OccluderTooNear),
                (|by| Fault::NoInflation(by as f32), FalseCullCause::DepthTie),
            ] {
                let at = format!("{testing:?}, {placement:?}, {:?}", fault(allowance));
                assert_eq!(lost(fault(0.5 * allowance), testing, placement), Errors::default(), "{at}");
                let errors = lost(fault(3.0 * allowance), testing, placement);
                assert_eq!(errors.lost, BTreeMap::from([(cause, errors.differing)]), "{at}");
                assert!(errors.differing > 36 * 64, "{at}: {errors:?}");
            }
        }
    }
}

/// Without their half pixel, boxes smaller than a pixel are lost between the samples though nothing is before
/// them.
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
        let mut walk = ReferenceWalkthrough::new(scene.clone(), LodRule::new(1.0).unwrap()).with_fault(fault);
        walk.frame(&view).unwrap();
        walk.frame(&view).unwrap().emitted.len()
    };
    assert_eq!(emitted(Fault::None), 100);
    assert!(emitted(Fault::NoOutline) < 60, "{}", emitted(Fault::NoOutline));
}
