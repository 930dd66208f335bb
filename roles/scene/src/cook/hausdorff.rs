//! The certificate: an upper bound of the two-sided Hausdorff distance between two triangle meshes.
//!
//! Branch and bound. The distance to a surface changes by at most the way one walks (it is 1-Lipschitz), and the distance to
//! *one* triangle is a convex function, so over a piece of the other mesh it is greatest at a corner. Both bound the distance
//! over a whole triangle from its corners alone; most triangles are settled by that. The rest are cut in two, worst first, until
//! the worst bound is within 5 % of the largest distance seen. The same holds for two triangles that together are flat and
//! convex (see `facets`), which is what "facet" means below.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::Vec3;

use super::bvh::{Bvh, Nearest};
use super::facets::FLATNESS;

/// How far the bound may be above the largest distance seen: 5 %.
const GAP: f32 = 1.05;
/// Distances below this part of the meshes' extent are as good as none (0.1 pixels where the mesh fills 1,000).
const FLOOR: f32 = 2e-4;
/// Rounding of coordinates and distances, and facets that are not quite flat, as part of the largest coordinate.
const ROUNDING: f32 = 1e-6 + 2.0 * FLATNESS;
/// Cuts allowed for each triangle of the two meshes; where they run out, the bound is what has been shown until then.
const CUTS: usize = 4;

/// A mesh with its hierarchy, ready to be measured against others.
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
        self.positions.get(index as usize).copied().unwrap_or_default()
    }
}

/// An upper bound of the two-sided Hausdorff distance between two meshes, given as positions and corner indices in one frame:
/// no point of either is farther than this from the other. Within 5 % of the distance, unless that is below 2e-4 of the
/// meshes' extent, or the work allowed for the two meshes' size runs out: the
/// bound holds then too, but is looser. Two meshes without triangles are 0 apart; one without is infinitely far from one with.
///
/// Indices past the positions count as the origin. Not-finite positions give a meaningless result, never a panic.
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
    let mut search = Search { lower: 0.0, settled: 0.0, floor: FLOOR * extent, open: BinaryHeap::new() };
    // Corners of both sides first: the larger the distance seen, the fewer triangles are in question.
    let sides = [(a, b, false), (b, a, true)];
    let corners = sides.map(|(from, to, _)| search.corner_distances(from, to));
    for ((from, to, to_first), corners) in sides.iter().zip(&corners) {
        search.add_triangles(from, to, *to_first, corners);
    }
    let budget = CUTS * (a.indices.len() + b.indices.len()) / 3 + 256;
    for _ in 0..budget {
        let Some(piece) = search.open.pop() else { break };
        if search.settles(piece.bound) {
            search.settled = search.settled.max(piece.bound);
            search.open.clear(); // the others' bounds are lower still
            break;
        }
        search.cut(&piece, if piece.to_first { &a.bvh } else { &b.bvh });
    }
    let open = search.open.peek().map_or(0.0, |piece| piece.bound);
    search.lower.max(search.settled).max(open) + ROUNDING * extent
}

/// A point of one mesh and what is nearest to it on the other.
#[derive(Debug, Clone, Copy)]
struct Sample {
    point: Vec3,
    nearest: Nearest,
}

/// A part of a triangle whose bound is not yet good enough.
#[derive(Debug, Clone, Copy)]
struct Piece {
    bound: f32,
    /// Whether the mesh that distances go to is the first of the two.
    to_first: bool,
    corners: [Sample; 3],
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
    /// The largest bound that was good enough when it was found.
    settled: f32,
    floor: f32,
    open: BinaryHeap<Piece>,
}

impl Search {
    /// Whether a bound is as good as the largest distance seen allows.
    fn settles(&self, bound: f32) -> bool {
        bound <= (self.lower * GAP).max(self.floor)
    }

    fn sample(&mut self, point: Vec3, to: &Bvh, hint: u32) -> Sample {
        let nearest =
            to.nearest(point, hint).unwrap_or(Nearest { distance: f32::INFINITY, triangle: 0, facet: 0 });
        self.lower = self.lower.max(nearest.distance);
        Sample { point, nearest }
    }

    /// What is nearest to each vertex that a triangle uses; `None` for the others.
    fn corner_distances(&mut self, from: &Surface<'_>, to: &Surface<'_>) -> Vec<Option<Nearest>> {
        let mut found = vec![None; from.positions.len()];
        let mut hint = 0;
        for &index in from.indices {
            if let Some(slot @ None) = found.get_mut(index as usize) {
                let nearest = self.sample(from.corner(index), &to.bvh, hint).nearest;
                hint = nearest.triangle;
                *slot = Some(nearest);
            }
        }
        found
    }

