//! The catalogue of parts: each shape is a few solids. Lengths are whole millimetres, so that equal parts
//! share a mesh.

use glam::{DAffine3, DMat3, DVec3};

use super::brush::{Brush, Y_TO_Z};

/// A part's shape in a frame of its own, metres, y up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Shape {
    /// A unit cube about the origin; placing scales it.
    Box,
    /// A round bar or pipe of unit length along +y; placing scales its length.
    Rod { radius: u32 },
    /// An I section of unit length along +y.
    Beam { depth: u32, width: u32 },
    /// An L section of unit length along +y.
    Angle { leg: u32 },
    /// A quarter bend, from the origin along +y to +x.
    Elbow { pipe: u32, bend: u32 },
    /// A pair of bolted flanges about the origin, pipe along y.
    Flange { pipe: u32 },
    /// A gate valve with flanges and hand wheel, pipe along y, stem along +x.
    Valve { pipe: u32 },
    /// A cone from radius `from` at the origin to `to`, along +y.
    Reducer { from: u32, to: u32, length: u32 },
    /// A pressure vessel with dished ends along +y from the origin.
    Vessel { radius: u32, length: u32 },
    /// A storage tank with stiffening rings and a cone roof, standing at the origin.
    Tank { radius: u32, height: u32 },
    /// A pump with its motor on a base plate, along x, standing at the origin.
    Pump { size: u32 },
    /// Bearing and cross bars, from the origin over +x and +z, top at y = 0.
    Grating { width: u32, length: u32 },
    /// Posts, two rails and a toe plate along +x.
    Handrail { length: u32 },
    /// Treads and stringers, rising along +z; x from 0 to the width.
    Stairs { rise: u32, run: u32, width: u32 },
    /// Two stiles and rungs, along +y, width along x.
    Ladder { rise: u32 },
    /// A ladder-type cable tray, two metres along +z, centred on x, bottom at y = 0.
    Tray { width: u32 },
    /// A cabinet with door, plinth and handle, standing at the origin, front towards +z.
    Cabinet { width: u32, height: u32, depth: u32 },
    /// Two jambs and a head around an opening from the origin along +x.
    DoorFrame { width: u32, height: u32 },
    /// A door leaf hung at the origin, along +x when shut, with handles.
    DoorLeaf { width: u32, height: u32 },
    /// A long lamp under a ceiling, along +x, top at y = 0.
    Lamp,
    /// A junction box with glands, back at z = 0.
    Junction,
    /// A dial on a stem, standing at the origin, facing +z.
    Gauge,
    /// A fire extinguisher standing at the origin.
    Extinguisher,
    /// A hexagon bolt with a washer along +y.
    Bolt,
    /// A plate with a man-sized hole in its middle, in the plane z = 0, from the origin over +x and +y.
    Manhole { width: u32, height: u32 },
    /// A wedge or trapezium plate: from x = 0 to `width` at the foot, to `top` at the head, extruded 1 m
    /// along +y.
    Trapeze { width: u32, depth: u32, top: u32 },
}

impl Shape {
    /// Draws or counts the shape's triangles.
    pub(super) fn paint(self, brush: &mut Brush<'_>) {
        match self {
            Self::Box => brush.cuboid([-0.5; 3], [0.5; 3]),
            Self::Rod { radius } => brush.lathe(&[(m(radius), 0.0), (m(radius), 1.0)]),
            Self::Beam { depth, width } => beam(brush, m(depth), m(width)),
            Self::Angle { leg } => angle(brush, m(leg)),
            Self::Elbow { pipe, bend } => brush.elbow(m(pipe), m(bend)),
            Self::Flange { pipe } => flange(brush, m(pipe), 0.0),
            Self::Valve { pipe } => valve(brush, m(pipe)),
            Self::Reducer { from, to, length } => brush.lathe(&[(m(from), 0.0), (m(to), m(length))]),
            Self::Vessel { radius, length } => vessel(brush, m(radius), m(length)),
            Self::Tank { radius, height } => tank(brush, m(radius), m(height)),
            Self::Pump { size } => pump(brush, m(size)),
            Self::Grating { width, length } => grating(brush, m(width), m(length)),
            Self::Handrail { length } => handrail(brush, m(length)),
            Self::Stairs { rise, run, width } => stairs(brush, m(rise), m(run), m(width)),
            Self::Ladder { rise } => ladder(brush, m(rise)),
            Self::Tray { width } => tray(brush, m(width)),
            Self::Cabinet { width, height, depth } => cabinet(brush, m(width), m(height), m(depth)),
            Self::DoorFrame { width, height } => door_frame(brush, m(width), m(height)),
            Self::DoorLeaf { width, height } => door_leaf(brush, m(width), m(height)),
            Self::Lamp => lamp(brush),
            Self::Junction => junction(brush),
            Self::Gauge => gauge(brush),
            Self::Extinguisher => extinguisher(brush),
            Self::Bolt => bolt(brush, 0.012),
            Self::Manhole { width, height } => manhole(brush, m(width), m(height)),
            Self::Trapeze { width, depth, top } => {
                brush.prism(&[(0.0, 0.0), (0.0, m(depth)), (m(top), m(depth)), (m(width), 0.0)], 1.0);
            }
        }
    }
}

