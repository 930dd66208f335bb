//! One room: floor, walls with doors, stairs, pipe rack, trays, ducts and equipment around a cross of two
//! clear aisles.

use glam::{DAffine3, DMat3, DVec3};

use trimaran_scene::random::Random;

use super::{
    assembly::{Axis, Module},
    brush::X_TO_Z,
    equipment::{PIPES, Pad, Tags, equip},
    paint::Paint,
    shape::Shape,
};

/// Length and width of a room, wall to wall, metres.
pub(super) const SIDE: f64 = 8.0;
/// From floor to floor, metres.
pub(super) const STOREY: f64 = 5.0;
/// Thickness of a floor; its top is at the storey's zero.
pub(super) const SLAB: f64 = 0.2;
/// Thickness of a wall.
const WALL: f64 = 0.15;
/// A door's clear width and height.
pub(super) const DOOR: [f64; 2] = [1.0, 2.2];
/// The aisles: nothing stands between these two distances from a wall, up to the height of [`TRAYS`].
pub(super) const AISLE: [f64; 2] = [3.0, 5.0];
const TRAYS: f64 = 2.75;
const RACK: f64 = 3.3;
const DUCTS: f64 = 4.3;
/// Stairs stay on this side of x, with room for a walker's shoulders.
const STAIR_EDGE: f64 = 2.2;

/// One side of a room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Wall {
    /// The neighbour builds it, or the two rooms are one.
    None,
    /// No way through.
    Blind,
    /// A door, with its opening this far along the wall.
    Door(f64),
}

/// The surroundings of a room.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surroundings {
    /// The walls at x = 0, z = 0, x = side and z = side.
    pub(super) walls: [Wall; 4],
    /// The stairs from the room below come up through this floor.
    pub(super) stairs_below: bool,
    /// Stairs lead to the room above.
    pub(super) stairs_up: bool,
    /// Nothing is above.
    pub(super) roof: bool,
}

/// Seeds of a room: all rooms share `lines`, so that pipes continue from one to the next; `content` is the
/// room's own.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeds {
    pub(super) lines: u64,
    pub(super) content: u64,
}

/// Builds a room without its small parts.
pub(super) fn build(module: &mut Module, around: &Surroundings, seeds: Seeds, tags: &mut Tags) {
    let random = &mut Random::new(seeds.content);
    // Over stairs that lead up, everything at the ceiling ends short of them.
    let start = if around.stairs_up { STAIR_EDGE } else { 0.0 };
    frame(module, start);
    floor(module, 0.0, around.stairs_below);
    if around.roof {
        floor(module, STOREY, false);
    }
    for (side, wall) in around.walls.into_iter().enumerate() {
        build_wall(module, side, wall);
    }
    rack(module, &mut Random::new(seeds.lines), start);
    services(module, start);
    let stairs = around.stairs_below || around.stairs_up;
    if around.stairs_up {
        let shape = Shape::Stairs { rise: 5000, run: 6000, width: 1200 };
        module.stand(Paint::Grating, shape, [0.5, 0.0, 1.0], "stairs");
    }
    if around.stairs_below {
        for z in [2.4, 4.9] {
            let rail = DAffine3 { matrix3: X_TO_Z, translation: DVec3::new(1.95, 0.0, z) };
            module.put(Paint::Rail, Shape::Handrail { length: 2100 }, rail, "stair well handrail");
        }
    }
    for (x, z) in
        [(0.35, 0.35), (0.35, AISLE[1] + 0.1), (AISLE[1] + 0.1, 0.35), (AISLE[1] + 0.1, AISLE[1] + 0.1)]
    {
        if stairs && x < 1.0 {
            continue;
        }
        equip(module, random, tags, Pad { corner: [x, z], size: [2.5, 2.4], rack: RACK });
    }
}

