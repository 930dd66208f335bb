//! Equipment in one quarter of a room, with its piping up to the rack.

use glam::DAffine3;

use trimaran_scene::random::Random;

use super::{
    assembly::{Axis, Module},
    paint::Paint,
    shape::Shape,
};

/// The radii of pipes in millimetres.
pub(super) const PIPES: [u32; 7] = [13, 25, 40, 57, 84, 110, 162];

/// A free area of a floor for equipment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pad {
    /// Lower corner, x and z, metres in the module's frame.
    pub(super) corner: [f64; 2],
    /// Size along x and z.
    pub(super) size: [f64; 2],
    /// Height of the pipe rack above it.
    pub(super) rack: f64,
}

/// Numbers of tags, so that equipment has unique names.
#[derive(Debug, Default)]
pub(super) struct Tags(u32);

impl Tags {
    pub(super) const fn starting_at(first: u32) -> Self {
        Self(first)
    }

    pub(super) fn next(&mut self, letter: &str) -> String {
        self.0 += 1;
        format!("{letter}-{:03}", self.0)
    }
}

/// Fills a pad with one kind of equipment.
pub(super) fn equip(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    match random.below(7) {
        0 | 1 => pumps(module, random, tags, pad),
        2 => column(module, random, tags, pad),
        3 => drum(module, random, tags, pad),
        4 => tank(module, random, tags, pad),
        5 => cabinets(module, random, tags, pad),
        _ => stores(module, random, tags, pad),
    }
}

fn pumps(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let size = 0.7;
    let count = if pad.size[1] > 2.0 { 2 } else { 1 };
    for pump in 0..count {
        let tag = tags.next("P");
        let (x, z) = (pad.corner[0] + 1.0, pad.corner[1] + 0.6 + 1.2 * f64::from(pump));
        module.cuboid(
            Paint::Floor,
            [x - 0.8, 0.0, z - 0.35],
            [x + 0.8, 0.12, z + 0.35],
            format!("{tag} plinth"),
        );
        module.stand(Paint::Machine, Shape::Pump { size: 700 }, [x, 0.12, z], tag.as_str());
        let service = random.pick(Paint::SERVICES);
        let pipe = random.pick([40, 57, 84]);
        riser(module, service, pipe, [x + size * 0.5, 0.12 + size * 0.85, z, pad.rack], &tag);
        module.stand(Paint::Instrument, Shape::Gauge, [x - 0.3, 0.6, z], format!("{tag} gauge"));
        module.stand(Paint::Cabinet, Shape::Junction, [x - 0.7, 1.2, z - 0.5], format!("{tag} local panel"));
        module.bar(
            Paint::Steel,
            Shape::Angle { leg: 50 },
            [x - 0.7, 0.0, z - 0.5],
            (Axis::Y, 1.1),
            format!("{tag} panel post"),
        );
    }
}

/// A pipe from a nozzle up to the rack: flange, valve, gauge and bend. `at` is x, y, z of the nozzle and the
/// rack's height.
fn riser(module: &mut Module, service: Paint, pipe: u32, [x, y, z, rack]: [f64; 4], tag: &str) {
    let radius = f64::from(pipe) / 1000.0;
    let bend = 3 * pipe;
    module.stand(Paint::Fitting, Shape::Flange { pipe }, [x, y, z], format!("{tag} flange"));
    let top = rack - f64::from(bend) / 1000.0;
    module.bar(
        service,
        Shape::Rod { radius: pipe },
        [x, y, z],
        (Axis::Y, top - y),
        format!("{tag} discharge"),
    );
    if top - y > 1.5 {
        let place = DAffine3::from_translation(glam::DVec3::new(x, y + 0.5 + radius, z));
        module.put(Paint::Fitting, Shape::Valve { pipe }, place, format!("{tag} gate valve"));
    }
    module.stand(service, Shape::Elbow { pipe, bend }, [x, top, z], format!("{tag} bend"));
    module.bar(
        service,
        Shape::Rod { radius: pipe },
        [x + f64::from(bend) / 1000.0, rack, z],
        (Axis::X, 0.4),
        format!("{tag} header"),
    );
}

