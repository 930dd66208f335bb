//! Thins triangles by clustering their corners, and bounds the error.
//!
//! Space is cut into cells. All corners in a cell become one, at the middle of the box around them, so none
//! moves by more than half a cell's diagonal, and no point of a triangle by more than its corners. That alone
//! bounds the distance, both ways, for each triangle whose corners are in three cells, without measuring.
//!
//! The others collapse to a segment or a point. If that is an edge or a corner of the result, they are near
//! it. If a facet of the result is near all their corners, they are dropped too, and that distance counts.
//! For the rest one triangle stays that contains the segment or point, with an original corner: so nothing
//! vanishes that is far from the result.

use glam::Vec3;

use super::bvh::Bvh;
use super::gather::Soup;
use super::hausdorff::ROUNDING;
use crate::lists::{at, put};
use trimaran_scene::{Rgba8, Vertex};

/// The side of a cell, relative to the reach. Half of its diagonal is a little more than the reach, but cells
/// are hardly ever full.
const SIDE: f32 = 1.3;

/// Fewer triangles in place of others.
#[derive(Debug)]
pub(super) struct Thinned {
    corners: Vec<Vertex>,
    /// No point of either is farther from the other than this.
    pub(super) error: f32,
}

/// Thins triangles to at most `most`, so that none of their points is much farther than `reach` from the
/// result, nor the other way round. `None` if there is nothing to thin, the reach allows no cells, or more
/// would be left.
pub(super) fn thin(soup: &Soup, reach: f32, most: usize) -> Option<Thinned> {
    let cells = Cells::new(soup, SIDE * reach)?;
    let image = |(index, corners): (u32, &[u32; 3])| Image::new(index, *corners, soup, &cells);
    let images = (0_u32..).zip(soup.triangles()).map(image);
    let (mut whole, mut collapsed): (Vec<_>, Vec<_>) =
        images.partition(|image| image.shape() == Shape::Triangle);
    let mut left = Left::new(soup, &cells);
    whole.sort_unstable();
    for first in whole.chunk_by(Image::is_same).filter_map(<[_]>::first) {
        left.keep_triangle(first);
    }
    if left.count() > most {
        return None;
    }
    let mut error = cells.radius;
    collapsed.sort_unstable();
    for shape in collapsed.chunk_by(|a, b| a.shape() == b.shape()) {
        let bvh = left.bvh();
        for group in shape.chunk_by(Image::is_same) {
            let Some(first) = group.first().filter(|first| !left.holds(first)) else { continue };
            match left.farthest(&bvh, first, group) {
                Some(distance) if distance <= reach => error = error.max(distance),
                _ => left.keep_one(group),
            }
        }
        if left.count() > most {
            return None;
        }
    }
    Some(Thinned { corners: left.corners, error: error + ROUNDING * cells.extent })
}

impl Thinned {
    pub(super) fn count(&self) -> usize {
        self.corners.len() / 3
    }

    /// The vertices, and three indices for each triangle.
    pub(super) fn into_mesh(self) -> (Vec<Vertex>, Vec<u32>) {
        let (count, remap) = meshopt::generate_vertex_remap(&self.corners, None);
        let indices = meshopt::optimize_vertex_cache(&remap, count);
        let mut vertices = vec![Vertex::new([0.0; 3], Rgba8([0; 4])); count];
        for (vertex, &slot) in self.corners.iter().zip(&remap) {
            put(&mut vertices, slot, *vertex);
        }
        (vertices, indices)
    }
}

/// Clusters of corners.
#[derive(Debug)]
struct Cells {
    /// The cell of each vertex.
    of: Vec<u32>,
    /// The new corner of each cell.
    middles: Vec<Vec3>,
    /// No corner moves farther than this.
    radius: f32,
    /// The largest coordinate.
    extent: f32,
}

