//! Where to begin in a scene, and how large most of it is: found once, when it is cooked, because the search
//! reads much of it.

use glam::DVec3;

use crate::path::{AutoPathError, AutoPathOptions, PathKind, auto};
use crate::{Bounds, Node, Overview, ReadError, Scene};

/// The share of objects at each end of an axis that may be outliers.
const FEW: f64 = 0.02;
/// The most boxes that stand for the shape of a scene.
const MOST_BOXES: usize = 512;
/// An object is far this many times the longest side of all the others beyond their end.
const FAR: f64 = 1.0;

impl Overview {
    /// Finds it.
    ///
    /// # Errors
    /// If a part of the scene cannot be read, or lengths in it overflow.
    pub(crate) fn find(scene: &Scene) -> Result<Self, AutoPathError> {
        let options = AutoPathOptions { frames: 1, teleport: false, ..AutoPathOptions::default() };
        let found = auto(scene, &options)?;
        let pose = found.path.frames().first();
        Ok(Self {
            core: scene.reading(|| Bounds::of_most(scene, 0..scene.objects().len() as u32))?,
            eye: pose.map_or([0.0; 3], |pose| pose.eye().to_array()),
            forward: pose.map_or([0.0, 0.0, -1.0], |pose| pose.forward().to_array()),
            has_floors: found.kind == PathKind::Floors,
            eye_height: found.eye_height,
            clearance: found.clearance,
            vfov_deg: found.path.vfov_deg(),
        })
    }
}

impl Bounds {
    /// The box around some objects, without the few that lie far from the others. Without objects it is a
    /// point. Objects that cannot be read are left out, which [`Scene::reading`] tells.
    #[must_use]
    pub fn of_most(scene: &Scene, objects: impl IntoIterator<Item = u32>) -> Self {
        let all: Vec<_> = boxes(scene, objects).collect();
        let few = (FEW * all.len() as f64) as usize;
        // The quantile of numbers that has this few below it.
        let nth = |mut numbers: Vec<f64>| {
            let few = few.min(numbers.len().saturating_sub(1));
            if numbers.is_empty() { 0.0 } else { *numbers.select_nth_unstable_by(few, f64::total_cmp).1 }
        };
        let low = [0, 1, 2].map(|axis| nth(all.iter().map(|(min, _)| min[axis]).collect()));
        let high = [0, 1, 2].map(|axis| -nth(all.iter().map(|(_, max)| -max[axis]).collect()));
        let (low, high) = (DVec3::from_array(low), DVec3::from_array(high));
        // By the longest side, so that a tower on a deck does not count as far.
        let far = DVec3::splat(FAR * (high - low).max_element().max(0.0));
        let is_near = |(min, max): &(DVec3, DVec3)| min.cmpge(low - far).all() && max.cmple(high + far).all();
        let near = around(all.iter().copied().filter(is_near)).or_else(|| around(all.iter().copied()));
        let (min, max) = near.unwrap_or_default();
        Self { min: min.to_array(), max: max.to_array() }
    }
}

fn boxes(scene: &Scene, objects: impl IntoIterator<Item = u32>) -> impl Iterator<Item = (DVec3, DVec3)> {
    let node = move |id: u32| scene.nodes().get(scene.objects().get(id as usize)?.node as usize);
    objects.into_iter().filter_map(move |id| Some(node(id)?.world_box()))
}

/// Boxes that together hold the whole scene: those of the tree's largest nodes are opened first.
fn upper_boxes(scene: &Scene) -> Vec<(DVec3, DVec3)> {
    let size = |node: &Node| {
        let (min, max) = node.world_box();
        (max - min).length_squared()
    };
    let mut open: Vec<Node> = scene.nodes().first().copied().into_iter().collect();
    let mut closed = Vec::new();
    while open.len() + closed.len() < MOST_BOXES {
        let largest = (0..open.len()).max_by(|&a, &b| size(&open[a]).total_cmp(&size(&open[b])));
        let Some(node) = largest.map(|at| open.swap_remove(at)) else { break };
        if node.is_leaf() {
            closed.push(node);
        }
        open.extend(node.children().filter_map(|id| scene.nodes().get(id as usize).copied()));
    }
    open.iter().chain(&closed).map(Node::world_box).collect()
}

/// Directions all round: to the points of a grid on the faces of a cube.
fn directions() -> impl Iterator<Item = DVec3> {
    let axis = || (-2..=2).map(f64::from);
    let grid = axis().flat_map(move |x| axis().flat_map(move |y| axis().map(move |z| DVec3::new(x, y, z))));
    grid.filter(|direction| direction.abs().max_element() == 2.0)
}

