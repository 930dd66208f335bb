//! Box occlusion tests against the f64 reference and against each other.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use trimaran_audit::{Placement, ReferenceTest, rasterize};
use trimaran_cull::{Answer, OcclusionTest, TestBox, View};
use trimaran_gpu::{GpuScene, OccluderPass};
use trimaran_proto::DrawableId;
use trimaran_scene::{FlatObject, Scene, random::Random};

use crate::common::{CheckedGpu, answers, ids, lacks_float64, scene, triangles, upload, view, wall};

/// A box along the view's axes.
pub(crate) fn upright(centre: Vec3, half: Vec3) -> TestBox {
    TestBox { centre, axes: [Vec3::X * half.x, Vec3::Y * half.y, Vec3::Z * half.z] }
}

/// A box in front of the eye in any pose, of about `size` metres.
pub(crate) fn random_box(random: &mut Random, size: f64) -> TestBox {
    let centre = random.point(DVec3::new(-6.0, -6.0, -12.0), DVec3::new(6.0, 6.0, -2.5));
    let rotation = random.rotation();
    let half = random.point(DVec3::splat(0.05 * size), DVec3::splat(size));
    // One box in two is left-handed: its corners wind the other way.
    let hand = if random.bits() & 1 == 0 { 1.0 } else { -1.0 };
    TestBox {
        centre: centre.as_vec3(),
        axes: [DVec3::X * half.x * hand, DVec3::Y * half.y, DVec3::Z * half.z]
            .map(|axis| (rotation * axis).as_vec3()),
    }
}

/// Walls at odd places, upright and slanted, that hide about half of the space behind them.
pub(crate) fn walls() -> Vec<FlatObject> {
    let slanted = triangles(&[[-5.0, -5.0, -4.0], [5.0, -5.0, -9.0], [0.0, 6.0, -7.0]]);
    vec![
        wall(Vec3::new(-2.13, 1.77, -5.31), 2.21, 1.43),
        wall(Vec3::new(1.91, -1.37, -3.7), 1.33, 1.71),
        slanted,
    ]
}

/// The answers of each occlusion test on `boxes` behind `occluders`.
struct Answers {
    reference: Vec<u32>,
    query: Vec<u32>,
    raster: Vec<u32>,
}

fn ask(gpu: &CheckedGpu, scene: &Arc<Scene>, view: &View, boxes: &[TestBox]) -> Answers {
    let all = ids(scene.drawables().len());
    let picture = rasterize(scene, view, all.iter().copied(), Placement::Single);
    let reference = answers(ReferenceTest::new(&picture), view, boxes);

    let uploaded = GpuScene::new(gpu, scene).unwrap();
    let mut pass = OccluderPass::new(&uploaded, view.viewport()).unwrap();
    pass.begin(view).unwrap();
    pass.draw(&all).unwrap();
    // Not finished: an occlusion test waits for pending draws by itself.
    let query = answers(pass.query_test().unwrap(), view, boxes);
    let raster = answers(pass.raster_test().unwrap(), view, boxes);
    // Testing changes nothing: the same again.
    assert_eq!(answers(pass.query_test().unwrap(), view, boxes), query);
    Answers { reference, query, raster }
}

#[test]
fn queries_and_counting_agree_with_the_reference_on_random_boxes() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&walls()));
    let mut random = Random::new(1);
    for (width, height) in [(256, 256), (333, 177)] {
        let view = view(width, height, DVec3::ZERO);
        let boxes: Vec<TestBox> =
            (0..2500).map(|i| random_box(&mut random, [1.5, 0.3, 0.06][i % 3])).collect();
        let Answers { reference, query, raster } = ask(&gpu, &scene, &view, &boxes);
        assert_eq!(query, raster);
        let hidden = reference.iter().filter(|&&count| count == 0).count();
        assert!((250..2000).contains(&hidden), "{hidden} hidden: the test tests little");
        // The device places corners in f32, so one in a few hundred rounds to another sub-pixel step than in
        // f64, and a pixel on an edge changes sides.
        let differing: Vec<_> = (0..boxes.len()).filter(|&i| reference[i] != query[i]).collect();
        assert!(differing.len() * 50 < boxes.len(), "{} of {} differ", differing.len(), boxes.len());
        for i in differing {
            let (expected, counted) = (reference[i], query[i]);
            assert!(expected.abs_diff(counted) <= 2 + expected / 200, "box {i}: {counted} for {expected}");
        }
    }
}

