//! The depth pyramid hides nothing that a rasterized test shows.

use glam::{DVec3, Mat3, Vec3};
use trimaran_audit::cases::looking;
use trimaran_audit::{IdBuffer, ReferenceTest, rasterize_triangle};
use trimaran_cull::{
    DepthImage, DepthPyramid, HzbError, HzbTest, OcclusionTest, Outline, RectangleTest, TestBox, View,
    Viewport,
};
use trimaran_proto::{Camera, FrameNumber};
use trimaran_scene::random::Random;

fn random_box(random: &mut Random) -> TestBox {
    let depth = random.between(-2.0, 5.0).exp2();
    let centre =
        DVec3::new(random.between(-0.8, 0.8) * depth, random.between(-0.8, 0.8) * depth, -depth - 0.1);
    let turn = random.rotation();
    let axes = [DVec3::X, DVec3::Y, DVec3::Z]
        .map(|axis| (turn * axis * depth * 0.4 * random.between(-9.0, 0.0).exp2()).as_vec3());
    TestBox { centre: centre.as_vec3(), axes }
}

fn answers(mut test: impl OcclusionTest, view: &View, boxes: &[TestBox]) -> Vec<u32> {
    let mut answers = Vec::new();
    test.test(view, boxes, &mut answers).unwrap();
    answers
}

/// Against random triangles at sizes from one pixel up: a box that a rasterized test shows is never
/// hidden, and most of those that it hides are.
#[test]
fn nothing_that_a_rasterized_test_shows_is_hidden() {
    let mut random = Random::new(9);
    let (mut both_hide, mut rectangle_hides, mut half_hides, mut reference_hides) = (0, 0, 0, 0);
    for round in 0..60 {
        let (width, height) = [(64, 48), (1, 1), (1, 33), (77, 31), (127, 129)][round % 5];
        let fov = [60.0, 100.0, 20.0][round % 3];
        let viewport = Viewport::new(width, height).unwrap();
        let view = looking(DVec3::ZERO, DVec3::Y, fov, viewport, 0).unwrap();
        let mut occluders = IdBuffer::new(viewport);
        for _ in 0..12 {
            let wall = random_box(&mut random);
            let [a, b] = [wall.axes[0] * 9.0, wall.axes[1] * 9.0].map(Vec3::as_dvec3);
            let centre = wall.centre.as_dvec3();
            rasterize_triangle(&view, [centre + a, centre - a + b, centre - a - b], |hit| {
                occluders.cover(hit);
            });
        }
        let depth = occluders.depth32();
        let image = DepthImage::new(viewport, &depth).unwrap();
        let pyramid = DepthPyramid::over(image);
        let boxes: Vec<TestBox> = (0..200).map(|_| random_box(&mut random)).collect();
        let exact = answers(ReferenceTest::new(&occluders), &view, &boxes);
        let test = HzbTest::new(image, &pyramid).unwrap().with_outline(Outline::InBox);
        let fast = answers(test.clone(), &view, &boxes);
        let loose = answers(RectangleTest::new(Some(image), &pyramid), &view, &boxes);
        let without_image = answers(RectangleTest::new(None, &pyramid), &view, &boxes);
        let by_rectangle = loose.iter().zip(&without_image);
        for (test_box, ((&count, &shows), (&loosely, &by_half))) in
            boxes.iter().zip(exact.iter().zip(&fast).zip(by_rectangle))
        {
            let beyond_near =
                -test_box.centre.z - test_box.axes.iter().map(|a| a.z.abs()).sum::<f32>() > 0.011;
            if !beyond_near {
                continue;
            }
            assert!(
                count == 0 || shows == 1,
                "{count} pixels of {test_box:?} show at {width} x {height}, fov {fov}"
            );
            assert!(shows <= loosely, "{test_box:?} is hidden by its rectangle, and shows");
            assert!(loosely <= by_half, "{test_box:?} is hidden by half the depth, and shows");
            half_hides += u32::from(by_half == 0);
            reference_hides += u32::from(count == 0);
            rectangle_hides += u32::from(loosely == 0);
            both_hide += u32::from(count == 0 && shows == 0);
        }
    }
    assert!(f64::from(both_hide) > 0.9 * f64::from(reference_hides), "{both_hide} of {reference_hides}");
    assert!(rectangle_hides < both_hide, "rectangles alone hide {rectangle_hides} of {reference_hides}");
    assert!(half_hides * 2 > rectangle_hides, "with half the depth {half_hides} of {rectangle_hides}");
}

