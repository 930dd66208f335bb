//! Hard cases of culling, walked by the roles of a session in every system.

use std::sync::Arc;

use glam::DVec3;
use tokio::runtime::Runtime;
use trimaran::{
    audit::{CaseOnDevice, CaseWalkError, Figures, Way, walk_reference},
    comparison::System,
};
use trimaran_audit::{
    Testing,
    cases::{Case, hard_cases, plant, plant_views, with_halved_boxes},
};
use trimaran_cull::{LodRule, View, Viewport};
use trimaran_gpu::GpuError;
use trimaran_proto::OcclusionTestKind;

use crate::common::devices;

fn rule() -> LodRule {
    LodRule::new(2.0).unwrap()
}

fn hard_case(name: &str) -> Case {
    hard_cases().unwrap().into_iter().find(|case| case.name == name).unwrap()
}

/// Walks a case with two cullers.
fn walked(case: &Case) -> Option<Result<Figures, CaseWalkError>> {
    let [gpu, ..] = devices()?;
    let runtime = Runtime::new().unwrap();
    let way = Way { system: System::Independent2, occlusion_test: OcclusionTestKind::Raster, rule: rule() };
    Some(CaseOnDevice::new(case, gpu, runtime.handle()).unwrap().walk(&way))
}

fn plant_case(size: Viewport) -> Case {
    Case {
        name: "plant",
        scene: plant(5, 120, DVec3::ZERO).unwrap(),
        views: plant_views(5, 120, DVec3::ZERO, size, 20).unwrap(),
    }
}

#[test]
fn every_system_is_exact_and_nothing_toggles() {
    let Some([gpu, ..]) = devices() else { return };
    let runtime = Runtime::new().unwrap();
    for name in ["origin at 1e6", "wall against its own surface, 200 still frames"] {
        let case = hard_case(name);
        let reference = walk_reference(&case, Testing::Rasterized, rule()).unwrap();
        assert!(reference.is_exact() && reference.toggles == Some(0), "{name}: {reference:?}");
        let mut on_device = CaseOnDevice::new(&case, gpu, runtime.handle()).unwrap();
        for way in Way::all(rule()) {
            let figures = on_device.walk(&way).unwrap();
            assert!(figures.is_exact(), "{name}, {way:?}: {figures:?}");
            assert_eq!((figures.frames, figures.whole), (reference.frames, reference.whole), "{way:?}");
            assert!(figures.toggles.is_none_or(|toggles| toggles == 0), "{name}, {way:?}: {figures:?}");
            assert!(way.system.cullers() == 0 || figures.drawn * 4 < figures.whole * 3, "{way:?} culls");
        }
    }
}

#[test]
fn boxes_that_are_too_small_lose_pixels_and_drawables() {
    let case = plant_case(Viewport::new(96, 80).unwrap());
    let small = Case { scene: Arc::new(with_halved_boxes(&case.scene).unwrap()), ..case.clone() };
    for (case, exact) in [(case, true), (small, false)] {
        let Some(figures) = walked(&case) else { return };
        let figures = figures.unwrap();
        assert_eq!((figures.is_exact(), figures.first_wrong.is_none()), (exact, exact), "{figures:?}");
        assert_eq!((figures.wrong_pixels > 0, figures.lost_nodes > 0), (!exact, !exact), "{figures:?}");
    }
}

/// The picture's size changes in the midst of a walk, and to one that no device draws.
#[test]
fn sizes_change_and_a_picture_that_is_too_large_is_refused() {
    let mut case = plant_case(Viewport::new(64, 48).unwrap());
    let other = Viewport::new(33, 70).unwrap();
    for view in case.views.iter_mut().skip(7).step_by(2) {
        *view = View::new(*view.camera(), other);
    }
    let Some(figures) = walked(&case) else { return };
    assert!(figures.unwrap().is_exact());
    let huge = Viewport::new(1, Viewport::LARGEST.height()).unwrap();
    case.views = case.views.iter().map(|view| View::new(*view.camera(), huge)).collect();
    let refused = walked(&case).unwrap();
    assert!(matches!(refused, Err(CaseWalkError::Gpu(GpuError::ViewportTooLarge { .. }))), "{refused:?}");
}