/// Like culling in rounds.
#[test]
fn occluders_can_be_added_after_boxes_were_tested() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let with_hzb = !lacks_float64(&gpu);
    let scene = Arc::new(scene(&walls()));
    let view = view(256, 256, DVec3::ZERO);
    let mut random = Random::new(3);
    let boxes: Vec<TestBox> = (0..500).map(|_| random_box(&mut random, 0.3)).collect();
    let uploaded = GpuScene::new(&gpu, &scene).unwrap();
    let mut pass = OccluderPass::new(&uploaded, view.viewport()).unwrap();
    let mut tested = |parts: &[&[DrawableId]]| {
        let (mut query, mut hzb) = (Vec::new(), Vec::new());
        pass.begin(&view).unwrap();
        for part in parts {
            pass.draw(part).unwrap();
            pass.finish().unwrap();
            query = answers(pass.query_test().unwrap(), &view, &boxes);
            assert_eq!(answers(pass.raster_test().unwrap(), &view, &boxes), query);
            if with_hzb {
                hzb = answers(pass.hzb_test().unwrap(), &view, &boxes);
            }
        }
        (query, hzb)
    };
    let all = ids(3);
    let together = tested(&[&all]);
    assert!(tested(&[&all[..1], &all[1..]]) == together);
    let part = tested(&[&all[..1]]);
    assert!(part.0 != together.0);
    assert!(!with_hzb || part.1 != together.1);
}

/// A pass with views of changing size answers like new ones for each.
#[test]
fn pictures_that_change_their_size_get_the_answers_of_new_ones() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&walls()));
    let mut random = Random::new(4);
    let boxes: Vec<TestBox> = (0..300).map(|_| random_box(&mut random, 0.3)).collect();
    let uploaded = GpuScene::new(&gpu, &scene).unwrap();
    let mut pass = OccluderPass::new(&uploaded, view(8, 8, DVec3::ZERO).viewport()).unwrap();
    for (width, height) in [(256, 256), (31, 200), (333, 177), (1, 1), (256, 256)] {
        let view = view(width, height, DVec3::ZERO);
        pass.begin(&view).unwrap();
        pass.draw(&ids(3)).unwrap();
        let expected = ask(&gpu, &scene, &view, &boxes);
        let at = format!("{width} x {height}");
        assert!(answers(pass.query_test().unwrap(), &view, &boxes) == expected.query, "{at}");
        assert!(answers(pass.raster_test().unwrap(), &view, &boxes) == expected.raster, "{at}");
    }
}

#[test]
fn a_box_in_the_open_counts_its_silhouette_once() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&[wall(Vec3::new(0.0, 0.0, -50.0), 1.0, 1.0)]));
    // 64 pixels to 2 m at 1 m: the front face of half-width 1/4 at 1 m covers 16 x 16 pixels, the back face
    // fewer.
    let front = upright(Vec3::new(0.0, 0.0, -1.5), Vec3::new(0.25, 0.25, 0.5));
    let mirrored = TestBox { axes: [-front.axes[0], front.axes[1], front.axes[2]], ..front };
    let swapped = TestBox { axes: [front.axes[2], front.axes[0], front.axes[1]], ..front };
    let view = view(64, 64, DVec3::ZERO);
    let Answers { reference, query, raster } = ask(&gpu, &scene, &view, &[front, mirrored, swapped]);
    assert_eq!(reference, [256; 3]);
    assert_eq!(query, [256; 3]);
    assert_eq!(raster, [256; 3]);
}

