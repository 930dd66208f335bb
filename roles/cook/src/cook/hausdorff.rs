//! The certificate: an upper bound of the two-sided Hausdorff distance between two triangle meshes.
//!
//! Branch and bound. The distance to a surface changes by at most the distance moved (it is 1-Lipschitz), and
//! the distance to *one* triangle is a convex function, so over a piece of the other mesh it is greatest at a
//! corner. Both bound the distance over a whole triangle from its corners alone, which settles most
//! triangles. The rest are cut, worst first, until the worst bound is within 5 % of the largest distance
//! seen: along the outline of the facet below, where two facets are equally far, or in halves. The same holds
//! for two triangles that together are flat and convex (see `facets`); "facet" below means either.
//!
//! Measured on the levels of a real plant and of a building of bricks, 7,482 pairs of meshes: the work limit
//! was reached for 5. The bound was within 5 % of the largest distance seen for all but those and 11 below
//! the floor.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::Vec3;

use super::bvh::{Bvh, Nearest};
use super::facets::FLATNESS;
use super::polygon::{Cut, Polygon};
use crate::lists::{at, put};

/// How far the bound may be above the largest distance seen: 5 %.
const GAP: f32 = 1.05;
/// Distances below this fraction of the meshes' extent are negligible (0.1 pixels if the mesh fills 1,000).
const FLOOR: f32 = 2e-4;
/// Rounding of coordinates and distances, and slightly curved facets, relative to the largest coordinate.
pub(super) const ROUNDING: f32 = 2e-6 + 2.0 * FLATNESS;
/// The limit of nearest-facet searches, per triangle of the two meshes; beyond it, the bound so far is
/// returned.
const SEARCHES: usize = 4;
/// How far beyond a facet's outline a piece may reach, relative to the largest distance seen. Half the gap
/// remains even if two walls meet at a right angle: the square root of 1 + 2 * 0.15^2 is 1.022.
const SLACK: f32 = 0.15;
/// A part that is not settled must have less than this fraction of the original area.
const ENOUGH: f32 = 0.75;

/// A mesh with its hierarchy, prepared for measurements against others.
#[derive(Debug)]
pub(super) struct Surface<'a> {
    pub(super) positions: &'a [Vec3],
    pub(super) indices: &'a [u32],
    bvh: Bvh,
}

impl<'a> Surface<'a> {
    pub(super) fn new(positions: &'a [Vec3], indices: &'a [u32]) -> Self {
        Self { positions, indices, bvh: Bvh::new(positions, indices) }
    }

    fn corner(&self, index: u32) -> Vec3 {
        at(self.positions, index)
    }
}

/// An upper bound of the two-sided Hausdorff distance between two meshes, given as positions and corner
/// indices in one frame: no point of either is farther than this from the other. Within 5 % of the distance,
/// unless that is below 2e-4 of the meshes' extent, or the work limit for the meshes' size is reached: the
/// bound is valid then too, but looser. Two meshes without triangles are 0 apart; one without is infinitely
/// far from one with.
///
/// Indices past the positions count as the origin. Not-finite positions give a meaningless result, never a
/// panic.
#[must_use]
pub fn hausdorff_bound(a: (&[Vec3], &[u32]), b: (&[Vec3], &[u32])) -> f32 {
    bound(&Surface::new(a.0, a.1), &Surface::new(b.0, b.1))
}

