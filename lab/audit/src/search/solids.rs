//! The objects of a trial.

use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::Viewport;
use trimaran_scene::random::Random;

use super::draw::{World, magnitude};
use super::trial::{Shape, Solid};

/// Draws objects one after the other, many of them in relation to an earlier one.
pub(super) struct Builder {
    world: World,
    size: Viewport,
    solids: Vec<Solid>,
}

impl Builder {
    pub(super) const fn new(world: World, size: Viewport) -> Self {
        Self { world, size, solids: Vec::new() }
    }

    pub(super) fn solids(mut self, random: &mut Random, count: usize) -> Vec<Solid> {
        // Many trials have one kind of size: all small, all large, or any.
        let sizes = random.pick([(1e-4, 20.0), (0.03, 1.0), (0.1, 1.0), (0.2, 2.0), (1e-3, 0.05)]);
        let related = random.pick([0.0, 0.3, 0.6, 0.9]);
        // Walls, so that something is hidden.
        let walls = random.pick([0, 1, 2, 5]).min(count);
        for _ in 0..walls {
            let wall = self.wall(random);
            self.solids.push(wall);
        }
        while self.solids.len() < count {
            let earlier = self.solids.get(random.below(self.solids.len())).cloned();
            let solid = match earlier {
                Some(earlier) if random.chance(related) => self.beside(random, earlier),
                _ => self.alone(random, sizes),
            };
            self.solids.push(solid);
        }
        self.solids
    }

    fn wall(&self, random: &mut Random) -> Solid {
        let mut half = [1.0; 3].map(|one: f64| one * self.world.scale * magnitude(random, 0.3, 3.0));
        half[random.below(3)] *= random.pick([0.0, 1e-4, 0.01, 0.1]);
        let half = self.world.snapped(DVec3::from_array(half)).as_vec3();
        let shape = Shape::Box { half: half.to_array(), cuts: random.pick([1, 2, 4]) };
        let most = random.chance(0.3).then_some(2);
        let linear = if random.chance(0.5) { Mat3::IDENTITY } else { self.linear(random) };
        let origin = self.world.point(random, 1.0).to_array();
        Solid { shape, coarser: Vec::new(), origin, linear: linear.to_cols_array(), most }
    }

    fn alone(&self, random: &mut Random, (low, high): (f64, f64)) -> Solid {
        let (low, high) = match random.below(12) {
            0 => (5.0, 80.0),
            1 => (1e-6, 1e-3),
            _ => (low, high),
        };
        let reach = if random.chance(0.05) { 100.0 } else { random.pick([0.5, 1.0, 2.0, 3.0]) };
        let shape = self.shape(random, low, high);
        let linear = self.linear(random);
        let coarser = if random.chance(0.4) { coarser(random, &shape) } else { Vec::new() };
        let most = random.chance(0.4).then(|| random.pick([1, 2, 5, 16]));
        let origin = self.world.point(random, reach).to_array();
        Solid { shape, coarser, origin, linear: linear.to_cols_array(), most }
    }

    /// The earlier one again, in the same plane, within it, touching it, or behind a gap of about a pixel.
    fn beside(&self, random: &mut Random, earlier: Solid) -> Solid {
        let linear = Mat3::from_cols_array(&earlier.linear);
        let half = earlier.shape.half();
        let axis = random.below(3);
        let along = (linear * Vec3::AXES[axis]).as_dvec3() * f64::from(half[axis]);
        let pixel = self.world.scale * 2.0 / f64::from(self.size.height());
        let shift = match random.below(6) {
            0 => along,
            1 => along * 2.0,
            2 => along * 2.0 * (1.0 + 1e-7 * random.between(-8.0, 8.0)),
            3 => along * 2.0 + along.normalize_or_zero() * pixel * magnitude(random, 0.1, 3.0),
            4 => along.normalize_or_zero() * pixel * magnitude(random, 1e-5, 0.1),
            _ => DVec3::ZERO,
        };
        let linear = linear * random.pick([1.0, 1.0, 1.0, 0.5, 0.999, 0.999_999, 1.001, -1.0]);
        let origin = (DVec3::from_array(earlier.origin) + shift).to_array();
        Solid { origin, linear: linear.to_cols_array(), ..earlier }
    }

