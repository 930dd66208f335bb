//! A process plant: storeys of rooms in a grid, joined by doors and stairs.

use glam::DVec3;

use trimaran_scene::random::Random;

use super::{
    assembly::{Grain, Module, assemble, object_count},
    equipment::Tags,
    room::{self, AISLE, DOOR, SIDE, STOREY, Seeds, Surroundings, Wall},
};
use crate::Model;

/// The size and seed of a plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlantOptions {
    /// Equal seeds make equal plants.
    pub seed: u64,
    /// Wanted objects. Met exactly with one object per part (see `triangles`), to the last room otherwise;
    /// never fewer than one room has, about 250.
    pub objects: usize,
    /// Wanted triangles in total, instances counted each time. Met within a few percent by the fineness of
    /// round parts, down to eight sides. Up to 2,000 per object on average, each part is an object of its
    /// own; above that, an object is everything of one trade in a room, as in models exported by discipline.
    pub triangles: usize,
}

impl PlantOptions {
    /// A plant for tests and the demo: 4 thousand objects, 0.4 million triangles.
    #[must_use]
    pub const fn small(seed: u64) -> Self {
        Self { seed, objects: 4_000, triangles: 400_000 }
    }

    /// As large as the paper's power plant (section 5): 13 million triangles in 1,200 objects.
    #[must_use]
    pub const fn paper(seed: u64) -> Self {
        Self { seed, objects: 1_200, triangles: 13_000_000 }
    }
}

/// With more triangles per object than this on average, objects are merged by trade.
const FINEST_MEAN: usize = 2_000;
/// Different rooms of a merged plant; the others repeat them.
const MERGED_KINDS: usize = 16;
/// Small parts in each room of a merged plant.
const MERGED_SMALL_PARTS: usize = 60;
/// Share of a plant's objects, in percent, that is left to small parts.
const SMALL_PARTS_PERCENT: usize = 20;

/// Makes a plant. Its names are of the kind "P-101 gate valve"; its one source is called "plant".
#[must_use]
pub fn plant(options: &PlantOptions) -> Model {
    let grain =
        if options.triangles / options.objects.max(1) > FINEST_MEAN { Grain::Trade } else { Grain::Part };
    let modules = match grain {
        Grain::Part => fine_modules(options),
        Grain::Trade => merged_modules(options),
    };
    assemble(&modules, grain, options.triangles, "plant")
}

fn fine_modules(options: &PlantOptions) -> Vec<Module> {
    let wanted = options.objects * (100 - SMALL_PARTS_PERCENT) / 100;
    let build = |rooms| rooms_of(&Grid::of(rooms), options.seed, |index| index);
    let modules = fill_up_to(wanted, Grain::Part, build);
    with_small_parts(modules, options.objects, options.seed)
}

fn merged_modules(options: &PlantOptions) -> Vec<Module> {
    fill_up_to(options.objects, Grain::Trade, |rooms| {
        let mut modules = rooms_of(&Grid::of(rooms), options.seed, |index| index % MERGED_KINDS);
        for (index, module) in modules.iter_mut().enumerate() {
            let mut random = Random::stream(options.seed, 3, (index % MERGED_KINDS) as u64);
            (0..MERGED_SMALL_PARTS).for_each(|part| room::add_small_part(module, &mut random, part));
        }
        modules
    })
}

/// Builds as many rooms as fit into this many objects; at least one.
pub(super) fn fill_up_to(objects: usize, grain: Grain, build: impl Fn(usize) -> Vec<Module>) -> Vec<Module> {
    const SAMPLE: usize = 24;
    let mut rooms = (objects * SAMPLE / object_count(&build(SAMPLE), grain).max(1)).max(1);
    loop {
        let modules = build(rooms);
        let got = object_count(&modules, grain);
        if got <= objects || rooms == 1 {
            return modules;
        }
        rooms = (rooms * objects / got).clamp(1, rooms - 1);
    }
}