/// A wall hides all of a slanted rod, but not the corner of the rectangle around it.
#[test]
fn a_rectangle_shows_where_the_box_in_it_does_not() {
    let viewport = Viewport::new(64, 64).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 90.0, viewport, 0).unwrap();
    // Nearer below the diagonal of the picture; the rod lies there, along the diagonal.
    let depth: Vec<f32> =
        (0..64 * 64).map(|pixel| if pixel % 64 <= pixel / 64 { 0.5 } else { 0.0 }).collect();
    let image = DepthImage::new(viewport, &depth).unwrap();
    let pyramid = DepthPyramid::over(image);
    let rod = TestBox {
        centre: Vec3::new(-1.0, -1.0, -10.0),
        axes: [Vec3::new(5.0, -5.0, 0.0), Vec3::new(0.05, 0.05, 0.0), Vec3::new(0.0, 0.0, 0.05)],
    };
    let test = HzbTest::new(image, &pyramid).unwrap();
    assert_eq!(answers(test, &view, &[rod]), [0]);
    assert_eq!(answers(RectangleTest::new(Some(image), &pyramid), &view, &[rod]), [1]);
}

#[test]
fn a_box_that_cannot_be_judged_shows() {
    let viewport = Viewport::new(8, 8).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, viewport, 0).unwrap();
    let nearest = [1.0; 64];
    let image = DepthImage::new(viewport, &nearest).unwrap();
    let pyramid = DepthPyramid::over(image);
    let sound = TestBox { centre: Vec3::new(0.0, 0.0, -5.0), axes: [Vec3::X, Vec3::Y, Vec3::Z] };
    let around_the_eye = TestBox { centre: Vec3::ZERO, ..sound };
    let nan = TestBox { centre: Vec3::new(f32::NAN, 0.0, -5.0), ..sound };
    let infinite = TestBox { axes: [Vec3::X * f32::INFINITY, Vec3::Y, Vec3::Z], ..sound };
    let test = HzbTest::new(image, &pyramid).unwrap();
    assert_eq!(answers(test, &view, &[sound, around_the_eye, nan, infinite]), [0, 1, 1, 1]);
}

/// A plate of a real platform, seen almost edge-on, whose corner falls on pixel centres. The rasterizer moved
/// the side outwards by a 540th of a pixel; there its depth is 0.5 mm nearer than any corner.
#[test]
fn a_side_that_the_rasterizer_moves_past_its_corner_does_not_hide_its_box() {
    let viewport = Viewport::new(384, 384).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, viewport, 0).unwrap();
    let plate = TestBox {
        centre: Vec3::new(-4.492_045_4, -8.861_727, -15.525_961),
        axes: [
            Vec3::new(0.0, 0.938_035_37, 0.0),
            Vec3::new(-0.036_934_294, 0.0, -0.354_617_18),
            Vec3::new(-0.037_333_414, 0.0, 0.003_888_371_4),
        ],
    };
    let mut depth = vec![1.0; 384 * 384];
    for row in 379..384 {
        depth[row * 384 + 93] = view.camera().near() / 15.167_034;
    }
    let image = DepthImage::new(viewport, &depth).unwrap();
    let pyramid = DepthPyramid::over(image);
    assert_eq!(answers(HzbTest::new(image, &pyramid).unwrap(), &view, &[plate]), [1]);
}