impl Cells {
    fn new(soup: &Soup, side: f32) -> Option<Self> {
        let scale = side.recip();
        if !scale.is_finite() || soup.indices.is_empty() {
            return None;
        }
        let key = |p: &Vec3| (*p * scale).floor().as_ivec3().to_array();
        let keys: Vec<[i32; 3]> = soup.positions.iter().map(key).collect();
        let (count, of) = meshopt::generate_vertex_remap(&keys, None);
        let mut boxes = vec![(Vec3::INFINITY, Vec3::NEG_INFINITY); count];
        for (&cell, &p) in of.iter().zip(&soup.positions) {
            if let Some((low, high)) = boxes.get_mut(cell as usize) {
                (*low, *high) = (low.min(p), high.max(p));
            }
        }
        let middles: Vec<Vec3> = boxes.into_iter().map(|(low, high)| low.midpoint(high)).collect();
        let moved = of
            .iter()
            .zip(&soup.positions)
            .filter_map(|(&cell, &p)| Some(p.distance(*middles.get(cell as usize)?)));
        let radius = moved.fold(0.0, f32::max);
        let extent = soup.positions.iter().fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
        Some(Self { of, middles, radius, extent })
    }

    fn cell(&self, vertex: u32) -> u32 {
        at(&self.of, vertex)
    }

    fn middle(&self, cell: u32) -> Vec3 {
        at(&self.middles, cell)
    }
}

/// The result for a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    Triangle,
    Segment,
    Point,
}

/// A triangle with its corners moved to their cells' middles. Triangles come before segments and these before
/// points, then equal cells together, larger ones first. As numbers these are sorted in a third of the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Image {
    /// The shape, and the cells of its corners, ascending; a segment's second one is there twice.
    group: u128,
    /// The complement of the bits of twice the triangle's area, and its index.
    order: u64,
}

impl Image {
    fn new(index: u32, corners: [u32; 3], soup: &Soup, cells: &Cells) -> Self {
        let [a, b, c] = corners.map(|corner| soup.position(corner));
        let area = (b - a).cross(c - a).length();
        let mut image = corners.map(|corner| cells.cell(corner));
        image.sort_unstable();
        let [x, y, z] = image;
        let shape = match (x == y, y == z) {
            (false, false) => Shape::Triangle,
            (true, true) => Shape::Point,
            _ => Shape::Segment,
        };
        let image = [shape as u32, x, if shape == Shape::Segment { z } else { y }, z];
        Self {
            group: image.iter().fold(0, |group, &number| group << 32 | u128::from(number)),
            order: u64::from(!area.to_bits()) << 32 | u64::from(index),
        }
    }

    fn is_same(&self, other: &Self) -> bool {
        self.group == other.group
    }

    const fn shape(&self) -> Shape {
        match self.group >> 96 {
            0 => Shape::Triangle,
            1 => Shape::Segment,
            _ => Shape::Point,
        }
    }

    const fn cells(&self) -> [u32; 3] {
        [(self.group >> 64) as u32, (self.group >> 32) as u32, self.group as u32]
    }

    const fn index(&self) -> u32 {
        self.order as u32
    }
}

/// The result so far.
#[derive(Debug)]
struct Left<'a> {
    soup: &'a Soup,
    cells: &'a Cells,
    /// Three per triangle.
    corners: Vec<Vertex>,
    /// Pairs of cells joined by an edge; sorted once all whole triangles are there.
    edges: Vec<[u32; 2]>,
    /// Whether the middle of each cell is a corner.
    used: Vec<bool>,
}

impl<'a> Left<'a> {
    fn new(soup: &'a Soup, cells: &'a Cells) -> Self {
        Self { soup, cells, corners: Vec::new(), edges: Vec::new(), used: vec![false; cells.middles.len()] }
    }

    const fn count(&self) -> usize {
        self.corners.len() / 3
    }