/// Adds the `index`th of the small parts that rooms are full of: conduits, brackets, boxes, gauges, bolts.
/// All hang above the doors or keep to the walls between the aisles.
pub(super) fn add_small_part(module: &mut Module, random: &mut Random, index: usize) {
    // Along one of the walls at x = 0 or z = 0, beside the aisle, or under the ceiling.
    let along = if random.chance(0.5) { random.between(0.4, 2.6) } else { random.between(5.4, 7.6) };
    let y = random.between(0.3, 4.2);
    let at = if random.chance(0.5) { [along, y, WALL] } else { [WALL, y, along] };
    let number = index + 1;
    match random.below(8) {
        0 | 1 => {
            let (rod, length) = (Shape::Rod { radius: 13 }, random.between(0.4, (4.6 - y).min(2.0)));
            module.bar(Paint::Cable, rod, at, (Axis::Y, length), format!("conduit {number}"));
        }
        2 => {
            let angle = Shape::Angle { leg: 60 };
            module.bar(Paint::Steel, angle, at, (Axis::X, 0.3), format!("bracket {number}"));
        }
        3 => module.stand(Paint::Cabinet, Shape::Junction, at, format!("junction box {number}")),
        4 => module.stand(Paint::Instrument, Shape::Gauge, at, format!("gauge {number}")),
        5 => module.stand(Paint::Fitting, Shape::Bolt, at, format!("anchor {number}")),
        6 => {
            let (x, z) = (random.between(STAIR_EDGE, 7.5), random.between(0.5, 7.5));
            let (rod, length) = (Shape::Rod { radius: 8 }, STOREY - SLAB - RACK);
            module.bar(Paint::Steel, rod, [x, RACK, z], (Axis::Y, length), format!("hanger {number}"));
        }
        _ => {
            let [x, y, z] = at;
            let high = [x + random.pick([0.15, 0.2, 0.3]), y + 0.15, z + 0.02];
            module.cuboid(Paint::Instrument, at, high, format!("sign {number}"));
        }
    }
}

fn frame(module: &mut Module, start: f64) {
    let height = STOREY - SLAB;
    let column = Shape::Beam { depth: 300, width: 300 };
    module.bar(Paint::Steel, column, [0.0, 0.0, 0.0], (Axis::Y, height), "column");
    let girder = Shape::Beam { depth: 400, width: 200 };
    module.bar(Paint::Steel, girder, [0.0, height - 0.2, 0.0], (Axis::X, SIDE), "girder x");
    module.bar(Paint::Steel, girder, [0.0, height - 0.2, 0.0], (Axis::Z, SIDE), "girder z");
    let joist = Shape::Beam { depth: 200, width: 100 };
    for z in [2.0, 4.0, 6.0] {
        module.bar(Paint::Steel, joist, [start, height - 0.1, z], (Axis::X, SIDE - start), "joist");
    }
}

fn floor(module: &mut Module, top: f64, well: bool) {
    // The well of the stairs: x 0.4 .. 1.9, z 2.4 .. 7.
    let strips = [(0.0, 0.4), (0.4, 1.9), (1.9, 4.0), (4.0, 6.0), (6.0, SIDE)];
    for (number, (from, to)) in strips.into_iter().enumerate() {
        let plates: &[(f64, f64)] = if well && number == 1 {
            &[(0.0, 2.4), (7.0, SIDE)]
        } else {
            &[(0.0, SIDE / 2.0), (SIDE / 2.0, SIDE)]
        };
        for &(near, far) in plates {
            let name = format!("deck plate {}", number + 1);
            module.cuboid(Paint::Floor, [from, top - SLAB, near], [to, top, far], name);
        }
    }
}

/// Builds one wall: `side` is 0 at x = 0, 1 at z = 0, 2 at x = SIDE, 3 at z = SIDE.
fn build_wall(module: &mut Module, side: usize, wall: Wall) {
    let height = STOREY - SLAB;
    // Along the wall, then up, then its thickness; mapped to world by side.
    let slab = |module: &mut Module, along: [f64; 2], up: [f64; 2], name: &str| {
        let face = if side < 2 { [-WALL / 2.0, WALL / 2.0] } else { [SIDE - WALL / 2.0, SIDE + WALL / 2.0] };
        let (x, z) = if side.is_multiple_of(2) { (face, along) } else { (along, face) };
        module.cuboid(Paint::Wall, [x[0], up[0], z[0]], [x[1], up[1], z[1]], name);
    };
    match wall {
        Wall::None => {}
        Wall::Blind => slab(module, [0.0, SIDE], [0.0, height], "wall"),
        Wall::Door(start) => {
            let [width, head] = DOOR;
            slab(module, [0.0, start], [0.0, height], "wall");
            slab(module, [start + width, SIDE], [0.0, height], "wall");
            slab(module, [start, start + width], [head, height], "wall over door");
            door(module, side, start);
        }
    }
}

