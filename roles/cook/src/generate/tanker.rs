//! A tanker: a double hull with cargo tanks, stiffened everywhere, deck piping, and a superstructure of rooms
//! aft.
//!
//! Frames: x forward from the aft end of the superstructure, y up from the keel, z to starboard from the port
//! side.

use glam::{DAffine3, DMat3, DVec3};

use trimaran_scene::random::Random;

use super::{
    assembly::{Axis, Grain, Module, assemble, object_count},
    brush::X_TO_Z,
    equipment::{PIPES, Pad, Tags, equip},
    paint::Paint,
    plant::{Grid, fill_up_to, rooms_of, with_small_parts},
    room::{SIDE, STOREY},
    shape::Shape,
};
use crate::Model;

/// The size and seed of a tanker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TankerOptions {
    /// Equal seeds make equal tankers.
    pub seed: u64,
    /// Wanted objects: met exactly, but never fewer than the smallest tanker has, about 1,400.
    pub objects: usize,
    /// Wanted triangles in total, instances counted each time; met within a few percent.
    pub triangles: usize,
}

impl TankerOptions {
    /// A tanker for tests and the demo: 5 thousand objects, 0.5 million triangles.
    #[must_use]
    pub const fn small(seed: u64) -> Self {
        Self { seed, objects: 5_000, triangles: 500_000 }
    }

    /// As large as the paper's Double Eagle (section 5): 82 million triangles in 127 thousand objects.
    #[must_use]
    pub const fn paper(seed: u64) -> Self {
        Self { seed, objects: 127_000, triangles: 82_000_000 }
    }
}

/// Height of the double bottom, and width of the double sides.
const DOUBLE: f64 = 2.5;
/// A cargo tank's length, inner height and width.
const TANK: [f64; 3] = [16.0, 17.5, 16.0];
/// Tanks abreast.
const ABREAST: usize = 3;
/// Height of the cargo deck over the keel: a whole number of storeys, so that superstructure decks meet it.
const DECK: f64 = DOUBLE + TANK[1];
/// Breadth over all.
const BEAM: f64 = TANK[2] * ABREAST as f64 + 2.0 * DOUBLE;
/// Distance of frames along the hull, and of stiffeners on plates.
const FRAME: f64 = 4.0;
const STIFFENER: f64 = 0.8;
/// Rooms in a ship for each length of cargo tanks.
const ROOMS_A_TANK: usize = 24;
/// Share of a tanker's objects, in percent, that is left to small parts.
const SMALL_PARTS_PERCENT: usize = 10;

/// Makes a tanker. Its names are of the kind "tank 3S stiffener"; its one source is called "tanker".
#[must_use]
pub fn tanker(options: &TankerOptions) -> Model {
    let wanted = options.objects * (100 - SMALL_PARTS_PERCENT) / 100;
    let modules = fill_up_to(wanted, Grain::Part, |rooms| ship(rooms, options.seed));
    let (hull, rooms): (Vec<_>, Vec<_>) = modules.into_iter().partition(|module| !module.is_room());
    let missing = options.objects.saturating_sub(object_count(&hull, Grain::Part));
    let rooms = with_small_parts(rooms, missing, options.seed);
    assemble(&[rooms, hull].concat(), Grain::Part, options.triangles, "tanker")
}

/// A ship with this many rooms aft, from the keel (engine room and stores) up to the bridge, and a matching
/// number of tanks.
fn ship(rooms: usize, seed: u64) -> Vec<Module> {
    let grid = Grid::stack(rooms, (BEAM / SIDE) as usize, (DECK / STOREY) as usize + 4);
    let mut modules = rooms_of(&grid, seed, |index| index);
    let tanks = (rooms / ROOMS_A_TANK).max(1);
    let aft = grid.columns() as f64 * SIDE;
    let tags = &mut Tags::starting_at(10_000);
    for tank in 0..tanks {
        let x = aft + 0.5 + tank as f64 * TANK[0];
        for berth in 0..ABREAST {
            let side = ["P", "C", "S"][berth];
            let origin = DVec3::new(x, DOUBLE, DOUBLE + berth as f64 * TANK[2]);
            modules.push(cargo_tank(origin, &format!("tank {}{side}", tank + 1), berth));
        }
        modules.push(shell(DVec3::new(x, 0.0, 0.0), &format!("section {}", tank + 1)));
        let mut random = Random::stream(seed, 21, tank as u64);
        modules.push(deck(DVec3::new(x, DECK, 0.0), &format!("deck {}", tank + 1), seed, &mut random, tags));
    }
    modules.push(bow(DVec3::new(aft + 0.5 + tanks as f64 * TANK[0], 0.0, 0.0)));
    modules
}

