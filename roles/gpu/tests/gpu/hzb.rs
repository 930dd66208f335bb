//! Boxes tested against the depth pyramid on the device: the host's answers, box by box.

use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::{DepthPyramid, HzbTest, OcclusionTest, Outline, TestBox, View};
use trimaran_gpu::{GpuError, GpuScene, OccluderPass};
use trimaran_proto::DrawableId;
use trimaran_scene::{FlatObject, random::Random};

use crate::common::{CheckedGpu, answers, ids, lacks_float64, triangles, upload, view, wall};
use crate::occlusion_tests::{random_box, upright, walls};

/// A device that can test against a pyramid, or `None` without one, to skip the test.
fn open() -> Option<CheckedGpu> {
    CheckedGpu::open().filter(|gpu| !lacks_float64(gpu))
}

fn pass(scene: &Arc<GpuScene>, view: &View) -> OccluderPass {
    let mut pass = OccluderPass::new(scene, view.viewport()).unwrap();
    pass.begin(view).unwrap();
    pass
}

fn on_host(pass: &mut OccluderPass, view: &View, boxes: &[TestBox]) -> Vec<u32> {
    let image = pass.read_depth().unwrap();
    answers(HzbTest::new(image, &DepthPyramid::over(image)).unwrap(), view, boxes)
}

/// Asserts that host and device agree on each box behind the drawn depth, and returns the answers.
fn assert_same(pass: &mut OccluderPass, view: &View, boxes: &[TestBox]) -> Vec<u32> {
    // The device first, so that it does not benefit from the host's wait.
    let answers = answers(pass.hzb_test().unwrap(), view, boxes);
    let expected = on_host(pass, view, boxes);
    assert_eq!(answers.len(), boxes.len());
    for ((answer, expected), test_box) in answers.iter().zip(&expected).zip(boxes) {
        assert_eq!(answer, expected, "{test_box:?} at {:?}", view.viewport());
    }
    answers
}

/// Slanted triangles at all depths.
fn shards(random: &mut Random, count: usize) -> FlatObject {
    let shard = |random: &mut Random| {
        let depth = random.between(1.5, 12.0);
        let middle = random.point(DVec3::new(-1.0, -1.0, -1.0), DVec3::new(1.0, 1.0, -1.0)) * depth;
        [(); 3]
            .map(|()| (middle + random.point(DVec3::NEG_ONE, DVec3::ONE) * 0.2 * depth).as_vec3().to_array())
    };
    triangles(&(0..count).flat_map(|_| shard(random)).collect::<Vec<_>>())
}

#[test]
fn random_boxes_get_the_hosts_answers_after_each_part_of_a_frame() {
    let Some(gpu) = open() else { return };
    let mut random = Random::new(11);
    let (mut hidden, mut all) = (0, 0);
    for (width, height) in [(256, 256), (333, 177), (1023, 3), (1, 9), (1, 1), (640, 480)] {
        let view = view(width, height, DVec3::ZERO);
        let mut objects = walls();
        objects.push(shards(&mut random, 300));
        let scene = upload(&gpu, &objects);
        let mut pass = pass(&scene, &view);
        let boxes: Vec<_> =
            (0..2400).map(|i| random_box(&mut random, [3.0, 1.0, 0.2, 0.05, 0.01, 0.002][i % 6])).collect();
        let mut before = vec![1; boxes.len()];
        // Like a culler that adds occluders within a frame: more depth, and the same boxes again.
        for part in [&[][..], &[0, 1], &[2], &[3]] {
            let part: Vec<_> = part.iter().copied().map(DrawableId).collect();
            pass.draw(&part).unwrap();
            let answers = assert_same(&mut pass, &view, &boxes);
            assert!(answers.iter().zip(&before).all(|(now, before)| now <= before), "what was hidden shows");
            before = answers;
        }
        hidden += before.iter().filter(|&&shows| shows == 0).count();
        all += boxes.len();
    }
    assert!((all / 5..all * 4 / 5).contains(&hidden), "{hidden} of {all} hidden: the test tests little");
}