/// As [`hausdorff_bound`].
pub(super) fn bound(a: &Surface<'_>, b: &Surface<'_>) -> f32 {
    match (a.indices.len() < 3, b.indices.len() < 3) {
        (true, true) => return 0.0,
        (false, false) => {}
        _ => return f32::INFINITY,
    }
    let used =
        |s: &Surface<'_>| s.indices.iter().fold(0.0_f32, |m, &i| m.max(s.corner(i).abs().max_element()));
    let extent = used(a).max(used(b));
    let searches = SEARCHES * (a.indices.len() + b.indices.len()) / 3 + 512;
    let mut search =
        Search { lower: 0.0, settled: 0.0, floor: FLOOR * extent, budget: searches, open: BinaryHeap::new() };
    // Corners of both sides first: the larger the distance seen, the fewer triangles are in question.
    let sides = [(a, b, false), (b, a, true)];
    let corners = sides.map(|(from, to, _)| search.corners(from, to));
    for ((from, to, to_first), corners) in sides.iter().zip(&corners) {
        search.add_triangles(from, to, *to_first, corners);
    }
    search.budget = searches;
    while search.budget > 0 {
        let Some(piece) = search.open.pop() else { break };
        if piece.bound <= search.goal() {
            search.settled = search.settled.max(piece.bound);
            search.open.clear(); // the others' bounds are lower still
            break;
        }
        search.refine(&piece, if piece.to_first { &a.bvh } else { &b.bvh });
    }
    let open = search.open.peek().map_or(0.0, |piece| piece.bound);
    search.lower.max(search.settled).max(open) + ROUNDING * extent
}