fn around(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> Option<(DVec3, DVec3)> {
    boxes.reduce(|(a, b), (min, max)| (a.min(min), b.max(max)))
}

impl Scene {
    /// Points that stick out farthest, in many directions, from what lies within `core`: a view that shows
    /// them shows all of it, and is closer than one that shows the corners of `core`. They are corners of the
    /// upper nodes' boxes, so nothing else is read.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub fn outermost_points(&self, core: &Bounds) -> Result<Vec<[f64; 3]>, ReadError> {
        let [lowest, highest] = [core.min, core.max].map(DVec3::from_array);
        let boxes = self.reading(|| upper_boxes(self))?;
        let within = boxes.iter().map(|(min, max)| (min.max(lowest), max.min(highest)));
        let within: Vec<_> = within.filter(|(min, max)| min.cmple(*max).all()).collect();
        let mut points: Vec<[f64; 3]> = Vec::new();
        for direction in directions() {
            let corner =
                |(min, max): &(DVec3, DVec3)| DVec3::select(direction.cmplt(DVec3::ZERO), *min, *max);
            let reach = |corner: &DVec3| direction.dot(*corner);
            let farthest = within.iter().map(corner).max_by(|a, b| reach(a).total_cmp(&reach(b)));
            points.extend(farthest.map(|corner| corner.to_array()).filter(|point| !points.contains(point)));
        }
        Ok(points)
    }

    /// Where to begin in the scene. One that was cooked has it in its file; in others it is searched for,
    /// which takes a moment in a large one.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub fn overview(&self) -> Result<Overview, AutoPathError> {
        match self.stored_overview()? {
            Some(stored) => Ok(stored),
            None => Overview::find(self),
        }
    }

    /// The same scene with an [overview](Self::overview) in its file, so that opening it searches for none.
    /// It stays as it is if it has one, is a file already, or is so large that none is found.
    #[must_use]
    pub fn with_overview(mut self) -> Self {
        if let Some(overview) = Overview::find(&self).ok().and_then(Overview::sound) {
            self.add_overview(&overview);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::testing::{boxes, uncooked};

    fn cube(half: f64, [x, y, z]: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        ([x - half, y - half, z - half], [x + half, y + half, z + half])
    }

    fn is_about(a: [f64; 3], b: [f64; 3]) -> bool {
        DVec3::from_array(a).distance(DVec3::from_array(b)) < 0.1
    }

    #[test]
    fn a_few_objects_far_away_do_not_count_and_a_tower_does() {
        let crowd = |place: u32| cube(0.5, [f64::from(place % 10), 0.0, f64::from(place / 10)]);
        let mut objects: Vec<_> = (0..100).map(crowd).collect();
        objects.push(cube(0.5, [4.0, 9.0, 4.0]));
        let compact = uncooked(&boxes(&objects));
        let Bounds { min, max } = Bounds::of_most(&compact, 0..101);
        assert!(is_about(min, [-0.5; 3]) && is_about(max, [9.5, 9.5, 9.5]), "{min:?} {max:?}");
        objects.push(cube(0.5, [4000.0, 0.0, 0.0]));
        // A ground much larger than everything on it.
        objects.push(([-900.0, -1.0, -900.0], [900.0, -0.6, 900.0]));
        let scattered = uncooked(&boxes(&objects));
        let Bounds { min, max } = Bounds::of_most(&scattered, 0..103);
        assert!(is_about(min, [-0.5; 3]) && is_about(max, [9.5, 9.5, 9.5]), "{min:?} {max:?}");
        // Among few objects none counts as far.
        let Bounds { max, .. } = Bounds::of_most(&scattered, 99..102);
        assert!(is_about(max, [4000.5, 9.5, 9.5]), "{max:?}");
        assert_eq!(Bounds::of_most(&scattered, 7..7), Bounds { min: [0.0; 3], max: [0.0; 3] });
    }

    #[test]
    fn the_outermost_points_of_a_cross_are_the_ends_of_its_arms() {
        // Its box is as large as that of a cube, whose corners it does not reach.
        let arm = |x: i32| cube(0.5, [f64::from(x), 0.0, 0.0]);
        let across = |z: i32| cube(0.5, [0.0, 0.0, f64::from(z)]);
        let mut objects: Vec<_> = (-20..=20).flat_map(|at| [arm(at), across(at)]).collect();
        objects.push(cube(0.5, [0.0, 9000.0, 0.0]));
        let scene = uncooked(&boxes(&objects));
        let core = Bounds::of_most(&scene, 0..83);
        let points = scene.outermost_points(&core).unwrap();
        assert!((8..=98).contains(&points.len()), "{points:?}");
        for point in &points {
            let [x, y, z] = point.map(f64::abs);
            assert!(y <= 0.51 && x <= 20.51 && z <= 20.51 && x.min(z) <= 0.51, "{point:?}");
        }
        let reaches = |axis: usize, end: f64| points.iter().any(|point| (point[axis] - end).abs() < 0.01);
        assert!([0, 2].iter().all(|axis| reaches(*axis, 20.5) && reaches(*axis, -20.5)), "{points:?}");
        // All of a scene of one box are its corners, and a model without any has none.
        let one = uncooked(&boxes(&objects[..1]));
        let core = Bounds::of_most(&one, 0..1);
        assert_eq!(one.outermost_points(&core).unwrap().len(), 8);
        let elsewhere = Bounds { min: [1e6; 3], max: [2e6; 3] };
        assert!(one.outermost_points(&elsewhere).unwrap().is_empty());
    }

    #[test]
    fn an_overview_in_the_file_is_the_one_found_and_nothing_else_is_read_for_it() {
        let model = boxes(&(0..400).map(|i| cube(0.3, [f64::from(i), 0.0, 0.0])).collect::<Vec<_>>());
        let found = uncooked(&model).overview().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.scene");
        let scene = uncooked(&model).with_overview();
        assert_eq!(scene.overview().unwrap(), found);
        scene.save(&path).unwrap();
        let opened = Scene::open(&path).unwrap();
        let before = opened.resident_bytes();
        assert_eq!((opened.overview().unwrap(), opened.resident_bytes()), (found, before));
        assert_eq!(opened.hash(), scene.hash());
        opened.check().unwrap();
        // A second one is not added.
        let again = uncooked(&model).with_overview().with_overview();
        assert_eq!(again.hash(), scene.hash());
    }
}
