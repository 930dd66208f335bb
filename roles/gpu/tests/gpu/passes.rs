//! The passes' output, pixel by pixel.

use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::{Image, Viewport};
use trimaran_gpu::{BACKGROUND, GpuError, ItemImage, ItemPass, OccluderPass, PicturePass};
use trimaran_proto::DrawableId;
use trimaran_scene::FlatObject;

use crate::common::{CheckedGpu, NEAR, depth, ids, items, pixels, triangles, upload, view, wall};

const NOTHING: u32 = ItemImage::BACKGROUND;

/// A triangle whose corners fall on pixel corners (1, 1), (7, 1) and (1, 7) of an 8 x 8 picture, 2 m away.
fn known_triangle() -> FlatObject {
    let at = |x: f32, y: f32| [(x / 4.0 - 1.0) * 2.0, (1.0 - y / 4.0) * 2.0, -2.0];
    triangles(&[at(1.0, 1.0), at(7.0, 1.0), at(1.0, 7.0)])
}

/// Whether it covers a pixel: the centre is inside, or on the top or left edge; a centre on the slanted edge
/// is outside.
fn known_coverage(x: u32, y: u32) -> bool {
    x >= 1 && y >= 1 && x + y < 7
}

#[test]
fn a_triangle_covers_exactly_its_pixels_in_every_pass() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[known_triangle()]);
    let view = view(8, 8, DVec3::ZERO);
    let covered: Vec<bool> = (0..64).map(|i| known_coverage(i % 8, i / 8)).collect();
    assert_eq!(covered.iter().filter(|&&c| c).count(), 15);

    let mut occluders = OccluderPass::new(&scene, view.viewport()).unwrap();
    let expected: Vec<f32> = covered.iter().map(|&c| if c { NEAR / 2.0 } else { 0.0 }).collect();
    assert_eq!(depth(&mut occluders, &view, &ids(1)), expected);

    let mut picture_pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let drawn = pixels(&mut picture_pass, &view, &ids(1));
    assert_eq!(drawn.iter().map(|&pixel| pixel != BACKGROUND).collect::<Vec<_>>(), covered);
    assert_eq!(picture_pass.read_depth().unwrap().depth(), expected);

    let mut item_pass = ItemPass::new(&scene, view.viewport()).unwrap();
    item_pass.begin(&view).unwrap();
    item_pass.draw(&ids(1)).unwrap();
    item_pass.finish().unwrap();
    let mut items = ItemImage::default();
    item_pass.read(&mut items).unwrap();
    assert_eq!((items.width, items.height), (8, 8));
    let expected: Vec<u32> = covered.iter().map(|&c| if c { 0 } else { NOTHING }).collect();
    assert_eq!(items.drawable, expected);
    assert_eq!(items.triangle, expected);
}

#[test]
fn depth_is_near_over_distance_from_millimetres_to_kilometres() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let distances = [0.125_f32, 0.126, 0.37, 1.0, 3.3, 77.7, 1234.5, 99_999.0];
    let walls: Vec<FlatObject> =
        distances.iter().map(|&d| wall(Vec3::new(0.0, 0.0, -d), 2.0 * d, 2.0 * d)).collect();
    let scene = upload(&gpu, &walls);
    let view = view(31, 17, DVec3::ZERO);
    let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
    for (id, distance) in ids(walls.len()).into_iter().zip(distances) {
        let expected = NEAR / distance;
        for depth in depth(&mut pass, &view, &[id]) {
            assert!((depth - expected).abs() <= expected * 2e-7, "{depth} for {expected} at {distance} m");
        }
    }
}

#[test]
fn the_nearest_surface_shows_whatever_the_order_and_the_first_of_equal_ones() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let wall = |distance: f32| wall(Vec3::new(0.0, 0.0, -distance), 99.0, 99.0);
    let scene = upload(&gpu, &[wall(3.0), wall(2.0), wall(2.0)]);
    let view = view(4, 4, DVec3::ZERO);
    let mut pass = ItemPass::new(&scene, view.viewport()).unwrap();
    for (order, shows) in [([0, 1, 2], 1), ([2, 1, 0], 2), ([1, 0, 2], 1), ([2, 0, 1], 2)] {
        let items = items(&mut pass, &view, &order.map(DrawableId));
        assert!(items.iter().all(|&[drawable, _]| drawable == shows), "{order:?}");
    }
}

