//! The shortest distance between two objects, and between two sets of them.

use trimaran_proto::ObjectSet;

use super::{
    Clearance, ClearanceError, Clearances,
    boxes::{Boxes, Cuboid, sort_far_first},
    pieces::Near,
};
use crate::{GeometryReader, Level, Node, Scene};

/// Steps of a search between two checks whether it is stopped: some microseconds each.
const BETWEEN_LOOKS: u32 = 256;

/// An object with triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Located {
    pub(super) number: u32,
    /// Its node.
    node: u32,
    pub(super) bounds: Cuboid,
    /// The error of its rounded coordinates, metres.
    pub(super) rounding: f64,
}

/// The objects of a set, in a tree of their boxes.
#[derive(Debug)]
pub(super) struct Placed {
    objects: Vec<Located>,
    pub(super) boxes: Boxes,
    /// The largest rounding of any.
    pub(super) rounding: f64,
}

impl Placed {
    /// Numbers that the scene lacks are left out.
    pub(super) fn of(scene: &Scene, set: &ObjectSet) -> Self {
        let count = scene.objects().len() as u32;
        let numbers = set.runs().iter().flat_map(|run| run.start..run.end.min(count));
        let objects: Vec<Located> = numbers.filter_map(|number| Located::new(scene, number)).collect();
        let bounds: Vec<Cuboid> = objects.iter().map(|object| object.bounds).collect();
        let rounding = objects.iter().fold(0.0, |most: f64, object| most.max(object.rounding));
        Self { objects, boxes: Boxes::new(&bounds), rounding }
    }

    /// An object by its place in the set.
    pub(super) fn get(&self, item: u32) -> Option<&Located> {
        self.objects.get(item as usize)
    }
}

impl Located {
    fn new(scene: &Scene, number: u32) -> Option<Self> {
        let node = scene.objects().get(number as usize)?.node;
        let of = scene.nodes().get(node as usize)?;
        // A coordinate and the matrix are each off by half a unit in the last place of an f32.
        let rounding = f64::from(of.own_reach()) * f64::from(f32::EPSILON);
        Some(Self { number, node, bounds: Cuboid::of(of), rounding })
    }
}

impl Cuboid {
    fn of(node: &Node) -> Self {
        let (min, max) = node.world_box();
        Self { min, max }
    }
}

impl Clearances<'_> {
    /// The shortest distance from an object of one set to an object of the other one; an object has none to
    /// itself. `None` if there are no two such objects with triangles.
    ///
    /// # Errors
    /// If a part of the scene cannot be read, or soon after `is_stopped` says so.
    pub fn shortest(
        &self,
        first: &ObjectSet,
        second: &ObjectSet,
        is_stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Clearance>, ClearanceError> {
        self.scene.reading(|| self.find_shortest(first, second, is_stopped))?
    }

    fn find_shortest(
        &self,
        first: &ObjectSet,
        second: &ObjectSet,
        is_stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Clearance>, ClearanceError> {
        let (mut here, there) = (Placed::of(self.scene, first).objects, Placed::of(self.scene, second));
        let Some(all) = there.boxes.bounds() else { return Ok(None) };
        let mut search = Search::new(self, is_stopped);
        let (mut shortest, mut limit) = (None, f64::INFINITY);
        here.sort_by(|a, b| a.bounds.square(&all).total_cmp(&b.bounds.square(&all)));
        for object in here {
            there.boxes.visit_near(&object.bounds, limit, |item| {
                let other = there.get(item).filter(|other| other.number != object.number);
                let found = other.map(|other| search.between([&object, other], limit)).transpose()?;
                if let Some(found) = found.flatten() {
                    limit = found.distance.powi(2);
                    shortest = Some(found);
                }
                Ok::<f64, ClearanceError>(limit)
            })?;
        }
        Ok(shortest)
    }
}

/// A search on one thread.
pub(super) struct Search<'c> {
    of: &'c Clearances<'c>,
    reader: GeometryReader<'c>,
    is_stopped: &'c dyn Fn() -> bool,
    steps: u32,
}

impl<'c> Search<'c> {
    pub(super) fn new(of: &'c Clearances<'_>, is_stopped: &'c dyn Fn() -> bool) -> Self {
        Self { of, reader: of.scene.reader(), is_stopped, steps: 0 }
    }

    /// The clearance of two objects, if the square of their distance is below a limit.
    pub(super) fn between(
        &mut self,
        objects: [&Located; 2],
        below: f64,
    ) -> Result<Option<Clearance>, ClearanceError> {
        let nodes = self.of.scene.nodes();
        let mut near = Near::below(below);
        let pair = |[here, there]: [u32; 2]| Some([nodes.get(here as usize)?, nodes.get(there as usize)?]);
        let away = |ids: [u32; 2]| {
            let [a, b] = pair(ids)?.map(Cuboid::of);
            Some((a.square(&b), ids))
        };
        let mut open: Vec<(f64, [u32; 2])> = away(objects.map(|object| object.node)).into_iter().collect();
        while let Some((square, [here, there])) = open.pop() {
            let Some([a, b]) = pair([here, there]).filter(|_| square < near.square) else { continue };
            step(&mut self.steps, self.is_stopped)?;
            let begin = open.len();
            let is_larger = Cuboid::of(a).diagonal() >= Cuboid::of(b).diagonal();
            if a.is_leaf() && b.is_leaf() {
                self.between_leaves([a, b], &mut near)?;
            } else if b.is_leaf() || (is_larger && !a.is_leaf()) {
                open.extend(a.children().filter_map(|child| away([child, there])));
            } else {
                open.extend(b.children().filter_map(|child| away([here, child])));
            }
            sort_far_first(open.get_mut(begin..).unwrap_or_default());
        }
        Ok(near.points.map(|points| Clearance {
            objects: objects.map(|object| object.number),
            distance: near.square.sqrt(),
            points,
            rounding: objects.map(|object| object.rounding).into_iter().sum(),
        }))
    }

    fn between_leaves(&mut self, leaves: [&Node; 2], near: &mut Near) -> Result<(), ClearanceError> {
        let scene = self.of.scene;
        let pieces = leaves.map(|leaf| {
            let finest = scene.levels(leaf).next().into_iter().flat_map(Level::pieces);
            finest.filter_map(|id| Some((id, Cuboid::of(&scene.part(id)?.1)))).collect::<Vec<_>>()
        });
        let [here, there] = &pieces;
        let mut pairs: Vec<_> = here
            .iter()
            .flat_map(|(a, of_a)| there.iter().map(move |(b, of_b)| (of_a.square(of_b), [*a, *b])))
            .filter(|(square, _)| *square < near.square)
            .collect();
        pairs.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        for (square, [a, b]) in pairs {
            if square >= near.square {
                break;
            }
            let mut get = |id| self.of.pieces.get(scene, &mut self.reader, id);
            if let (Some(a), Some(b)) = (get(a)?, get(b)?) {
                a.approach(&b, near, || step(&mut self.steps, self.is_stopped))?;
            }
        }
        Ok(())
    }
}

/// Counts a step, and checks now and then whether the search is stopped.
fn step(steps: &mut u32, is_stopped: &dyn Fn() -> bool) -> Result<(), ClearanceError> {
    *steps += 1;
    if *steps < BETWEEN_LOOKS {
        return Ok(());
    }
    *steps = 0;
    if is_stopped() { Err(ClearanceError::Stopped) } else { Ok(()) }
}
