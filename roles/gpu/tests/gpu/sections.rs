//! Sections in the three passes: the pixels equal the reference's, and the occluders' depth has nothing that
//! the picture lacks.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{LodRule, Viewport, draw_order, lod_cut};
use trimaran_gpu::{BACKGROUND, ItemImage};
use trimaran_proto::{Section, SectionBox, SectionPlane, Sections};
use trimaran_scene::{Scene, random::Random};

use crate::common::{CheckedGpu, NEAR, ids, scene, triangles, view, wall};
use crate::three_passes::{NOTHING, Passes};

/// A plane through `location` that cuts away what lies towards `direction`.
pub(crate) fn plane(location: DVec3, direction: DVec3) -> Section {
    Section::Plane(SectionPlane::new(location.to_array(), direction.to_array()).unwrap())
}

/// Up to three planes and boxes through the scene. One box in two ends at walls.
pub(crate) fn random_sections(random: &mut Random, scene: &Scene) -> Sections {
    let (min, max) = scene.nodes()[0].world_box();
    let count = random.below(4);
    let section = |_| {
        let place = random.point(min, max);
        if random.chance(0.3) {
            return plane(place, random.direction());
        }
        let half = (max - min) * random.between(0.3, 0.8);
        let rooms = |corner: DVec3| min + ((corner - min) / 4.0).round() * 4.0;
        let corners = [place - half, place + half];
        let [low, high] = if random.chance(0.5) { corners.map(rooms) } else { corners };
        Section::Box(SectionBox::new(low.to_array(), high.to_array()).unwrap())
    };
    let sections: Vec<_> = (0..count).map(section).collect();
    Sections::new(&sections).unwrap()
}

/// Two walls that fill the picture, and a slanted plane that cuts the nearer one at the middle and the
/// farther one at three quarters of the width.
#[test]
fn a_plane_cuts_walls_in_every_pass_and_shows_what_is_behind() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let walls = [2.0, 4.0].map(|distance| wall(Vec3::new(0.0, 0.0, -distance), 99.0, 99.0));
    let mut passes = Passes::new(&gpu, Arc::new(scene(&walls)));
    let slanted = Sections::new(&[plane(DVec3::new(0.0, 0.0, -2.0), DVec3::new(1.0, 0.0, 1.0))]).unwrap();
    // Other sizes with every frame, including whole frames.
    for size in [16, 64, 4, 32] {
        let whole = view(size, size, DVec3::ZERO);
        let alone = ids(2).into_iter().map(|id| passes.draw(&whole, &[id])).collect::<Vec<_>>();
        assert!(alone.iter().all(|drawn| drawn.pixels.iter().all(|pixel| *pixel != BACKGROUND)));
        let cut = whole.with_sections(slanted);
        let drawn = passes.draw(&cut, &ids(2));
        drawn.check("slanted");
        assert_eq!(passes.differing(&cut, &ids(2), &drawn), 0);
        for i in 0..(size * size) as usize {
            let column = i as u32 % size;
            let shows = if column * 2 < size { Some(0) } else { (column * 4 < size * 3).then_some(1) };
            let at = format!("pixel {i} of {size} a row");
            let near = |depth: f32| {
                let expected = shows.map_or(0.0, |wall| NEAR / [2.0, 4.0][wall]);
                (depth - expected).abs() <= expected * 2e-7
            };
            assert_eq!(drawn.items[i][0], shows.map_or(ItemImage::BACKGROUND, |wall| wall as u32), "{at}");
            assert!(near(drawn.depth[i]) && near(drawn.occluders[i]), "{at}");
            let expected = shows.map_or(BACKGROUND, |wall| alone[wall].pixels[i]);
            // Another shader may round a colour differently.
            assert!(drawn.pixels[i].iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1), "{at}");
        }
    }
}