fn column(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let tag = tags.next("V");
    let radius = random.pick([500, 600, 700]);
    let r = f64::from(radius) / 1000.0;
    let (x, z) = (pad.corner[0] + 1.1, pad.corner[1] + pad.size[1] / 2.0);
    let height = (pad.rack - 0.9).min(2.6);
    let length = (height * 1000.0) as u32;
    module.bar(
        Paint::Steel,
        Shape::Rod { radius: radius * 9 / 10 },
        [x, 0.0, z],
        (Axis::Y, 0.6),
        format!("{tag} skirt"),
    );
    module.stand(Paint::Vessel, Shape::Vessel { radius, length }, [x, 0.4, z], tag.as_str());
    for nozzle in 0..4 {
        let y = 0.9 + 0.45 * f64::from(nozzle);
        let pipe = random.pick([25, 40, 57]);
        let from = [x + r * 0.95, y, z - 0.3 + 0.2 * f64::from(nozzle)];
        let name = format!("{tag} nozzle {}", nozzle + 1);
        module.bar(Paint::Vessel, Shape::Rod { radius: pipe }, from, (Axis::X, 0.25), name.as_str());
        let face =
            DAffine3 { matrix3: Axis::X.turn(), translation: glam::DVec3::new(from[0] + 0.25, y, from[2]) };
        module.put(Paint::Fitting, Shape::Flange { pipe }, face, format!("{name} flange"));
    }
    riser(module, random.pick(Paint::SERVICES), 57, [x, 0.35 + height, z, pad.rack], &tag);
    module.stand(Paint::Instrument, Shape::Gauge, [x, 0.42 + height, z + 0.2], format!("{tag} gauge"));
    module.stand(Paint::Rail, Shape::Ladder { rise: 3000 }, [x, 0.0, z - r - 0.2], format!("{tag} ladder"));
}

fn drum(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let tag = tags.next("D");
    let (y, z) = (1.2, pad.corner[1] + pad.size[1] / 2.0);
    let x = pad.corner[0] + 0.1;
    let place = DAffine3 { matrix3: Axis::X.turn(), translation: glam::DVec3::new(x, y, z) };
    module.put(Paint::Vessel, Shape::Vessel { radius: 600, length: 2300 }, place, tag.as_str());
    for saddle in [0.5, 1.6] {
        module.cuboid(
            Paint::Steel,
            [x + saddle, 0.0, z - 0.5],
            [x + saddle + 0.15, 0.8, z + 0.5],
            format!("{tag} saddle"),
        );
    }
    for nozzle in 0..3 {
        let at = x + 0.6 + 0.5 * f64::from(nozzle);
        let pipe = random.pick([25, 40, 57]);
        let tag = format!("{tag} nozzle {}", nozzle + 1);
        module.bar(
            Paint::Vessel,
            Shape::Rod { radius: pipe },
            [at, y + 0.5, z],
            (Axis::Y, 0.3),
            tag.as_str(),
        );
        riser(module, random.pick(Paint::SERVICES), pipe, [at, y + 0.8, z, pad.rack], &tag);
    }
    module.stand(Paint::Instrument, Shape::Gauge, [x + 0.3, y + 0.55, z], format!("{tag} gauge"));
}

