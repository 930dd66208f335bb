//! The eye in, on and close to boxes.

use glam::{DVec3, Vec3};

use crate::cases::{
    builder::{Mesh, Object},
    case::{Case, CaseError, case, crate_at, views, wall},
};

pub(super) fn across_the_near_plane() -> Result<Case, CaseError> {
    let objects =
        [crate_at(0.7, 0.0, 0.0), wall(0.02, 0.3), crate_at(0.0, 3.0, 0.0), crate_at(-0.6, 0.3, 0.0)];
    let at = |frame: f64| (DVec3::new(0.0, -0.05 + frame * 0.002, 0.0), DVec3::new(0.3, 1.0, 0.1));
    case("box across the near plane", &objects, views(40, 70.0, at)?)
}

pub(super) fn eye_inside_a_box() -> Result<Case, CaseError> {
    // A big crate around the eye with a wall close in front of it, and things inside and outside of the
    // crate.
    let big = Object::new(Mesh::cuboid(Vec3::splat(-4.0), Vec3::splat(4.0), 2));
    let objects =
        [big, wall(0.3, 0.2), crate_at(2.0, 2.0, 0.0), crate_at(0.0, 8.0, 0.0), crate_at(0.0, 1.5, 0.0)];
    let at = |frame: f64| {
        let angle = frame * 0.26;
        (DVec3::new(0.01, 0.02, 0.03), DVec3::new(angle.sin(), angle.cos(), 0.1))
    };
    case("eye inside a box", &objects, views(24, 80.0, at)?)
}

/// The eye on a face, an edge and a corner of a crate, and a wall close in front of it.
pub(super) fn eye_on_a_box() -> Result<Case, CaseError> {
    let objects =
        [crate_at(0.0, 0.0, 0.0), wall(0.52, 0.05), crate_at(0.3, 2.0, 0.1), crate_at(-0.4, 1.2, -0.3)];
    let places = [DVec3::new(0.0, 0.5, 0.0), DVec3::new(0.5, 0.5, 0.0), DVec3::splat(0.5)];
    let at = |frame: f64| {
        let place = places[frame as usize / 4 % 3];
        let angle = frame * 0.8;
        (place, place + DVec3::new(0.4 * angle.sin(), 1.0, 0.1 * angle.cos()))
    };
    case("eye on a box", &objects, views(24, 70.0, at)?)
}