#[test]
fn items_name_drawables_and_their_triangles_from_zero() {
    let Some(gpu) = CheckedGpu::open() else { return };
    // A row of walls, each of two triangles, one to a column of 8 pixels.
    let walls: Vec<FlatObject> =
        (0..8).map(|i| wall(Vec3::new((i as f32 * 8.0 + 4.0) / 32.0 - 1.0, 0.0, -1.0), 0.125, 1.0)).collect();
    let scene = upload(&gpu, &walls);
    let view = view(64, 64, DVec3::ZERO);
    let mut pass = ItemPass::new(&scene, view.viewport()).unwrap();
    pass.begin(&view).unwrap();
    // In two batches and out of order: neither the draw's place nor its batch may leak into the ids.
    pass.draw(&[7, 6, 5].map(DrawableId)).unwrap();
    pass.flush().unwrap();
    pass.draw(&[0, 1, 2, 3, 4].map(DrawableId)).unwrap();
    let mut items = ItemImage::default();
    pass.read(&mut items).unwrap();
    for y in 0..64_u32 {
        for x in 0..64_u32 {
            let pixel = (y * 64 + x) as usize;
            assert_eq!(items.drawable[pixel], x / 8, "at {x}, {y}");
            // The lower left half is triangle 0: left of the diagonal from the top left to the lower right
            // corner.
            let (across, down) = ((x % 8) as f32 + 0.5, (y as f32 + 0.5) / 8.0);
            let expected = u32::from(across > down);
            if (across - down).abs() > 0.01 {
                assert_eq!(items.triangle[pixel], expected, "at {x}, {y}");
            }
        }
    }
}

#[test]
fn any_size_is_drawn_to_its_last_pixel() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[wall(Vec3::new(0.0, 0.0, -2.0), 1e4, 1e4)]);
    let first = Viewport::new(2, 2).unwrap();
    let mut occluders = OccluderPass::new(&scene, first).unwrap();
    let mut picture_pass = PicturePass::new(&scene, first).unwrap();
    let mut item_pass = ItemPass::new(&scene, first).unwrap();
    for (width, height) in [(1, 1), (1, 7), (7, 1), (333, 777), (1023, 1023), (2, 2)] {
        let view = view(width, height, DVec3::ZERO);
        let count = (width * height) as usize;

        occluders.begin(&view).unwrap();
        occluders.draw(&ids(1)).unwrap();
        let depth = occluders.read_depth().unwrap();
        assert_eq!(depth.viewport(), view.viewport());
        assert_eq!(depth.depth().len(), count);
        assert!(depth.depth().iter().all(|&d| (d - NEAR / 2.0).abs() < 1e-7), "{width} x {height}");

        let pixels = pixels(&mut picture_pass, &view, &ids(1));
        let mut picture = Image::default();
        picture_pass.read(&mut picture).unwrap();
        assert_eq!((picture.width, picture.height, picture.rgba.len()), (width, height, 4 * count));
        assert_eq!(picture.rgba, pixels.as_flattened());
        assert!(pixels.iter().all(|&pixel| pixel != BACKGROUND && pixel[3] == 255));

        let items = items(&mut item_pass, &view, &ids(1));
        assert_eq!(items.len(), count);
        assert!(items.iter().all(|&[drawable, triangle]| drawable == 0 && triangle < 2));
    }
}

#[test]
fn a_picture_larger_than_the_device_draws_is_refused_by_name() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[known_triangle()]);
    let limit = gpu.info().max_viewport;
    let size = Viewport::new(limit + 1, 1).unwrap();
    let error = OccluderPass::new(&scene, size).err().unwrap();
    assert!(matches!(error, GpuError::ViewportTooLarge { height: 1, .. }), "{error}");
}

#[test]
fn no_draws_give_the_background() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[known_triangle()]);
    let view = view(5, 3, DVec3::ZERO);
    let mut occluders = OccluderPass::new(&scene, view.viewport()).unwrap();
    assert_ne!(depth(&mut occluders, &view, &ids(1)), [0.0; 15]);
    // Nothing of the frame before may remain.
    assert_eq!(depth(&mut occluders, &view, &[]), [0.0; 15]);

    let mut picture_pass = PicturePass::new(&scene, view.viewport()).unwrap();
    picture_pass.begin(&view).unwrap();
    picture_pass.finish().unwrap();
    assert_eq!(picture_pass.pixels().unwrap(), [BACKGROUND; 15]);

    let mut item_pass = ItemPass::new(&scene, view.viewport()).unwrap();
    item_pass.begin(&view).unwrap();
    assert_eq!(item_pass.items().unwrap(), [[NOTHING; 2]; 15]);
}

