//! Levels of detail that differ from their mesh and from their neighbours.

use glam::{DVec3, Mat3, Vec3};
use trimaran_scene::random::Random;

use crate::cases::{
    builder::{Mesh, Object},
    case::{Case, CaseError, case, crate_at, views, wall},
};

pub(super) fn scaled_mirrored_sheared() -> Result<Case, CaseError> {
    let shear = Mat3::from_cols(Vec3::X, Vec3::new(0.8, 1.0, 0.0), Vec3::new(0.3, -0.5, 1.0));
    let flat_shear = Mat3::from_cols(Vec3::X, Vec3::new(1.0, 1e-4, 0.0), Vec3::Z);
    let linears = [
        Mat3::from_diagonal(Vec3::new(1e-3, 1.0, 1e3)),
        Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)),
        Mat3::from_diagonal(Vec3::new(1e3, 1e-3, -1.0)),
        Mat3::from_diagonal(Vec3::splat(1e-3)),
        shear,
        flat_shear,
        Mat3::from_diagonal(Vec3::new(1.0, 0.0, 1.0)),
    ];
    let mut random = Random::new(11);
    let objects: Vec<Object> = (0..70)
        .map(|index| {
            let place = random.point(DVec3::new(-3.0, 3.0, -3.0), DVec3::new(3.0, 12.0, 3.0));
            Object::new(Mesh::cylinder(0.5, 0.5, 8))
                .at(place)
                .turned(linears[index % linears.len()])
                .with_box_level()
        })
        .chain([wall(6.0, 1.0)])
        .collect();
    let at = |frame: f64| {
        let angle = frame * 0.15;
        (DVec3::new(5.0 * angle.sin(), 5.0 - 6.0 * angle.cos(), 0.4), DVec3::new(0.0, 6.0, 0.0))
    };
    case("scaled by 1e-3 to 1e3, mirrored, sheared", &objects, views(40, 60.0, at)?)
}

/// Frames with an opening whose coarser level is a plate without one: a level that occludes more than the
/// mesh. Crates show through the openings. The eye comes closer and goes back, so levels change.
pub(super) fn level_that_occludes_more() -> Result<Case, CaseError> {
    let mut frame = Mesh::default();
    for (min, max) in [
        ([-1.0, -1.0], [-0.4, 1.0]),
        ([0.4, -1.0], [1.0, 1.0]),
        ([-0.4, 0.4], [0.4, 1.0]),
        ([-0.4, -1.0], [0.4, -0.4]),
    ] {
        let bar = Mesh::cuboid(Vec3::new(min[0], 0.0, min[1]), Vec3::new(max[0], 0.1, max[1]), 1);
        frame.append(&bar);
    }
    let objects: Vec<Object> = (0..9)
        .flat_map(|index| {
            let (x, z) = (f64::from(index % 3) * 2.1 - 2.1, f64::from(index / 3) * 2.1 - 2.1);
            let there = Object::new(frame.clone()).at(DVec3::new(x, 10.0, z)).with_box_level();
            [there, crate_at(x, 11.5, z)]
        })
        .collect();
    let at = |frame: f64| {
        let way = (frame * 0.35).sin();
        (DVec3::new(0.3 * frame - 3.0, -40.0 + 45.0 * way, 0.2), DVec3::new(0.0, 10.0, 0.0))
    };
    case("a level that occludes more than its mesh", &objects, views(30, 50.0, at)?)
}

/// A dome around the eye in patches, each at a level of its own. Their borders have the same corners at each
/// level: no background may show.
pub(super) fn patches_of_a_dome() -> Result<Case, CaseError> {
    const ACROSS: u16 = 12;
    const CUTS: u16 = 4;
    // Longitude and latitude in steps of a cut.
    let point = |column: u16, row: u16| {
        let (columns, rows) = (f32::from(ACROSS * CUTS), f32::from(ACROSS * CUTS / 2));
        let column = column % (ACROSS * CUTS);
        let longitude = std::f32::consts::TAU * f32::from(column) / columns;
        let latitude = std::f32::consts::PI * (f32::from(row) / rows - 0.5);
        let ripple = 8.0 + 0.4 * (3.0 * longitude).sin() * latitude.cos();
        let (flat, up) = (latitude.cos() * ripple, latitude.sin() * ripple);
        Vec3::new(flat * longitude.cos(), flat * longitude.sin(), up)
    };
    let mut objects = Vec::new();
    for (left, low) in (0..ACROSS).flat_map(|column| (0..ACROSS / 2).map(move |row| (column, row))) {
        let (left, low) = (left * CUTS, low * CUTS);
        let grid = Mesh {
            positions: (0..=CUTS)
                .flat_map(|row| (0..=CUTS).map(move |column| (column, row)))
                .map(|(column, row)| point(left + column, low + row))
                .collect(),
            indices: Mesh::rectangle(Vec3::ZERO, Vec3::X, Vec3::Y, CUTS.into()).indices,
        };
        // A fan from the middle to all corners of the border, which stay where they are.
        let side = |step: u16| {
            (0..CUTS).map(move |at| [(at, 0), (CUTS, at), (CUTS - at, CUTS), (0, CUTS - at)][step as usize])
        };
        let border: Vec<(u16, u16)> = (0..4).flat_map(side).collect();
        let mut fan = Mesh::default();
        fan.positions.push(point(left + CUTS / 2, low + CUTS / 2));
        fan.positions.extend(border.iter().map(|(column, row)| point(left + column, low + row)));
        let corners = border.len() as u32;
        fan.indices = (0..corners).flat_map(|corner| [0, 1 + corner, 1 + (corner + 1) % corners]).collect();
        let mut patch = Object::new(grid);
        // Every other patch says too little on purpose, so that neighbours are at different levels.
        patch.coarser.push((if (left + low) % (2 * CUTS) == 0 { 0.02 } else { 4.0 }, fan));
        objects.push(patch);
    }
    let at = |frame: f64| {
        let (angle, up) = (frame * 0.37, 0.6 * (frame * 0.61).sin());
        let eye = DVec3::new(2.0 * (frame * 0.2).sin(), 1.0, 0.5);
        (eye, eye + DVec3::new(angle.sin(), angle.cos(), up))
    };
    case("patches of a dome, each at a level of its own", &objects, views(24, 75.0, at)?)
}
