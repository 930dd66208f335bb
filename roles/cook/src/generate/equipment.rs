//! Equipment in one quarter of a room, with its piping up to the rack.

use glam::{DAffine3, DVec3};

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
    module.tag("");
}

fn pumps(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let size = 0.7;
    let count = if pad.size[1] > 2.0 { 2 } else { 1 };
    for pump in 0..count {
        module.tag(&tags.next("P"));
        let (x, z) = (pad.corner[0] + 1.0, pad.corner[1] + 0.6 + 1.2 * f64::from(pump));
        module.cuboid(Paint::Floor, [x - 0.8, 0.0, z - 0.35], [x + 0.8, 0.12, z + 0.35], "plinth");
        module.stand(Paint::Machine, Shape::Pump { size: 700 }, [x, 0.12, z], "");
        let service = random.pick(Paint::SERVICES);
        let pipe = random.pick([40, 57, 84]);
        riser(module, service, pipe, [x + size * 0.5, 0.12 + size * 0.85, z, pad.rack]);
        module.stand(Paint::Instrument, Shape::Gauge, [x - 0.3, 0.6, z], "gauge");
        module.stand(Paint::Cabinet, Shape::Junction, [x - 0.7, 1.2, z - 0.5], "local panel");
        let (post, foot) = (Shape::Angle { leg: 50 }, [x - 0.7, 0.0, z - 0.5]);
        module.bar(Paint::Steel, post, foot, (Axis::Y, 1.1), "panel post");
    }
}

/// A pipe from a nozzle up to the rack: flange, valve, gauge and bend. `at` is x, y, z of the nozzle and the
/// rack's height.
fn riser(module: &mut Module, service: Paint, pipe: u32, [x, y, z, rack]: [f64; 4]) {
    let radius = f64::from(pipe) / 1000.0;
    let (rod, bend) = (Shape::Rod { radius: pipe }, 3 * pipe);
    let reach = f64::from(bend) / 1000.0;
    module.stand(Paint::Fitting, Shape::Flange { pipe }, [x, y, z], "flange");
    let top = rack - reach;
    module.bar(service, rod, [x, y, z], (Axis::Y, top - y), "discharge");
    if top - y > 1.5 {
        module.stand(Paint::Fitting, Shape::Valve { pipe }, [x, y + 0.5 + radius, z], "gate valve");
    }
    module.stand(service, Shape::Elbow { pipe, bend }, [x, top, z], "bend");
    module.bar(service, rod, [x + reach, rack, z], (Axis::X, 0.4), "header");
}

fn column(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    module.tag(&tags.next("V"));
    let radius = random.pick([500, 600, 700]);
    let r = f64::from(radius) / 1000.0;
    let (x, z) = (pad.corner[0] + 1.1, pad.corner[1] + pad.size[1] / 2.0);
    let height = (pad.rack - 0.9).min(2.6);
    let length = (height * 1000.0) as u32;
    let skirt = Shape::Rod { radius: radius * 9 / 10 };
    module.bar(Paint::Steel, skirt, [x, 0.0, z], (Axis::Y, 0.6), "skirt");
    module.stand(Paint::Vessel, Shape::Vessel { radius, length }, [x, 0.4, z], "");
    for nozzle in 0..4 {
        let y = 0.9 + 0.45 * f64::from(nozzle);
        let pipe = random.pick([25, 40, 57]);
        let from = [x + r * 0.95, y, z - 0.3 + 0.2 * f64::from(nozzle)];
        let name = format!("nozzle {}", nozzle + 1);
        module.bar(Paint::Vessel, Shape::Rod { radius: pipe }, from, (Axis::X, 0.25), name.as_str());
        let face = DAffine3 { matrix3: Axis::X.turn(), translation: DVec3::new(from[0] + 0.25, y, from[2]) };
        module.put(Paint::Fitting, Shape::Flange { pipe }, face, name + " flange");
    }
    riser(module, random.pick(Paint::SERVICES), 57, [x, 0.35 + height, z, pad.rack]);
    module.stand(Paint::Instrument, Shape::Gauge, [x, 0.42 + height, z + 0.2], "gauge");
    module.stand(Paint::Rail, Shape::Ladder { rise: 3000 }, [x, 0.0, z - r - 0.2], "ladder");
}