fn door(module: &mut Module, side: usize, start: f64) {
    let [width, height] = DOOR.map(|m| (m * 1000.0) as u32);
    let plane = if side < 2 { 0.0 } else { SIDE };
    // x along the wall; the leaf stands open at a right angle, on the side of the opening nearer to the
    // equipment.
    let hinge_at_start = start < (AISLE[0] + AISLE[1] - DOOR[0]) / 2.0;
    let (turn, at): (DMat3, fn(f64, f64) -> DVec3) = if side.is_multiple_of(2) {
        (X_TO_Z, |along, plane| DVec3::new(plane, 0.0, along))
    } else {
        (DMat3::IDENTITY, |along, plane| DVec3::new(along, 0.0, plane))
    };
    let opening = DAffine3 { matrix3: turn, translation: at(start, plane) };
    module.put(Paint::Door, Shape::DoorFrame { width, height }, opening, "door frame");
    let inwards = if side < 2 { 1.0 } else { -1.0 };
    let hinge = if hinge_at_start { start - 0.03 } else { start + DOOR[0] + 0.03 };
    let normal = if side.is_multiple_of(2) { DVec3::X } else { DVec3::Z } * inwards;
    let leaf = DAffine3 {
        matrix3: DMat3::from_cols(normal, DVec3::Y, normal.cross(DVec3::Y)),
        translation: at(hinge, plane) + normal * 0.1,
    };
    module.put(Paint::Door, Shape::DoorLeaf { width, height }, leaf, "door");
}

/// Pipes that cross the room in both directions above the aisles.
fn rack(module: &mut Module, random: &mut Random, start: f64) {
    for (axis, y) in [(Axis::X, RACK), (Axis::Z, RACK + 0.55)] {
        let mut across = 0.55;
        let mut line = 0;
        while across < SIDE - 0.6 {
            line += 1;
            let radius = random.pick(PIPES);
            let r = f64::from(radius) / 1000.0;
            let paint = random.pick(Paint::SERVICES);
            let name = format!("line {}{line:02}", if matches!(axis, Axis::X) { 1 } else { 2 });
            let at = |along: f64, y: f64, across: f64| match axis {
                Axis::X => [along, y, across],
                _ => [across, y, along],
            };
            let fitting_at = random.between(2.9, 7.0);
            let valve = random.chance(0.3);
            let spacing = 2.0 * r + random.between(0.35, 0.9);
            let from = if matches!(axis, Axis::X) { start } else { 0.0 };
            // A line that would run along the stairs stops at this room's walls.
            if from > 0.0 || across > start {
                let run = (axis, SIDE - from);
                module.bar(paint, Shape::Rod { radius }, at(from, y, across), run, name.as_str());
                for along in [2.7, 5.3] {
                    let shoe = at(along, y - r - 0.1, across);
                    let angle = Shape::Angle { leg: 80 };
                    module.bar(Paint::Steel, angle, shoe, (Axis::Y, 0.1), format!("{name} shoe"));
                }
                if radius >= 40 {
                    let translation = DVec3::from_array(at(fitting_at, y, across));
                    let place = DAffine3 { matrix3: axis.turn(), translation };
                    let shape =
                        if valve { Shape::Valve { pipe: radius } } else { Shape::Flange { pipe: radius } };
                    module.put(Paint::Fitting, shape, place, format!("{name} fitting"));
                }
            }
            across += spacing;
        }
        for along in [2.7, 5.3] {
            let support = Shape::Beam { depth: 150, width: 100 };
            let (from, run) = match axis {
                Axis::X => ([along, y - 0.32, 0.0], (Axis::Z, SIDE)),
                _ => ([start, y - 0.32, along], (Axis::X, SIDE - start)),
            };
            module.bar(Paint::Steel, support, from, run, "rack beam");
        }
    }
}

/// Cable trays, ducts and lamps.
fn services(module: &mut Module, start: f64) {
    for (tray, x) in [2.6, 5.4].into_iter().enumerate() {
        for section in 0..4 {
            let z = 2.0 * f64::from(section);
            let name = format!("tray {} section {}", tray + 1, section + 1);
            module.stand(Paint::Tray, Shape::Tray { width: 400 }, [x, TRAYS, z], name);
        }
        for cable in 0..3 {
            let from = [x - 0.1 + 0.1 * f64::from(cable), TRAYS + 0.05, 0.0];
            let (rod, name) = (Shape::Rod { radius: 20 }, format!("cable {}", cable + 1));
            module.bar(Paint::Cable, rod, from, (Axis::Z, SIDE), name);
        }
    }
    module.cuboid(Paint::Duct, [3.7, DUCTS, 0.0], [4.3, DUCTS + 0.35, SIDE], "duct");
    module.cuboid(Paint::Duct, [3.8, DUCTS - 0.15, 3.8], [4.2, DUCTS, 4.2], "duct outlet");
    for (x, z) in [(1.2, 1.5), (5.6, 1.5), (1.2, 6.5), (5.6, 6.5)] {
        if x > start {
            module.stand(Paint::Instrument, Shape::Lamp, [x, DUCTS, z], "lamp");
        }
    }
    module.stand(Paint::Fire, Shape::Extinguisher, [2.7, 0.0, 0.25], "fire extinguisher");
}
