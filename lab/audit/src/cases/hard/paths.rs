//! Camera paths, places and pictures that are hard.

use glam::DVec3;
use trimaran_cull::Viewport;

use crate::cases::{
    case::{Case, CaseError, case, crate_at, looking, small, views, wall},
    plant::{plant, plant_views},
};

pub(super) fn looking_away() -> Result<Case, CaseError> {
    let objects = [crate_at(0.0, 5.0, 0.0), wall(8.0, 2.0)];
    let away = looking(DVec3::ZERO, DVec3::NEG_Y, 60.0, small()?, 0)?;
    let towards = looking(DVec3::ZERO, DVec3::Y, 60.0, small()?, 0)?;
    case("nothing visible, and back", &objects, vec![towards, away, away, towards, away, towards])
}

/// Every frame from another place in the plant: the last frame's visible set is never useful.
pub(super) fn teleporting() -> Result<Case, CaseError> {
    let views = plant_views(9, 120, DVec3::ZERO, small()?, 60)?;
    // Views change place every 13, so steps of 17 never stay in the same stretch.
    let views = (0..30).filter_map(|frame| views.get(frame * 17 % 60).copied()).collect();
    Ok(Case { name: "teleport every frame", scene: plant(9, 120, DVec3::ZERO)?, views })
}

pub(super) fn far_from_the_origin(name: &'static str, distance: f64) -> Result<Case, CaseError> {
    let origin = DVec3::new(distance, -distance, 0.5 * distance);
    Ok(Case { name, scene: plant(5, 120, origin)?, views: plant_views(5, 120, origin, small()?, 30)? })
}

pub(super) fn field_of_view(name: &'static str, fov_degrees: f64) -> Result<Case, CaseError> {
    let at = |frame: f64| {
        let (angle, eye) = (frame * 0.3, DVec3::new(4.3, 4.4, 1.5));
        (eye, eye + DVec3::new(angle.sin(), angle.cos(), 0.1))
    };
    Ok(Case { name, scene: plant(6, 120, DVec3::ZERO)?, views: views(20, fov_degrees, at)? })
}

pub(super) fn picture_size(name: &'static str, width: u32, height: u32) -> Result<Case, CaseError> {
    let viewport = Viewport::new(width, height)?;
    Ok(Case {
        name,
        scene: plant(8, 120, DVec3::ZERO)?,
        views: plant_views(8, 120, DVec3::ZERO, viewport, 12)?,
    })
}

/// A quarter turn every frame: nothing that was seen last is in the picture.
pub(super) fn quarter_turns() -> Result<Case, CaseError> {
    turning("a turn by 90 degrees every frame", std::f64::consts::FRAC_PI_2)
}

/// A shake by one pixel: what was just hidden, or just visible, changes sides.
pub(super) fn shaking() -> Result<Case, CaseError> {
    let pixel = pixels(1.0);
    let still = turning("", 0.0)?;
    let at = |frame: f64| {
        let (side, eye) = (if frame % 2.0 == 0.0 { 0.0 } else { pixel }, DVec3::new(4.3, 4.4, 1.5));
        let angle = 0.7 + (frame / 8.0).floor() * 0.9 + side;
        (eye, eye + DVec3::new(angle.sin(), angle.cos(), 0.1 + side))
    };
    Ok(Case { name: "a shake by one pixel", views: views(32, 70.0, at)?, ..still })
}

/// A steady turn by eight pixels a frame, by which the delay of a picture shows as an offset.
pub(super) fn steady_turn() -> Result<Case, CaseError> {
    turning("a steady turn by 8 pixels a frame", pixels(8.0))
}

/// The angle by which the middle of a small picture of 70 degrees moves by this many pixels.
fn pixels(count: f64) -> f64 {
    (count / 40.0 * 35_f64.to_radians().tan()).atan()
}

/// On the spot in a plant, by this angle a frame.
fn turning(name: &'static str, angle: f64) -> Result<Case, CaseError> {
    let at = |frame: f64| {
        let (angle, eye) = (frame * angle, DVec3::new(4.3, 4.4, 1.5));
        (eye, eye + DVec3::new(angle.sin(), angle.cos(), 0.1))
    };
    Ok(Case { name, scene: plant(6, 120, DVec3::ZERO)?, views: views(24, 70.0, at)? })
}
