//! See-through drawables.

use glam::{DVec3, Vec3};
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{LodRule, View, Viewport, draw_order, lod_cut};
use trimaran_gpu::{BACKGROUND, GpuError, GpuScene, ItemPass, PicturePass, SEE_THROUGH_ALPHA};
use trimaran_proto::{DrawableId, Sections};
use trimaran_scene::{FlatObject, Rgba8, random::Random};

use crate::common::{CheckedGpu, items, upload, view, wall};
use crate::sections::{plane, random_sections};

/// A picture and its depth.
#[derive(Debug, Clone, PartialEq)]
struct Picture {
    pixels: Vec<[u8; 4]>,
    depth: Vec<f32>,
}

fn picture(pass: &mut PicturePass, view: &View, solid: &[DrawableId], panes: &[DrawableId]) -> Picture {
    pass.begin(view).unwrap();
    pass.draw(solid).unwrap();
    pass.draw_see_through(panes).unwrap();
    read(pass)
}

fn read(pass: &mut PicturePass) -> Picture {
    pass.finish().unwrap();
    let pixels = pass.pixels().unwrap().to_vec();
    assert!(pixels.iter().all(|pixel| pixel[3] == 255), "the picture is not opaque");
    Picture { pixels, depth: pass.read_depth().unwrap().depth().to_vec() }
}

/// A wall that fills the picture.
fn pane(distance: f32, colour: [u8; 3]) -> FlatObject {
    let [red, green, blue] = colour;
    FlatObject { colour: Rgba8([red, green, blue, 255]), ..wall(Vec3::new(0.0, 0.0, -distance), 99.0, 99.0) }
}

/// `over` blended over `under`.
fn blend(over: [u8; 4], under: [u8; 4]) -> [f32; 3] {
    let mix =
        |i: usize| SEE_THROUGH_ALPHA * f32::from(over[i]) + (1.0 - SEE_THROUGH_ALPHA) * f32::from(under[i]);
    [mix(0), mix(1), mix(2)]
}

/// Asserts that the pixel has this colour within `steps` of rounding.
fn assert_near(pixel: [u8; 4], expected: [f32; 3], steps: f32, what: &str) {
    let near = pixel.iter().zip(expected).all(|(&got, expected)| (f32::from(got) - expected).abs() <= steps);
    assert!(near, "{what}: {pixel:?} for {expected:?}");
}

const WALL: DrawableId = DrawableId(0);
const BEFORE: DrawableId = DrawableId(1);
const NEAREST: DrawableId = DrawableId(2);
const LEVEL: DrawableId = DrawableId(3);
const BEHIND: DrawableId = DrawableId(4);

/// These five.
fn panes() -> [FlatObject; 5] {
    [
        pane(4.0, [40, 200, 90]),
        pane(3.0, [250, 20, 60]),
        // Seen from behind.
        FlatObject { indices: vec![2, 1, 0, 3, 1, 2], ..pane(2.0, [10, 30, 240]) },
        pane(4.0, [255, 255, 255]),
        pane(5.0, [255, 255, 255]),
    ]
}

#[test]
fn panes_are_blended_over_what_is_behind_them_and_change_no_depth() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &panes());
    let view = view(12, 8, DVec3::ZERO);
    let mut pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let mut draw = |solid: &[_], panes: &[_]| picture(&mut pass, &view, solid, panes);
    let [wall, before, nearest] = [WALL, BEFORE, NEAREST].map(|id| draw(&[id], &[]));
    let through = draw(&[WALL], &[BEFORE]);
    let both = draw(&[WALL], &[BEFORE, NEAREST]);
    let turned = draw(&[WALL], &[NEAREST, BEFORE]);
    let on_nothing = draw(&[], &[BEFORE]);
    assert!(through.depth == wall.depth && both.depth == wall.depth);
    assert!(on_nothing.depth.iter().all(|&depth| depth == 0.0));
    for i in 0..wall.pixels.len() {
        let [wall, before, nearest] = [&wall, &before, &nearest].map(|picture| picture.pixels[i]);
        assert_near(through.pixels[i], blend(before, wall), 1.0, "a pane before a wall");
        assert_near(both.pixels[i], blend(nearest, through.pixels[i]), 1.0, "two panes");
        let [red, green, blue] = blend(nearest, wall).map(|channel| channel.round() as u8);
        assert_near(turned.pixels[i], blend(before, [red, green, blue, 255]), 2.0, "two panes turned round");
        assert_near(on_nothing.pixels[i], blend(before, BACKGROUND), 1.0, "a pane before nothing");
    }
    assert_ne!(both.pixels, turned.pixels);
}

#[cfg(feature = "window")]
#[test]
fn in_a_window_the_sky_shines_through_a_pane() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &panes());
    let view = view(12, 8, DVec3::ZERO);
    let mut pass = PicturePass::for_window(&scene, view.viewport()).unwrap();
    let mut draw = |solid: &[_], panes: &[_]| picture(&mut pass, &view, solid, panes).pixels;
    let [sky, pane, through] = [draw(&[], &[]), draw(&[BEFORE], &[]), draw(&[], &[BEFORE])];
    assert_ne!(sky.first(), sky.last(), "there is sky above and ground below");
    for ((sky, pane), through) in sky.iter().zip(&pane).zip(&through) {
        // Sky and pane were rounded before, and are again.
        assert_near(*through, blend(*pane, *sky), 2.0, "a pane before the sky");
    }
}

