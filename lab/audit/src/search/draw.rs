//! Trials at random.

use glam::DVec3;
use trimaran_cull::Viewport;
use trimaran_proto::{ObjectSet, Section, SectionBox, SectionPlane};
use trimaran_scene::random::Random;

use super::cameras::Cameraman;
use super::solids::Builder;
use super::trial::{Solid, Trial, TrialFrame};

/// The frame of reference of a trial.
#[derive(Debug, Clone, Copy)]
pub(super) struct World {
    /// The middle of the scene.
    pub(super) origin: DVec3,
    /// The size of what is there, metres.
    pub(super) scale: f64,
    /// If set, coordinates are multiples of this, and directions are along axes. Then many things lie exactly
    /// in one plane, and edges run through pixels' centres.
    pub(super) grid: Option<f64>,
}

impl World {
    fn draw(random: &mut Random) -> Self {
        let on_grid = random.chance(0.35);
        let power = random.between(-6.0, 9.0);
        let scale = if on_grid { power.round() } else { power }.exp2();
        let origin = match random.below(4) {
            0 => random.direction() * 10_f64.powf(random.between(2.0, 8.0)),
            1 => random.direction() * scale,
            _ => DVec3::ZERO,
        };
        let world = Self { origin: DVec3::ZERO, scale, grid: on_grid.then_some(scale / 8.0) };
        Self { origin: world.snapped(origin), ..world }
    }

    /// The point on the grid, if there is one.
    pub(super) fn snapped(&self, point: DVec3) -> DVec3 {
        self.grid.map_or(point, |step| (point / step).round() * step)
    }

    /// A point at most `reach` times the scale from the middle, along each axis.
    pub(super) fn point(&self, random: &mut Random, reach: f64) -> DVec3 {
        let reach = DVec3::splat(reach * self.scale);
        self.snapped(self.origin + random.point(-reach, reach))
    }

    /// A unit vector: along an axis, mostly, if there is a grid.
    pub(super) fn direction(&self, random: &mut Random) -> DVec3 {
        if self.grid.is_some() && random.chance(0.8) {
            let axis = random.pick(DVec3::AXES);
            return if random.chance(0.5) { axis } else { -axis };
        }
        random.direction()
    }
}

/// A number between two others, each power of ten equally likely.
pub(super) fn magnitude(random: &mut Random, low: f64, high: f64) -> f64 {
    low * (high / low).powf(random.unit())
}

impl Trial {
    /// The trial of a seed, with this many frames.
    #[must_use]
    pub fn draw(seed: u64, frames: usize) -> Self {
        let mut random = Random::stream(seed, 0x0074_7269_616c, 0);
        let world = World::draw(&mut random);
        let size = size(&mut random, world.grid.is_some());
        let count = match random.below(10) {
            0..2 => 1 + random.below(6),
            2..8 => 5 + random.below(20),
            _ => 25 + random.below(60),
        };
        let solids = Builder::new(world, size).solids(&mut random, count);
        let mut frames = Cameraman::new(world, size, &solids).frames(&mut random, frames);
        Changes::draw(&mut random).change(&mut random, &world, &solids, &mut frames);
        Self { merged: random.chance(0.5), solids, frames }
    }
}

/// A picture's size: with a grid, one whose middle is a pixel's corner and whose sides are powers of two.
fn size(random: &mut Random, on_grid: bool) -> Viewport {
    let mut side = || match random.below(12) {
        _ if on_grid => random.pick([8, 16, 32, 64]),
        0 => 1 + random.below(8) as u32,
        _ => 8 + random.below(89) as u32,
    };
    let (width, height) = (side(), side());
    Viewport::new(width, height).unwrap_or(Viewport::LARGEST)
}

/// How often each part of the view state changes from a frame to the next.
struct Changes {
    hidden: f64,
    see_through: f64,
    sections: f64,
    epsilon: f64,
    size: f64,
}

impl Changes {
    fn draw(random: &mut Random) -> Self {
        let mut often = || random.pick([0.0, 0.0, 0.0, 0.1, 0.5]);
        let [hidden, see_through, sections, epsilon] = std::array::from_fn(|_| often());
        Self { hidden, see_through, sections, epsilon, size: if random.chance(0.1) { 0.2 } else { 0.0 } }
    }

    fn change(&self, random: &mut Random, world: &World, solids: &[Solid], frames: &mut [TrialFrame]) {
        let Some(mut last) = frames.first().cloned() else { return };
        last.epsilon = magnitude(random, 0.05, 60.0);
        for frame in frames {
            if random.chance(self.hidden) {
                (last.hidden, last.isolated) = match random.below(5) {
                    0 => Default::default(),
                    1 => (ObjectSet::default(), Some(some(random, solids))),
                    _ => (some(random, solids), None),
                };
            }
            if random.chance(self.see_through) {
                last.see_through = some(random, solids);
            }
            if random.chance(self.sections) {
                last.sections = sections(random, world, solids);
            }
            if random.chance(self.epsilon) {
                last.epsilon = magnitude(random, 0.05, 60.0);
            }
            if random.chance(self.size) {
                last.size = size(random, world.grid.is_some());
            }
            let TrialFrame { eye, target, roll, fov, near, .. } = *frame;
            *frame = TrialFrame { eye, target, roll, fov, near, ..last.clone() };
        }
    }
}

/// Some of the objects, or none.
fn some(random: &mut Random, solids: &[Solid]) -> ObjectSet {
    let share = random.between(-0.1, 0.8);
    (0..solids.len() as u32).filter(|_| random.chance(share)).collect()
}

/// Up to three sections. Some lie in the middle of an object.
fn sections(random: &mut Random, world: &World, solids: &[Solid]) -> Vec<Section> {
    let count = random.below(4);
    let section = |_| {
        let middle = solids.get(random.below(solids.len()));
        let place = match middle.filter(|_| random.chance(0.5)) {
            Some(solid) => DVec3::from_array(solid.origin),
            None => world.point(random, 2.0),
        };
        if random.chance(0.6) {
            let direction = world.direction(random);
            return SectionPlane::new(place.to_array(), direction.to_array()).ok().map(Section::Plane);
        }
        let half = world.snapped(DVec3::splat(world.scale * random.between(0.3, 3.0)));
        let [low, high] = [place - half, place + half].map(|corner| corner.to_array());
        SectionBox::new(low, high).ok().map(Section::Box)
    };
    (0..count).filter_map(section).collect()
}
