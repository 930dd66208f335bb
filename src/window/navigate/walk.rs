//! A walking body: it falls, climbs stairs, and does not pass through walls.

use glam::{DVec2, DVec3};

use super::ground::Solid;

/// Metres, of a person whose eye is at 1.7 m. Others scale with the eye.
const EYE: f64 = 1.7;
const RADIUS: f64 = 0.22;
const HEIGHT: f64 = 1.78;
/// The highest step that is climbed.
const STEP: f64 = 0.45;
const JUMP: f64 = 0.4;
const GRAVITY: f64 = 9.81;
const FASTEST_FALL: f64 = 30.0;
/// The time constant with which the eye follows a step, seconds.
const SMOOTH: f64 = 0.09;

/// A body.
#[derive(Debug, Clone)]
pub struct Walk {
    feet: DVec3,
    /// Metres a second upwards.
    rise: f64,
    is_standing: bool,
    /// How far the eye is above its place over the feet.
    lag: f64,
    /// The body's size, relative to a person.
    scale: f64,
}

impl Walk {
    /// A body with this eye height, metres, whose eye is now at `eye`.
    #[must_use]
    pub fn new(eye: DVec3, eye_height: f64) -> Self {
        let mut walk = Self { feet: eye, rise: 0.0, is_standing: false, lag: 0.0, scale: eye_height / EYE };
        walk.place(eye);
        walk
    }

    /// The eye's position.
    #[must_use]
    pub fn eye(&self) -> DVec3 {
        self.feet + DVec3::new(0.0, EYE * self.scale + self.lag, 0.0)
    }

    /// Puts the eye at a place.
    pub fn place(&mut self, eye: DVec3) {
        self.feet = eye - DVec3::new(0.0, EYE * self.scale, 0.0);
        (self.rise, self.lag, self.is_standing) = (0.0, 0.0, false);
    }

    /// Leaves the ground, if it stands on it.
    pub fn jump(&mut self) {
        if self.is_standing {
            self.rise = (2.0 * GRAVITY * JUMP).sqrt() * self.scale;
            self.is_standing = false;
        }
    }

    /// Moves this far along x and z, in this many seconds. Returns whether it has moved.
    pub fn step(&mut self, seconds: f64, way: DVec2, solid: &impl Solid) -> bool {
        let before = self.eye();
        // No part of a move is longer than half a column, so nothing is stepped over.
        let parts = (way.length() / (0.5 * solid.cell())).max(seconds / 0.02).ceil().clamp(1.0, 1e4);
        for _ in 0..parts as u32 {
            self.go(way / parts, solid);
            self.fall(seconds / parts, solid);
        }
        self.lag *= (-seconds / SMOOTH).exp();
        if self.lag.abs() < 1e-4 * self.scale {
            self.lag = 0.0;
        }
        self.eye() != before
    }

    /// Moves there, or along a wall in the way.
    fn go(&mut self, way: DVec2, solid: &impl Solid) {
        if way == DVec2::ZERO {
            return;
        }
        // A body within something may leave it in any direction.
        let is_within = !self.fits(self.feet, solid);
        for way in [way, DVec2::new(way.x, 0.0), DVec2::new(0.0, way.y)] {
            let there = self.feet + DVec3::new(way.x, 0.0, way.y);
            let Some(ground) = self.ground_below(there, solid) else { continue };
            // Onto a step, if there is room for the head above it.
            let on_step = DVec3 { y: ground.max(there.y), ..there };
            if is_within || self.fits(on_step, solid) {
                if self.is_standing && ground > there.y {
                    self.lag -= ground - there.y;
                    self.feet = on_step;
                } else {
                    self.feet = there;
                }
                return;
            }
        }
    }

    /// Falls, or stands, or steps down.
    fn fall(&mut self, seconds: f64, solid: &impl Solid) {
        let known = self.ground_below(self.feet, solid);
        // Without any ground nobody falls for ever.
        let Some(ground) = known.filter(|ground| ground.is_finite()) else {
            (self.rise, self.is_standing) = (0.0, known.is_some());
            return;
        };
        if self.is_standing && self.feet.y - ground <= STEP * self.scale {
            self.lag += self.feet.y - ground;
            self.feet.y = ground;
            return;
        }
        self.rise = (self.rise - GRAVITY * self.scale * seconds).max(-FASTEST_FALL * self.scale);
        let up = self.feet.y + self.rise * seconds;
        if self.rise > 0.0 && !self.fits(DVec3 { y: up, ..self.feet }, solid) {
            self.rise = 0.0;
        } else if up <= ground {
            (self.feet.y, self.rise, self.is_standing) = (ground, 0.0, true);
        } else {
            (self.feet.y, self.is_standing) = (up, false);
        }
    }

    /// Whether the body has room at a place: low steps are no obstacle.
    fn fits(&self, feet: DVec3, solid: &impl Solid) -> bool {
        let (low, high) = (feet.y + STEP * self.scale, feet.y + HEIGHT * self.scale);
        self.columns(feet, solid, |[bottom, top]| !(bottom < high && top > low))
    }

