//! The hard cases of culling, each a small scene and views of it.

mod coplanar;
mod depth;
mod levels;
mod near;
mod paths;
mod thin;

use super::case::{Case, CaseError};

/// All hard cases.
///
/// # Errors
/// None, unless this module has a bug.
pub fn hard_cases() -> Result<Vec<Case>, CaseError> {
    Ok(vec![
        near::across_the_near_plane()?,
        near::eye_inside_a_box()?,
        near::eye_on_a_box()?,
        thin::flat_line_and_point()?,
        thin::slivers_behind_a_gap()?,
        thin::thin_wall_with_something_behind()?,
        thin::plates_about_a_thin_wall()?,
        thin::keyhole()?,
        thin::grating()?,
        thin::edge_off_screen()?,
        coplanar::still_wall()?,
        coplanar::plates_flush_with_a_wall("plates flush with a wall, 60 still frames", 0.0)?,
        coplanar::plates_flush_with_a_wall("plates flush with a wall at 1e6, 60 still frames", 1e6)?,
        coplanar::plates_about_walls_far_away()?,
        depth::depth_range()?,
        depth::near_plane_at_a_millimetre()?,
        levels::scaled_mirrored_sheared()?,
        levels::level_that_occludes_more()?,
        levels::patches_of_a_dome()?,
        paths::looking_away()?,
        paths::teleporting()?,
        paths::quarter_turns()?,
        paths::shaking()?,
        paths::steady_turn()?,
        paths::far_from_the_origin("origin at 0", 0.0)?,
        paths::far_from_the_origin("origin at 1e6", 1e6)?,
        paths::far_from_the_origin("origin at 1e7", 1e7)?,
        paths::far_from_the_origin("origin at 1e8", 1e8)?,
        paths::field_of_view("fov 0.01", 0.01)?,
        paths::field_of_view("fov 1", 1.0)?,
        paths::field_of_view("fov 120", 120.0)?,
        paths::field_of_view("fov 179", 179.0)?,
        paths::picture_size("1 x 1", 1, 1)?,
        paths::picture_size("1 x 97", 1, 97)?,
        paths::picture_size("97 x 1", 97, 1)?,
        paths::picture_size("333 x 777", 333, 777)?,
        paths::picture_size("1023 x 33", 1023, 33)?,
    ])
}