#[test]
fn panes_level_with_a_wall_or_behind_it_change_no_pixel() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &panes());
    let view = view(12, 8, DVec3::ZERO);
    let mut pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let wall = picture(&mut pass, &view, &[WALL], &[]);
    assert_eq!(picture(&mut pass, &view, &[WALL], &[BEHIND, LEVEL]), wall);
    let through = picture(&mut pass, &view, &[WALL], &[BEFORE]);
    assert_ne!(through, wall);
    assert_eq!(picture(&mut pass, &view, &[WALL], &[BEHIND, LEVEL, BEFORE]), through);
}

#[test]
fn what_is_solid_comes_first_and_panes_in_as_many_parts_as_one_likes() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &panes());
    let view = view(12, 8, DVec3::ZERO);
    let mut pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let error = pass.draw_see_through(&[BEFORE]).unwrap_err();
    assert!(matches!(error, GpuError::NotBegun(_)), "{error}");
    let expected = picture(&mut pass, &view, &[WALL], &[BEFORE, NEAREST]);
    pass.begin(&view).unwrap();
    pass.draw(&[WALL]).unwrap();
    pass.draw_see_through(&[BEFORE]).unwrap();
    assert!(matches!(pass.draw(&[WALL]), Err(GpuError::SolidAfterSeeThrough)));
    pass.flush().unwrap();
    pass.draw_see_through(&[]).unwrap();
    pass.draw_see_through(&[NEAREST]).unwrap();
    assert_eq!(read(&mut pass), expected);
}

#[test]
fn sections_cut_panes_too() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &panes());
    let whole = view(16, 8, DVec3::ZERO);
    // It cuts the pane at 3 m at the middle, and the wall at 4 m beside the picture.
    let slanted = plane(DVec3::new(0.0, 0.0, -3.0), DVec3::new(1.0, 0.0, 9.0));
    let cut = whole.with_sections(Sections::new(&[slanted]).unwrap());
    let mut pass = PicturePass::new(&scene, whole.viewport()).unwrap();
    let wall = picture(&mut pass, &cut, &[WALL], &[]);
    let through = picture(&mut pass, &cut, &[WALL], &[BEFORE]);
    let uncut = picture(&mut pass, &whole, &[WALL], &[BEFORE]);
    assert_eq!(through.depth, wall.depth);
    for i in 0..through.pixels.len() {
        if i % 16 < 8 {
            let expected = uncut.pixels[i];
            // Another shader may round a colour differently.
            assert!(through.pixels[i].iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1), "pixel {i}");
            assert_ne!(through.pixels[i], wall.pixels[i]);
        } else {
            assert_eq!(through.pixels[i], wall.pixels[i], "pixel {i}");
        }
    }
}

/// Culling leaves out hidden panes.
#[test]
fn a_picture_is_the_same_to_the_bit_without_the_panes_that_are_hidden() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let size = Viewport::new(160, 100).unwrap();
    let scene = plant(7, 800, DVec3::ZERO).unwrap();
    let uploaded = GpuScene::new(&gpu, &scene).unwrap();
    let mut pass = PicturePass::new(&uploaded, size).unwrap();
    let mut item_pass = ItemPass::new(&uploaded, size).unwrap();
    let mut random = Random::new(31);
    let (mut hidden, mut seen) = (0, 0);
    let views = plant_views(7, 800, DVec3::ZERO, size, 30).unwrap();
    for (index, view) in views.iter().step_by(3).enumerate() {
        let sections = if index % 2 == 0 { Sections::NONE } else { random_sections(&mut random, &scene) };
        let view = view.with_sections(sections);
        let mut ids = lod_cut(&scene, &view, LodRule::new(0.25).unwrap());
        draw_order(&scene, &view, &mut ids);
        let (mut panes, solid): (Vec<_>, Vec<_>) = ids.into_iter().partition(|_| random.chance(0.5));
        panes.reverse();
        let mut shows = |pane: &DrawableId| {
            let all = [&solid[..], &[*pane]].concat();
            items(&mut item_pass, &view, &all).iter().any(|[drawable, _]| *drawable == pane.0)
        };
        let shown: Vec<_> = panes.iter().copied().filter(&mut shows).collect();
        let all = picture(&mut pass, &view, &solid, &panes);
        assert!(picture(&mut pass, &view, &solid, &shown) == all, "{}", view.camera().frame());
        let bare = picture(&mut pass, &view, &solid, &[]);
        assert_eq!(shown.is_empty(), bare == all);
        (hidden, seen) = (hidden + panes.len() - shown.len(), seen + shown.len());
    }
    assert!(hidden > 50 && seen > 50, "{hidden} hidden, {seen} seen: the test tests little");
}

/// The model's glass may be more transparent than a user's see-through objects.
#[test]
fn a_smaller_alpha_of_the_colour_is_the_share() {
    let clear = 51;
    let mut panes = panes();
    panes[1].colour.0[3] = clear;
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &panes);
    let view = view(12, 8, DVec3::ZERO);
    let mut pass = PicturePass::new(&scene, view.viewport()).unwrap();
    let share = f32::from(clear) / 255.0;
    let solid = picture(&mut pass, &view, &[BEFORE], &[]).pixels[0];
    let under = picture(&mut pass, &view, &[WALL], &[]).pixels[0];
    let seen = picture(&mut pass, &view, &[WALL], &[BEFORE]).pixels[0];
    let mix = |i: usize| share * f32::from(solid[i]) + (1.0 - share) * f32::from(under[i]);
    assert_near(seen, [mix(0), mix(1), mix(2)], 1.5, "a clear pane");
}