    fn shape(&self, random: &mut Random, low: f64, high: f64) -> Shape {
        let scale = self.world.scale;
        let step = self.world.grid;
        let on_grid = |value: f64| step.map_or(value, |step| (value / step).round() * step) as f32;
        let length = |random: &mut Random| on_grid(scale * magnitude(random, low, high));
        let cuts = random.pick([1, 1, 1, 2, 3]);
        match random.below(10) {
            0..4 => {
                let mut half = [length(random), length(random), length(random)];
                if random.chance(0.3) {
                    // A plate, or a bar.
                    let thin = random.pick([0.0, 1e-6, 1e-4, 1e-2]) * scale as f32;
                    half[random.below(3)] = thin;
                    if random.chance(0.3) {
                        half[random.below(3)] = thin;
                    }
                }
                Shape::Box { half, cuts }
            }
            4..6 => {
                let axis = random.below(3);
                let [a, b] = [1, 2].map(|turn| {
                    let edge = Vec3::AXES[(axis + turn) % 3] * length(random);
                    if random.chance(0.05) { [0.0; 3] } else { edge.to_array() }
                });
                Shape::Rectangle { a, b, cuts }
            }
            6..8 => Shape::Cylinder {
                radius: length(random),
                half_length: length(random),
                sides: random.pick([3, 4, 6, 10, 24]),
            },
            _ => {
                let reach = DVec3::splat(f64::from(length(random)));
                let (sliver, count) = (random.chance(0.5), 1 + random.below(6));
                let triangle = |_| {
                    let [a, b, c] = [(); 3].map(|()| random.point(-reach, reach));
                    let c = if sliver { a.lerp(b, random.unit()) + (c - a) * 1e-3 } else { c };
                    [a, b, c].map(|corner| corner.to_array().map(on_grid))
                };
                Shape::Triangles((0..count).map(triangle).collect())
            }
        }
    }

    fn linear(&self, random: &mut Random) -> Mat3 {
        let turn = Mat3::from_quat(random.rotation().as_quat());
        let mirror = Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0));
        let kind = random.below(20);
        if self.world.grid.is_some() && random.chance(0.8) {
            let swap = Mat3::from_cols(Vec3::Y, Vec3::X, Vec3::Z);
            return random.pick([Mat3::IDENTITY, mirror, swap, mirror * swap]);
        }
        match kind {
            0..9 => Mat3::IDENTITY,
            9..14 => turn,
            14 => turn * mirror,
            15..17 => {
                let stretch = random.point(DVec3::splat(-3.0), DVec3::splat(3.0));
                turn * Mat3::from_diagonal(Vec3::from_array(
                    stretch.as_vec3().to_array().map(|x| 10_f32.powf(x)),
                ))
            }
            17 => Mat3::from_diagonal(Vec3::new(1.0, random.pick([0.0, 1e-5, 1.0]), 1.0)),
            _ => {
                let mut slant = || random.between(-1.0, 1.0) as f32;
                let shear =
                    Mat3::from_cols(Vec3::X, Vec3::new(slant(), 1.0, 0.0), Vec3::new(slant(), slant(), 1.0));
                turn * shear
            }
        }
    }
}

/// One or two coarser levels: a box of about the size, or a thin prism. Their errors need not be right for
/// culling to be exact.
fn coarser(random: &mut Random, shape: &Shape) -> Vec<(f32, Shape)> {
    let half = shape.half();
    let mut error = 0.0;
    (0..1 + random.below(2))
        .map(|_| {
            error += half.length() * magnitude(random, 0.01, 1.5) as f32;
            let about = half * random.pick([1.0, 1.0, 0.7, 1.3]);
            let coarse = match (random.below(8), shape) {
                (0..4, Shape::Cylinder { radius, half_length, .. }) => {
                    Shape::Cylinder { radius: *radius, half_length: *half_length, sides: 3 }
                }
                _ => Shape::Box { half: about.to_array(), cuts: random.pick([1, 2]) },
            };
            (error, coarse)
        })
        .collect()
}

impl Shape {
    /// Half the size of the box about the origin that holds it.
    pub(super) fn half(&self) -> Vec3 {
        match self {
            Self::Box { half, .. } => Vec3::from_array(*half),
            Self::Rectangle { a, b, .. } => Vec3::from_array(*a).abs() + Vec3::from_array(*b).abs(),
            Self::Cylinder { radius, half_length, .. } => Vec3::new(*half_length, *radius, *radius),
            Self::Triangles(triangles) => {
                let corners = triangles.iter().flatten().map(|corner| Vec3::from_array(*corner).abs());
                corners.reduce(Vec3::max).unwrap_or_default()
            }
        }
    }
}