#[test]
fn a_pass_without_a_view_says_so() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[known_triangle()]);
    let size = Viewport::new(4, 4).unwrap();
    let mut pass = OccluderPass::new(&scene, size).unwrap();
    assert!(matches!(pass.draw(&ids(1)), Err(GpuError::NotBegun(_))));
    assert!(matches!(pass.finish(), Err(GpuError::NotBegun(_))));
    assert!(matches!(pass.read_depth(), Err(GpuError::NotBegun(_))));
    let mut pictures = PicturePass::new(&scene, size).unwrap();
    assert!(matches!(pictures.pixels(), Err(GpuError::NotBegun(_))));
    pictures.begin(&view(4, 4, DVec3::ZERO)).unwrap();
    assert!(matches!(pictures.finish_previous(), Err(GpuError::NotBegun(_))));
}

#[test]
fn an_id_that_the_scene_lacks_is_refused_and_the_pass_goes_on() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[known_triangle()]);
    let view = view(8, 8, DVec3::ZERO);
    let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
    pass.begin(&view).unwrap();
    let error = pass.draw(&[DrawableId(0), DrawableId(1)]).unwrap_err();
    assert_eq!(error.to_string(), "drawable 1 is not in this scene, which has 1");
    pass.draw(&ids(1)).unwrap();
    pass.finish().unwrap();
    assert_eq!(pass.read_depth().unwrap().depth()[9], NEAR / 2.0);
}

/// A floor seen at a grazing angle: its depth changes by a tenth from one pixel to the next.
#[test]
fn occluders_are_drawn_farther_than_the_picture_by_the_margin_of_the_grid_where_they_are_steep() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let corners = [[-50.0, -0.1, -1.0], [50.0, -0.1, -1.0], [0.0, -0.1, -1000.0]];
    let scene = upload(&gpu, &[triangles(&corners), wall(Vec3::new(0.0, 0.8, -1.0), 1.0, 0.2)]);
    let view = view(64, 64, DVec3::ZERO);
    let mut occluders = OccluderPass::new(&scene, view.viewport()).unwrap();
    let farther = depth(&mut occluders, &view, &ids(2));
    let mut pictures = PicturePass::new(&scene, view.viewport()).unwrap();
    pixels(&mut pictures, &view, &ids(2));
    let depth = pictures.read_depth().unwrap().depth();

    // The wall faces the eye.
    assert_eq!((farther[5 * 64 + 30], depth[5 * 64 + 30]), (NEAR, NEAR));
    // Depth falls by the same with every row up to the horizon.
    let column: Vec<usize> = (33..35).map(|row| row * 64 + 31).collect();
    let slope = depth[column[1]] - depth[column[0]];
    let bias = gpu.info().sub_pixel_grid.margin_px() as f32 * slope;
    for pixel in column {
        let moved = (depth[pixel] - farther[pixel]) / bias;
        assert!((moved - 1.0).abs() < 0.01, "{moved} of what is asked for at {pixel}, {slope} a pixel");
    }
}

/// A grid of small walls at various distances, more than one chunk of draws.
fn many_walls(count: usize) -> Vec<FlatObject> {
    (0..count)
        .map(|i| {
            let (x, y, z) = ((i * 37 % 101) as f32, (i * 61 % 103) as f32, (i * 17 % 97) as f32);
            wall(Vec3::new(x / 50.0 - 1.0, y / 50.0 - 1.0, -1.0 - z / 100.0), 0.02, 0.015)
        })
        .collect()
}