/// One tank: bulkheads aft and to port, their stiffeners and webs, heating coils, a ladder, a suction pipe.
fn cargo_tank(origin: DVec3, name: &str, berth: usize) -> Module {
    let mut module = Module::named_throughout(origin, name);
    let [length, height, width] = TANK;
    let plate = 0.02;
    module.cuboid(Paint::Hull, [-plate, 0.0, 0.0], [0.0, height, width], "bulkhead");
    if berth > 0 {
        module.cuboid(Paint::Hull, [0.0, 0.0, -plate], [length, height, 0.0], "bulkhead");
    }
    let profile = Shape::Beam { depth: 300, width: 150 };
    for number in 1..(width / STIFFENER) as u32 {
        let z = STIFFENER * f64::from(number);
        let name = format!("stiffener {number}");
        module.bar(Paint::Steel, profile, [0.17, 0.0, z], (Axis::Y, height), name);
        let name = format!("deck longitudinal {number}");
        module.bar(Paint::Steel, profile, [0.0, height - 0.2, z], (Axis::X, length), name);
    }
    for frame in 1..(length / FRAME) as u32 {
        let x = FRAME * f64::from(frame);
        let name = format!("deck transverse {frame}");
        module.cuboid(Paint::Steel, [x, height - 1.2, 0.0], [x + plate, height, width], name);
        module.cuboid(Paint::Steel, [x, 0.0, 0.05], [x + plate, height, 1.0], format!("web frame {frame}"));
        for (corner, y) in [("lower", 0.0), ("upper", height - 2.2)] {
            let bracket = Shape::Trapeze { width: 1500, depth: 20, top: 500 };
            let place = DAffine3 { matrix3: X_TO_Z, translation: DVec3::new(x, y, 1.0) };
            module.put(Paint::Steel, bracket, place, format!("{corner} bracket {frame}"));
        }
    }
    for stringer in 1..4 {
        let y = height * f64::from(stringer) / 4.0;
        let name = format!("stringer {stringer}");
        module.cuboid(Paint::Steel, [0.35, y, 0.0], [1.2, y + plate, width], name);
    }
    coils(&mut module);
    module.stand(Paint::Rail, Shape::Ladder { rise: 17_000 }, [2.0, 0.0, 1.4], "ladder");
    let suction = Shape::Rod { radius: 162 };
    module.bar(Paint::Oil, suction, [length - 1.0, 0.3, 2.0], (Axis::Y, height), "suction");
    let bell = Shape::Reducer { from: 300, to: 162, length: 250 };
    module.stand(Paint::Fitting, bell, [length - 1.0, 0.05, 2.0], "bell mouth");
    module
}

/// Heating coils over the tank's bottom: straight runs and bends, on feet.
fn coils(module: &mut Module) {
    let [length, _, width] = TANK;
    let runs = 12;
    let gap = (width - 3.0) / f64::from(runs);
    for run in 0..runs {
        let z = 1.5 + gap * f64::from(run);
        let (pipe, y) = (Shape::Rod { radius: 40 }, 0.35);
        let name = format!("coil {}", run + 1);
        module.bar(Paint::Steam, pipe, [1.6, y, z], (Axis::X, length - 3.2), name);
        for foot in 0..4 {
            let x = 2.0 + (length - 4.0) * f64::from(foot) / 3.0;
            module.bar(Paint::Steel, Shape::Angle { leg: 50 }, [x, 0.0, z], (Axis::Y, 0.31), "coil foot");
        }
        for x in [1.6, length - 1.6] {
            module.stand(Paint::Fitting, Shape::Flange { pipe: 40 }, [x, y, z], "coil flange");
        }
    }
}

