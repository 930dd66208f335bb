//! A scene larger than its device's memory is drawn as if all of it were there.

use std::fs::OpenOptions;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;
use trimaran_cull::View;
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene, ItemPass, OccluderPass, PicturePass};
use trimaran_proto::DrawableId;
use trimaran_scene::{FlatObject, ReadCause, Scene};

use crate::common::{self, CheckedGpu, ids, pixels, scene, triangles, view};

/// A bumpy square that faces the eye, of `2 * n * n` triangles, at this place.
fn sheet(n: u32, x: f32, y: f32, z: f32) -> FlatObject {
    let corner = |i: u32| {
        let (column, row) = (i % (n + 1), i / (n + 1));
        let bump = 0.05 * ((column * 7 + row * 3) % 5) as f32;
        [x + column as f32 / n as f32, y + row as f32 / n as f32, z + bump]
    };
    let square = |i: u32| {
        let at = i / n * (n + 1) + i % n;
        [at, at + 1, at + n + 1, at + n + 1, at + 1, at + n + 2]
    };
    let corners: Vec<_> = (0..(n + 1) * (n + 1)).map(corner).collect();
    FlatObject { indices: (0..n * n).flat_map(square).collect(), ..triangles(&corners) }
}

/// This many sheets at several depths, some before others; each takes about 40 kB.
fn sheets(count: u32) -> Scene {
    let sheet = |i: u32| {
        let (x, y) = ((i * 5 % 7) as f32 * 0.6 - 2.0, (i * 3 % 5) as f32 * 0.7 - 1.7);
        sheet(24, x, y, -2.0 - (i % 4) as f32 * 0.5)
    };
    scene(&(0..count).map(sheet).collect::<Vec<_>>())
}

fn with_memory(memory: Option<u64>) -> Option<CheckedGpu> {
    CheckedGpu::with(GpuOptions { memory, ..GpuOptions::default() })
}

fn items(drawn: &Arc<GpuScene>, view: &View, ids: &[DrawableId]) -> Vec<[u32; 2]> {
    common::items(&mut ItemPass::new(drawn, view.viewport()).unwrap(), view, ids)
}

#[test]
fn a_frame_larger_than_the_memory_is_drawn_in_parts_and_looks_the_same() {
    let Some(gpu) = with_memory(None) else { return };
    let scene = Arc::new(sheets(40));
    let (view, ids) = (view(160, 120, DVec3::ZERO), ids(40));
    let all = GpuScene::new(&gpu, &scene).unwrap();
    let mut pass = PicturePass::new(&all, view.viewport()).unwrap();
    let expected = pixels(&mut pass, &view, &ids);
    let expected_items = items(&all, &view, &ids);
    assert_eq!(all.working_set().dropped, 0);
    let whole = all.working_set().resident_bytes;
    assert!(whole > 1 << 20, "{whole} bytes");

    let Some(small) = with_memory(Some(200 << 10)) else { return };
    let drawn = GpuScene::new(&small, &scene).unwrap();
    let mut pass = PicturePass::new(&drawn, view.viewport()).unwrap();
    for _ in 0..3 {
        assert!(pixels(&mut pass, &view, &ids) == expected);
    }
    assert!(items(&drawn, &view, &ids) == expected_items);
    let set = drawn.working_set();
    assert!(set.resident_bytes <= set.taken_bytes && set.taken_bytes <= 200 << 10, "{set:?}");
    assert!(set.dropped >= 4 * 30, "each frame brings most of it anew: {set:?}");
}

#[test]
fn a_frame_is_begun_while_the_last_one_still_holds_all_of_the_memory() {
    let Some(small) = with_memory(Some(200 << 10)) else { return };
    let scene = Arc::new(sheets(24));
    let view = view(96, 96, DVec3::ZERO);
    let drawn = GpuScene::new(&small, &scene).unwrap();
    let (front, back) = (ids(24)[..12].to_vec(), ids(24)[12..].to_vec());
    let mut pass = PicturePass::new(&drawn, view.viewport()).unwrap();
    let [first, second] = [&front, &back].map(|ids| pixels(&mut pass, &view, ids));
    assert!(first != second);
    // Like a display that prepares a frame while the last one is drawn.
    pass.begin(&view).unwrap();
    pass.draw(&front).unwrap();
    pass.flush().unwrap();
    pass.begin(&view).unwrap();
    pass.draw(&back).unwrap();
    pass.flush().unwrap();
    pass.finish_previous().unwrap();
    assert!(pass.pixels().unwrap() == first);
    pass.finish().unwrap();
    assert!(pass.pixels().unwrap() == second);
}

#[test]
fn occluders_without_room_are_left_out_and_the_others_hide_as_before() {
    let scene = Arc::new(sheets(40));
    let (view, ids) = (view(64, 64, DVec3::ZERO), ids(40));
    let depth = |gpu: &Arc<Gpu>| {
        let drawn = GpuScene::new(gpu, &scene).unwrap();
        let mut pass = OccluderPass::new(&drawn, view.viewport()).unwrap();
        (common::depth(&mut pass, &view, &ids), drawn.working_set().loaded)
    };
    let (Some(large), Some(small)) = (with_memory(None), with_memory(Some(400 << 10))) else { return };
    let ((all, loaded_all), (some, loaded_some)) = (depth(&large), depth(&small));
    assert_eq!(loaded_all, 40);
    assert!((4..20).contains(&loaded_some), "{loaded_some}");
    // Reversed depth: farther is smaller.
    assert!(some.iter().zip(&all).all(|(some, all)| some <= all));
    assert!(some.iter().any(|&depth| depth > 0.0) && some != all);
}