fn drum(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    let tag = tags.next("D");
    module.tag(&tag);
    let (y, z) = (1.2, pad.corner[1] + pad.size[1] / 2.0);
    let x = pad.corner[0] + 0.1;
    let place = DAffine3 { matrix3: Axis::X.turn(), translation: DVec3::new(x, y, z) };
    module.put(Paint::Vessel, Shape::Vessel { radius: 600, length: 2300 }, place, "");
    for saddle in [x + 0.5, x + 1.6] {
        module.cuboid(Paint::Steel, [saddle, 0.0, z - 0.5], [saddle + 0.15, 0.8, z + 0.5], "saddle");
    }
    for nozzle in 0..3 {
        let at = x + 0.6 + 0.5 * f64::from(nozzle);
        let pipe = random.pick([25, 40, 57]);
        module.tag(&format!("{tag} nozzle {}", nozzle + 1));
        module.bar(Paint::Vessel, Shape::Rod { radius: pipe }, [at, y + 0.5, z], (Axis::Y, 0.3), "");
        riser(module, random.pick(Paint::SERVICES), pipe, [at, y + 0.8, z, pad.rack]);
    }
    module.tag(&tag);
    module.stand(Paint::Instrument, Shape::Gauge, [x + 0.3, y + 0.55, z], "gauge");
}

fn tank(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    module.tag(&tags.next("T"));
    let r = (pad.size[0].min(pad.size[1]) / 2.0 - 0.1).min(1.2);
    let (x, z) = (pad.corner[0] + pad.size[0] / 2.0, pad.corner[1] + pad.size[1] / 2.0);
    let radius = (r * 1000.0) as u32;
    module.cuboid(Paint::Floor, [x - r, 0.0, z - r], [x + r, 0.1, z + r], "plinth");
    module.stand(Paint::Vessel, Shape::Tank { radius, height: 2000 }, [x, 0.1, z], "");
    riser(module, random.pick(Paint::SERVICES), random.pick([40, 84]), [x, 2.2, z, pad.rack]);
    module.stand(Paint::Rail, Shape::Ladder { rise: 2400 }, [x, 0.0, z - r - 0.1], "ladder");
    module.stand(Paint::Instrument, Shape::Gauge, [x + r * 0.5, 2.15, z], "level gauge");
}

fn cabinets(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    module.tag(&tags.next("E"));
    let [x0, z0] = pad.corner;
    for cabinet in 0..(pad.size[0] / 0.65) as u32 {
        let (x, number) = (x0 + 0.65 * f64::from(cabinet), cabinet + 1);
        let height = random.pick([1800, 2000]);
        let shape = Shape::Cabinet { width: 600, height, depth: 500 };
        module.stand(Paint::Cabinet, shape, [x, 0.0, z0 + 0.3], format!("cabinet {number}"));
        let from = [x + 0.3, f64::from(height) / 1000.0, z0 + 0.5];
        let (rod, rise) = (Shape::Rod { radius: 25 }, pad.rack - from[1]);
        module.bar(Paint::Cable, rod, from, (Axis::Y, rise), format!("conduit {number}"));
    }
    module.cuboid(Paint::Furniture, [x0, 0.7, z0 + 1.6], [x0 + 1.6, 0.75, z0 + 2.2], "desk");
    for (x, z) in [(0.05, 1.65), (1.5, 1.65), (0.05, 2.1), (1.5, 2.1)] {
        let leg = Shape::Rod { radius: 25 };
        module.bar(Paint::Furniture, leg, [x0 + x, 0.0, z0 + z], (Axis::Y, 0.7), "desk leg");
    }
}

fn stores(module: &mut Module, random: &mut Random, tags: &mut Tags, pad: Pad) {
    module.tag(&tags.next("S"));
    let [x0, z0] = pad.corner;
    for shelf in 0..4 {
        let y = 0.3 + 0.6 * f64::from(shelf);
        let name = format!("shelf {}", shelf + 1);
        module.cuboid(Paint::Furniture, [x0, y, z0], [x0 + 2.4, y + 0.03, z0 + 0.6], name);
        for crate_number in 0..3 {
            let x = x0 + 0.1 + 0.8 * f64::from(crate_number);
            let (w, h) = (random.pick([0.4, 0.5, 0.6]), random.pick([0.2, 0.3, 0.4]));
            let paint = random.pick([Paint::Furniture, Paint::Cabinet, Paint::Machine]);
            module.cuboid(paint, [x, y + 0.03, z0 + 0.05], [x + w, y + 0.03 + h, z0 + 0.5], "box");
        }
    }
    for (x, z) in [(0.0, 0.0), (2.36, 0.0), (0.0, 0.56), (2.36, 0.56)] {
        module.bar(Paint::Steel, Shape::Angle { leg: 40 }, [x0 + x, 0.0, z0 + z], (Axis::Y, 2.4), "upright");
    }
    for drum in 0..3 {
        let from = [x0 + 0.4 + 0.7 * f64::from(drum), 0.0, z0 + 1.6];
        let name = format!("barrel {}", drum + 1);
        let paint = random.pick(Paint::SERVICES);
        module.bar(paint, Shape::Rod { radius: 290 }, from, (Axis::Y, 0.88), name);
    }
}
