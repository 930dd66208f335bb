//! Triangles of simple solids, in one colour, to a chord tolerance.

use glam::{DAffine3, DMat3, DVec3};

use crate::Mesh;
use trimaran_scene::Rgba8;

/// The fineness of curved surfaces: the largest distance between a circle and its chords, in metres.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(super) struct Tolerance(pub(super) f64);

impl Tolerance {
    /// A pipe of eight sides and two caps has 28 triangles: the median object of a real plant.
    const FEWEST: u32 = 8;
    const MOST: u32 = 4096;

    /// Chords of a full circle of `radius` metres. Uses only a square root, for equal counts everywhere.
    pub(super) fn chords(self, radius: f64) -> u32 {
        let exact = std::f64::consts::PI * (radius / (2.0 * self.0)).sqrt();
        (exact.ceil() as u32).clamp(Self::FEWEST, Self::MOST)
    }
}

/// Turns y onto x: a shape along +y then lies along +x.
pub(super) const Y_TO_X: DMat3 = DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z);
/// Turns x onto z, about y.
pub(super) const X_TO_Z: DMat3 = DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X);
/// Turns y onto z.
pub(super) const Y_TO_Z: DMat3 = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);

/// Draws solids into a mesh; without one it only counts.
pub(super) struct Brush<'a> {
    mesh: Option<&'a mut Mesh>,
    place: DAffine3,
    colour: Rgba8,
    tolerance: Tolerance,
    triangles: usize,
}

/// The place of a ring of a lathed surface in the mesh.
#[derive(Clone, Copy)]
enum Ring {
    Pole(u32),
    Circle(u32),
}

impl<'a> Brush<'a> {
    /// A brush that draws into `mesh`, with `place` from the shape's frame to the mesh's.
    pub(super) const fn draw(
        mesh: &'a mut Mesh,
        place: DAffine3,
        colour: Rgba8,
        tolerance: Tolerance,
    ) -> Self {
        Self { mesh: Some(mesh), place, colour, tolerance, triangles: 0 }
    }

    /// A brush that counts.
    pub(super) const fn count(tolerance: Tolerance) -> Self {
        Self { mesh: None, place: DAffine3::IDENTITY, colour: Rgba8([0; 4]), tolerance, triangles: 0 }
    }

    /// The triangles drawn or counted so far.
    pub(super) const fn triangles(&self) -> usize {
        self.triangles
    }

    /// Draws with `place` applied first.
    pub(super) fn at(&mut self, place: DAffine3, draw: impl FnOnce(&mut Self)) {
        let outer = self.place;
        self.place = outer * place;
        draw(self);
        self.place = outer;
    }

    /// Draws `offset` metres away.
    pub(super) fn moved(&mut self, x: f64, y: f64, z: f64, draw: impl FnOnce(&mut Self)) {
        self.at(DAffine3::from_translation(DVec3::new(x, y, z)), draw);
    }

    /// Draws at a place, with what goes along +y turned to go along +x.
    pub(super) fn along_x(&mut self, at: [f64; 3], draw: impl FnOnce(&mut Self)) {
        self.at(DAffine3 { matrix3: Y_TO_X, translation: DVec3::from_array(at) }, draw);
    }