    fn keep_triangle(&mut self, image: &Image) {
        let [x, y, z] = image.cells();
        self.edges.extend([[x, y], [y, z], [x, z]]);
        let middles =
            self.soup.triangle(image.index()).map(|corner| self.cells.middle(self.cells.cell(corner)));
        self.keep(image, middles);
    }

    fn keep(&mut self, image: &Image, corners: [Vec3; 3]) {
        let colour = self.soup.colour(self.soup.triangle(image.index())[0]);
        self.corners.extend(corners.map(|corner| Vertex::new(corner.to_array(), colour)));
        for cell in image.cells() {
            put(&mut self.used, cell, true);
        }
    }

    /// The result so far, for searches.
    fn bvh(&mut self) -> Bvh {
        self.edges.sort_unstable();
        let positions: Vec<Vec3> =
            self.corners.iter().map(|corner| Vec3::from_array(corner.position)).collect();
        let indices: Vec<u32> = (0..positions.len() as u32).collect();
        Bvh::new(&positions, &indices)
    }

    /// Whether a segment is an edge of the result, or a point a corner.
    fn holds(&self, image: &Image) -> bool {
        let [x, y, _] = image.cells();
        if x == y {
            self.used.get(x as usize) == Some(&true)
        } else {
            self.edges.binary_search(&[x, y]).is_ok()
        }
    }

    /// The largest distance of a group's triangles from one facet of the result. The distance to a facet is
    /// greatest at a corner, because it is convex.
    fn farthest(&self, bvh: &Bvh, first: &Image, group: &[Image]) -> Option<f32> {
        let [x, y, _] = first.cells();
        let nearest = bvh.nearest(self.cells.middle(x).midpoint(self.cells.middle(y)), 0)?;
        let corners = group.iter().flat_map(|image| self.soup.triangle(image.index()));
        let distance = |corner| bvh.distance_to(nearest.facet, self.soup.position(corner));
        Some(corners.map(distance).fold(0.0, f32::max))
    }

    /// Keeps one triangle for a group: the largest that contains the segment or the point.
    fn keep_one(&mut self, group: &[Image]) {
        let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length_squared();
        let holders = group.iter().flat_map(|image| self.holders(image).map(move |corners| (image, corners)));
        if let Some((image, corners)) = holders.max_by(|a, b| area(a.1).total_cmp(&area(b.1))) {
            self.keep(image, corners);
        }
    }