#[test]
fn boxes_level_with_a_wall_show_and_boxes_behind_it_do_not() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&[wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0)]));
    let view = view(40, 40, DVec3::ZERO);
    let at = |z: f32| upright(Vec3::new(0.25, 0.25, z - 0.5), Vec3::new(0.3, 0.3, 0.5));
    let Answers { reference, query, raster } =
        ask(&gpu, &scene, &view, &[at(-1.999), at(-2.0), at(-2.001), at(-40.0)]);
    assert!(query[0] > 0 && query[1] > 0, "{query:?}");
    assert_eq!(query[2..], [0, 0]);
    assert_eq!(query, reference);
    assert_eq!(raster, query);
}

#[test]
fn boxes_smaller_than_a_pixel_agree_with_the_reference() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&walls()));
    let view = view(200, 200, DVec3::ZERO);
    let mut random = Random::new(2);
    let boxes: Vec<TestBox> = (0..4000).map(|_| random_box(&mut random, 0.03)).collect();
    let Answers { reference, query, raster } = ask(&gpu, &scene, &view, &boxes);
    assert_eq!(query, raster);
    assert!(query.contains(&0) && query.contains(&1));
    let differing = (0..boxes.len()).filter(|&i| reference[i] != query[i]).count();
    assert!(differing * 200 < boxes.len(), "{differing} of {} differ", boxes.len());
    assert!(reference.iter().zip(&query).all(|(a, b)| a.abs_diff(*b) <= 1));
}

#[test]
fn what_no_test_can_decide_is_visible() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&[wall(Vec3::new(0.0, 0.0, -0.2), 99.0, 99.0)]));
    let view = view(16, 16, DVec3::ZERO);
    let behind = upright(Vec3::new(0.0, 0.0, -9.0), Vec3::ONE);
    let around = upright(Vec3::ZERO, Vec3::splat(5.0));
    let across_near = upright(Vec3::new(0.0, 0.0, -1.1), Vec3::ONE);
    let not_a_number = TestBox { centre: Vec3::new(f32::NAN, 0.0, -9.0), ..behind };
    let infinite = TestBox { axes: [Vec3::X * f32::INFINITY, Vec3::Y, Vec3::Z], ..behind };
    let boxes = [behind, around, not_a_number, across_near, infinite, behind];
    let Answers { query, raster, .. } = ask(&gpu, &scene, &view, &boxes);
    assert_eq!(query, [0, 1, 1, 1, 1, 0]);
    assert_eq!(raster, query);
}

#[test]
fn flat_boxes_show_as_the_rectangle_they_are() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = Arc::new(scene(&[wall(Vec3::new(0.0, 0.0, -50.0), 1.0, 1.0)]));
    let view = view(64, 64, DVec3::ZERO);
    let flat = upright(Vec3::new(0.0, 0.0, -1.0), Vec3::new(0.25, 0.25, 0.0));
    let thin = upright(Vec3::new(0.0, 0.0, -1.0), Vec3::new(0.25, 0.25, 1e-7));
    let Answers { query, raster, .. } = ask(&gpu, &scene, &view, &[flat, thin]);
    assert_eq!(query, [256, 256]);
    assert_eq!(raster, query);
}

#[test]
fn batches_of_any_size_are_answered_in_order() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene: Arc<GpuScene> = upload(&gpu, &walls());
    let view = view(64, 64, DVec3::ZERO);
    let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
    pass.begin(&view).unwrap();
    pass.draw(&ids(3)).unwrap();
    let mut random = Random::new(3);
    let boxes: Vec<TestBox> = (0..70_000).map(|_| random_box(&mut random, 0.2)).collect();
    let all = answers(pass.raster_test().unwrap(), &view, &boxes);
    assert_eq!(all.len(), boxes.len());
    for count in [0, 1, 2, 999, 1000, 1001, 4500] {
        let (some, expected) = (&boxes[..count], &all[..count]);
        assert_eq!(answers(pass.query_test().unwrap(), &view, some), expected, "{count} queries");
        assert_eq!(answers(pass.raster_test().unwrap(), &view, some), expected, "{count} counted");
    }
    let query = answers(pass.query_test().unwrap(), &view, &boxes[65_000..]);
    assert_eq!(query, all[65_000..], "the second part of a batch that was cut in two");
    assert_eq!(pass.query_test().unwrap().answer(), Answer::PixelCount);
    assert_eq!(pass.raster_test().unwrap().answer(), Answer::PixelCount);
}