    /// A box between two corners.
    pub(super) fn cuboid(&mut self, min: [f64; 3], max: [f64; 3]) {
        self.triangles += 12;
        if self.mesh.is_none() {
            return;
        }
        let corner = |bit: usize, axis: usize| if bit == 0 { min[axis] } else { max[axis] };
        let first = self.next_vertex();
        for index in 0..8 {
            let at = DVec3::new(corner(index & 1, 0), corner(index & 2, 1), corner(index & 4, 2));
            self.vertex(at);
        }
        for quad in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            self.quad(quad.map(|corner| first + corner));
        }
    }

    /// A surface of revolution about y through `profile`, points (radius, height) from bottom to top, closed
    /// by flat caps where it ends off the axis.
    pub(super) fn lathe(&mut self, profile: &[(f64, f64)]) {
        let widest = profile.iter().fold(0.0, |widest, &(radius, _)| f64::max(widest, radius));
        self.lathe_of(self.tolerance.chords(widest), profile);
    }

    /// Like [`Self::lathe`], with this many sides at any tolerance: nuts, square posts.
    pub(super) fn lathe_of(&mut self, sides: u32, profile: &[(f64, f64)]) {
        let n = sides as usize;
        let on_axis = |&(radius, _): &(f64, f64)| radius == 0.0;
        for pair in profile.windows(2) {
            self.triangles += n * (2 - pair.iter().filter(|p| on_axis(p)).count());
        }
        let capped = |end: Option<&(f64, f64)>| end.is_some_and(|p| !on_axis(p));
        for end in [profile.first(), profile.last()] {
            self.triangles += if capped(end) { n - 2 } else { 0 };
        }
        if self.mesh.is_none() {
            return;
        }
        let circle = unit_circle(sides);
        let rings: Vec<Ring> =
            profile.iter().map(|&(radius, height)| self.ring(&circle, radius, height)).collect();
        for pair in rings.windows(2) {
            self.band(sides, pair[0], pair[1]);
        }
        for (end, turned) in [(rings.first(), true), (rings.last(), false)] {
            if let Some(&Ring::Circle(first)) = end {
                for i in 1..sides - 1 {
                    let (a, b) = if turned { (i, i + 1) } else { (i + 1, i) };
                    self.triangle([first, first + a, first + b]);
                }
            }
        }
    }

    /// A quarter of a torus: a pipe of radius `pipe` that starts at the origin along +y and ends along +x at
    /// (bend, bend, 0).
    pub(super) fn elbow(&mut self, pipe: f64, bend: f64) {
        let sides = self.tolerance.chords(pipe);
        let steps = self.tolerance.chords(bend + pipe).div_ceil(4).max(3);
        self.triangles += (2 * sides * steps) as usize;
        if self.mesh.is_none() {
            return;
        }
        let circle = unit_circle(sides);
        let mut previous = None;
        for step in 0..=steps {
            let angle = std::f64::consts::FRAC_PI_2 * f64::from(step) / f64::from(steps);
            let (sine, cosine) = libm::sincos(angle);
            let ring = Ring::Circle(self.next_vertex());
            for &(c, s) in &circle {
                let out = bend - pipe * c;
                self.vertex(DVec3::new(bend - out * cosine, out * sine, pipe * s));
            }
            if let Some(previous) = previous.replace(ring) {
                self.band(sides, previous, ring);
            }
        }
    }

    /// A prism: `outline` (x, z), counter-clockwise seen from above and star-shaped about its first point,
    /// from y = 0 to `height`.
    pub(super) fn prism(&mut self, outline: &[(f64, f64)], height: f64) {
        let n = outline.len();
        self.triangles += 4 * n - 4;
        if self.mesh.is_none() {
            return;
        }
        let first = self.next_vertex();
        for y in [0.0, height] {
            for &(x, z) in outline {
                self.vertex(DVec3::new(x, y, z));
            }
        }
        let n = n as u32;
        for i in 0..n {
            let j = (i + 1) % n;
            self.quad([first + i, first + j, first + n + j, first + n + i]);
        }
        for i in 1..n - 1 {
            self.triangle([first, first + i + 1, first + i]);
            self.triangle([first + n, first + n + i, first + n + i + 1]);
        }
    }

    fn ring(&mut self, circle: &[(f64, f64)], radius: f64, height: f64) -> Ring {
        let first = self.next_vertex();
        if radius == 0.0 {
            self.vertex(DVec3::new(0.0, height, 0.0));
            return Ring::Pole(first);
        }
        for &(c, s) in circle {
            self.vertex(DVec3::new(radius * c, height, radius * s));
        }
        Ring::Circle(first)
    }

    fn band(&mut self, sides: u32, low: Ring, high: Ring) {
        for i in 0..sides {
            let j = (i + 1) % sides;
            match (low, high) {
                (Ring::Circle(low), Ring::Circle(high)) => self.quad([low + i, high + i, high + j, low + j]),
                (Ring::Pole(pole), Ring::Circle(high)) => self.triangle([pole, high + i, high + j]),
                (Ring::Circle(low), Ring::Pole(pole)) => self.triangle([low + i, pole, low + j]),
                (Ring::Pole(_), Ring::Pole(_)) => {}
            }
        }
    }

    fn next_vertex(&self) -> u32 {
        self.mesh.as_ref().map_or(0, |mesh| mesh.positions.len() as u32)
    }

    fn vertex(&mut self, at: DVec3) {
        if let Some(mesh) = &mut self.mesh {
            mesh.positions.push(self.place.transform_point3(at).as_vec3());
            mesh.colours.push(self.colour);
        }
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }

    fn triangle(&mut self, corners: [u32; 3]) {
        if let Some(mesh) = &mut self.mesh {
            mesh.indices.extend(corners);
        }
    }
}