    /// Triangles that contain the segment or point of a collapsed triangle, and all its other points: of a
    /// segment, one of the two merged corners; of a point, two of three.
    fn holders(&self, image: &Image) -> impl Iterator<Item = [Vec3; 3]> + use<> {
        let corners = self.soup.triangle(image.index());
        let cells = corners.map(|corner| self.cells.cell(corner));
        let own = corners.map(|corner| self.soup.position(corner));
        let middles = cells.map(|cell| self.cells.middle(cell));
        let (held, turned) = if image.shape() == Shape::Point { (own, middles) } else { (middles, own) };
        (0..3).filter(move |&turn| cells.iter().filter(|&&cell| cell == cells[turn]).count() > 1).map(
            move |turn| {
                let mut holder = held;
                holder[turn] = turned[turn];
                holder
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::hausdorff::hausdorff_bound;
    use super::*;

    const GREY: Rgba8 = Rgba8([128; 4]);

    fn soup(triangles: &[[Vec3; 3]]) -> Soup {
        let positions = triangles.concat();
        let indices = (0..positions.len() as u32).collect();
        Soup { colours: vec![GREY; positions.len()], positions, indices, error: 0.0 }
    }

    /// The result, each corner by itself.
    fn left(thinned: Thinned) -> Vec<Vec3> {
        let (vertices, indices) = thinned.into_mesh();
        indices.iter().map(|&index| Vec3::from_array(vertices[index as usize].position)).collect()
    }

    fn small(at: Vec3, size: f32) -> [Vec3; 3] {
        [at, at + Vec3::X * size, at + Vec3::Y * size]
    }

    #[test]
    fn a_fine_grid_becomes_a_coarse_one_in_its_plane() {
        let corner = |x: usize, y: usize| Vec3::new(x as f32, y as f32, 0.5) / 10.0;
        let square = |x, y| {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [[a, b, c], [a, c, d]]
        };
        let grid: Vec<_> = (0..400).flat_map(|i| square(i % 20, i / 20)).collect();
        let thinned = thin(&soup(&grid), 0.4, usize::MAX).unwrap();
        assert!(thinned.count() < 60, "{}", thinned.count());
        assert!(thinned.error < 0.4, "{}", thinned.error);
        let left = left(thinned);
        assert!(left.iter().all(|p| p.z == 0.05));
    }

    #[test]
    fn one_of_many_small_parts_that_stand_together_stays() {
        let near_floor = small(Vec3::new(1.0, 1.0, 0.1), 0.1);
        let floor = small(Vec3::ZERO, 10.0);
        let far = [small(Vec3::new(0.1, 0.1, 5.0), 0.1), small(Vec3::new(0.2, 0.2, 5.0), 0.4)];
        let thinned = thin(&soup(&[floor, near_floor, far[0], far[1]]), 1.0, usize::MAX).unwrap();
        assert_eq!(thinned.count(), 2);
        let at_most = |most| thin(&soup(&[floor, near_floor, far[0], far[1]]), 1.0, most);
        assert!(at_most(2).is_some() && at_most(1).is_none() && at_most(0).is_none());
        let left = left(thinned);
        assert_eq!(left.iter().filter(|p| far[1].contains(p)).count(), 2, "of the larger one: {left:?}");
    }

    #[test]
    fn a_long_thin_part_stays_a_long_thin_triangle() {
        let rod = [[Vec3::ZERO, Vec3::Y * 0.1, Vec3::X * 20.0], [Vec3::ZERO, Vec3::Z * 0.05, Vec3::X * 20.0]];
        let thinned = thin(&soup(&rod), 1.0, usize::MAX).unwrap();
        assert_eq!(thinned.count(), 1);
        assert!(thinned.error < 0.1);
        let (low, high) = left(thinned)
            .into_iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        assert_eq!((low.x, high.x), (0.0, 20.0));
        assert!(high.y - low.y > 0.04 && high.z - low.z > 0.02, "it is as wide as half of the part");
    }

    #[test]
    fn nothing_comes_of_nothing() {
        assert!(thin(&soup(&[]), 1.0, 9).is_none());
        assert!(thin(&soup(&[small(Vec3::ZERO, 1.0)]), 0.0, 9).is_none());
    }

    fn triangles() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
        let point = prop::array::uniform3(-10.0..10.0_f32).prop_map(Vec3::from_array);
        let size = prop_oneof![Just(0.02_f32), Just(0.3), Just(2.0), Just(8.0)];
        let offset = || prop::array::uniform3(-1.0..1.0_f32).prop_map(Vec3::from_array);
        let triangle =
            (point, size, offset(), offset()).prop_map(|(p, size, a, b)| [p, p + a * size, p + b * size]);
        prop::collection::vec(triangle, 1..60)
    }

    proptest! {
        /// The distance measured by branch and bound is at most 5 % or its floor too large.
        #[test]
        fn the_error_is_never_below_the_distance(triangles in triangles(), reach in 0.05..8.0_f32) {
            let soup = soup(&triangles);
            let thinned = thin(&soup, reach, usize::MAX).unwrap();
            let error = thinned.error;
            prop_assert!(error <= 1.2 * reach);
            let left = left(thinned);
            let indices: Vec<u32> = (0..left.len() as u32).collect();
            let measured = hausdorff_bound((&soup.positions, &soup.indices), (&left, &indices));
            prop_assert!(measured <= 1.05 * error + 0.01, "{measured} for {error}");
        }
    }
}