    /// Bounds all triangles of `from`; those that are not settled wait in the queue.
    fn add_triangles(
        &mut self,
        from: &Surface<'_>,
        to: &Surface<'_>,
        to_first: bool,
        corners: &[Option<Nearest>],
    ) {
        for triangle in from.indices.as_chunks::<3>().0 {
            let samples = triangle.map(|index| {
                let point = from.corner(index);
                match corners.get(index as usize).copied().flatten() {
                    Some(nearest) => Sample { point, nearest },
                    None => self.sample(point, &to.bvh, 0),
                }
            });
            let bound = corner_bound(&samples, &to.bvh);
            if self.settles(bound) {
                self.settled = self.settled.max(bound);
                continue;
            }
            // Neighbours tie at corners and edges; the middle tells which triangle lies below.
            let [a, b, c] = samples.map(|s| s.point);
            let middle = self.sample((a + b + c) / 3.0, &to.bvh, samples[0].nearest.triangle);
            let reach = samples.iter().fold(0.0_f32, |m, s| m.max(s.point.distance(middle.point)));
            let bound = bound.min(middle.nearest.distance + reach).min(facet_bound(
                &samples,
                &to.bvh,
                middle.nearest.facet,
            ));
            self.add(Piece { bound, to_first, corners: samples });
        }
    }

    fn add(&mut self, piece: Piece) {
        if self.settles(piece.bound) {
            self.settled = self.settled.max(piece.bound);
        } else {
            self.open.push(piece);
        }
    }

    /// Cuts a piece in two. What held for the whole holds for both halves.
    fn cut(&mut self, piece: &Piece, to: &Bvh) {
        let [a, b, c] = piece.corners;
        let edges = [(a, b, c), (b, c, a), (c, a, b)].map(|(s, t, rest)| (Edge::new(s, t, to), rest));
        // Across the edge whose ends know least of each other's facets: a long strip over a long facet is not cut short.
        let [first, second, third] = edges;
        let wider = if second.0.apart > first.0.apart { second } else { first };
        let (edge, rest) = if third.0.apart > wider.0.apart { third } else { wider };
        let point = edge.turn();
        // The facets at hand may do: then nothing need be searched.
        let known = [edge.from, edge.to, rest].map(|s| {
            let facet = s.nearest.facet;
            Nearest { distance: to.distance_to(facet, point), triangle: s.nearest.triangle, facet }
        });
        let nearest = known.into_iter().fold(known[0], |n, k| if k.distance < n.distance { k } else { n });
        let halves = |middle: Sample| {
            [[edge.from, middle, rest], [middle, edge.to, rest]].map(|corners| {
                let bound = corner_bound(&corners, to).min(piece.bound);
                Piece { bound, corners, ..*piece }
            })
        };
        let mut pieces = halves(Sample { point, nearest });
        if !pieces.iter().all(|half| self.settles(half.bound)) {
            pieces = halves(self.sample(point, to, nearest.triangle));
        }
        pieces.into_iter().for_each(|half| self.add(half));
    }
}

/// An edge of a piece, and how far its ends are from each other's facets.
#[derive(Debug, Clone, Copy)]
struct Edge {
    from: Sample,
    to: Sample,
    /// From the first end to the facet of the second.
    from_other: f32,
    /// From the second end to the facet of the first.
    to_other: f32,
    /// The larger of the two; 0 if one facet is nearest to both ends, as it then holds for the whole edge.
    apart: f32,
}

impl Edge {
    fn new(from: Sample, to: Sample, surface: &Bvh) -> Self {
        let from_other = surface.distance_to(to.nearest.facet, from.point);
        let to_other = surface.distance_to(from.nearest.facet, to.point);
        let apart = if from.nearest.facet == to.nearest.facet { 0.0 } else { from_other.max(to_other) };
        Self { from, to, from_other, to_other, apart }
    }

    /// Where the edge passes from above one facet to above the other, as if both distances were linear: cut there, either
    /// part is above one facet. Kept off the ends so that parts do shrink.
    fn turn(&self) -> Vec3 {
        let before = (self.from_other - self.from.nearest.distance).max(0.0);
        let after = (self.to_other - self.to.nearest.distance).max(0.0);
        let part = before / (before + after);
        let part = if part > 0.1 && part < 0.9 { part } else { 0.5 };
        self.from.point.lerp(self.to.point, part)
    }
}

/// A bound of the distance over a triangle from what is nearest to its corners.
fn corner_bound(corners: &[Sample; 3], to: &Bvh) -> f32 {
    let [a, b, c] = corners;
    let longest = a.point.distance(b.point).max(b.point.distance(c.point)).max(c.point.distance(a.point));
    let farthest = corners.iter().fold(0.0_f32, |m, s| m.max(s.nearest.distance));
    // No point of a triangle is farther from its nearest corner than the longest edge over the square root of three.
    let mut bound = farthest + longest * 0.577_350_3;
    for (index, corner) in corners.iter().enumerate() {
        let known = corners.iter().take(index).any(|s| s.nearest.facet == corner.nearest.facet);
        if !known {
            bound = bound.min(facet_bound(corners, to, corner.nearest.facet));
        }
    }
    bound
}

/// The distance over a piece to one facet: convex, so greatest at a corner.
fn facet_bound(corners: &[Sample; 3], to: &Bvh, facet: u32) -> f32 {
    corners.iter().fold(0.0_f32, |m, s| {
        m.max(if s.nearest.facet == facet { s.nearest.distance } else { to.distance_to(facet, s.point) })
    })
}