/// One length of the double hull: shell and inner plates, floors and webs with manholes, longitudinals.
fn shell(origin: DVec3, name: &str) -> Module {
    let mut module = Module::named_throughout(origin, name);
    let (length, plate) = (TANK[0], 0.02);
    module.cuboid(Paint::Hull, [0.0, -plate, 0.0], [length, 0.0, BEAM], "bottom shell");
    let (low, high) = ([0.0, DOUBLE - plate, DOUBLE], [length, DOUBLE, BEAM - DOUBLE]);
    module.cuboid(Paint::Hull, low, high, "inner bottom");
    for (side, outer, inner) in [("port", 0.0, DOUBLE), ("starboard", BEAM, BEAM - DOUBLE)] {
        let (low, high) = ([0.0, 0.0, outer - plate], [length, DECK, outer + plate]);
        module.cuboid(Paint::Hull, low, high, format!("{side} shell"));
        let (low, high) = ([0.0, 0.0, inner - plate], [length, DECK, inner]);
        module.cuboid(Paint::Hull, low, high, format!("{side} inner side"));
        let inwards = if side == "port" { 1.0 } else { -1.0 };
        for level in 1..(DECK / STIFFENER) as u32 {
            let y = STIFFENER * f64::from(level);
            for (which, z) in [("shell", outer + 0.14 * inwards), ("inner", inner - 0.14 * inwards)] {
                let profile = Shape::Angle { leg: 140 };
                let name = format!("{side} {which} longitudinal {level}");
                module.bar(Paint::Steel, profile, [0.0, y, z], (Axis::X, length), name);
            }
        }
    }
    for frame in 0..(length / FRAME) as u32 {
        let x = FRAME * f64::from(frame) + 0.05;
        // Floors of the double bottom, three metres wide each, and webs of the sides: plates across the ship.
        let floors = (BEAM / 3.0) as u32;
        for floor in 0..floors {
            let at = DVec3::new(x, 0.0, BEAM * f64::from(floor) / f64::from(floors));
            let shape = Shape::Manhole { width: (BEAM / f64::from(floors) * 1000.0) as u32, height: 2480 };
            let place = DAffine3 { matrix3: X_TO_Z, translation: at };
            module.put(Paint::Steel, shape, place, format!("floor {frame}.{floor}"));
        }
        for storey in 0..(DECK / DOUBLE) as u32 - 1 {
            for (side, z) in [("port", 0.0), ("starboard", BEAM - DOUBLE)] {
                let y = DOUBLE * f64::from(storey + 1);
                let place = DAffine3 { matrix3: X_TO_Z, translation: DVec3::new(x, y, z) };
                let shape = Shape::Manhole { width: 2500, height: 2480 };
                module.put(Paint::Steel, shape, place, format!("{side} web {frame}.{storey}"));
                let (low, high) = ([x + 1.0, y - plate, z], [x + FRAME - 0.05, y, z + DOUBLE]);
                module.cuboid(Paint::Floor, low, high, format!("{side} stringer deck"));
            }
        }
    }
    for girder in 0..(BEAM / 2.0) as u32 {
        let from = [0.0, 0.0, 1.0 + 2.0 * f64::from(girder)];
        let name = format!("bottom longitudinal {girder}");
        module.bar(Paint::Steel, Shape::Angle { leg: 200 }, from, (Axis::X, length), name);
    }
    module
}

/// One length of the cargo deck: plates, pipe runs with valves, catwalk, handrails, some equipment.
fn deck(origin: DVec3, name: &str, seed: u64, random: &mut Random, tags: &mut Tags) -> Module {
    let mut module = Module::named_throughout(origin, name);
    let length = TANK[0];
    for strake in 0..10 {
        let (from, to) = (BEAM * f64::from(strake) / 10.0, BEAM * f64::from(strake + 1) / 10.0);
        let name = format!("strake {}", strake + 1);
        module.cuboid(Paint::Hull, [0.0, -0.02, from], [length, 0.0, to], name);
    }
    // The same lines run along the whole ship.
    let lines = &mut Random::stream(seed, 22, 0);
    let middle = BEAM / 2.0;
    for tier in 0..2 {
        let y = 1.2 + 0.7 * f64::from(tier);
        let mut z = middle - 7.0;
        let mut line = 100 * (tier + 1);
        while z < middle + 6.6 {
            // The catwalk's place.
            if (middle - 0.9..middle + 0.9).contains(&z) {
                z = middle + 0.9;
            }
            line += 1;
            let radius = lines.pick(PIPES);
            let r = f64::from(radius) / 1000.0;
            let paint = lines.pick(Paint::SERVICES);
            let pipe = Shape::Rod { radius };
            module.bar(paint, pipe, [0.0, y, z], (Axis::X, length), format!("line {line}"));
            for fitting in 0..3 {
                let x = length * (f64::from(fitting) + random.between(0.1, 0.9)) / 3.0;
                let place = DAffine3 { matrix3: Axis::X.turn(), translation: DVec3::new(x, y, z) };
                let (shape, kind) = if random.chance(0.25) {
                    (Shape::Valve { pipe: radius }, "valve")
                } else {
                    (Shape::Flange { pipe: radius }, "flange")
                };
                module.put(Paint::Fitting, shape, place, format!("line {line} {kind}"));
            }
            if random.chance(0.5) {
                let x = random.between(2.0, length - 2.0);
                let (top, name) = (y - 3.0 * r, format!("line {line} drop"));
                module.bar(paint, pipe, [x, 0.0, z], (Axis::Y, top), name);
                let elbow = Shape::Elbow { pipe: radius, bend: 3 * radius };
                module.stand(paint, elbow, [x, top, z], format!("line {line} bend"));
            }
            z += 2.0 * r + lines.between(0.25, 0.6);
        }
        for support in 0..4 {
            let x = 2.0 + 4.0 * f64::from(support);
            let (beam, from) = (Shape::Beam { depth: 160, width: 80 }, [x, y - 0.35, middle - 7.2]);
            module.bar(Paint::Steel, beam, from, (Axis::Z, 14.4), "pipe support");
            for post in [-7.2, -3.6, 3.6, 7.2] {
                module.bar(Paint::Steel, beam, [x, 0.0, middle + post], (Axis::Y, y), "support post");
            }
        }
    }
    for panel in 0..(length / 2.0) as u32 {
        let at = DVec3::new(2.0 * f64::from(panel) + 2.0, 2.6, middle - 0.7);
        let grating = Shape::Grating { width: 1400, length: 2000 };
        let place = DAffine3 { matrix3: X_TO_Z, translation: at };
        module.put(Paint::Grating, grating, place, format!("catwalk {}", panel + 1));
    }
    for (side, y, z) in [
        ("port", 0.0, 0.1),
        ("starboard", 0.0, BEAM - 0.1),
        ("catwalk", 2.6, middle - 0.7),
        ("catwalk", 2.6, middle + 0.7),
    ] {
        for section in 0..4 {
            let (rail, x) = (Shape::Handrail { length: 4000 }, 4.0 * f64::from(section));
            module.stand(Paint::Rail, rail, [x, y, z], format!("{side} handrail"));
        }
    }
    for z in [6.0, 12.0, BEAM - 15.0, BEAM - 9.0] {
        let pad = Pad { corner: [random.between(1.0, 12.0), z], size: [2.5, 2.4], rack: 3.3 };
        equip(&mut module, random, tags, pad);
    }
    module
}