#[test]
fn six_boxes_keep_what_is_in_all_of_them() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut passes = Passes::new(&gpu, Arc::new(scene(&[wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0)])));
    let all = DVec3::splat(50.0);
    // Each bounds another side, at -1 or 1 metre, to check that the last ones are used.
    let kept = |axis: usize, sign: f64| {
        let (mut low, mut high) = (-all, all);
        *if sign < 0.0 { &mut low[axis] } else { &mut high[axis] } = sign;
        Section::Box(SectionBox::new(low.to_array(), high.to_array()).unwrap())
    };
    let around = SectionBox::new((-all).to_array(), all.to_array()).unwrap();
    let mut sections = [Section::Box(around); 6];
    sections[1..5].copy_from_slice(&[kept(0, -1.0), kept(0, 1.0), kept(1, -1.0), kept(1, 1.0)]);
    let cut = view(32, 32, DVec3::ZERO).with_sections(Sections::new(&sections).unwrap());
    let drawn = passes.draw(&cut, &ids(1));
    drawn.check("six boxes");
    for (i, item) in drawn.items.iter().enumerate() {
        let inside = [i % 32, i / 32].iter().all(|at| (8..24).contains(at));
        assert_eq!(*item != NOTHING, inside, "pixel {i}");
    }
    sections[5] = Section::Box(SectionBox::new([-50.0; 3], [50.0, 50.0, -2.1]).unwrap());
    let drawn = passes.draw(&cut.with_sections(Sections::new(&sections).unwrap()), &ids(1));
    assert!(drawn.items.iter().all(|item| *item == NOTHING));
}

#[test]
fn planes_as_far_as_numbers_go_cut_everything_or_nothing() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut passes = Passes::new(&gpu, Arc::new(scene(&[wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0)])));
    for far in [1e9, 1e25, 1e37, 1e39, 1e300] {
        for (direction, shown) in [(1.0, true), (-1.0, false)] {
            let section = plane(DVec3::new(far, 0.0, 0.0), DVec3::X * direction);
            let cut = view(8, 8, DVec3::ZERO).with_sections(Sections::new(&[section]).unwrap());
            let drawn = passes.draw(&cut, &ids(1));
            drawn.check("a far plane");
            assert!(drawn.items.iter().all(|item| (*item != NOTHING) == shown), "{far} {direction}");
        }
    }
}

/// Only rounding decides which of its pixels are cut away.
#[test]
fn of_a_surface_in_the_plane_itself_the_occluders_draw_no_more_than_the_picture() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut random = Random::new(21);
    let mut shown = 0;
    for _ in 0..40 {
        let (middle, normal) = (DVec3::Z * -random.between(0.5, 50.0), random.direction());
        let (u, v) = normal.any_orthonormal_pair();
        let corner = |u: DVec3| (middle + u * 300.0).as_vec3().to_array();
        let surface = triangles(&[corner(u), corner(-0.5 * u + v), corner(-0.5 * u - v)]);
        let mut passes = Passes::new(&gpu, Arc::new(scene(&[surface])));
        let section = Sections::new(&[plane(middle, normal)]).unwrap();
        let drawn = passes.draw(&view(96, 64, DVec3::ZERO).with_sections(section), &ids(1));
        drawn.check("in the plane");
        shown += drawn.depth.iter().filter(|&&depth| depth > 0.0).count();
    }
    assert!(shown > 40 * 96 * 64 / 10, "only {shown} pixels show: the test tests little");
}

#[test]
fn random_sections_cut_a_plant_as_the_reference_does_and_the_occluders_are_no_more_than_the_picture() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let (origin, size) = (DVec3::new(1e6, 2e6, 0.0), Viewport::new(320, 200).unwrap());
    let mut random = Random::new(22);
    let mut passes = Passes::new(&gpu, plant(7, 800, origin).unwrap());
    let views = plant_views(7, 800, origin, size, 40).unwrap();
    let (mut pixels, mut differing, mut changed) = (0, 0, 0);
    let (mut cut_pixels, mut margin) = (0, 0);
    for view in &views {
        let cut = view.with_sections(random_sections(&mut random, &passes.scene));
        let mut ids = lod_cut(&passes.scene, view, LodRule::new(1.0).unwrap());
        draw_order(&passes.scene, view, &mut ids);
        let whole = passes.draw(view, &ids);
        let drawn = passes.draw(&cut, &ids);
        drawn.check(&view.camera().frame().to_string());
        pixels += drawn.items.len();
        differing += passes.differing(&cut, &ids, &drawn);
        changed += whole.items.iter().zip(&drawn.items).filter(|(a, b)| a != b).count();
        if cut.sections().is_empty() {
            continue; // what is steep is drawn a little farther there
        }
        cut_pixels += drawn.items.len();
        margin += drawn.occluders.iter().zip(&drawn.depth).filter(|(a, b)| a != b).count();
    }
    // Surfaces that touch tie within f32's rounding, and so do those in a section's plane.
    assert!(differing * 500 < pixels, "{differing} of {pixels} pixels differ");
    assert!(margin * 100 < cut_pixels, "the occluders' margin costs {margin} of {cut_pixels} pixels");
    assert!(changed * 5 > pixels, "sections change {changed} of {pixels} pixels: the test tests little");
}