/// A box smaller than a pixel, between the centres of four: it is visible if its outline is grown, and misses
/// them all if the box itself should have been grown.
#[test]
fn outlines_are_grown_where_boxes_are_not() {
    let viewport = Viewport::new(8, 8).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, viewport, 0).unwrap();
    let mut pyramid = DepthPyramid::default();
    let image = DepthImage::new(viewport, &[0.0; 64]).unwrap();
    pyramid.rebuild(image);
    let small = TestBox { centre: Vec3::Z * -5.0, axes: [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * 1e-3) };
    for (outline, shows) in [(Outline::OnScreen, 1), (Outline::InBox, 0)] {
        let test = HzbTest::new(image, &pyramid).unwrap().with_outline(outline);
        assert_eq!((test.outline(), answers(test, &view, &[small])), (outline, vec![shows]));
    }
    assert_eq!(HzbTest::new(image, &pyramid).unwrap().outline(), Outline::OnScreen);
}

/// Boxes with slanted fronts just behind the depth of every pixel: only single pixels hide them. A small one
/// is tested to the end; a large one exceeds the budget of texels, and counts as visible.
#[test]
fn a_box_that_takes_too_long_counts_as_visible() {
    let viewport = Viewport::new(64, 64).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, viewport, 0).unwrap();
    let slanted = |half: f32| {
        let turn = Mat3::from_rotation_x(1.0);
        TestBox {
            centre: Vec3::Z * -5.0,
            axes: [Vec3::X * half, Vec3::Y * half, Vec3::Z * 1e-3].map(|a| turn * a),
        }
    };
    for (half, shows) in [(0.4, 0), (1.6, 1)] {
        let test_box = slanted(half);
        let mut front = IdBuffer::new(viewport);
        let [a, b, c] = test_box.axes.map(Vec3::as_dvec3);
        let middle = test_box.centre.as_dvec3() + c;
        // Beyond its edges as well, so that only the front's slope decides.
        for [a, b] in [[a, b], [b, -a], [-a, -b], [-b, a]].map(|axes| axes.map(|axis| axis * 20.0)) {
            rasterize_triangle(&view, [middle, middle + a, middle + b], |hit| front.cover(hit));
        }
        let depth: Vec<f32> = front.depth32().iter().map(|depth| depth * 1.01).collect();
        let image = DepthImage::new(viewport, &depth).unwrap();
        let pyramid = DepthPyramid::over(image);
        let test = HzbTest::new(image, &pyramid).unwrap().with_outline(Outline::InBox);
        assert_eq!(answers(test, &view, &[test_box]), [shows], "{half} m");
    }
}

/// A plate across a picture of one row, from its left edge on: it comes nearer to the right. Its pixels have
/// the depth of its front half a pixel farther right, so only single pixels hide them.
#[test]
fn a_box_takes_at_most_256_texels() {
    let viewport = Viewport::new(256, 1).unwrap();
    let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0 / 256.0, 0.01, FrameNumber(0)).unwrap();
    let view = View::new(camera, viewport);
    // The test begins at level 6, whose texels have 64 pixels. The first one hides the plate and does not
    // count. The next two lead to 127 texels each, down to the pixels. The last one ends in background, so it
    // is opened. With its first half, which hides the plate, these are 256. A 225th column leads to more.
    for (columns, shows) in [(224, 0), (225, 1)] {
        let inverse = |column: f64| (1.0 + column / f64::from(columns)) / 8.0;
        let end = |column: f64| DVec3::new((column - 128.0) / 128.0, 0.0, -1.0) / inverse(column);
        let (left, right) = (end(0.0), end(f64::from(columns)));
        let half = (right - left) * 0.5;
        let axes = [half, DVec3::Y, half.cross(DVec3::Y).normalize() * 1e-4].map(|axis| axis.as_vec3());
        let plate = TestBox { centre: ((left + right) * 0.5).as_vec3(), axes };
        let depth: Vec<f32> = (0..256)
            .map(|column| match column {
                64..192 => (0.01 * inverse(f64::from(column) + 1.0)) as f32,
                column if column < columns => 1.0,
                _ => 0.0,
            })
            .collect();
        let image = DepthImage::new(viewport, &depth).unwrap();
        let pyramid = DepthPyramid::over(image);
        let test = HzbTest::new(image, &pyramid).unwrap().with_outline(Outline::InBox);
        assert_eq!(answers(test, &view, &[plate]), [shows], "{columns} columns");
    }
}

