//! The whole loop on the hard cases: nothing visible is culled, and culling changes no pixel.

use trimaran_audit::cases::{Case, hard_cases};
use trimaran_audit::{FrameReport, Placement, ReferenceWalkthrough, Testing};
use trimaran_cull::LodRule;
use trimaran_proto::DrawableId;

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
fn eye_on_a_box() {
    let frames = assert_exact("eye on a box");
    let decided = |frame: &FrameReport| frame.stats.counts.eye_inside + frame.stats.counts.near_visible;
    assert!(frames.iter().all(|frame| decided(frame) > 0));
}

#[test]
fn surfaces_level_with_each_other_do_not_toggle() {
    for (name, count) in [
        ("wall against its own surface, 200 still frames", 200),
        ("plates flush with a wall, 60 still frames", 60),
        ("plates flush with a wall at 1e6, 60 still frames", 60),
    ] {
        let frames = assert_exact(name);
        assert_eq!(frames.len(), count);
        for frame in &frames[2..] {
            assert_eq!(frame.emitted, frames[1].emitted, "{name}: toggles though nothing moves");
        }
    }
}

#[test]
fn boxes_of_unusual_shapes() {
    for name in [
        "flat, line and point boxes",
        "sub-pixel boxes and slivers past a one-pixel gap",
        "thin wall with a crate touching it from behind",
        "plates before and behind a thin wall, from 0 to 1 cm",
        "scaled by 1e-3 to 1e3, mirrored, sheared",
    ] {
        assert_exact(name);
    }
}

#[test]
fn plates_before_walls_are_drawn_at_each_distance_and_some_behind_are_not() {
    let name = "plates before and behind walls at 2 m to 20 km";
    let frames = assert_exact(name);
    // Four frames of each wall: the last ones have its occluders.
    for (wall, frames) in frames.chunks(4).enumerate() {
        let [.., last] = frames else { panic!("no frames of wall {wall}") };
        assert_eq!(last.exact.len(), 5, "the wall and the four plates before it");
        assert!(last.emitted.len() < 9, "wall {wall}: nothing behind it is culled");
    }
}

#[test]
fn depths_near_and_far() {
    for name in ["depth from 0.1 m to 1e7 m", "near plane at 1 mm, pairs up to 100 km away"] {
        assert_exact(name);
    }
}

#[test]
fn gaps_of_a_pixel() {
    for name in
        ["a keyhole of one pixel", "a grating finer than a pixel", "a wall's edge outside of the picture"]
    {
        let frames = assert_exact(name);
        // The view through the gap differs between frames, so the path hits and misses it.
        assert!(frames.iter().any(|frame| frame.exact != frames[0].exact), "{name}");
    }
}

#[test]
fn levels_that_differ() {
    let frames = assert_exact("a level that occludes more than its mesh");
    assert!(frames.iter().any(|frame| frame.emitted != frames[0].emitted));
    let dome = case("patches of a dome, each at a level of its own");
    let frames = assert_exact(dome.name);
    assert!(frames.iter().all(|frame| frame.shown.ids().iter().all(Option::is_some)), "a crack");
    let levels = |frame: &FrameReport| {
        let of = |id: &DrawableId| dome.scene.drawables()[id.index()].error > 0.0;
        (frame.emitted.iter().any(of), frame.emitted.iter().any(|id| !of(id)))
    };
    assert!(frames.iter().any(|frame| levels(frame) == (true, true)), "all patches are at one level");
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
fn turns_and_shakes() {
    for name in
        ["a turn by 90 degrees every frame", "a shake by one pixel", "a steady turn by 8 pixels a frame"]
    {
        assert_exact(name);
    }
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