/// Adds small parts to the rooms in turn until there are `objects` parts.
pub(super) fn with_small_parts(mut modules: Vec<Module>, objects: usize, seed: u64) -> Vec<Module> {
    let missing = objects.saturating_sub(object_count(&modules, Grain::Part));
    let rooms = modules.len();
    for (index, module) in modules.iter_mut().enumerate() {
        let mut random = Random::stream(seed, 3, index as u64);
        let share = missing / rooms + usize::from(index < missing % rooms);
        (0..share).for_each(|part| room::add_small_part(module, &mut random, part));
    }
    modules
}

/// The layout of rooms: storey by storey, row by row along x. The last storey may be incomplete.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    rooms: usize,
    columns: usize,
    rows: usize,
}

/// A room's place in the grid: column (x), storey (y), row (z).
type Cell = [usize; 3];

impl Grid {
    /// About half as many storeys as rooms side by side.
    fn of(rooms: usize) -> Self {
        let storeys = ((rooms as f64 / 4.0).cbrt().round() as usize).clamp(1, 12);
        let storey = rooms.div_ceil(storeys);
        let columns = storey.isqrt().max(1);
        Self { rooms, columns, rows: storey.div_ceil(columns) }
    }

    /// This many rooms in `rows` rows and `storeys` storeys.
    pub(super) const fn stack(rooms: usize, rows: usize, storeys: usize) -> Self {
        Self { rooms, columns: rooms.div_ceil(rows * storeys), rows }
    }

    /// Rooms along x.
    pub(super) const fn columns(&self) -> usize {
        self.columns
    }

    fn cell(&self, index: usize) -> Cell {
        let storey = self.columns * self.rows;
        [index % self.columns, index / storey, index % storey / self.columns]
    }

    fn has(&self, [column, storey, row]: Cell) -> bool {
        column < self.columns
            && row < self.rows
            && (storey * self.rows + row) * self.columns + column < self.rooms
    }

    /// Whether stairs lead from this cell to the one above: at the end of every fourth row.
    fn has_stairs(&self, [column, storey, row]: Cell) -> bool {
        column == 0 && row.is_multiple_of(4) && self.has([column, storey + 1, row])
    }

    fn surroundings(&self, seed: u64, cell: Cell) -> Surroundings {
        let [column, storey, row] = cell;
        let mut random = Random::stream(seed, 2, cell.iter().fold(0, |key, &c| key << 20 | c as u64));
        // Doors are at one end of the aisle or the other, so that sight lines through many rooms are rare.
        let ends = [AISLE[0] + 0.05, AISLE[1] - DOOR[0] - 0.05];
        let [door_x, door_z] = [random.pick(ends), random.pick(ends)];
        // Along x every wall has its door, and along z those of the first column: so every room can be
        // reached.
        let west = if column == 0 { Wall::Blind } else { Wall::Door(door_x) };
        let north = match (row, column) {
            (0, 0) if storey == 0 => Wall::Door(door_z),
            (0, _) => Wall::Blind,
            (_, 0) => Wall::Door(door_z),
            _ if random.chance(0.5) => Wall::Door(door_z),
            _ => Wall::Blind,
        };
        let closing = |neighbour| if self.has(neighbour) { Wall::None } else { Wall::Blind };
        Surroundings {
            walls: [west, north, closing([column + 1, storey, row]), closing([column, storey, row + 1])],
            stairs_up: self.has_stairs(cell),
            stairs_below: storey.checked_sub(1).is_some_and(|below| self.has_stairs([column, below, row])),
            roof: !self.has([column, storey + 1, row]),
        }
    }
}