/// Metres of millimetres.
fn m(millimetres: u32) -> f64 {
    f64::from(millimetres) / 1000.0
}

fn beam(brush: &mut Brush<'_>, depth: f64, width: f64) {
    let (d, w, flange) = (depth / 2.0, width / 2.0, depth * 0.06);
    brush.cuboid([-w, 0.0, -d], [w, 1.0, flange - d]);
    brush.cuboid([-w, 0.0, d - flange], [w, 1.0, d]);
    brush.cuboid([-width * 0.04, 0.0, flange - d], [width * 0.04, 1.0, d - flange]);
}

fn angle(brush: &mut Brush<'_>, leg: f64) {
    let thick = leg * 0.12;
    brush.prism(&[(0.0, 0.0), (0.0, leg), (thick, leg), (thick, thick), (leg, thick), (leg, 0.0)], 1.0);
}

fn bolt(brush: &mut Brush<'_>, size: f64) {
    brush.lathe_of(6, &[(size, 0.0), (size, size * 1.6)]);
}

fn flange(brush: &mut Brush<'_>, pipe: f64, y: f64) {
    let (outer, thick) = (pipe * 1.6 + 0.02, pipe * 0.2 + 0.01);
    brush.lathe(&[
        (pipe * 1.1, y - thick * 1.8),
        (outer, y - thick),
        (outer, y + thick),
        (pipe * 1.1, y + thick * 1.8),
    ]);
    for (c, s) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)] {
        let circle = pipe * 1.35 + 0.01;
        brush.moved(circle * c, y + thick, circle * s, |b| bolt(b, pipe * 0.12 + 0.004));
    }
}

fn valve(brush: &mut Brush<'_>, pipe: f64) {
    let half = pipe * 2.2 + 0.05;
    flange(brush, pipe, -half);
    flange(brush, pipe, half);
    brush.lathe(&[(pipe * 1.1, -half), (pipe * 1.7, -pipe), (pipe * 1.7, pipe), (pipe * 1.1, half)]);
    brush.along_x([0.0; 3], |b| {
        let stem = pipe * 4.0 + 0.08;
        b.lathe(&[(pipe * 1.0, 0.0), (pipe * 0.8, stem * 0.6)]);
        b.lathe(&[(pipe * 0.2 + 0.004, stem * 0.6), (pipe * 0.2 + 0.004, stem)]);
        let wheel = pipe * 1.6 + 0.03;
        b.lathe(&[(wheel * 0.86, stem), (wheel, stem + 0.01), (wheel * 0.86, stem + 0.02)]);
    });
}

/// A dish as deep as half its radius: points from the rim to the pole, or back.
fn dish(radius: f64, base: f64, direction: f64) -> [(f64, f64); 6] {
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0].map(|t: f64| {
        let rim = 1.0 - t;
        let across = (1.0 - t * t).max(0.0).sqrt();
        (if rim == 0.0 { 0.0 } else { radius * across }, base + direction * radius * 0.5 * t)
    })
}

fn vessel(brush: &mut Brush<'_>, radius: f64, length: f64) {
    let deep = radius * 0.5;
    let mut profile = dish(radius, deep, -1.0);
    profile.reverse();
    let mut profile = profile.to_vec();
    profile.extend(dish(radius, length - deep, 1.0));
    brush.lathe(&profile);
}

fn tank(brush: &mut Brush<'_>, radius: f64, height: f64) {
    brush.lathe(&[(radius, 0.0), (radius, height), (radius * 0.1, height * 1.06)]);
    for ring in 1..4 {
        let y = height * f64::from(ring) / 4.0;
        brush.lathe(&[(radius, y), (radius + 0.06, y), (radius + 0.06, y + 0.06), (radius, y + 0.06)]);
    }
}