/// The nearest depth of this box, with its allowance, is exactly an f32. Few boxes have such a depth.
#[test]
fn a_box_at_the_very_depth_of_the_picture_shows() {
    let viewport = Viewport::new(8, 8).unwrap();
    let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 623.0 / 1024.0, FrameNumber(0)).unwrap();
    let view = View::new(camera, viewport);
    let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * 0.5);
    let test_box = TestBox { centre: Vec3::Z * -4.517_202, axes };
    let nearest = 0.170_527_4_f32;
    for (depth, shows) in [(nearest, 1), (nearest.next_up(), 0)] {
        let depth = [depth; 64];
        let image = DepthImage::new(viewport, &depth).unwrap();
        let pyramid = DepthPyramid::over(image);
        assert_eq!(answers(HzbTest::new(image, &pyramid).unwrap(), &view, &[test_box]), [shows]);
        assert_eq!(answers(RectangleTest::new(Some(image), &pyramid), &view, &[test_box]), [shows]);
    }
}

/// Pixels 2 to 5 each way are four texels of level 1.
#[test]
fn a_rectangle_is_hidden_if_its_four_texels_are() {
    let viewport = Viewport::new(8, 8).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 90.0, viewport, 0).unwrap();
    let test_box = TestBox { centre: Vec3::Z * -5.0, axes: [Vec3::X * 1.5, Vec3::Y * 1.5, Vec3::Z * 0.2] };
    for (hole, shows) in
        [(None, 0), (Some((2, 2)), 1), (Some((5, 2)), 1), (Some((2, 5)), 1), (Some((5, 5)), 1)]
    {
        let mut depth = [0.0; 64];
        for (x, y) in (2..6).flat_map(|y| (2..6).map(move |x| (x, y))).filter(|at| Some(*at) != hole) {
            depth[y * 8 + x] = 1.0;
        }
        let image = DepthImage::new(viewport, &depth).unwrap();
        let pyramid = DepthPyramid::over(image);
        let test = RectangleTest::new(Some(image), &pyramid);
        assert_eq!(test.outline(), Outline::OnScreen);
        assert_eq!(answers(test, &view, &[test_box]), [shows], "{hole:?}");
    }
}

#[test]
fn sizes_must_agree() {
    let depth = [0.0; 6];
    let image = DepthImage::new(Viewport::new(3, 2).unwrap(), &depth).unwrap();
    let mut pyramid = DepthPyramid::default();
    let error = HzbTest::new(image, &pyramid).unwrap_err();
    let message = "a depth image of 3 x 2 pixels against a pyramid that was never built: both must be of the view's size";
    assert_eq!(error.to_string(), message);
    pyramid.rebuild(image);
    let mut test = HzbTest::new(image, &pyramid).unwrap();
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, Viewport::new(2, 3).unwrap(), 0).unwrap();
    let error = test.test(&view, &[], &mut Vec::new()).unwrap_err();
    let message = "a depth image of 3 x 2 pixels against 2 x 3 pixels: both must be of the view's size";
    assert_eq!(error.to_string(), message);
    for image in [None, Some(image)] {
        let error = RectangleTest::new(image, &pyramid).test(&view, &[], &mut Vec::new()).unwrap_err();
        assert_eq!(error, HzbError::Size { image: view.viewport(), other: pyramid.viewport() });
    }
}
