//! Seeded camera paths through a scene: walks at eye height.
//!
//! Candidate starts are drawn near objects, with equal probability per object, so that walks begin where the
//! detail is. The one with the best view in the densest surroundings is taken. From there the reachable
//! ground is explored cell by cell, with stairs and doors, and a line through it is walked, looking to the
//! side with most to see. In a scene without floors the walker hovers; one without any room to move in is
//! circled from outside.

use glam::DVec3;
use thiserror::Error;

use super::{
    file::{PathError, PosePath},
    flood::{Body, Flood, Footing},
    gaze::Panorama,
    pose::Pose,
    route::{Pace, line, walk},
    space::Space,
};
use crate::{Node, ReadError, Scene, random::Random};

/// The options of an automatic path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AutoPathOptions {
    /// Equal seeds make equal paths through equal scenes.
    pub seed: u64,
    /// The number of frames; at least 1.
    pub frames: u32,
    /// Whether the second half of the frames is walked in another place.
    pub teleport: bool,
}

impl Default for AutoPathOptions {
    fn default() -> Self {
        Self { seed: 1, frames: 200, teleport: true }
    }
}

/// How the camera moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PathKind {
    /// On floors, at eye height.
    Floors,
    /// Through the air between the objects, level: no floor was found to walk on.
    Hovering,
    /// Around the scene from outside: there was no room to move inside.
    Orbit,
}

/// A camera path and how it was made.
#[derive(Debug, Clone, PartialEq)]
pub struct AutoPath {
    /// The path, with a near plane at half the clearance, so that it cuts nothing open, up to a field of view
    /// of 100 degrees either way.
    pub path: PosePath,
    /// How the camera moves.
    pub kind: PathKind,
    /// Height of the eye above floors, metres. 1.7 m in a scene of 25 m diagonal or more. A smaller one is a
    /// part or a toy: a fifteenth of its diagonal, or four times the diagonal of its median object,
    /// whichever is less.
    pub eye_height: f64,
    /// The least distance between an eye and any surface, metres: 0.15 eye heights.
    pub clearance: f64,
    /// Metres moved in a frame at full speed: 1.4 m/s at 30 frames a second for an eye height of 1.7 m.
    pub step: f64,
}

/// Why no path was made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AutoPathError {
    /// There are no frames.
    #[error("no walk can be made with these options")]
    Options(#[from] PathError),
    /// A part of the scene cannot be read.
    #[error(transparent)]
    Scene(#[from] ReadError),
}

/// The vertical field of view, degrees.
const FIELD_OF_VIEW: f64 = 60.0;
/// The eye height of people, metres.
const HUMAN: f64 = 1.7;
/// Scenes of at least this diagonal are of human scale, metres.
const HUMAN_SCENE: f64 = 25.0;
/// The most leaves whose sizes are measured.
const MOST_MEASURED: u32 = 1 << 16;
/// Candidates for a place to start.
const CANDIDATES: usize = 160;
/// The most cells to explore from a start.
const CELLS: usize = 1500;
/// A start with fewer reachable cells than this is a dead end.
const FEWEST_CELLS: usize = 24;
/// Starts to explore before giving up.
const STARTS: usize = 12;

/// Makes a camera path through a scene. Every scene has one: see [`PathKind`].
///
/// # Errors
/// If there are no frames, or a part of the scene on the way cannot be read.
pub fn auto(scene: &Scene, options: &AutoPathOptions) -> Result<AutoPath, AutoPathError> {
    scene.reading(|| find(scene, options))?
}

fn find(scene: &Scene, options: &AutoPathOptions) -> Result<AutoPath, AutoPathError> {
    let eye_height = natural_eye_height(scene);
    let frames = options.frames as usize;
    let pace = Pace { step: 1.4 / 30.0 * eye_height / HUMAN, turn: 0.07 };
    let space = Space::new(scene);
    for (footing, kind) in [(Footing::Floor, PathKind::Floors), (Footing::Air, PathKind::Hovering)] {
        let body = Body { eye_height, clearance: 0.15 * eye_height, footing };
        let poses = Explorer { space: &space, body, options }.poses(frames, pace);
        if let Some(poses) = poses {
            let path = PosePath::new(FIELD_OF_VIEW, poses)?.with_near(body.clearance / 2.0)?;
            return Ok(AutoPath { path, kind, eye_height, clearance: body.clearance, step: pace.step });
        }
    }
    orbit(scene, options, eye_height)
}

/// The eye height that suits a scene's size.
fn natural_eye_height(scene: &Scene) -> f64 {
    let scene_diagonal = scene.nodes().first().map_or(0.0, diagonal);
    if scene_diagonal >= HUMAN_SCENE || scene_diagonal == 0.0 {
        return HUMAN;
    }
    // In a large scene a sample of the leaves suffices.
    let step = scene.leaf_count().div_ceil(MOST_MEASURED).max(1);
    let leaves = (0..scene.leaf_count()).step_by(step as usize).filter_map(|leaf| scene.leaf(leaf));
    let mut diagonals: Vec<f64> = leaves.map(|(_, leaf)| diagonal(leaf)).filter(|&d| d > 0.0).collect();
    diagonals.sort_by(f64::total_cmp);
    let median = diagonals.get(diagonals.len() / 2).copied().unwrap_or(scene_diagonal);
    (scene_diagonal / 15.0).min(4.0 * median).max(scene_diagonal / 1000.0)
}

fn diagonal(node: &Node) -> f64 {
    let (min, max) = node.world_box();
    min.distance(max)
}

/// Searches for ground to walk on.
struct Explorer<'a> {
    space: &'a Space<'a>,
    body: Body,
    options: &'a AutoPathOptions,
}

