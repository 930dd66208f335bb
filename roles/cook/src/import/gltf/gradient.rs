//! Colours that change within a triangle. A scene has one colour per triangle, so such a triangle is cut
//! until each piece has about one.

use std::collections::HashMap;

use glam::Vec3;

use super::material::{byte, srgb};
use crate::lists::at;

/// Vertices with linear colours, and triangles of them.
pub(super) struct Coloured<'a> {
    pub positions: &'a mut Vec<Vec3>,
    pub colours: &'a mut Vec<[f32; 4]>,
    pub triangles: &'a mut Vec<[u32; 3]>,
}

/// The allowed differences between a piece's corners, of 255: the finest feasible one is taken.
const STEPS: [u8; 3] = [24, 48, 96];
/// This many pieces are few enough for any mesh, and for a larger one twice its triangles.
const FEW: usize = 16_384;

impl Coloured<'_> {
    /// Cuts triangles where their colours change. Only the colours of its ends decide whether an edge is cut,
    /// so triangles that share it stay joined.
    pub(super) fn cut(&mut self) {
        let most = FEW.max(2 * self.triangles.len());
        for step in STEPS {
            let mut cut = Cut { surface: self, step, middles: HashMap::new(), whole: 0 };
            cut.whole = cut.surface.positions.len();
            match cut.pieces(most) {
                Some(pieces) => {
                    *self.triangles = pieces;
                    return;
                }
                None => {
                    let whole = cut.whole;
                    self.positions.truncate(whole);
                    self.colours.truncate(whole);
                }
            }
        }
    }
}

struct Cut<'c, 'a> {
    surface: &'c mut Coloured<'a>,
    step: u8,
    /// The middle vertex of a cut edge, by the edge's ends.
    middles: HashMap<(u32, u32), u32>,
    /// The initial number of vertices.
    whole: usize,
}

impl Cut<'_, '_> {
    /// The pieces of all triangles, unless there are more than `most`.
    fn pieces(&mut self, most: usize) -> Option<Vec<[u32; 3]>> {
        let mut pieces = Vec::with_capacity(self.surface.triangles.len());
        let mut open = Vec::new();
        for number in 0..self.surface.triangles.len() {
            open.extend(self.surface.triangles.get(number).copied());
            while let Some([a, b, c]) = open.pop() {
                // Starting from the corner before the first cut edge, these four cases remain.
                let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| self.middle(from, to));
                match edges {
                    [None, None, None] => pieces.push([a, b, c]),
                    [Some(ab), Some(bc), Some(ca)] => {
                        open.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
                    }
                    [Some(ab), None, None] => open.extend([[a, ab, c], [ab, b, c]]),
                    [None, Some(bc), None] => open.extend([[a, b, bc], [a, bc, c]]),
                    [None, None, Some(ca)] => open.extend([[a, b, ca], [ca, b, c]]),
                    [Some(ab), Some(bc), None] => open.extend([[ab, b, bc], [a, ab, bc], [a, bc, c]]),
                    [None, Some(bc), Some(ca)] => open.extend([[bc, c, ca], [b, bc, ca], [b, ca, a]]),
                    [Some(ab), None, Some(ca)] => open.extend([[ca, a, ab], [c, ca, ab], [c, ab, b]]),
                }
                if pieces.len() + open.len() > most {
                    return None;
                }
            }
        }
        Some(pieces)
    }

    /// The middle of an edge whose ends differ in colour.
    fn middle(&mut self, from: u32, to: u32) -> Option<u32> {
        let Coloured { positions, colours, .. } = self.surface;
        let pair = [from, to].map(|end| at(colours, end));
        let [a, b] = pair;
        if difference(a, b) <= self.step {
            return None;
        }
        if let Some(&middle) = self.middles.get(&(from.min(to), from.max(to))) {
            return Some(middle);
        }
        let ends = [from, to].map(|end| at(positions, end));
        let middle = positions.len() as u32;
        // Halves first: a sum could overflow.
        positions.push(ends[0] / 2.0 + ends[1] / 2.0);
        colours.push([0, 1, 2, 3].map(|channel: usize| (a[channel] + b[channel]) / 2.0));
        self.middles.insert((from.min(to), from.max(to)), middle);
        Some(middle)
    }
}