fn pump(brush: &mut Brush<'_>, size: f64) {
    let (high, thick) = (size * 0.35, size * 0.22);
    brush.cuboid([-size, 0.0, -size * 0.35], [size, size * 0.1, size * 0.35]);
    brush.along_x([-size * 0.9, high, 0.0], |b| {
        b.lathe(&[
            (0.0, -0.02),
            (thick * 0.6, 0.0),
            (thick, 0.05),
            (thick, size * 0.8),
            (thick * 0.5, size * 0.85),
        ]);
        b.lathe(&[(thick * 0.25, size * 0.85), (thick * 0.25, size * 1.2)]);
        b.lathe(&[
            (thick * 0.5, size * 1.15),
            (thick * 1.3, size * 1.25),
            (thick * 1.3, size * 1.5),
            (thick * 0.6, size * 1.6),
        ]);
    });
    for fin in 0..6 {
        let x = size * (0.1 * f64::from(fin) - 0.8);
        brush.moved(x, high, 0.0, |b| {
            b.cuboid([0.0, -thick * 1.15, -thick * 1.15], [size * 0.02, thick * 1.15, thick * 1.15]);
        });
    }
    brush.moved(size * 0.5, high, 0.0, |b| b.lathe(&[(thick * 0.4, 0.0), (thick * 0.4, size * 0.5)]));
}

fn grating(brush: &mut Brush<'_>, width: f64, length: f64) {
    let bars = (width / 0.1).round().max(2.0) as u32;
    for bar in 0..=bars {
        let x = width * f64::from(bar) / f64::from(bars);
        brush.cuboid([x - 0.003, -0.03, 0.0], [x + 0.003, 0.0, length]);
    }
    for cross in 0..=4 {
        let z = length * f64::from(cross) / 4.0;
        brush.cuboid([0.0, -0.012, z - 0.003], [width, -0.002, z + 0.003]);
    }
}

fn handrail(brush: &mut Brush<'_>, length: f64) {
    let gaps = (length / 1.5).ceil().max(1.0) as u32;
    for post in 0..=gaps {
        let x = length * f64::from(post) / f64::from(gaps);
        brush.moved(x, 0.0, 0.0, |b| b.lathe(&[(0.021, 0.0), (0.021, 1.1)]));
    }
    for y in [0.55, 1.1] {
        brush.along_x([0.0, y, 0.0], |b| b.lathe(&[(0.021, 0.0), (0.021, length)]));
    }
    brush.cuboid([0.0, 0.0, -0.003], [length, 0.1, 0.003]);
}

fn stairs(brush: &mut Brush<'_>, rise: f64, run: f64, width: f64) {
    let steps = (rise / 0.2).round().max(1.0) as u32;
    let (up, on) = (rise / f64::from(steps), run / f64::from(steps));
    for step in 1..=steps {
        let (y, z) = (up * f64::from(step), on * f64::from(step - 1));
        brush.cuboid([0.0, y - 0.04, z], [width, y, z + on + 0.02]);
    }
    // The stringers: slanted plates beside the treads.
    let slant = DMat3::from_cols(DVec3::X, DVec3::new(0.0, rise, run), DVec3::Z);
    for x in [-0.02, width] {
        let place = DAffine3::from_mat3_translation(slant, DVec3::new(x, -0.1, 0.0));
        brush.at(place, |b| b.cuboid([0.0, 0.0, 0.0], [0.02, 1.0, 0.3]));
    }
}

fn ladder(brush: &mut Brush<'_>, rise: f64) {
    for x in [-0.25, 0.22] {
        brush.cuboid([x, 0.0, -0.03], [x + 0.03, rise, 0.03]);
    }
    let rungs = (rise / 0.3).floor() as u32;
    for rung in 1..=rungs {
        brush.along_x([-0.22, 0.3 * f64::from(rung), 0.0], |b| b.lathe(&[(0.012, 0.0), (0.012, 0.44)]));
    }
}

fn tray(brush: &mut Brush<'_>, width: f64) {
    let half = width / 2.0;
    for x in [-half, half - 0.004] {
        brush.cuboid([x, 0.0, 0.0], [x + 0.004, 0.1, 2.0]);
    }
    for rung in 0..8 {
        let z = 0.125 + 0.25 * f64::from(rung);
        brush.cuboid([-half, 0.0, z - 0.015], [half, 0.02, z + 0.015]);
    }
}

fn cabinet(brush: &mut Brush<'_>, width: f64, height: f64, depth: f64) {
    brush.cuboid([0.0, 0.1, 0.0], [width, height, depth]);
    brush.cuboid([0.02, 0.0, 0.02], [width - 0.02, 0.1, depth - 0.02]);
    brush.cuboid([0.03, 0.13, depth], [width - 0.03, height - 0.03, depth + 0.02]);
    brush.cuboid(
        [width * 0.85, height * 0.5, depth + 0.02],
        [width * 0.85 + 0.03, height * 0.5 + 0.15, depth + 0.05],
    );
}