/// Boxes whose answers depend on few texels, on rounding, or on the projection's result.
fn hard_boxes() -> Vec<(&'static str, TestBox)> {
    let turned = |angle: f32, half: Vec3, centre: Vec3| {
        let turn = Mat3::from_rotation_x(angle) * Mat3::from_rotation_y(0.3);
        TestBox { centre, axes: [Vec3::X * half.x, Vec3::Y * half.y, Vec3::Z * half.z].map(|a| turn * a) }
    };
    let behind = upright(Vec3::new(0.0, 0.0, -9.0), Vec3::ONE);
    vec![
        ("sub-pixel", upright(Vec3::new(0.01, 0.01, -3.0), Vec3::splat(1e-4))),
        ("sub-pixel behind", upright(Vec3::new(0.01, 0.01, -7.0), Vec3::splat(1e-4))),
        ("sliver", turned(0.4, Vec3::new(6.0, 1e-4, 1e-4), Vec3::new(0.0, 0.3, -4.0))),
        ("sliver behind", turned(0.4, Vec3::new(3.0, 1e-4, 1e-4), Vec3::new(0.0, 0.3, -9.0))),
        ("flat", upright(Vec3::new(0.0, 0.0, -5.0), Vec3::new(0.4, 0.4, 0.0))),
        ("flat and turned", turned(1.2, Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 0.0, -8.0))),
        ("a point", upright(Vec3::new(0.0, 0.0, -6.0), Vec3::ZERO)),
        ("just before the wall", upright(Vec3::new(0.0, 0.0, -4.4999), Vec3::splat(0.5))),
        ("level with the wall", upright(Vec3::new(0.0, 0.0, -4.5), Vec3::splat(0.5))),
        ("just behind the wall", upright(Vec3::new(0.0, 0.0, -4.51), Vec3::splat(0.5))),
        ("leaning on the wall", turned(0.7, Vec3::new(0.3, 0.3, 0.3), Vec3::new(0.0, 0.0, -4.45))),
        ("at the left border", upright(Vec3::new(-9.0, 0.0, -9.0), Vec3::splat(0.3))),
        ("at a corner", upright(Vec3::new(9.0, -9.0, -9.0), Vec3::splat(0.3))),
        ("beside the picture", upright(Vec3::new(-30.0, 0.0, -9.0), Vec3::splat(0.3))),
        ("at the wall's edge", upright(Vec3::new(3.0, 0.0, -4.6), Vec3::splat(0.4))),
        ("whole screen", upright(Vec3::new(0.0, 0.0, -30.0), Vec3::new(90.0, 90.0, 1.0))),
        ("whole screen before all", upright(Vec3::new(0.0, 0.0, -2.0), Vec3::new(9.0, 9.0, 1.0))),
        ("huge", upright(Vec3::new(0.0, 0.0, -2e30), Vec3::splat(1e30))),
        ("huge and near", upright(Vec3::new(0.0, 0.0, -1e30), Vec3::splat(0.999e30))),
        ("tiny and near", upright(Vec3::new(0.0, 0.0, -1e-30), Vec3::splat(1e-32))),
        ("far", upright(Vec3::new(0.0, 0.0, -3e38), Vec3::ONE)),
        ("too many texels", turned(1.0, Vec3::new(4.0, 9.0, 1e-3), Vec3::new(0.0, 0.0, -14.0))),
        ("around the eye", upright(Vec3::ZERO, Vec3::splat(5.0))),
        ("across the near plane", upright(Vec3::new(0.0, 0.0, -1.1), Vec3::ONE)),
        ("behind the eye", upright(Vec3::new(0.0, 0.0, 9.0), Vec3::ONE)),
        ("not a number", TestBox { centre: Vec3::new(f32::NAN, 0.0, -9.0), ..behind }),
        ("infinite", TestBox { axes: [Vec3::X * f32::INFINITY, Vec3::Y, Vec3::Z], ..behind }),
    ]
}

#[test]
fn hard_boxes_get_the_hosts_answers() {
    let Some(gpu) = open() else { return };
    // A thin wall with an edge, a slanted one behind it, and a distant one that hides everything.
    let slanted = triangles(&[[-20.0, -20.0, -6.0], [20.0, -20.0, -6.0], [0.0, 20.0, -16.0]]);
    let objects =
        [wall(Vec3::new(0.0, 0.0, -4.0), 3.0, 3.0), slanted, wall(Vec3::new(0.0, 0.0, -25.0), 99.0, 99.0)];
    let scene = upload(&gpu, &objects);
    let (names, boxes): (Vec<_>, Vec<_>) = hard_boxes().into_iter().unzip();
    for (width, height) in [(1, 1), (2, 1), (64, 64), (333, 77), (1023, 3), (1024, 1024)] {
        let view = view(width, height, DVec3::ZERO);
        let mut pass = pass(&scene, &view);
        for id in ids(3) {
            pass.draw(&[id]).unwrap();
            assert_same(&mut pass, &view, &boxes);
        }
        if (width, height) == (1024, 1024) {
            let answers = assert_same(&mut pass, &view, &boxes);
            let say = |shows| {
                let of = names.iter().zip(&answers).filter(move |(_, answer)| **answer == shows);
                of.map(|(name, _)| *name).collect::<Vec<_>>()
            };
            for name in ["sub-pixel", "whole screen before all", "around the eye", "not a number", "infinite"]
            {
                assert!(say(1).contains(&name), "{name} is hidden");
            }
            for name in ["sub-pixel behind", "sliver behind", "just behind the wall", "whole screen", "huge"]
            {
                assert!(say(0).contains(&name), "{name} shows");
            }
        }
    }
}

