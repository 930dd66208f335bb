//! The whole loop on the hard cases: nothing visible is culled, and culling changes no pixel.

use trimaran_cull::CutRule;
use trimaran_cull::reference::cases::{Case, hard_cases};
use trimaran_cull::reference::{Placement, ReferenceWalk, Testing};

/// Walks a case and asserts that culling is exact in every frame.
fn assert_exact(case: &Case, testing: Testing, placement: Placement) {
    for epsilon in [0.5, 4.0] {
        let rule = CutRule::new(epsilon).unwrap();
        let mut walk = ReferenceWalk::new(case.scene.clone(), rule).testing(testing).placing(placement);
        for view in &case.views {
            let report = walk.frame(view).unwrap();
            let at = format!(
                "{}, {testing:?}, {placement:?}, epsilon {epsilon}, {}",
                case.name,
                view.camera().frame()
            );
            assert_eq!(report.false_culled, [], "{at}");
            assert_eq!(report.differing_pixels, 0, "{at}");
        }
    }
}

#[test]
fn culling_is_exact_with_rasterized_boxes() {
    for case in hard_cases().unwrap() {
        assert_exact(&case, Testing::Rasterized, Placement::Exact);
        assert_exact(&case, Testing::Rasterized, Placement::Single);
    }
}

#[test]
fn culling_is_exact_with_the_depth_pyramid() {
    for case in hard_cases().unwrap() {
        assert_exact(&case, Testing::Pyramid, Placement::Exact);
        assert_exact(&case, Testing::Pyramid, Placement::Single);
    }
}
