//! Depth from the near plane to far away.

use glam::{DVec3, Vec3};

use crate::cases::{
    builder::{Mesh, Object},
    case::{Case, CaseError, case, looking_past, small, views},
};

/// Plates at each power of ten from 0.1 m to 10,000 km, side by side and one behind the other.
pub(super) fn depth_range() -> Result<Case, CaseError> {
    let objects: Vec<Object> = (-1..=7)
        .flat_map(|power| {
            let distance = 10_f64.powi(power);
            let side = f64::from(power.rem_euclid(3)) - 1.0;
            [(1.0, 0.35), (1.001, 0.5)].map(|(further, half)| {
                let half = (half * distance) as f32;
                let mesh = Mesh::rectangle(Vec3::ZERO, Vec3::X * half, Vec3::Z * half * 0.3, 2);
                let place = DVec3::new(side * 0.2, further, 0.1 * side) * distance;
                Object::new(mesh).at(place)
            })
        })
        .collect();
    let at = |frame: f64| (DVec3::new(frame * 0.003, 0.0, frame * 0.001), DVec3::new(0.0, 10.0, 0.0));
    case("depth from 0.1 m to 1e7 m", &objects, views(16, 80.0, at)?)
}

/// The near plane at a millimetre, and pairs of plates up to 100 km away, a ten-thousandth of their distance
/// apart. Each pair fills the picture's height in a column of its own.
pub(super) fn near_plane_at_a_millimetre() -> Result<Case, CaseError> {
    let objects: Vec<Object> = (0..=5)
        .flat_map(|power| {
            let distance = 10_f64.powi(power);
            let x = 0.2 * (f64::from(power) - 2.5);
            [1.0, 1.0001].map(|further| {
                let (half, high) = ((0.09 * distance) as f32, (distance * 2.0) as f32);
                let mesh = Mesh::rectangle(Vec3::ZERO, Vec3::X * half, Vec3::Z * high, 1);
                Object::new(mesh).at(DVec3::new(x, further, 0.0) * distance)
            })
        })
        .collect();
    let view = |frame: u32| {
        let eye = DVec3::new(1e-5 * f64::from(frame), 0.0, 0.0);
        looking_past(1e-3, eye, eye + DVec3::Y, 60.0, small()?, frame).map_err(CaseError::from)
    };
    case("near plane at 1 mm, pairs up to 100 km away", &objects, (0..8).map(view).collect::<Result<_, _>>()?)
}