/// Slanted plates just behind a slanted wall, which only single pixels hide. Small ones are tested to the
/// end, large ones exceed the budget of texels. Somewhere between them one takes the very last texel.
#[test]
fn plates_that_take_all_texels_there_are_get_the_hosts_answers() {
    let Some(gpu) = open() else { return };
    let turn = Mat3::from_rotation_x(1.0);
    let at = |x: f32, y: f32| (Vec3::Z * -5.0 + turn * (Vec3::new(x, y, 0.0) * 4.0)).to_array();
    let scene = upload(&gpu, &[triangles(&[at(-1.0, -1.0), at(1.0, -1.0), at(0.0, 1.0)])]);
    let view = view(512, 512, DVec3::ZERO);
    let mut pass = pass(&scene, &view);
    pass.draw(&ids(1)).unwrap();
    let mut random = Random::new(13);
    let mut plate = |_| {
        let half = random.point(DVec3::new(0.05, 0.05, 1e-4), DVec3::new(0.5, 0.2, 1e-4)).as_vec3();
        let axes = [Vec3::X * half.x, Vec3::Y * half.y, Vec3::Z * half.z].map(|axis| turn * axis);
        TestBox { centre: Vec3::Z * -5.025, axes }
    };
    let boxes: Vec<_> = (0..6000).map(&mut plate).collect();
    let answers = assert_same(&mut pass, &view, &boxes);
    let hidden = answers.iter().filter(|&&shows| shows == 0).count();
    assert!((1000..5000).contains(&hidden), "{hidden} of {} hidden", boxes.len());
}

/// Boxes whose grown outline ends exactly at the centre of the one open column: the last bit of sums and
/// products decides whether they are visible.
#[test]
fn boxes_that_rounding_decides_on_get_the_hosts_answers() {
    let Some(gpu) = open() else { return };
    let view = view(256, 256, DVec3::ZERO);
    // All but column 192, whose centre is 64.5 pixels right of the middle; 128 pixels to the metre at 1 m.
    let wall_between = |left: f32, right: f32| {
        let [left, right] = [left, right].map(|at| at / 128.0);
        wall(Vec3::new(0.5 * (left + right), 0.0, -1.0), 0.5 * (right - left), 2.0)
    };
    let scene = upload(&gpu, &[wall_between(-200.0, 64.0), wall_between(65.0, 200.0)]);
    let mut pass = pass(&scene, &view);
    pass.draw(&ids(2)).unwrap();
    let grown = (view.grid().outline_px() + view.grid().margin_px()) as f32;
    let mut random = Random::new(14);
    let mut edge = |_| {
        // Few bits, so that the right end is exact.
        let mut sixteenths = |low, high| (random.between(low, high) * 16.0).round() as f32 / 16.0;
        let (depth, half_depth) = (sixteenths(2.0, 60.0), sixteenths(0.1, 8.0));
        let half = Vec3::new(sixteenths(0.1, 0.4), sixteenths(0.1, 1.5), half_depth);
        let right = (64.5 - grown) / 128.0 * depth;
        upright(Vec3::new(right - half.x, sixteenths(-0.4, 0.4), -depth - half_depth), half)
    };
    let boxes: Vec<_> = (0..3000).map(&mut edge).collect();
    let answers = assert_same(&mut pass, &view, &boxes);
    let hidden = answers.iter().filter(|&&shows| shows == 0).count();
    assert!((300..2700).contains(&hidden), "{hidden} of {} hidden", boxes.len());
}

#[test]
fn batches_of_any_size_and_pictures_that_change_theirs_get_the_hosts_answers() {
    let Some(gpu) = open() else { return };
    let scene = upload(&gpu, &walls());
    let mut random = Random::new(12);
    let boxes: Vec<TestBox> = (0..70_000).map(|_| random_box(&mut random, 0.2)).collect();
    let first = view(64, 64, DVec3::ZERO);
    let mut pass = pass(&scene, &first);
    for (size, counts) in
        [(64, &[0, 1, 1000, 1025, 70_000][..]), (200, &[3000]), (31, &[3000]), (31, &[2000])]
    {
        let view = view(size, size, DVec3::ZERO);
        pass.begin(&view).unwrap();
        pass.draw(&ids(3)).unwrap();
        for &count in counts {
            assert_same(&mut pass, &view, &boxes[..count]);
        }
    }
    assert_eq!(pass.hzb_test().unwrap().outline(), Outline::OnScreen);
    let error = pass.hzb_test().unwrap().test(&first, &boxes[..1], &mut Vec::new()).unwrap_err();
    assert!(matches!(error, GpuError::OtherSize { .. }), "{error}");
}

/// On a CPU driver without f64, such as SwiftShader.
#[test]
fn a_device_without_f64_says_so() {
    let Some(gpu) = CheckedGpu::open().filter(|gpu| lacks_float64(gpu)) else { return };
    let scene = upload(&gpu, &walls());
    let error = pass(&scene, &view(8, 8, DVec3::ZERO)).hzb_test().err().unwrap();
    assert!(error.to_string().contains("lacks shaderFloat64"), "{error}");
}