/// Cosines and sines of a full turn, by a portable sine.
fn unit_circle(sides: u32) -> Vec<(f64, f64)> {
    (0..sides)
        .map(|i| {
            let (sine, cosine) = libm::sincos(std::f64::consts::TAU * f64::from(i) / f64::from(sides));
            (cosine, sine)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(draw: impl Fn(&mut Brush<'_>)) -> Mesh {
        let (mut mesh, tolerance) = (Mesh::default(), Tolerance(0.001));
        let mut brush = Brush::draw(&mut mesh, DAffine3::IDENTITY, Rgba8([1; 4]), tolerance);
        draw(&mut brush);
        let triangles = brush.triangles();
        assert_eq!(mesh.triangle_count(), triangles);
        let mut counter = Brush::count(tolerance);
        draw(&mut counter);
        assert_eq!(counter.triangles(), triangles, "counting and drawing agree");
        mesh
    }

    /// Six times the signed volume: positive if all triangles wind counter-clockwise as seen from outside.
    fn volume(mesh: &Mesh) -> f64 {
        let at = |i: u32| mesh.positions[i as usize].as_dvec3();
        mesh.indices.chunks(3).map(|t| at(t[0]).dot(at(t[1]).cross(at(t[2])))).sum::<f64>() / 6.0
    }

    #[test]
    fn a_box_has_its_volume() {
        let mesh = drawn(|b| b.cuboid([-1.0, 0.0, 2.0], [1.0, 3.0, 2.5]));
        assert!((volume(&mesh) - 3.0).abs() < 1e-6);
    }

    #[test]
    fn a_thin_pipe_has_28_triangles() {
        let mesh = drawn(|b| b.lathe(&[(0.01, 0.0), (0.01, 1.0)]));
        assert_eq!(mesh.triangle_count(), 28);
    }

    #[test]
    fn a_lathed_cylinder_keeps_to_the_tolerance() {
        let mesh = drawn(|b| b.lathe(&[(0.5, 0.0), (0.5, 2.0)]));
        let (exact, got) = (std::f64::consts::PI * 0.5, volume(&mesh));
        assert!(got < exact && got > exact * (1.0 - 4.0 * 0.001 / 0.5), "{got} of {exact}");
    }

    #[test]
    fn poles_close_a_sphere_like_profile() {
        let mesh = drawn(|b| b.lathe(&[(0.0, -1.0), (1.0, 0.0), (0.0, 1.0)]));
        let exact = 2.0 / 3.0 * std::f64::consts::PI;
        assert!((volume(&mesh) / exact - 1.0).abs() < 0.01);
    }

    #[test]
    fn an_elbow_ends_where_it_should() {
        let mesh = drawn(|b| b.elbow(0.1, 0.3));
        let top = mesh.positions.iter().map(|p| p.y).fold(f32::MIN, f32::max);
        let right = mesh.positions.iter().map(|p| p.x).fold(f32::MIN, f32::max);
        assert!((top - 0.4).abs() < 1e-3 && (right - 0.3).abs() < 1e-6, "{top} {right}");
    }

    #[test]
    fn a_prism_has_its_volume() {
        let mesh = drawn(|b| b.prism(&[(0.0, 0.0), (0.0, 2.0), (1.0, 2.0), (1.0, 0.0)], 3.0));
        assert!((volume(&mesh) - 6.0).abs() < 1e-6, "{}", volume(&mesh));
    }
}
