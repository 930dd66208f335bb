//! Thin boxes, thin walls, and thin gaps between them.

use glam::{DVec3, Mat3, Vec3};
use trimaran_scene::random::Random;

use crate::cases::{
    builder::{Mesh, Object},
    case::{Case, CaseError, case, crate_at, views, wall},
};

pub(super) fn flat_line_and_point() -> Result<Case, CaseError> {
    let flat = Mesh::rectangle(Vec3::ZERO, Vec3::X * 0.4, Vec3::Y * 0.3, 1);
    let line = Mesh::rectangle(Vec3::ZERO, Vec3::X * 0.4, Vec3::ZERO, 1);
    let point = Mesh::rectangle(Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, 1);
    let mut random = Random::new(3);
    let objects: Vec<Object> = (0..60)
        .map(|index| {
            let mesh = [&flat, &line, &point][index % 3].clone();
            let place = random.point(DVec3::new(-2.0, 3.0, -2.0), DVec3::new(2.0, 7.0, 2.0));
            Object::new(mesh).at(place).turned(Mat3::from_quat(random.rotation().as_quat()))
        })
        .chain([wall(5.0, 0.8)])
        .collect();
    let at = |frame: f64| (DVec3::new(frame * 0.05 - 0.7, 0.0, 0.2), DVec3::new(0.0, 5.0, 0.0));
    case("flat, line and point boxes", &objects, views(30, 50.0, at)?)
}

pub(super) fn slivers_behind_a_gap() -> Result<Case, CaseError> {
    // Slivers far away, most of them smaller than a pixel, seen past two walls with a gap of about a pixel.
    let mut random = Random::new(7);
    let mut objects: Vec<Object> = (0..150)
        .map(|_| {
            let half = Vec3::new(random.between(0.001, 0.4) as f32, 0.002, 0.003);
            let place = random.point(DVec3::new(-6.0, 20.0, -6.0), DVec3::new(6.0, 40.0, 6.0));
            Object::new(Mesh::cuboid(-half, half, 1))
                .at(place)
                .turned(Mat3::from_quat(random.rotation().as_quat()))
        })
        .collect();
    let panel = Mesh::cuboid(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(0.0, 0.1, 2.0), 1);
    objects.push(Object::new(panel.clone()).at(DVec3::new(-0.03, 6.0, 0.0)));
    objects.push(Object::new(panel).at(DVec3::new(2.03, 6.0, 0.0)));
    let at = |frame: f64| (DVec3::new(frame * 0.004 - 0.08, 0.0, 0.0), DVec3::new(0.0, 6.0, 0.0));
    case("sub-pixel boxes and slivers past a one-pixel gap", &objects, views(40, 60.0, at)?)
}

pub(super) fn thin_wall_with_something_behind() -> Result<Case, CaseError> {
    let thin = Mesh::cuboid(Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 1e-4, 3.0), 2);
    let touching = crate_at(0.0, 4.0 + 1e-4 + 0.5, 0.0);
    let before = crate_at(1.0, 4.0 - 0.5, 1.0);
    let objects = [Object::new(thin).at(DVec3::new(0.0, 4.0, 0.0)), touching, before];
    let at = |frame: f64| (DVec3::new(frame * 0.2 - 3.0, -1.0, 0.1), DVec3::new(0.0, 4.0, 0.0));
    case("thin wall with a crate touching it from behind", &objects, views(30, 60.0, at)?)
}

/// Plates before and behind a thin wall, from touching it to 1 cm away.
pub(super) fn plates_about_a_thin_wall() -> Result<Case, CaseError> {
    let thin = Mesh::cuboid(Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 1e-4, 3.0), 2);
    let plate = Mesh::rectangle(Vec3::ZERO, Vec3::X * 0.2, Vec3::Z * 0.4, 1);
    let plates = (0..6).flat_map(|step| {
        let gap = if step == 0 { 0.0 } else { 10_f64.powi(step - 7) };
        let x = f64::from(step) - 2.5;
        [(x, 4.0 - gap, 0.6), (x, 4.0 + 1e-4 + gap, -0.6)]
    });
    let plates = plates.map(|(x, y, z)| Object::new(plate.clone()).at(DVec3::new(x, y, z)));
    let objects: Vec<Object> = plates.chain([Object::new(thin).at(DVec3::new(0.0, 4.0, 0.0))]).collect();
    let at = |frame: f64| (DVec3::new(frame * 0.15 - 1.5, 0.0, 0.05), DVec3::new(0.0, 4.0, 0.0));
    case("plates before and behind a thin wall, from 0 to 1 cm", &objects, views(20, 70.0, at)?)
}

/// A wall with a hole of about a pixel, and crates behind it. The eye passes the line through the hole.
pub(super) fn keyhole() -> Result<Case, CaseError> {
    let panel = |x: [f32; 2], z: [f32; 2]| {
        let mesh = Mesh::cuboid(Vec3::new(x[0], 0.0, z[0]), Vec3::new(x[1], 0.1, z[1]), 1);
        Object::new(mesh).at(DVec3::new(0.0, 6.0, 0.0))
    };
    let (hole, far) = (0.06, 5.0);
    let objects = [
        panel([-far, -hole], [-far, far]),
        panel([hole, far], [-far, far]),
        panel([-hole, hole], [hole, far]),
        panel([-hole, hole], [-far, -hole]),
        crate_at(0.0, 12.0, 0.0),
        crate_at(1.5, 12.0, 0.5),
        crate_at(-0.6, 30.0, 0.2),
    ];
    let at = |frame: f64| (DVec3::new(frame * 0.08 - 1.3, 0.0, 0.02), DVec3::new(0.0, 6.0, 0.0));
    case("a keyhole of one pixel", &objects, views(34, 60.0, at)?)
}

/// Bars and gaps narrower than a pixel, and crates behind them.
pub(super) fn grating() -> Result<Case, CaseError> {
    let bar = Mesh::cuboid(Vec3::new(-0.015, 0.0, -4.0), Vec3::new(0.015, 0.03, 4.0), 1);
    let bars = (0..120).map(|bar| f64::from(bar) * 0.05 - 3.0);
    let bars = bars.map(|x| Object::new(bar.clone()).at(DVec3::new(x, 5.0, 0.0)));
    let behind = (0..9).map(|index| crate_at(f64::from(index) * 0.9 - 3.6, 8.0 + f64::from(index % 3), 0.0));
    let objects: Vec<Object> = bars.chain(behind).collect();
    let at = |frame: f64| (DVec3::new(frame * 0.011, 0.0, 0.1), DVec3::new(frame * 0.017, 5.0, 0.0));
    case("a grating finer than a pixel", &objects, views(20, 60.0, at)?)
}

/// A wall whose edges lie outside of the picture, until one comes into the last column of pixels, with crates
/// that show only there.
pub(super) fn edge_off_screen() -> Result<Case, CaseError> {
    let behind = (0..12).map(|index| crate_at(3.0 + f64::from(index) * 0.7, 9.0, f64::from(index % 3) - 1.0));
    let objects: Vec<Object> = behind.chain([wall(5.0, 4.0)]).collect();
    let at = |frame: f64| {
        let angle = (frame * 0.5 - 2.0).to_radians();
        (DVec3::ZERO, DVec3::new(angle.sin() + 0.05, angle.cos(), 0.0))
    };
    case("a wall's edge outside of the picture", &objects, views(40, 60.0, at)?)
}