#[test]
fn what_is_drawn_each_frame_stays_whatever_comes_and_goes() {
    let Some(small) = with_memory(Some(400 << 10)) else { return };
    let drawn = GpuScene::new(&small, &Arc::new(sheets(40))).unwrap();
    let view = view(32, 32, DVec3::ZERO);
    let mut pass = PicturePass::new(&drawn, view.viewport()).unwrap();
    let always = [DrawableId(3), DrawableId(7)];
    pixels(&mut pass, &view, &always);
    let mut brought = drawn.working_set().loaded;
    for other in (0..40).filter(|id| ![3, 7].contains(id)).map(DrawableId) {
        pixels(&mut pass, &view, &[always[0], other, always[1]]);
        brought += 1;
        assert_eq!(drawn.working_set().loaded, brought, "only {other} is new");
    }
    assert!(drawn.working_set().dropped > 20);
}

#[test]
fn a_drawable_larger_than_the_memory_is_an_error_that_says_how_much_it_takes() {
    let Some(small) = with_memory(Some(50_000)) else { return };
    let scene = Arc::new(scene(&[sheet(4, 0.0, 0.0, -2.0), sheet(60, 0.0, 0.0, -3.0)]));
    let view = view(16, 16, DVec3::ZERO);
    let drawn = GpuScene::new(&small, &scene).unwrap();
    let mut pass = PicturePass::new(&drawn, view.viewport()).unwrap();
    pass.begin(&view).unwrap();
    pass.draw(&[DrawableId(0)]).unwrap();
    match pass.draw(&[DrawableId(1)]) {
        Err(error @ GpuError::WorkingSetTooSmall { needed, budget: 50_000 }) => {
            assert!(needed > 7_200 * 12, "{needed}");
            assert!(error.to_string().contains("--gpu-memory"), "{error}");
        }
        other => panic!("{other:?}"),
    }
    // Drawables that fit can still be drawn.
    assert!(pixels(&mut pass, &view, &[DrawableId(0)]).iter().any(|pixel| pixel[..3] != [0; 3]));
}

#[test]
fn a_damaged_piece_is_an_error_of_the_frame_that_needs_it() {
    let Some(gpu) = with_memory(None) else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheets.scene");
    sheets(40).save(&path).unwrap();
    let scene = Arc::new(Scene::open(&path).unwrap());
    let view = view(32, 32, DVec3::ZERO);
    let drawn = GpuScene::new(&gpu, &scene).unwrap();
    let mut pass = PicturePass::new(&drawn, view.viewport()).unwrap();
    let ids = ids(40);
    let before = pixels(&mut pass, &view, &ids[..1]);
    // Past the directory and the first pages: into the last pieces.
    let file = OpenOptions::new().write(true).open(&path).unwrap();
    let end = file.metadata().unwrap().len();
    file.write_all_at(&[0xff; 64], end * 3 / 4).unwrap();
    pass.begin(&view).unwrap();
    let error = pass.draw(&ids).unwrap_err();
    let GpuError::Scene(fault) = error else { panic!("{error}") };
    assert!(matches!(fault.cause, ReadCause::Changed), "{fault:?}");
    assert!(fault.bytes.contains(&(end * 3 / 4)), "{fault}");
    assert!(fault.to_string().contains("sheets.scene"), "{fault}");
    // Geometry on the device is drawn as before.
    assert!(pixels(&mut pass, &view, &ids[..1]) == before);
}

#[test]
fn a_scene_whose_file_is_deleted_or_replaced_is_drawn_on_as_it_was() {
    let Some(gpu) = with_memory(None) else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheets.scene");
    let (view, ids) = (view(64, 64, DVec3::ZERO), ids(20));
    let expected = {
        let drawn = GpuScene::new(&gpu, &Arc::new(sheets(20))).unwrap();
        pixels(&mut PicturePass::new(&drawn, view.viewport()).unwrap(), &view, &ids)
    };
    let replace = |path: &std::path::Path| sheets(3).save(path).unwrap();
    let delete = |path: &std::path::Path| std::fs::remove_file(path).unwrap();
    for becomes in [replace, delete] {
        sheets(20).save(&path).unwrap();
        let drawn = GpuScene::new(&gpu, &Arc::new(Scene::open(&path).unwrap())).unwrap();
        becomes(&path);
        let mut pass = PicturePass::new(&drawn, view.viewport()).unwrap();
        assert!(pixels(&mut pass, &view, &ids) == expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// Two passes of one scene in turn, with any memory and any lists: no pixel and no depth differs.
    #[test]
    fn any_frames_look_the_same_with_any_memory(
        memory in (45_u64..400).prop_map(|kib| kib << 10),
        frames in prop::collection::vec(prop::collection::vec(0_u32..30, 0..40), 1..6),
    ) {
        let (Some(large), Some(small)) = (with_memory(None), with_memory(Some(memory))) else {
            return Ok(());
        };
        let scene = Arc::new(sheets(30));
        let view = view(48, 48, DVec3::ZERO);
        let drawn = [&large, &small].map(|gpu| GpuScene::new(gpu, &scene).unwrap());
        let mut pictures = drawn.each_ref().map(|drawn| PicturePass::new(drawn, view.viewport()).unwrap());
        let mut occluders = OccluderPass::new(&drawn[1], view.viewport()).unwrap();
        for frame in &frames {
            let ids: Vec<DrawableId> = frame.iter().copied().map(DrawableId).collect();
            // Occluders first, not waited for, as in a display that culls for itself.
            occluders.begin(&view).unwrap();
            occluders.draw(&ids).unwrap();
            occluders.flush().unwrap();
            let [expected, found] = pictures.each_mut().map(|pass| pixels(pass, &view, &ids));
            prop_assert!(expected == found);
            occluders.finish().unwrap();
            let set = drawn[1].working_set();
            prop_assert!(set.resident_bytes <= memory, "{:?}", set);
        }
    }
}