/// The bow: plates that close in on the stem, and decks between them.
fn bow(origin: DVec3) -> Module {
    let mut module = Module::new(origin, "bow");
    let (length, steps) = (32.0, 16);
    // Half the breadth at a fraction of the bow's length: a parabola.
    let half = |t: f64| (BEAM / 2.0) * (1.0 - t * t);
    module.cuboid(Paint::Hull, [-0.02, 0.0, 0.0], [0.0, DECK, BEAM], "collision bulkhead");
    for step in 0..steps {
        let [t0, t1] = [step, step + 1].map(|s| f64::from(s) / f64::from(steps));
        let (x0, x1) = (length * t0, length * t1);
        for (side, sign) in [("port", -1.0), ("starboard", 1.0)] {
            // The bulwark stands a metre above the deck.
            let high = DECK + 1.0;
            let [z0, z1] = [t0, t1].map(|t| BEAM / 2.0 + sign * half(t));
            let along = DVec3::new(x1 - x0, 0.0, z1 - z0);
            let thick = DVec3::new(0.0, 0.0, 0.03);
            let middle = DVec3::new((x0 + x1) / 2.0, high / 2.0, (z0 + z1) / 2.0);
            let place =
                DAffine3 { matrix3: DMat3::from_cols(along, DVec3::Y * high, thick), translation: middle };
            module.put(Paint::Hull, Shape::Box, place, format!("{side} bow plate {}", step + 1));
        }
        let (low, high) = (BEAM / 2.0 - half(t1), BEAM / 2.0 + half(t1));
        // The decks end before the stem, where no plate has any breadth left.
        for deck in (0..=(DECK / STOREY) as u32).filter(|_| high > low) {
            let y = STOREY * f64::from(deck);
            let name = format!("bow deck {deck} plate {}", step + 1);
            module.cuboid(Paint::Floor, [x0, y - 0.02, low], [x1, y, high], name);
        }
        let frame = Shape::Angle { leg: 200 };
        for (side, z) in [("port", low), ("starboard", high)] {
            let name = format!("{side} bow frame {}", step + 1);
            module.bar(Paint::Steel, frame, [x1, 0.0, z], (Axis::Y, DECK), name);
        }
    }
    module
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_tanker_has_the_counts_asked_for() {
        let model = tanker(&TankerOptions::small(1));
        model.check().unwrap();
        assert_eq!(model.objects.len(), 5_000);
        assert!(model.triangle_count().abs_diff(500_000) < 25_000, "{}", model.triangle_count());
        assert!(model.meshes.len() < 1_000, "{} meshes", model.meshes.len());
    }

    #[test]
    fn a_seed_is_a_tanker() {
        let placed = |seed| -> Vec<(u32, [f64; 12])> {
            let objects = tanker(&TankerOptions::small(seed)).objects;
            objects.iter().map(|o| (o.mesh, o.to_world.to_cols_array())).collect()
        };
        assert_eq!(placed(4), placed(4));
        assert_ne!(placed(4), placed(5));
    }

    #[test]
    fn the_smallest_tanker_is_whole() {
        let model = tanker(&TankerOptions { seed: 0, objects: 0, triangles: 0 });
        model.check().unwrap();
        for part in ["tank 1C bulkhead", "collision bulkhead", "deck 1 strake 1", "column"] {
            assert!(model.objects.iter().any(|o| o.name == part), "no {part}");
        }
    }
}