fn door_frame(brush: &mut Brush<'_>, width: f64, height: f64) {
    // It reaches into the opening by this much: a frame flush with the wall's edge would flicker with it.
    let lining = 0.015;
    for (from, to) in [(-0.06, lining), (width - lining, width + 0.06)] {
        brush.cuboid([from, 0.0, -0.1], [to, height + 0.06, 0.1]);
    }
    brush.cuboid([lining, height - lining, -0.1], [width - lining, height + 0.06, 0.1]);
}

fn door_leaf(brush: &mut Brush<'_>, width: f64, height: f64) {
    brush.cuboid([0.0, 0.01, -0.02], [width - 0.01, height - 0.01, 0.02]);
    for z in [-0.07, 0.05] {
        brush.cuboid([width - 0.2, 1.03, z], [width - 0.08, 1.06, z + 0.02]);
    }
    for y in [0.2, height - 0.3] {
        brush.moved(0.0, y, 0.0, |b| b.lathe(&[(0.025, 0.0), (0.025, 0.1)]));
    }
}

fn lamp(brush: &mut Brush<'_>) {
    brush.cuboid([0.0, -0.06, -0.08], [1.2, 0.0, 0.08]);
    brush.along_x([0.05, -0.09, 0.0], |b| b.lathe(&[(0.02, 0.0), (0.02, 1.1)]));
}

fn junction(brush: &mut Brush<'_>) {
    brush.cuboid([-0.1, -0.15, 0.0], [0.1, 0.15, 0.12]);
    for x in [-0.06, 0.0, 0.06] {
        brush.moved(x, -0.19, 0.06, |b| b.lathe_of(6, &[(0.015, 0.0), (0.015, 0.04)]));
    }
}

fn gauge(brush: &mut Brush<'_>) {
    brush.lathe(&[(0.012, 0.0), (0.012, 0.12)]);
    brush.moved(0.0, 0.18, -0.02, |b| {
        b.at(DAffine3::from_mat3(Y_TO_Z), |b| b.lathe(&[(0.06, 0.0), (0.06, 0.05)]));
    });
}

fn extinguisher(brush: &mut Brush<'_>) {
    brush.lathe(&[(0.08, 0.0), (0.08, 0.5), (0.05, 0.56), (0.025, 0.58), (0.025, 0.66)]);
    brush.cuboid([-0.02, 0.62, -0.02], [0.14, 0.65, 0.02]);
}

fn manhole(brush: &mut Brush<'_>, width: f64, height: f64) {
    let (left, right) = (width / 2.0 - 0.45, width / 2.0 + 0.45);
    let (sill, head) = (0.1, 2.2);
    let t = 0.008;
    brush.cuboid([0.0, 0.0, -t], [left, height, t]);
    brush.cuboid([right, 0.0, -t], [width, height, t]);
    brush.cuboid([left, 0.0, -t], [right, sill, t]);
    brush.cuboid([left, head, -t], [right, height, t]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mesh;
    use crate::generate::brush::Tolerance;
    use trimaran_scene::Rgba8;

    fn bounds(shape: Shape) -> (DVec3, DVec3) {
        let mut mesh = Mesh::default();
        shape.paint(&mut Brush::draw(&mut mesh, DAffine3::IDENTITY, Rgba8([9; 4]), Tolerance(0.001)));
        let points = mesh.positions.iter().map(|p| p.as_dvec3());
        points.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)))
    }

    #[test]
    fn stairs_reach_the_floor_above() {
        let (low, high) = bounds(Shape::Stairs { rise: 5000, run: 6000, width: 1200 });
        assert!((high.y - 5.1).abs() < 0.01 || (high.y - 5.0).abs() < 0.01, "{high}");
        assert!(low.y >= -0.11 && low.x >= -0.021 && high.x <= 1.221, "{low} {high}");
    }

    #[test]
    fn a_vessel_is_as_long_as_it_says() {
        let (low, high) = bounds(Shape::Vessel { radius: 1000, length: 4000 });
        assert!(
            low.y.abs() < 1e-6 && (high.y - 4.0).abs() < 1e-6 && (high.x - 1.0).abs() < 1e-3,
            "{low} {high}"
        );
    }

    #[test]
    fn a_door_frame_leaves_its_opening() {
        let (low, high) = bounds(Shape::DoorFrame { width: 1000, height: 2200 });
        assert!((high.x - 1.06).abs() < 1e-6 && (low.x + 0.06).abs() < 1e-6, "{low} {high}");
    }
}