/// A part of a triangle whose bound is not good enough yet.
#[derive(Debug, Clone, Copy)]
struct Piece {
    bound: f32,
    /// Whether distances go to the first of the two meshes.
    to_first: bool,
    /// A facet near all of it: the bound is the distance to it unless it came from elsewhere.
    facet: u32,
    polygon: Polygon,
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Piece {}

impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Piece {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

#[derive(Debug)]
struct Search {
    /// The largest distance seen at a point.
    lower: f32,
    /// The largest bound that was good enough when found.
    settled: f32,
    floor: f32,
    /// How many nearest-facet searches are left.
    budget: usize,
    open: BinaryHeap<Piece>,
}

impl Search {
    /// The bound that is good enough now.
    fn goal(&self) -> f32 {
        (self.lower * GAP).max(self.floor)
    }

    fn nearest(&mut self, point: Vec3, to: &Bvh, hint: u32) -> Nearest {
        self.budget = self.budget.saturating_sub(1);
        let nearest =
            to.nearest(point, hint).unwrap_or(Nearest { distance: f32::INFINITY, triangle: 0, facet: 0 });
        self.lower = self.lower.max(nearest.distance);
        nearest
    }

    /// The nearest facet of each vertex that a triangle uses; `None` for the others.
    fn corners(&mut self, from: &Surface<'_>, to: &Surface<'_>) -> Vec<Option<Nearest>> {
        let shared = std::ptr::eq(from.positions, to.positions);
        let mut found = vec![None; from.positions.len()];
        if shared {
            // A vertex of both is nearest to itself.
            for (&[a, b, c], facet) in to.indices.as_chunks::<3>().0.iter().zip(to.bvh.facets()) {
                for index in [a, b, c] {
                    put(&mut found, index, Some(Nearest { distance: 0.0, triangle: facet, facet }));
                }
            }
        }
        let mut hint = 0;
        for &index in from.indices {
            if let Some(slot @ None) = found.get_mut(index as usize) {
                let nearest = self.nearest(from.corner(index), &to.bvh, hint);
                hint = nearest.triangle;
                *slot = Some(nearest);
            }
        }
        found
    }

    /// Bounds all triangles of `from`; those not settled wait in the queue.
    fn add_triangles(
        &mut self,
        from: &Surface<'_>,
        to: &Surface<'_>,
        to_first: bool,
        corners: &[Option<Nearest>],
    ) {
        for triangle in from.indices.as_chunks::<3>().0 {
            let points = triangle.map(|index| from.corner(index));
            let known = triangle.map(|index| corners.get(index as usize).copied().flatten());
            let [Some(a), Some(b), Some(c)] = known else { continue };
            let mut piece =
                Piece { bound: f32::INFINITY, to_first, facet: a.facet, polygon: Polygon::triangle(points) };
            let [p, q, r] = points;
            // No point of a triangle is farther from its nearest corner than the longest edge over the square
            // root of three.
            let longest = p.distance(q).max(q.distance(r)).max(r.distance(p));
            let farthest = a.distance.max(b.distance).max(c.distance);
            piece.bound = farthest + longest * 0.577_350_3;
            if piece.bound > self.goal() {
                piece.try_facet(a.facet, &to.bvh);
            }
            if piece.bound > self.goal() && b.facet != a.facet {
                piece.try_facet(b.facet, &to.bvh);
            }
            if piece.bound > self.goal() && c.facet != a.facet && c.facet != b.facet {
                piece.try_facet(c.facet, &to.bvh);
            }
            self.add(piece, &to.bvh, a.triangle);
        }
    }

    /// Settles a piece, if necessary by the facet nearest to its middle, or queues it.
    fn add(&mut self, mut piece: Piece, to: &Bvh, hint: u32) {
        if piece.bound > self.goal() {
            let middle = piece.polygon.centre();
            let nearest = self.nearest(middle, to, hint);
            let reach = piece.polygon.corners().iter().fold(0.0_f32, |m, p| m.max(p.distance(middle)));
            piece.bound = piece.bound.min(nearest.distance + reach);
            piece.facet = nearest.facet;
            piece.try_facet(nearest.facet, to);
        }
        self.keep(piece);
    }

    fn keep(&mut self, piece: Piece) {
        if piece.bound <= self.goal() {
            self.settled = self.settled.max(piece.bound);
        } else {
            self.open.push(piece);
        }
    }

    /// Replaces a piece by parts with lower bounds. The whole's bounds hold for each part.
    fn refine(&mut self, piece: &Piece, to: &Bvh) {
        let much_larger = piece.polygon.extent() > 2.0 * to.extent_of(piece.facet);
        if !much_larger && (self.cut_to_outline(piece, to) || self.cut_between_facets(piece, to)) {
            return;
        }
        for polygon in piece.polygon.halves() {
            self.add(Piece { polygon, ..*piece }, to, piece.facet);
        }
    }

    /// Cuts off the area that is not above the piece's facet. False if that is nothing, or all.
    fn cut_to_outline(&mut self, piece: &Piece, to: &Bvh) -> bool {
        // A little beyond the outline the facet is hardly farther, and this avoids slivers.
        let slack = SLACK * self.lower.max(self.floor);
        let mut above = piece.polygon;
        let mut outside = [None; 4];
        for ((through, inwards), slot) in to.walls(piece.facet).into_iter().flatten().zip(&mut outside) {
            match above.cut(|p| inwards.dot(p - through) + slack) {
                Some(Cut::Both(within, beyond)) => (above, *slot) = (within, Some(beyond)),
                Some(Cut::Positive) => {}
                Some(Cut::Negative) | None => return false,
            }
        }
        if outside.iter().all(Option::is_none) {
            return false;
        }
        let mut above = Piece { polygon: above, ..*piece };
        above.try_facet(piece.facet, to);
        if !self.helps(piece, &above)
            || !outside.iter().flatten().all(|part| part.area() < ENOUGH * piece.polygon.area())
        {
            return false;
        }
        self.keep(above);
        for polygon in outside.into_iter().flatten() {
            self.add(Piece { polygon, ..*piece }, to, piece.facet);
        }
        true
    }

    /// Cuts along the line at which the piece's facet and the one nearest to its farthest corner are equally
    /// far. False if there is no such line.
    fn cut_between_facets(&mut self, piece: &Piece, to: &Bvh) -> bool {
        let far = piece.polygon.corners().iter().map(|&p| (to.distance_to(piece.facet, p), p));
        let Some((_, farthest)) = far.reduce(|m, next| if next.0 > m.0 { next } else { m }) else {
            return false;
        };
        let other = self.nearest(farthest, to, piece.facet).facet;
        if other == piece.facet {
            return false;
        }
        let gain = |p: Vec3| to.distance_to(piece.facet, p) - to.distance_to(other, p);
        let Some(Cut::Both(nearer_other, nearer_own)) = piece.polygon.cut(gain) else { return false };
        let parts = [(other, nearer_other), (piece.facet, nearer_own)].map(|(facet, polygon)| {
            let mut part = Piece { facet, polygon, ..*piece };
            part.try_facet(facet, to);
            part
        });
        let helps = parts.iter().all(|part| self.helps(piece, part));
        if helps {
            parts.into_iter().for_each(|part| self.keep(part));
        }
        helps
    }

    /// Whether a part is progress: settled, or clearly smaller than the whole. Cuts that only chip at a piece
    /// never end.
    fn helps(&self, whole: &Piece, part: &Piece) -> bool {
        part.bound <= self.goal() || part.polygon.area() < ENOUGH * whole.polygon.area()
    }
}

impl Piece {
    /// Lowers the bound to the distance to one facet, if that is less: it is convex, so greatest at a corner.
    fn try_facet(&mut self, facet: u32, to: &Bvh) {
        let farthest = self.polygon.corners().iter().fold(0.0_f32, |m, &p| m.max(to.distance_to(facet, p)));
        if farthest < self.bound {
            (self.bound, self.facet) = (farthest, facet);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: usize = 100;

    fn search(lower: f32) -> Search {
        Search { lower, settled: 0.0, floor: 0.0, budget: BUDGET, open: BinaryHeap::new() }
    }

    fn piece(bound: f32, points: [Vec3; 3]) -> Piece {
        Piece { bound, to_first: false, facet: 0, polygon: Polygon::triangle(points) }
    }

    fn v(x: f32, y: f32, z: f32) -> Vec3 {
        Vec3::new(x, y, z)
    }

    /// A rectangle in the ground, as two triangles.
    fn plate(x: [f32; 2], y: [f32; 2]) -> Vec<Vec3> {
        let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j): (usize, usize)| v(x[i], y[j], 0.0));
        vec![a, b, c, a, c, d]
    }

    fn bvh(corners: &[Vec3]) -> Bvh {
        Bvh::new(corners, &(0..corners.len() as u32).collect::<Vec<_>>())
    }

    #[test]
    fn the_worst_piece_comes_first() {
        let of = |bound| piece(bound, [Vec3::ZERO; 3]);
        let mut open: BinaryHeap<Piece> = BinaryHeap::new();
        for bound in [3.0, 1.0, 5.0, 2.0, 4.0] {
            open.push(of(bound));
        }
        let order: Vec<f32> = std::iter::from_fn(|| open.pop()).map(|piece| piece.bound).collect();
        assert_eq!(order, [5.0, 4.0, 3.0, 2.0, 1.0]);
        assert!(of(1.0) == of(1.0) && of(1.0) != of(2.0));
    }

    #[test]
    fn corners_settle_a_triangle_over_one_facet_or_far_from_all() {
        // A plate, with a small triangle below two of the three corners.
        let [p, q, r] = [v(0.0, 0.0, 1.0), v(4.0, 0.0, 1.0), v(2.0, 4.0, 1.0)];
        let small = |p: Vec3| [0.0, 0.01, -0.01].map(|x| p + v(x, x * x, -0.99));
        let ground = [plate([-9.0, 9.0], [-9.0, 9.0]), small(q).to_vec(), small(r).to_vec()].concat();
        // Three points, each at 1 from its own corner and beyond the goal from the others.
        let rays = [v(0.0, 1.0, 0.0), v(0.75_f32.sqrt(), -0.5, 0.0), v(-0.75_f32.sqrt(), -0.5, 0.0)];
        let far = rays.map(|ray| ray * 0.08 / 3.0_f32.sqrt());
        let points = rays.map(|ray| [ray * (1.0 + 0.08 / 3.0_f32.sqrt()); 3]).concat();
        let rows = [([p, q, r], &ground), ([q, p, r], &ground), ([q, r, p], &ground), (far, &points)];
        for (triangle, to) in rows {
            let indices: Vec<u32> = (0..to.len() as u32).collect();
            let (from, to) = (Surface::new(&triangle, &[0, 1, 2]), Surface::new(to, &indices));
            let mut search = search(0.0);
            let corners = search.corners(&from, &to);
            search.add_triangles(&from, &to, false, &corners);
            assert_eq!((search.budget, search.open.len()), (BUDGET - 3, 0), "{triangle:?}");
            assert!((1.0..=1.05).contains(&search.settled), "{triangle:?}: {}", search.settled);
        }
    }

    #[test]
    fn a_piece_between_two_facets_is_cut_where_they_are_equally_far() {
        let to = bvh(&[plate([-4.0, -1.0], [-4.0, 4.0]), plate([1.0, 4.0], [-4.0, 4.0])].concat());
        let points = [v(-1.5, -1.0, 1.0), v(1.5, -1.0, 1.0), v(0.0, 1.0, 1.0)];
        let root = 2.0_f32.sqrt();
        let mut search = search(root);
        search.refine(&piece(f32::INFINITY, points), &to);
        assert_eq!((search.budget, search.open.len()), (BUDGET - 1, 0));
        assert!((search.settled - root).abs() < 1e-6, "{}", search.settled);
        // A bound from elsewhere stays, and each part is of its own facet from then on.
        let mut search = Search { lower: 1.0, budget: BUDGET, ..search };
        search.refine(&piece(1.2, points), &to);
        let mut facets: Vec<(u32, f32)> = search.open.iter().map(|part| (part.facet, part.bound)).collect();
        facets.sort_by_key(|part| part.0);
        assert_eq!(facets, [(0, 1.2), (2, 1.2)]);
    }

    #[test]
    fn a_piece_is_cut_along_an_outline_that_it_crosses_by_enough() {
        let over = |x: f32| [v(0.0, 0.0, 1.0), v(x, 0.0, 1.0), v(0.0, 3.0, 1.0)];
        let wide = [v(0.0, 0.0, 1.0), v(8.0, -2.0, 1.0), v(8.0, 2.0, 1.0)];
        let rows = [
            ("within the slack", over(4.1), 1.0, false),
            ("beyond it", over(4.3), 1.0, true),
            ("three quarters are outside", wide, 0.0, false),
        ];
        let to = bvh(&plate([-1.0, 4.0], [-9.0, 9.0]));
        for (name, points, lower, cut) in rows {
            assert_eq!(search(lower).cut_to_outline(&piece(f32::INFINITY, points), &to), cut, "{name}");
        }
    }

    #[test]
    fn a_piece_more_than_twice_as_long_as_its_facet_is_halved() {
        for scale in [1.0, 1.0 / 64.0] {
            // A search for each half, or one for the part outside.
            for (length, searches) in [(10.0, 2), (15.0, 1)] {
                let to: Vec<Vec3> =
                    plate([-1.0, length - 1.0], [-1.0, 7.0]).iter().map(|p| *p * scale).collect();
                let points = [v(0.0, 0.0, 1.0), v(30.0, 0.0, 1.0), v(0.0, 6.0, 1.0)].map(|p| p * scale);
                let mut search = search(0.1 * scale);
                search.refine(&piece(f32::INFINITY, points), &bvh(&to));
                assert_eq!(search.budget, BUDGET - searches, "{length} at {scale}");
            }
        }
    }

    #[test]
    fn a_part_helps_if_it_is_settled_or_clearly_smaller() {
        let triangle = |bound, area| piece(bound, [Vec3::ZERO, v(area, 0.0, 0.0), v(0.0, 2.0, 0.0)]);
        let rows = [(9.0, 2.9, true), (9.0, 3.0, false), (9.0, 3.1, false), (2.1, 4.0, true)];
        for (bound, area, helps) in rows {
            let helped = search(2.0).helps(&triangle(9.0, 4.0), &triangle(bound, area));
            assert_eq!(helped, helps, "{bound} {area}");
        }
    }
}