/// Builds the rooms of a grid; rooms of equal `kind` have equal content.
pub(super) fn rooms_of(grid: &Grid, seed: u64, kind: impl Fn(usize) -> usize) -> Vec<Module> {
    let lines = Random::stream(seed, 1, 0).bits();
    (0..grid.rooms)
        .map(|index| {
            let cell = grid.cell(index);
            let [column, storey, row] = cell;
            let origin = DVec3::new(column as f64 * SIDE, storey as f64 * STOREY, row as f64 * SIDE);
            let mut module = Module::new(origin, format!("room {}-{}-{}", storey + 1, row + 1, column + 1));
            let content = Random::stream(seed, 4, kind(index) as u64).bits();
            let mut tags = Tags::starting_at(100 + index as u32 * 12);
            room::build(&mut module, &grid.surroundings(seed, cell), Seeds { lines, content }, &mut tags);
            module
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use xxhash_rust::xxh3::Xxh3Default;

    fn unique(model: &Model) -> usize {
        model.meshes.iter().map(crate::Mesh::triangle_count).sum()
    }

    fn fingerprint(model: &Model) -> u64 {
        let mut hasher = Xxh3Default::new();
        for mesh in &model.meshes {
            hasher.update(bytemuck::cast_slice(&mesh.positions));
            hasher.update(bytemuck::cast_slice(&mesh.colours));
            hasher.update(bytemuck::cast_slice(&mesh.indices));
        }
        for object in &model.objects {
            hasher.update(bytemuck::cast_slice(&object.to_world.to_cols_array()));
            hasher.update(&object.mesh.to_le_bytes());
            hasher.update(object.name.as_bytes());
        }
        hasher.digest()
    }

    #[test]
    fn a_small_plant_has_the_counts_asked_for() {
        let model = plant(&PlantOptions::small(1));
        model.check().unwrap();
        assert_eq!(model.objects.len(), 4_000);
        assert!(model.triangle_count().abs_diff(400_000) < 20_000, "{}", model.triangle_count());
    }

    #[test]
    fn a_plant_as_large_as_huldra_is_like_it() {
        let model = plant(&PlantOptions { seed: 1, objects: 9_720, triangles: 920_000 });
        assert_eq!(model.objects.len(), 9_720);
        assert!(model.triangle_count().abs_diff(920_000) < 46_000, "{}", model.triangle_count());
        let mut sizes: Vec<_> =
            model.objects.iter().map(|o| model.meshes[o.mesh as usize].triangle_count()).collect();
        sizes.sort_unstable();
        let percentile = |p: usize| sizes[sizes.len() * p / 100];
        assert!((20..=44).contains(&percentile(50)), "median {}", percentile(50));
        assert!((120..=450).contains(&percentile(90)), "90th {}", percentile(90));
        assert!((500..=2500).contains(&percentile(99)), "99th {}", percentile(99));
    }

    #[test]
    fn many_triangles_in_few_objects_are_merged_by_trade() {
        let options = PlantOptions { seed: 3, objects: 400, triangles: 1_500_000 };
        let model = plant(&options);
        model.check().unwrap();
        assert!(model.objects.len().abs_diff(400) <= 16, "{} objects", model.objects.len());
        assert!(model.triangle_count().abs_diff(1_500_000) < 75_000, "{}", model.triangle_count());
        assert!(unique(&model) < 1_200_000, "{} unique", unique(&model));
    }

    #[test]
    fn a_seed_is_a_plant() {
        let options = PlantOptions { seed: 7, objects: 1_000, triangles: 90_000 };
        let first = fingerprint(&plant(&options));
        assert_eq!(first, fingerprint(&plant(&options)));
        assert_ne!(first, fingerprint(&plant(&PlantOptions { seed: 8, ..options })));
    }

    #[test]
    fn the_smallest_plant_is_one_room() {
        let model = plant(&PlantOptions { seed: 0, objects: 0, triangles: 0 });
        model.check().unwrap();
        assert!((50..400).contains(&model.objects.len()), "{}", model.objects.len());
        for part in ["wall over door", "door frame", "door"] {
            assert!(model.objects.iter().any(|object| object.name == part), "{part}");
        }
    }

    #[test]
    fn every_storey_is_reached() {
        for rooms in 1..200 {
            let grid = Grid::of(rooms);
            let cells: Vec<_> = (0..rooms).map(|i| grid.cell(i)).collect();
            for storey in 1..=cells.iter().map(|c| c[1]).max().unwrap_or(0) {
                assert!(grid.has_stairs([0, storey - 1, 0]), "{rooms} rooms, storey {storey}");
            }
        }
    }
}
