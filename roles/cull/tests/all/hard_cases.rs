//! The whole loop on the hard cases: nothing visible is culled, and culling changes no pixel.

use trimaran_audit::cases::{Case, hard_cases};
use trimaran_audit::{FrameReport, Placement, ReferenceWalkthrough, Testing};
use trimaran_cull::LodRule;

fn case(name: &str) -> Case {
    hard_cases().unwrap().into_iter().find(|case| case.name == name).unwrap()
}

/// Walks a case with both occlusion tests and both ways to place vertices. Asserts that culling is exact in
/// every frame, and returns the frames with rasterized boxes.
fn assert_exact(name: &str) -> Vec<FrameReport> {
    let case = case(name);
    let walk = |testing, placement, epsilon| {
        let rule = LodRule::new(epsilon).unwrap();
        let mut walk =
            ReferenceWalkthrough::new(case.scene.clone(), rule).testing(testing).placing(placement);
        let frames = case.views.iter().map(|view| {
            let report = walk.frame(view).unwrap();
            let at = format!("{testing:?}, {placement:?}, epsilon {epsilon}, {}", view.camera().frame());
            assert_eq!(report.false_culled, [], "{at}");
            assert_eq!(report.differing_pixels, 0, "{at}");
            report
        });
        frames.collect::<Vec<_>>()
    };
    walk(Testing::Pyramid, Placement::Exact, 4.0);
    walk(Testing::Pyramid, Placement::Single, 0.5);
    walk(Testing::Rasterized, Placement::Single, 4.0);
    walk(Testing::Rasterized, Placement::Exact, 0.5)
}

#[test]
fn box_across_the_near_plane() {
    let frames = assert_exact("box across the near plane");
    assert!(frames.iter().any(|frame| frame.stats.counts.near_visible > 0));
}

#[test]
fn eye_inside_a_box() {
    let frames = assert_exact("eye inside a box");
    assert!(frames.iter().all(|frame| frame.stats.counts.eye_inside > 0));
}

#[test]
fn wall_against_its_own_surface() {
    let frames = assert_exact("wall against its own surface, 200 still frames");
    assert_eq!(frames.len(), 200);
    for frame in &frames[2..] {
        assert_eq!(frame.emitted, frames[1].emitted, "what is visible toggles though nothing moves");
    }
}

#[test]
fn boxes_of_unusual_shapes() {
    for name in [
        "flat, line and point boxes",
        "sub-pixel boxes and slivers past a one-pixel gap",
        "thin wall with a crate touching it from behind",
        "scaled by 1e-3 to 1e3, mirrored, sheared",
    ] {
        assert_exact(name);
    }
}

#[test]
fn nothing_visible_and_back() {
    let frames = assert_exact("nothing visible, and back");
    let emitted: Vec<usize> = frames.iter().map(|frame| frame.emitted.len()).collect();
    assert_eq!(emitted[1..3], [0, 0]);
    // After a frame with nothing visible there are no occluders: all in the frustum is drawn again.
    assert_eq!((frames[3].occluders.len(), emitted[3]), (0, 2));
}

#[test]
fn far_from_the_origin_is_as_at_the_origin() {
    let here = assert_exact("origin at 0");
    for name in ["origin at 1e6", "origin at 1e7", "origin at 1e8"] {
        for (far, here) in assert_exact(name).iter().zip(&here) {
            assert_eq!(far.shown.ids(), here.shown.ids(), "{name}");
        }
    }
}

#[test]
fn a_teleport_culls_nothing_falsely() {
    assert_exact("teleport every frame");
    // This path jumps every 13 views; the frame after a jump draws more, and nothing is lost.
    let frames = assert_exact("origin at 0");
    assert!(frames[13].emitted.len() >= frames[14].emitted.len());
}

#[test]
fn fields_of_view() {
    for name in ["fov 0.01", "fov 1", "fov 120", "fov 179"] {
        assert_exact(name);
    }
}

#[test]
fn odd_picture_sizes() {
    for name in ["1 x 1", "1 x 97", "97 x 1", "1023 x 33"] {
        assert_exact(name);
    }
}

#[test]
fn a_large_odd_picture() {
    assert_exact("333 x 777");
}
