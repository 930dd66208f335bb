//! A walker's reachable ground: cells of a lattice, each linked to the one from which it was first reached.

use std::collections::{HashMap, VecDeque};

use glam::DVec3;

use super::space::Space;

/// The walker's measures, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Body {
    /// Height of the eye above the floor.
    pub(super) eye_height: f64,
    /// The least distance between the eye and any surface.
    pub(super) clearance: f64,
    /// Whether it needs a floor, or hovers at its starting height.
    pub(super) footing: Footing,
}

/// The walker's support.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Footing {
    Floor,
    Air,
}

impl Body {
    /// The lattice spacing.
    pub(super) fn stride(&self) -> f64 {
        self.eye_height / 4.0
    }

    /// The largest rise or fall of the floor over one stride: a slope of 43 degrees, steeper than stairs.
    fn rise(&self) -> f64 {
        self.stride() * 0.95
    }

    /// The eye above or below `at`, at its height over the floor there; `None` without a floor within one
    /// rise.
    pub(super) fn stand(&self, space: &Space<'_>, at: DVec3) -> Option<DVec3> {
        match self.footing {
            Footing::Air => Some(at),
            Footing::Floor => {
                let floor = space.ray(at, DVec3::NEG_Y, self.eye_height + self.rise())?.distance;
                (floor >= self.eye_height - self.rise()).then(|| at + DVec3::Y * (self.eye_height - floor))
            }
        }
    }

    /// Whether the walker can move its eye straight between two points: nothing is within the clearance of
    /// the eye's path, nor within smaller ones of the waist's and the shins'. A hovering walker has only its
    /// eye.
    pub(super) fn passes(&self, space: &Space<'_>, from: DVec3, to: DVec3) -> bool {
        let free = |down: f64, clearance: f64| {
            let down = DVec3::Y * (down * self.eye_height);
            space.clearance(from - down, to - down, clearance) >= clearance
        };
        free(0.0, self.clearance)
            && (self.footing == Footing::Air
                || free(0.4, self.clearance * 0.8) && free(0.7, self.clearance * 0.5))
    }

    /// Whether there is floor to walk on all along a straight path.
    pub(super) fn carried(&self, space: &Space<'_>, from: DVec3, to: DVec3) -> bool {
        let steps = (from.distance(to) / self.stride()).ceil();
        (1..steps as u32).all(|step| {
            let at = from.lerp(to, f64::from(step) / steps);
            self.stand(space, at).is_some_and(|stood| (stood.y - at.y).abs() <= self.rise() / 2.0)
        })
    }
}

/// The ground reachable from one point.
#[derive(Debug)]
pub(super) struct Flood {
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    eye: DVec3,
    /// The cell it was reached from; itself for the first.
    parent: usize,
    /// Strides from the first cell.
    depth: u32,
}