#[test]
fn batches_of_any_size_give_the_same_depth_and_items() {
    let Some(gpu) = CheckedGpu::open() else { return };
    const COUNT: usize = 17_000;
    let scene = upload(&gpu, &many_walls(COUNT));
    let view = view(200, 100, DVec3::ZERO);
    let all = ids(COUNT);
    let mut occluders = OccluderPass::new(&scene, view.viewport()).unwrap();
    let mut item_pass = ItemPass::new(&scene, view.viewport()).unwrap();
    let mut results = Vec::new();
    for (batch, flush) in [(COUNT, false), (5_000, true), (1_000, false), (200, true)] {
        occluders.begin(&view).unwrap();
        item_pass.begin(&view).unwrap();
        for part in all.chunks(batch) {
            occluders.draw(part).unwrap();
            item_pass.draw(part).unwrap();
            if flush {
                occluders.flush().unwrap();
                item_pass.flush().unwrap();
            }
        }
        occluders.finish().unwrap();
        item_pass.finish().unwrap();
        let depth: Vec<u32> = occluders.read_depth().unwrap().depth().iter().map(|d| d.to_bits()).collect();
        results.push((depth, item_pass.items().unwrap().to_vec()));
    }
    assert!(results[0].1.iter().any(|&[drawable, _]| drawable > 16_400 && drawable != NOTHING));
    assert!(results.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn five_thousand_draws_show_the_nearest_of_each_pixel() {
    let Some(gpu) = CheckedGpu::open() else { return };
    // Wall i covers column i % 100 and hides those before it, which are farther.
    let walls: Vec<FlatObject> = (0..5_000)
        .map(|i| {
            let (column, distance) = ((i % 100) as f32, 60.0 - (i / 100) as f32);
            let x = ((column + 0.5) / 50.0 - 1.0) * distance;
            wall(Vec3::new(x, 0.0, -distance), distance / 100.0, distance)
        })
        .collect();
    let scene = upload(&gpu, &walls);
    let view = view(100, 100, DVec3::ZERO);
    let mut pass = ItemPass::new(&scene, view.viewport()).unwrap();
    for (pixel, [drawable, _]) in items(&mut pass, &view, &ids(5_000)).into_iter().enumerate() {
        assert_eq!(drawable, 4_900 + pixel as u32 % 100);
    }
}

#[test]
fn a_scene_far_from_the_origin_draws_as_at_the_origin() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut results = Vec::new();
    for far in [0.0, 1e6, 1e7, 1e8] {
        let origin = DVec3::new(far, -0.5 * far, 0.25 * far);
        let parts: Vec<FlatObject> = many_walls(300)
            .into_iter()
            .map(|part| FlatObject { origin: origin + DVec3::new(0.25, 0.0, -0.5), ..part })
            .collect();
        let scene = upload(&gpu, &parts);
        let view = view(128, 128, origin);
        let mut pass = ItemPass::new(&scene, view.viewport()).unwrap();
        results.push(items(&mut pass, &view, &ids(300)));
    }
    assert!(results[0].iter().any(|&[drawable, _]| drawable != NOTHING));
    // These offsets are exact in f64 at every origin, so the pictures are the same to the last bit.
    assert!(results.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn mirrored_and_scaled_nodes_draw_as_their_geometry_would() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let turn = Mat3::from_cols(Vec3::new(-4.0, 0.0, 0.0), Vec3::new(1.0, 0.5, 0.0), Vec3::new(0.0, 0.0, 2.0));
    let part = FlatObject { linear: turn, ..known_triangle() };
    let baked = triangles(&part.positions.iter().map(|&at| (turn * at).to_array()).collect::<Vec<_>>());
    let scene = upload(&gpu, &[part, baked]);
    let view = view(64, 64, DVec3::ZERO);
    let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
    let [placed, baked] = [0, 1].map(|id| depth(&mut pass, &view, &[DrawableId(id)]));
    assert!(placed.iter().any(|&depth| depth > 0.0));
    assert_eq!(placed, baked);
}

#[test]
fn the_next_picture_is_prepared_while_this_one_is_drawn() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let wall = |x: f32| wall(Vec3::new(x, 0.0, -2.0), 0.4, 0.4);
    let scene = upload(&gpu, &[wall(-1.0), wall(0.0), wall(1.0)]);
    let view = view(40, 40, DVec3::ZERO);
    let mut pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let alone: Vec<_> = (0..3).map(|id| pixels(&mut pass, &view, &[DrawableId(id)])).collect();
    assert_ne!(alone[0], alone[1]);
    let mut overlapped = Vec::new();
    for id in 0..3 {
        pass.begin(&view).unwrap();
        pass.draw(&[DrawableId(id)]).unwrap();
        pass.flush().unwrap();
        if id > 0 {
            pass.finish_previous().unwrap();
            overlapped.push(pass.pixels().unwrap().to_vec());
        }
    }
    pass.finish().unwrap();
    overlapped.push(pass.pixels().unwrap().to_vec());
    assert_eq!(overlapped, alone);
}

#[test]
fn both_sides_of_a_surface_are_lit_alike_and_slopes_differently() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut back = wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0);
    back.indices.reverse();
    let front = wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0);
    let floor = triangles(&[[-99.0, -1.0, 9.0], [99.0, -1.0, 9.0], [0.0, -1.0, -99.0]]);
    let scene = upload(&gpu, &[front, back, floor]);
    let view = view(16, 16, DVec3::ZERO);
    let mut pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let [front, back, floor] = [0, 1, 2].map(|id| pixels(&mut pass, &view, &[DrawableId(id)])[15 * 16 + 8]);
    assert_eq!(front, back);
    assert!(floor[0] > front[0] + 10, "a floor {floor:?} is lighter than a wall {front:?}");
    assert!(front[0] > front[1] && front[1] > front[2], "the base colour shows: {front:?}");
}
