//! Boxes and surfaces at the same depth.

use glam::{DMat3, DVec3, Mat3, Vec3};

use crate::cases::{
    builder::{Mesh, Object},
    case::{Case, CaseError, case, crate_at, looking, small, views},
};

pub(super) fn still_wall() -> Result<Case, CaseError> {
    // A flat wall is its own box: it is tested against its own surface. Far from the origin of its frame, to
    // make it harder.
    let flat = Mesh::rectangle(Vec3::new(300.0, 0.0, 0.0), Vec3::X * 3.0, Vec3::Z * 3.0, 3);
    let turn = Mat3::from_rotation_z(0.3);
    let place = DVec3::new(0.0, 5.0, 0.0) - turn.as_dmat3() * DVec3::new(300.0, 0.0, 0.0);
    let objects =
        [Object::new(flat).at(place).turned(turn), crate_at(1.0, 9.0, 0.0), crate_at(3.5, 5.0, 0.0)];
    let view = looking(DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.3, 5.0, 0.1), 60.0, small()?, 0)?;
    case("wall against its own surface, 200 still frames", &objects, vec![view; 200])
}

/// Plates whose front lies in the front of the wall that holds them, in frames of their own, far from their
/// origins: rounding decides at each pixel which is before. The camera stands still and looks straight at it.
pub(super) fn plates_flush_with_a_wall(name: &'static str, distance: f64) -> Result<Case, CaseError> {
    let place = DVec3::new(distance, -distance, 0.5 * distance);
    let objects: Vec<Object> = (0_u8..12)
        .map(|index| {
            let away = 40.0 * f32::from(index + 1);
            let min = Vec3::new(away - 0.3, 0.0, -0.3);
            let mesh = Mesh::cuboid(min, min + Vec3::new(0.6, 0.05, 0.6), 2);
            let turn = Mat3::from_rotation_y(0.4 * f32::from(index));
            let at = DVec3::new(f64::from(index % 4) - 1.5, 5.0, f64::from(index / 4) - 1.0);
            let origin = place + at - turn.as_dmat3() * DVec3::new(f64::from(away), 0.0, 0.0);
            Object::new(mesh).turned(turn).at(origin)
        })
        .chain([Object::new(Mesh::cuboid(Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 0.1, 3.0), 4))
            .at(place + DVec3::Y * 5.0)])
        .chain([Object::new(Mesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 2))
            .at(place + DVec3::new(0.4, 7.0, 0.2))])
        .collect();
    let eye = place + DVec3::new(0.1, 0.2, 0.3);
    let view = looking(eye, eye + DVec3::Y, 60.0, small()?, 0)?;
    case(name, &objects, vec![view; 60])
}

/// Plates a millionth to a thousandth of the distance before and behind walls, at 2 m to 20 km. Depth bias
/// would be too small near the eye, and too large far from it.
pub(super) fn plates_about_walls_far_away() -> Result<Case, CaseError> {
    const WALLS: u8 = 5;
    let angle = |wall: u8| std::f64::consts::TAU * f64::from(wall) / f64::from(WALLS);
    let mut objects = Vec::new();
    for number in 0..WALLS {
        let distance = 2.0 * 10_f64.powi(number.into());
        let turn = DMat3::from_rotation_z(-angle(number));
        let mut add = |half: f64, x: f64, y: f64, z: f64| {
            let half = (half * distance) as f32;
            let mesh = Mesh::rectangle(Vec3::ZERO, Vec3::X * half, Vec3::Z * half, 2);
            let place = turn * (DVec3::new(x, 1.0 + y, z) * distance);
            objects.push(Object::new(mesh).turned(turn.as_mat3()).at(place));
        };
        add(0.4, 0.0, 0.0, 0.0);
        for step in 0..4 {
            let (gap, x) = (10_f64.powi(step - 6), 0.2 * f64::from(step) - 0.3);
            add(0.06, x, -gap, 0.15);
            add(0.06, x, gap, -0.15);
        }
    }
    let at = |frame: f64| {
        let angle = angle(frame as u8 / 4);
        (DVec3::ZERO, DVec3::new(angle.sin(), angle.cos(), 0.0))
    };
    case("plates before and behind walls at 2 m to 20 km", &objects, views(4 * u32::from(WALLS), 60.0, at)?)
}