fn tank(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let tag = tags.next("T");
    let r = (pad.size[0].min(pad.size[1]) / 2.0 - 0.1).min(1.2);
    let (x, z) = (pad.corner[0] + pad.size[0] / 2.0, pad.corner[1] + pad.size[1] / 2.0);
    let radius = (r * 1000.0) as u32;
    module.cuboid(Paint::Floor, [x - r, 0.0, z - r], [x + r, 0.1, z + r], format!("{tag} plinth"));
    module.stand(Paint::Vessel, Shape::Tank { radius, height: 2000 }, [x, 0.1, z], tag.as_str());
    riser(module, random.pick(Paint::SERVICES), random.pick([40, 84]), [x, 2.2, z, pad.rack], &tag);
    module.stand(Paint::Rail, Shape::Ladder { rise: 2400 }, [x, 0.0, z - r - 0.1], format!("{tag} ladder"));
    module.stand(Paint::Instrument, Shape::Gauge, [x + r * 0.5, 2.15, z], format!("{tag} level gauge"));
}

fn cabinets(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let tag = tags.next("E");
    let count = (pad.size[0] / 0.65) as u32;
    for cabinet in 0..count {
        let x = pad.corner[0] + 0.65 * f64::from(cabinet);
        let height = random.pick([1800, 2000]);
        let shape = Shape::Cabinet { width: 600, height, depth: 500 };
        module.stand(
            Paint::Cabinet,
            shape,
            [x, 0.0, pad.corner[1] + 0.3],
            format!("{tag} cabinet {}", cabinet + 1),
        );
        let from = [x + 0.3, f64::from(height) / 1000.0, pad.corner[1] + 0.5];
        let rise = pad.rack - from[1];
        module.bar(
            Paint::Cable,
            Shape::Rod { radius: 25 },
            from,
            (Axis::Y, rise),
            format!("{tag} conduit {}", cabinet + 1),
        );
    }
    module.cuboid(
        Paint::Furniture,
        [pad.corner[0], 0.7, pad.corner[1] + 1.6],
        [pad.corner[0] + 1.6, 0.75, pad.corner[1] + 2.2],
        format!("{tag} desk"),
    );
    for (x, z) in [(0.05, 1.65), (1.5, 1.65), (0.05, 2.1), (1.5, 2.1)] {
        let from = [pad.corner[0] + x, 0.0, pad.corner[1] + z];
        module.bar(
            Paint::Furniture,
            Shape::Rod { radius: 25 },
            from,
            (Axis::Y, 0.7),
            format!("{tag} desk leg"),
        );
    }
}

fn stores(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let tag = tags.next("S");
    for shelf in 0..4 {
        let y = 0.3 + 0.6 * f64::from(shelf);
        let (x0, z0) = (pad.corner[0], pad.corner[1]);
        module.cuboid(
            Paint::Furniture,
            [x0, y, z0],
            [x0 + 2.4, y + 0.03, z0 + 0.6],
            format!("{tag} shelf {}", shelf + 1),
        );
        for crate_number in 0..3 {
            let x = x0 + 0.1 + 0.8 * f64::from(crate_number);
            let (w, h) = (random.pick([0.4, 0.5, 0.6]), random.pick([0.2, 0.3, 0.4]));
            let paint = random.pick([Paint::Furniture, Paint::Cabinet, Paint::Machine]);
            module.cuboid(
                paint,
                [x, y + 0.03, z0 + 0.05],
                [x + w, y + 0.03 + h, z0 + 0.5],
                format!("{tag} box"),
            );
        }
    }
    for (x, z) in [(0.0, 0.0), (2.36, 0.0), (0.0, 0.56), (2.36, 0.56)] {
        let from = [pad.corner[0] + x, 0.0, pad.corner[1] + z];
        module.bar(Paint::Steel, Shape::Angle { leg: 40 }, from, (Axis::Y, 2.4), format!("{tag} upright"));
    }
    for drum in 0..3 {
        let from = [pad.corner[0] + 0.4 + 0.7 * f64::from(drum), 0.0, pad.corner[1] + 1.6];
        let paint = random.pick(Paint::SERVICES);
        module.bar(
            paint,
            Shape::Rod { radius: 290 },
            from,
            (Axis::Y, 0.88),
            format!("{tag} barrel {}", drum + 1),
        );
    }
}