    /// The highest surface under the body that it can step on; minus infinity if there is none, `None` if not
    /// known yet.
    fn ground_below(&self, feet: DVec3, solid: &impl Solid) -> Option<f64> {
        let reach = feet.y + STEP * self.scale;
        let mut ground = f64::NEG_INFINITY;
        let known = self.columns(feet, solid, |[_, top]| {
            if top <= reach {
                ground = ground.max(top);
            }
            true
        });
        known.then_some(ground)
    }

    /// Whether all columns under the body are known and `holds` is true of each of their spans.
    fn columns(&self, feet: DVec3, solid: &impl Solid, mut holds: impl FnMut([f64; 2]) -> bool) -> bool {
        let (radius, cell) = (RADIUS * self.scale, solid.cell());
        let first = |at: f64| ((at - radius) / cell).floor();
        let mut z = first(feet.z);
        while z * cell < feet.z + radius {
            let mut x = first(feet.x);
            while x * cell < feet.x + radius {
                // The point of the column nearest to the axis of the body.
                let near = |low: f64, at: f64| at.clamp(low * cell, (low + 1.0) * cell) - at;
                let off = DVec2::new(near(x, feet.x), near(z, feet.z));
                if off.length_squared() < radius * radius {
                    let spans = solid.spans((x + 0.5) * cell, (z + 0.5) * cell);
                    if !spans.is_some_and(|mut spans| spans.all(&mut holds)) {
                        return false;
                    }
                }
                x += 1.0;
            }
            z += 1.0;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The solid spans at places, by their lower and upper ends.
    struct World<F> {
        cell: f64,
        spans: F,
    }

    impl<F: Fn(f64, f64) -> Option<Vec<[f64; 2]>>> Solid for World<F> {
        fn cell(&self) -> f64 {
            self.cell
        }

        fn spans(&self, x: f64, z: f64) -> Option<impl Iterator<Item = [f64; 2]>> {
            (self.spans)(x, z).map(Vec::into_iter)
        }
    }

    fn world(spans: impl Fn(f64, f64) -> Vec<[f64; 2]>) -> impl Solid {
        World { cell: 0.1, spans: move |x, z| Some(spans(x, z)) }
    }

    const FLOOR: [f64; 2] = [-0.2, 0.0];

    /// A person standing on a floor at the origin.
    fn person(solid: &impl Solid) -> Walk {
        let mut walk = Walk::new(DVec3::new(0.0, 1.7, 0.0), 1.7);
        walk.step(0.1, DVec2::ZERO, solid);
        assert!(walk.is_standing);
        walk
    }

    /// Walks along x at this speed in metres a second, at 20 pictures a second.
    fn ahead(walk: &mut Walk, seconds: f64, speed: f64, solid: &impl Solid) {
        for _ in 0..(seconds / 0.05).round() as u32 {
            walk.step(0.05, DVec2::new(speed * 0.05, 0.0), solid);
        }
    }

    #[test]
    fn a_person_walks_on_a_floor_and_the_eye_stays_at_its_height() {
        let solid = world(|_, _| vec![FLOOR]);
        let mut walk = person(&solid);
        ahead(&mut walk, 2.0, 1.4, &solid);
        assert!((walk.feet.x - 2.8).abs() < 0.1, "{}", walk.feet);
        assert_eq!(walk.eye().y, 1.7);
        assert!(!walk.step(0.05, DVec2::ZERO, &solid));
    }

    #[test]
    fn a_wall_stops_who_walks_against_it_and_who_walks_along_it_slides() {
        let solid = world(|x, _| match x {
            2.0..2.2 => vec![FLOOR, [0.0, 3.0]],
            _ => vec![FLOOR],
        });
        let mut walk = person(&solid);
        ahead(&mut walk, 5.0, 1.4, &solid);
        assert!((1.6..2.0 - RADIUS + 1e-9).contains(&walk.feet.x), "{}", walk.feet);
        for _ in 0..20 {
            walk.step(0.05, DVec2::new(0.05, 0.05), &solid);
        }
        assert!(walk.feet.x < 1.8 && walk.feet.z > 0.9, "{}", walk.feet);
    }

    #[test]
    fn stairs_of_20_and_of_40_cm_are_climbed_a_wall_of_60_cm_is_not() {
        for (rise, expected) in [(0.2, 2.0), (0.4, 4.0), (0.6, 0.0)] {
            let stairs = world(|x, _| vec![[-0.2, ((x - 1.0) / 0.35).ceil().clamp(0.0, 10.0) * rise]]);
            let mut walk = person(&stairs);
            ahead(&mut walk, 6.0, 1.4, &stairs);
            assert!((walk.feet.y - expected).abs() < 1e-9, "{rise}: {}", walk.feet);
            assert!((walk.eye().y - walk.feet.y - 1.7).abs() < 0.3, "{rise}: {}", walk.eye());
            // And down again, without a fall.
            for _ in 0..if expected > 0.0 { 160 } else { 0 } {
                walk.step(0.05, DVec2::new(-1.4 * 0.05, 0.0), &stairs);
                assert!(walk.is_standing);
            }
            assert!(walk.feet.y.abs() < 1e-9, "{rise}: {}", walk.feet);
        }
    }

    #[test]
    fn a_door_of_80_cm_lets_a_person_through_one_of_30_cm_or_below_the_head_does_not() {
        for (width, height, passes) in [(0.8, 2.0, true), (0.3, 2.0, false), (0.8, 1.5, false)] {
            let solid = world(|x, z: f64| match x {
                2.0..2.2 if z.abs() < width / 2.0 => vec![FLOOR, [height, 3.0]],
                2.0..2.2 => vec![FLOOR, [0.0, 3.0]],
                _ => vec![FLOOR],
            });
            let mut walk = person(&solid);
            ahead(&mut walk, 5.0, 1.4, &solid);
            assert_eq!(walk.feet.x > 3.0, passes, "{width} x {height}: {}", walk.feet);
        }
    }

    #[test]
    fn who_walks_over_an_edge_falls_and_lands_where_the_ground_is() {
        let solid = world(|x, _| vec![if x < 1.0 { FLOOR } else { [-5.2, -5.0] }]);
        let mut walk = person(&solid);
        ahead(&mut walk, 1.2, 1.4, &solid);
        assert!(!walk.is_standing && walk.feet.y < 0.0);
        ahead(&mut walk, 2.0, 1.4, &solid);
        assert!(walk.is_standing);
        assert_eq!(walk.feet.y, -5.0);
    }

    #[test]
    fn without_any_ground_nobody_falls_and_where_it_is_not_known_yet_nobody_goes() {
        let mut walk = Walk::new(DVec3::new(0.0, 1.7, 0.0), 1.7);
        walk.step(3.0, DVec2::ZERO, &world(|_, _| vec![]));
        assert_eq!(walk.feet.y, 0.0);
        let edge = World { cell: 0.1, spans: |x, _| (x < 1.0).then(|| vec![FLOOR]) };
        let mut waits = person(&edge);
        ahead(&mut waits, 3.0, 1.4, &edge);
        assert!(waits.feet.x < 1.0 && waits.feet.y == 0.0, "{}", waits.feet);
    }

    #[test]
    fn a_jump_is_40_cm_high_and_a_ceiling_ends_it() {
        for (ceiling, most) in [(9.0, 0.4), (1.9, 0.13)] {
            let solid = world(|_, _| vec![FLOOR, [ceiling, ceiling + 1.0]]);
            let mut walk = person(&solid);
            walk.jump();
            let mut highest = 0.0_f64;
            for _ in 0..150 {
                walk.step(0.01, DVec2::ZERO, &solid);
                highest = highest.max(walk.feet.y);
            }
            assert!((most - 0.06..most + 0.01).contains(&highest), "{ceiling}: {highest}");
            assert_eq!(walk.feet.y, 0.0);
        }
    }

    #[test]
    fn who_begins_within_something_gets_out_of_it() {
        let solid = world(|x, _| if x < 1.0 { vec![FLOOR, [0.0, 3.0]] } else { vec![FLOOR] });
        let mut walk = Walk::new(DVec3::new(0.0, 1.7, 0.0), 1.7);
        ahead(&mut walk, 3.0, 1.4, &solid);
        assert!(walk.feet.x > 1.5, "{}", walk.feet);
    }

    #[test]
    fn a_small_person_walks_in_a_small_world() {
        let spans =
            |x: f64, _| Some(vec![if (0.02..0.022).contains(&x) { [0.0, 0.03] } else { [-1.0, 0.0] }]);
        let solid = World { cell: 0.001, spans };
        let mut walk = Walk::new(DVec3::new(0.0, 0.017, 0.0), 0.017);
        ahead(&mut walk, 5.0, 0.014, &solid);
        assert!((0.016..0.0179).contains(&walk.feet.x), "{}", walk.feet);
    }

    proptest! {
        /// A room of 4 by 4 metres with a pillar and a step in it.
        #[test]
        fn no_way_leads_through_walls_whatever_is_wanted_and_however_long_a_picture_takes(
            steps in prop::collection::vec((-3.0..3.0, -3.0..3.0, 0.0..0.1, 0..10), 100)
        ) {
            let solid = world(|x: f64, z: f64| {
                let is_pillar = (0.5..0.8).contains(&x) && (0.5..0.8).contains(&z);
                match x.abs() > 2.0 || z.abs() > 2.0 || is_pillar {
                    true => vec![[-0.2, 3.0]],
                    false => vec![[-0.2, if (-2.0..-1.0).contains(&x) { 0.3 } else { 0.0 }]],
                }
            });
            let mut walk = person(&solid);
            for (x, z, seconds, jump) in steps {
                if jump == 0 {
                    walk.jump();
                }
                walk.step(seconds, DVec2::new(x, z), &solid);
                let DVec3 { x, y, z } = walk.feet;
                prop_assert!(x.abs() <= 1.79 && z.abs() <= 1.79 && y >= 0.0, "{}", walk.feet);
                prop_assert!((x - 0.65).hypot(z - 0.65) > 0.36, "{} is within the pillar", walk.feet);
            }
        }
    }
}
