//! Chooses the viewing direction: towards sides with much to see, near and far, rather than a wall close by.

use std::{collections::BTreeSet, f64::consts::TAU};

use glam::DVec3;

use super::space::{Hit, Space};

/// Rays around a place, this many to each side.
const COLUMNS: usize = 24;
/// How far the rays of a column lean up or down: the tangents.
const LEANS: [f64; 3] = [-0.35, 0.0, 0.35];
/// Columns to each side of the middle one that count as one view: 75 degrees in all.
const HALF_VIEW: usize = 2;
/// The cost of turning, per radian, so that the gaze does not change for a small gain.
const TURNING: f64 = 3.0;

/// The hits of rays from one place, all around.
#[derive(Debug)]
pub(super) struct Panorama {
    columns: Vec<[Option<Hit>; LEANS.len()]>,
    /// Surfaces nearer than this block the view.
    close: f64,
    reach: f64,
}

impl Panorama {
    /// Looks around from `eye`, as far as 12 eye heights.
    pub(super) fn around(space: &Space<'_>, eye: DVec3, eye_height: f64) -> Self {
        let reach = 12.0 * eye_height;
        let column = |column| {
            let (sine, cosine) = libm::sincos(yaw(column));
            LEANS.map(|lean| space.ray(eye, DVec3::new(sine, lean, cosine), reach))
        };
        Self { columns: (0..COLUMNS).map(column).collect(), close: 0.6 * eye_height, reach }
    }

    /// The worth of the best view from here.
    pub(super) fn best(&self) -> f64 {
        (0..COLUMNS).map(|column| self.worth(column)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The direction with the best view within 1.2 radians of `heading`, with a bonus near `gaze`. All are
    /// angles from +z towards +x.
    pub(super) fn look(&self, heading: f64, gaze: f64) -> f64 {
        let near = |column: &usize| wrapped(yaw(*column) - heading).abs() <= 1.2;
        let worth = |column| self.worth(column) - TURNING * wrapped(yaw(column) - gaze).abs();
        let best = (0..COLUMNS).filter(near).max_by(|&a, &b| worth(a).total_cmp(&worth(b)));
        best.map_or(heading, yaw)
    }

    /// The worth of the view around a column: each object once, each ray by its length. Emptiness is worth
    /// nothing, a close surface less than nothing.
    fn worth(&self, middle: usize) -> f64 {
        let columns = (COLUMNS + middle - HALF_VIEW..=COLUMNS + middle + HALF_VIEW).map(|c| c % COLUMNS);
        let hits: Vec<Hit> =
            columns.filter_map(|column| self.columns.get(column)).flatten().flatten().copied().collect();
        let objects: BTreeSet<_> = hits.iter().filter(|h| h.distance > self.close).map(|h| h.leaf).collect();
        let depth = |hit: &Hit| match hit.distance {
            near if near <= self.close => -1.0,
            far => libm::log(far / self.close) / libm::log(self.reach / self.close),
        };
        objects.len() as f64 + hits.iter().map(depth).sum::<f64>()
    }
}

fn yaw(column: usize) -> f64 {
    column as f64 / COLUMNS as f64 * TAU
}

/// The same angle between -pi and pi.
pub(super) fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::testing::{boxes, uncooked};

    /// A wall half a metre to the right (-x, looking along +z) of the origin; four posts far to the left.
    fn wall_and_posts() -> crate::Scene {
        let post = |x: f64, z: f64| ([x, -2.0, z], [x + 1.5, 3.0, z + 1.5]);
        uncooked(&boxes(&[
            ([-0.6, -2.0, -20.0], [-0.5, 3.0, 20.0]),
            post(4.0, 5.0),
            post(7.0, 4.0),
            post(6.0, 8.0),
            post(9.0, 6.0),
        ]))
    }

    #[test]
    fn the_gaze_turns_from_a_wall_to_what_stands_beyond() {
        let scene = wall_and_posts();
        let panorama = Panorama::around(&Space::new(&scene), DVec3::ZERO, 1.7);
        // One column away from the wall, it is out of reach and a post in view; the next column shows another
        // post, for more turning than it is worth.
        assert_eq!(panorama.look(0.0, 0.0), yaw(1));
        assert!(panorama.worth(1) > panorama.worth(0) + 3.0 && panorama.worth(2) > panorama.worth(1));
        assert_eq!(panorama.look(0.0, yaw(3)), yaw(3), "a gaze on the posts stays");
        assert!(panorama.best() > panorama.worth(COLUMNS * 3 / 4) + 5.0, "the wall is worth less");
    }

    #[test]
    fn the_gaze_keeps_to_the_way_and_rests_where_nothing_is() {
        let scene = wall_and_posts();
        let panorama = Panorama::around(&Space::new(&scene), DVec3::ZERO, 1.7);
        let back = panorama.look(-2.4, -2.4);
        assert!(wrapped(back + 2.4).abs() <= 1.2, "{back}");
        let nowhere = Panorama::around(&Space::new(&scene), DVec3::Y * 1e3, 1.7);
        assert!((nowhere.look(1.0, 1.0) - 1.0).abs() < TAU / COLUMNS as f64);
        assert_eq!(nowhere.best(), 0.0);
    }

    #[test]
    fn angles_wrap_to_the_nearest_turn() {
        assert!((wrapped(7.0) - (7.0 - TAU)).abs() < 1e-12);
        assert!((wrapped(-4.0) - (TAU - 4.0)).abs() < 1e-12);
    }
}