impl Explorer<'_> {
    /// The poses of a path; `None` if there is no ground for one.
    fn poses(&self, frames: usize, pace: Pace) -> Option<Vec<Pose>> {
        let mut random = Random::stream(self.options.seed, 11, self.body.footing as u64);
        let starts = self.starts(&mut random);
        let mut starts = starts.into_iter().take(STARTS);
        let first = self.flood(&mut starts)?;
        let second_half = if self.options.teleport { frames / 2 } else { 0 };
        let first_half = frames - second_half;
        let mut walk_in = |flood: &Flood, frames: usize| {
            let length = frames as f64 * pace.step;
            let line = line(self.space, &self.body, flood, length, &mut random);
            let look = |eye, heading, gaze| self.panorama(eye).look(heading, gaze);
            walk(&line, frames, pace, &mut random, look)
        };
        let mut poses = walk_in(&first, first_half);
        if second_half > 0 {
            let away = |start: &DVec3| start.distance(first.eye(0)) > 6.0 * self.body.eye_height;
            let elsewhere = self.flood(&mut starts.filter(away)).unwrap_or_else(|| {
                let far = first.eye(first.farthest());
                Flood::from(self.space, &self.body, far, CELLS)
            });
            poses.extend(walk_in(&elsewhere, second_half));
        }
        Some(poses)
    }

    /// The ground around the first start that is no dead end.
    fn flood(&self, starts: &mut impl Iterator<Item = DVec3>) -> Option<Flood> {
        starts
            .map(|start| Flood::from(self.space, &self.body, start, CELLS))
            .find(|flood| flood.len() >= FEWEST_CELLS)
    }

    /// Points where the walker can stand, the most interesting first.
    fn starts(&self, random: &mut Random) -> Vec<DVec3> {
        let mut starts: Vec<(f64, DVec3)> = (0..CANDIDATES)
            .filter_map(|_| {
                let eye = self.candidate(random)?;
                let free = self.body.passes(self.space, eye, eye);
                free.then(|| self.interest(eye)).flatten().map(|interest| (interest, eye))
            })
            .collect();
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        starts.into_iter().map(|(_, eye)| eye).collect()
    }

    /// An eye above the floor near some object, or anywhere near it for a hovering walker.
    fn candidate(&self, random: &mut Random) -> Option<DVec3> {
        let height = self.body.eye_height;
        let scene = self.space.scene();
        let (_, leaf) = scene.leaf(random.below(scene.leaf_count() as usize) as u32)?;
        let (min, max) = leaf.world_box();
        let (min, max) = (min - height, max + height);
        let fractions = DVec3::new(random.unit(), random.unit(), random.unit());
        let at = min + (max - min) * fractions;
        match self.body.footing {
            Footing::Air => Some(at),
            Footing::Floor => {
                let floor = self.space.ray(at, DVec3::NEG_Y, 4.0 * height)?.distance;
                // From inside a solid the ray finds its underside: stand on the real floor below the eye
                // instead.
                self.body.stand(self.space, at + DVec3::Y * (height - floor))
            }
        }
    }

    /// The interest of a place: the worth of its best view, times the logarithm of the number of objects
    /// near. Inside a closed tank it is low, in a full room high. `None` in the air with next to nothing
    /// near: such a place is better seen from outside.
    fn interest(&self, eye: DVec3) -> Option<f64> {
        let crowd = self.space.crowd(eye, 4.0 * self.body.eye_height, 1000);
        let desert = self.body.footing == Footing::Air && crowd < 4;
        (!desert).then(|| self.panorama(eye).best() * libm::log1p(crowd as f64))
    }

    fn panorama(&self, eye: DVec3) -> Panorama {
        Panorama::around(self.space, eye, self.body.eye_height)
    }
}

