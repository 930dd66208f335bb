//! The cameras of a trial.

use glam::{DMat3, DQuat, DVec3, Mat3};
use trimaran_cull::Viewport;
use trimaran_proto::ObjectSet;
use trimaran_scene::random::Random;

use super::draw::{World, magnitude};
use super::trial::{Solid, TrialFrame};

/// Walks about some objects.
pub(super) struct Cameraman<'s> {
    world: World,
    solids: &'s [Solid],
    frame: TrialFrame,
}

/// How the camera moves for some frames.
#[derive(Debug, Clone, Copy)]
enum Move {
    Still,
    /// A small step in any direction.
    Walk,
    Turn,
    /// Up to a pixel to and fro.
    Shake,
    /// To anywhere.
    Jump,
    /// Into an object, or beside its middle.
    Inside,
    /// Its near plane through an object, a little farther with each frame.
    Through,
    /// In the plane of a face.
    Along,
    Zoom,
    /// Back to where it was some frames ago.
    Back,
}

/// As often as they stand here.
const MOVES: [Move; 16] = [
    Move::Still,
    Move::Still,
    Move::Walk,
    Move::Walk,
    Move::Walk,
    Move::Turn,
    Move::Turn,
    Move::Shake,
    Move::Shake,
    Move::Jump,
    Move::Inside,
    Move::Through,
    Move::Along,
    Move::Along,
    Move::Zoom,
    Move::Back,
];

impl<'s> Cameraman<'s> {
    pub(super) fn new(world: World, size: Viewport, solids: &'s [Solid]) -> Self {
        let frame = TrialFrame {
            eye: [0.0; 3],
            target: [0.0; 3],
            roll: 0.0,
            fov: 60.0,
            near: 0.01,
            size,
            epsilon: 1.0,
            sections: Vec::new(),
            hidden: ObjectSet::default(),
            isolated: None,
            see_through: ObjectSet::default(),
        };
        Self { world, solids, frame }
    }

    pub(super) fn frames(mut self, random: &mut Random, count: usize) -> Vec<TrialFrame> {
        self.frame.near = (self.world.scale * magnitude(random, 1e-4, 0.1)) as f32;
        self.zoom(random);
        self.look_from_afar(random);
        let mut frames: Vec<TrialFrame> = Vec::with_capacity(count);
        while frames.len() < count {
            let movement = random.pick(MOVES);
            let run = 1 + random.below(8);
            for step in 0..run.min(count - frames.len()) {
                match movement {
                    Move::Back => {
                        if let Some(earlier) = frames.get(random.below(frames.len())) {
                            self.frame = earlier.clone();
                        }
                    }
                    _ => self.step(random, movement, step),
                }
                frames.push(self.frame.clone());
            }
        }
        frames
    }

    fn step(&mut self, random: &mut Random, movement: Move, step: usize) {
        let scale = self.world.scale;
        let pixel = (self.frame.fov.to_radians() * 0.5).tan() * 2.0 / f64::from(self.frame.size.height());
        match movement {
            Move::Still | Move::Back => {}
            Move::Walk => self.walk(self.world.direction(random) * scale * magnitude(random, 1e-4, 0.3)),
            Move::Turn => self.turn(random, 0.3),
            Move::Shake => self.turn(random, pixel),
            Move::Jump => self.look_from_afar(random),
            Move::Inside if step == 0 => {
                let Some((middle, _)) = self.any(random) else { return };
                self.stand(middle, self.world.direction(random));
            }
            Move::Inside => self.turn(random, 1.0),
            Move::Through if step == 0 => {
                let Some((middle, half)) = self.any(random) else { return };
                let direction = self.world.direction(random);
                let distance =
                    half.col(random.below(3)).length() * random.unit() + f64::from(self.frame.near);
                self.stand(middle - direction * distance, direction);
            }
            Move::Through => {
                self.walk(self.forward() * f64::from(self.frame.near) * random.between(-0.2, 0.6));
            }
            Move::Along if step == 0 => self.look_along(random),
            Move::Along => self.walk(self.forward() * scale * magnitude(random, 1e-5, 0.1)),
            Move::Zoom => self.zoom(random),
        }
    }

    /// A random object's middle, and half its size along each of its axes in the world.
    fn any(&self, random: &mut Random) -> Option<(DVec3, DMat3)> {
        let solid = self.solids.get(random.below(self.solids.len()))?;
        let half = Mat3::from_cols_array(&solid.linear) * Mat3::from_diagonal(solid.shape.half());
        Some((DVec3::from_array(solid.origin), half.as_dmat3()))
    }

    fn look_from_afar(&mut self, random: &mut Random) {
        let target = match self.any(random).filter(|_| random.chance(0.7)) {
            Some((middle, _)) => middle,
            None => self.world.point(random, 1.0),
        };
        let distance = self.world.scale * magnitude(random, 0.3, 8.0);
        let direction = self.world.direction(random);
        self.stand(self.world.snapped(target - direction * distance), direction);
        self.frame.roll = if random.chance(0.3) { random.between(-180.0, 180.0) } else { 0.0 };
    }

    /// Stands in a plane that bounds an object, and looks along it.
    fn look_along(&mut self, random: &mut Random) {
        let Some((middle, half)) = self.any(random) else { return };
        let axis = random.below(3);
        let [across, along] = [0, 1].map(|turn| half.col((axis + turn) % 3));
        let distance = self.world.scale * magnitude(random, 0.1, 5.0);
        let direction = along.normalize_or(DVec3::X);
        let face = random.pick([-1.0, 0.0, 1.0, 1.0]) * (1.0 + random.pick([0.0, 0.0, 1e-6, 1e-3]));
        self.stand(middle + across * face - direction * distance, direction);
    }

    fn zoom(&mut self, random: &mut Random) {
        self.frame.fov = match random.below(10) {
            0 => magnitude(random, 0.01, 20.0),
            1 => random.between(120.0, 179.5),
            2..6 => 90.0,
            _ => random.between(30.0, 90.0),
        };
    }

    fn forward(&self) -> DVec3 {
        let [eye, target] = [self.frame.eye, self.frame.target].map(DVec3::from_array);
        (target - eye).normalize_or(DVec3::Y)
    }

    fn stand(&mut self, eye: DVec3, direction: DVec3) {
        self.frame.eye = eye.to_array();
        self.frame.target = (eye + direction * self.world.scale).to_array();
    }

    fn walk(&mut self, step: DVec3) {
        let direction = self.forward();
        self.stand(DVec3::from_array(self.frame.eye) + step, direction);
    }

    fn turn(&mut self, random: &mut Random, most: f64) {
        let turn = DQuat::from_axis_angle(random.direction(), random.between(-most, most));
        let direction = turn * self.forward();
        self.stand(DVec3::from_array(self.frame.eye), direction);
    }
}