/// The difference of two colours as stored: the largest of any channel.
fn difference(a: [f32; 4], b: [f32; 4]) -> u8 {
    let kept = |[r, g, b, a]: [f32; 4]| [byte(srgb(r)), byte(srgb(g)), byte(srgb(b)), byte(a)];
    let pairs = kept(a).into_iter().zip(kept(b));
    pairs.map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];
    const BLUE: [f32; 4] = [0.0, 0.0, 1.0, 1.0];

    struct Surface {
        positions: Vec<Vec3>,
        colours: Vec<[f32; 4]>,
        triangles: Vec<[u32; 3]>,
    }

    impl Surface {
        fn cut(mut self) -> Self {
            let Self { positions, colours, triangles } = &mut self;
            Coloured { positions, colours, triangles }.cut();
            self
        }

        fn corners(&self, triangle: [u32; 3]) -> [Vec3; 3] {
            triangle.map(|corner| self.positions[corner as usize])
        }

        fn area(&self) -> f32 {
            let area = |&triangle: &[u32; 3]| {
                let [a, b, c] = self.corners(triangle);
                (b - a).cross(c - a).z / 2.0
            };
            self.triangles.iter().map(area).sum()
        }
    }

    fn square(colours: [[f32; 4]; 4]) -> Surface {
        let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        Surface {
            positions: positions.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
            colours: colours.to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    #[test]
    fn one_colour_is_not_cut() {
        let whole = square([RED; 4]).cut();
        assert_eq!((whole.triangles.len(), whole.positions.len()), (2, 4));
    }

    #[test]
    fn a_gradient_becomes_pieces_of_about_one_colour() {
        let cut = square([RED, BLUE, BLUE, RED]).cut();
        assert!((50..2_000).contains(&cut.triangles.len()), "{}", cut.triangles.len());
        for &[a, b, c] in &cut.triangles {
            let [a, b, c] = [a, b, c].map(|corner| cut.colours[corner as usize]);
            assert!(difference(a, b).max(difference(b, c)).max(difference(c, a)) <= STEPS[0]);
        }
        for (place, colour) in cut.positions.iter().zip(&cut.colours) {
            assert!((colour[2] - place.x).abs() < 1e-6 && (colour[0] + place.x - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_large_mesh_of_noise_grows_no_more_than_twofold() {
        let mut noise = square([RED, BLUE, RED, BLUE]);
        noise.triangles = noise.triangles.repeat(20_000);
        let colours = [RED, BLUE].into_iter().cycle();
        let fresh = noise.triangles.len() as u32 * 3;
        noise.triangles = (0..fresh / 3).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        noise.positions = (0..fresh).map(|at| Vec3::new((at % 7) as f32, (at % 5) as f32, 0.0)).collect();
        noise.colours = colours.take(fresh as usize).collect();
        let cut = noise.cut();
        assert_eq!((cut.triangles.len(), cut.positions.len()), (40_000, 120_000));
    }

    proptest! {
        /// For any colours, the pieces cover the whole, and every inner edge has two sides.
        #[test]
        fn pieces_cover_the_whole_without_a_crack(colours in prop::array::uniform4(
            prop::array::uniform4(0.0f32..1.0),
        )) {
            let cut = square(colours).cut();
            prop_assert!((cut.area() - 1.0).abs() < 1e-4);
            let mut sides: HashMap<(u32, u32), i32> = HashMap::new();
            for &[a, b, c] in &cut.triangles {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *sides.entry((from.min(to), from.max(to))).or_default() += 1;
                }
            }
            let on_rim = |corner: u32| {
                let place = cut.positions[corner as usize];
                [place.x == 0.0, place.x == 1.0, place.y == 0.0, place.y == 1.0]
            };
            for ((from, to), count) in sides {
                let rim = on_rim(from).into_iter().zip(on_rim(to)).any(|(a, b)| a && b);
                prop_assert_eq!(count, if rim { 1 } else { 2 });
            }
        }
    }
}