/// Circles the scene once, looking at its middle; the teleport is a jump to the other side halfway.
fn orbit(scene: &Scene, options: &AutoPathOptions, eye_height: f64) -> Result<AutoPath, AutoPathError> {
    let (min, max) = scene.nodes().first().map_or((DVec3::ZERO, DVec3::ZERO), Node::world_box);
    let centre = (min + max) / 2.0;
    let radius = (min.distance(max) / 2.0).max(eye_height * 0.1);
    let start = Random::stream(options.seed, 11, 2).between(0.0, std::f64::consts::TAU);
    let frames = options.frames;
    let turn = std::f64::consts::TAU / f64::from(frames.max(1));
    let poses = (0..frames)
        .filter_map(|frame| {
            let jump = options.teleport && frame >= frames.div_ceil(2);
            let opposite = if jump { std::f64::consts::PI } else { 0.0 };
            let (sine, cosine) = libm::sincos(start + opposite + turn * f64::from(frame));
            let outward = DVec3::new(cosine, 0.35, sine).normalize();
            Pose::new(centre + outward * (2.5 * radius), -outward, DVec3::Y).ok()
        })
        .collect();
    let clearance = 1.5 * radius;
    let path = PosePath::new(FIELD_OF_VIEW, poses)?.with_near(clearance / 2.0)?;
    Ok(AutoPath { path, kind: PathKind::Orbit, eye_height, clearance, step: 2.5 * radius * turn })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::testing::{boxes, uncooked};
    use trimaran_cook::Model;
    use trimaran_cook::generate::{PlantOptions, plant};

    /// Asserts the guarantees of every path: its frames, their clearance all along the way, one teleport.
    fn check(scene: &Scene, made: &AutoPath, options: &AutoPathOptions) {
        let frames = made.path.frames();
        assert_eq!(frames.len(), options.frames as usize);
        let space = Space::new(scene);
        let mut jumps = 0;
        for pair in frames.windows(2) {
            let (from, to) = (pair[0].eye(), pair[1].eye());
            if from.distance(to) > made.step * 1.001 + 1e-9 {
                jumps += 1;
                continue;
            }
            let clearance = space.clearance(from, to, made.clearance);
            assert!(clearance >= made.clearance * 0.999, "{clearance} between {from} and {to}");
        }
        assert_eq!(jumps, usize::from(options.teleport));
        assert_eq!(made.path.near(), Some((made.clearance / 2.0) as f32));
    }

    /// A checked path of this kind.
    fn made(scene: &Scene, frames: u32, kind: PathKind) -> AutoPath {
        let options = AutoPathOptions { frames, ..AutoPathOptions::default() };
        let made = auto(scene, &options).unwrap();
        assert_eq!(made.kind, kind);
        check(scene, &made, &options);
        made
    }

    fn small_plant() -> Scene {
        uncooked(&plant(&PlantOptions { seed: 5, objects: 1_500, triangles: 120_000 }))
    }

    #[test]
    fn a_plant_is_walked_on_its_floors() {
        let scene = small_plant();
        for seed in 0..4 {
            let options = AutoPathOptions { seed, frames: 300, ..AutoPathOptions::default() };
            let made = auto(&scene, &options).unwrap();
            assert_eq!((made.kind, made.eye_height), (PathKind::Floors, 1.7));
            check(&scene, &made, &options);
            let frames = made.path.frames();
            let walked: f64 = frames.windows(2).map(|p| p[0].eye().distance(p[1].eye()).min(made.step)).sum();
            assert!(walked > 6.0, "seed {seed} walks {walked} m");
            let turned: f64 = frames.windows(2).map(|p| p[0].forward().angle_between(p[1].forward())).sum();
            assert!(turned > 2.0, "seed {seed} turns {turned} rad");
        }
    }

    #[test]
    fn a_seed_is_a_path() {
        let scene = small_plant();
        let options = AutoPathOptions { frames: 60, ..AutoPathOptions::default() };
        let first = auto(&scene, &options).unwrap();
        assert_eq!(first, auto(&scene, &options).unwrap());
        assert_ne!(first, auto(&scene, &AutoPathOptions { seed: 2, ..options }).unwrap());
    }

    #[test]
    fn a_toy_is_walked_at_its_own_scale() {
        let mut model = plant(&PlantOptions { seed: 5, objects: 1_000, triangles: 90_000 });
        let shrink = glam::DAffine3::from_scale(DVec3::splat(0.02));
        model.objects.iter_mut().for_each(|object| object.to_world = shrink * object.to_world);
        let scene = uncooked(&model);
        let made = made(&scene, 80, PathKind::Floors);
        assert!((0.005..0.08).contains(&made.eye_height), "{}", made.eye_height);
    }

    #[test]
    fn bars_in_the_air_are_hovered_through() {
        let bars: Vec<_> = (0..400)
            .map(|i| [f64::from(i % 10), f64::from(i / 100), f64::from(i / 10 % 10)].map(|c| c * 5.0))
            .map(|at| (at, [at[0] + 3.0, at[1] + 0.05, at[2] + 0.05]))
            .collect();
        let scene = uncooked(&boxes(&bars));
        made(&scene, 100, PathKind::Hovering);
    }

    #[test]
    fn a_single_triangle_is_circled() {
        let mut model: Model = boxes(&[([0.0; 3], [1.0; 3])]);
        let mesh = &mut model.meshes[0];
        mesh.positions.truncate(3);
        mesh.colours.truncate(3);
        mesh.indices = vec![0, 1, 2];
        let scene = uncooked(&model);
        for frames in [1, 2, 7] {
            let options = AutoPathOptions { frames, teleport: frames > 1, ..AutoPathOptions::default() };
            let made = auto(&scene, &options).unwrap();
            assert_eq!(made.kind, PathKind::Orbit);
            assert_eq!(made.path.frames().len(), frames as usize);
        }
    }

    #[test]
    fn a_stack_of_sheets_is_walked_on_top() {
        // So close that no eye fits between them.
        let sheets: Vec<_> =
            (0..40).map(|i| f64::from(i) * 0.2).map(|y| ([0.0, y, 0.0], [120.0, y + 0.1, 120.0])).collect();
        let scene = uncooked(&boxes(&sheets));
        for frame in made(&scene, 40, PathKind::Floors).path.frames() {
            assert!((frame.eye().y - 9.6).abs() < 1e-6, "{}", frame.eye());
        }
    }

    #[test]
    fn an_orbit_keeps_away_and_jumps_once() {
        let scene = uncooked(&boxes(&[([1e7, 0.0, 0.0], [1e7 + 1.0, 1.0, 1.0])]));
        let options = AutoPathOptions { frames: 21, ..AutoPathOptions::default() };
        let made = orbit(&scene, &options, 1.0).unwrap();
        assert_eq!(made.kind, PathKind::Orbit);
        check(&scene, &made, &options);
        let centre = DVec3::new(1e7 + 0.5, 0.5, 0.5);
        for frame in made.path.frames() {
            assert!((centre - frame.eye()).normalize().dot(frame.forward()) > 0.999_999);
        }
    }

    #[test]
    fn a_path_without_frames_is_refused() {
        let scene = uncooked(&boxes(&[([0.0; 3], [1.0; 3])]));
        let refused = auto(&scene, &AutoPathOptions { frames: 0, ..AutoPathOptions::default() });
        assert!(matches!(refused, Err(AutoPathError::Options(PathError::NoFrames))), "{refused:?}");
    }
}