impl Flood {
    /// Explores from `start`, a standing eye, until nothing new is reachable or `most` cells are known.
    pub(super) fn from(space: &Space<'_>, body: &Body, start: DVec3, most: usize) -> Self {
        let mut flood = Self { cells: vec![Cell { eye: start, parent: 0, depth: 0 }] };
        let mut known: HashMap<(i32, i32), Vec<usize>> = HashMap::from([((0, 0), vec![0])]);
        let mut queue = VecDeque::from([(0, (0, 0))]);
        while let Some((parent, (x, z))) = queue.pop_front() {
            let Cell { eye, depth, .. } = flood.cells[parent];
            for (dx, dz) in [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)] {
                if flood.cells.len() >= most {
                    return flood;
                }
                let place = (x + dx, z + dz);
                let here = known.entry(place).or_default();
                // Stairs pass over cells of the storey below: same place, another height.
                if here.iter().any(|&c| (flood.cells[c].eye.y - eye.y).abs() < body.eye_height / 2.0) {
                    continue;
                }
                let lattice = DVec3::new(f64::from(place.0), 0.0, f64::from(place.1)) * body.stride();
                let at = DVec3::new(start.x + lattice.x, eye.y, start.z + lattice.z);
                if let Some(stood) = body.stand(space, at).filter(|&to| body.passes(space, eye, to)) {
                    here.push(flood.cells.len());
                    queue.push_back((flood.cells.len(), place));
                    flood.cells.push(Cell { eye: stood, parent, depth: depth + 1 });
                }
            }
        }
        flood
    }

    /// The number of cells.
    pub(super) const fn len(&self) -> usize {
        self.cells.len()
    }

    /// The eye in a cell.
    pub(super) fn eye(&self, cell: usize) -> DVec3 {
        self.cells[cell].eye
    }

    /// The cell with the most strides from the first one.
    pub(super) fn farthest(&self) -> usize {
        (0..self.cells.len()).max_by_key(|&cell| self.cells[cell].depth).unwrap_or(0)
    }

    /// The eyes along the path from one cell to another, through the cell from which both were reached.
    pub(super) fn path(&self, from: usize, to: usize) -> Vec<DVec3> {
        let (mut up, mut down) = (vec![from], vec![to]);
        let (mut a, mut b) = (from, to);
        while a != b {
            if self.cells[a].depth >= self.cells[b].depth {
                a = self.cells[a].parent;
                up.push(a);
            } else {
                b = self.cells[b].parent;
                down.push(b);
            }
        }
        down.pop();
        up.into_iter().chain(down.into_iter().rev()).map(|cell| self.cells[cell].eye).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::testing::{boxes, uncooked};
    use trimaran_cook::generate::{PlantOptions, plant};

    const WALKER: Body = Body { eye_height: 1.7, clearance: 0.25, footing: Footing::Floor };

    #[test]
    fn every_room_of_a_plant_is_reached_through_doors_and_stairs() {
        let model = plant(&PlantOptions { seed: 2, objects: 4_000, triangles: 300_000 });
        let scene = uncooked(&model);
        let flood = Flood::from(&Space::new(&scene), &WALKER, DVec3::new(4.0, 1.7, 4.0), 20_000);
        let columns: Vec<DVec3> =
            model.objects.iter().filter(|o| o.name == "column").map(|o| o.to_world.translation).collect();
        assert!(columns.iter().any(|c| c.y > 4.0), "it has two storeys");
        for corner in columns {
            let middle = corner + DVec3::new(4.0, WALKER.eye_height, 4.0);
            let reached = (0..flood.len()).any(|cell| flood.eye(cell).distance(middle) < 1.0);
            assert!(reached, "the room at {corner} is not reached");
        }
    }

    #[test]
    fn a_wall_with_a_gap_too_narrow_holds() {
        let with_gap = |gap: f64| {
            let walls = [
                ([-9.0, -0.1, -9.0], [9.0, 0.0, 9.0]),
                ([0.0, 0.0, -9.0], [0.1, 3.0, -gap / 2.0]),
                ([0.0, 0.0, gap / 2.0], [0.1, 3.0, 9.0]),
            ];
            let scene = uncooked(&boxes(&walls));
            let flood = Flood::from(&Space::new(&scene), &WALKER, DVec3::new(-2.0, 1.7, 0.0), 20_000);
            (0..flood.len()).any(|cell| flood.eye(cell).x > 1.0)
        };
        assert!(!with_gap(0.45) && with_gap(0.9));
    }

    #[test]
    fn a_way_goes_through_neighbouring_cells() {
        let scene = uncooked(&boxes(&[([-3.0, -0.1, -3.0], [3.0, 0.0, 3.0])]));
        let flood = Flood::from(&Space::new(&scene), &WALKER, DVec3::new(0.0, 1.7, 0.0), 500);
        let way = flood.path(flood.farthest(), flood.len() - 1);
        assert_eq!((way[0], way[way.len() - 1]), (flood.eye(flood.farthest()), flood.eye(flood.len() - 1)));
        assert!(way.windows(2).all(|p| p[0].distance(p[1]) < WALKER.stride() * 1.5));
        assert!(
            (0..flood.len()).all(|cell| flood.eye(cell).abs().max_element() < 3.2),
            "nobody walks off the edge"
        );
    }
}
