//! The solid parts of a scene, for walking: a solid heightfield, as in Mononen's Recast.
//!
//! The ground is divided into square tiles, and a tile into columns. A column has spans: solid intervals of
//! height. They contain surfaces, not the inside of closed ones: a walker cannot get there without passing a
//! triangle.

use std::{collections::BTreeSet, ops::ControlFlow};

use glam::{DVec2, DVec3};

use crate::{Drawable, Level, Node, ReadError, Scene};

/// The most spans of a column before they are joined: so a tile takes at most 16 MiB, however many triangles
/// lie above each other.
const UNJOINED: usize = 1024;
/// Triangles between two checks whether the tile is given up: a large one takes about 0.1 ms.
const BETWEEN_LOOKS: usize = 64;

/// How a scene is divided. All lengths are metres in the world, y up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heightfield {
    /// Side of a column.
    cell: f64,
    /// The unit of heights.
    unit: f64,
    /// Height zero.
    base: f64,
}

/// A solid interval of height, in units above the base: `bottom` is less than `top`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span {
    /// The lower end.
    pub bottom: u16,
    /// The upper end.
    pub top: u16,
}

/// The columns of a square of the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    field: Heightfield,
    corner: DVec2,
    /// Row by row along z, and along x within a row. Spans ascend and do not touch.
    columns: Vec<Vec<Span>>,
}

impl Heightfield {
    /// Columns along a side of a tile.
    pub const SIDE: usize = 64;
    /// The most spans of a column, so that a tile [encodes](Tile::to_bytes) to less than a mebibyte. Beyond
    /// it, the narrowest gaps are closed.
    pub const SPANS: usize = 63;

    /// The heightfield of a scene for eyes this high above floors: columns are 10 cm for eyes at 1.7 m.
    #[must_use]
    pub fn new(scene: &Scene, eye_height: f64) -> Self {
        let (min, max) = scene.nodes().first().map(Node::world_box).unwrap_or_default();
        // A scene higher than 65,536 of the usual units has coarser ones.
        let unit = (eye_height / 34.0).max((max.y - min.y) / f64::from(u16::MAX - 3));
        Self { cell: eye_height / 17.0, unit, base: min.y - unit }
    }

    /// Side of a tile. The tile of numbers x and z has its lower corner at these multiples of it.
    #[must_use]
    pub fn tile_side(&self) -> f64 {
        self.cell * Self::SIDE as f64
    }

    /// A tile, made of triangles within a quarter of a column of the finest ones.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub fn tile(&self, scene: &Scene, x: i32, z: i32) -> Result<Tile, ReadError> {
        // It is never given up.
        Ok(self.tile_unless(scene, x, z, &|| false)?.unwrap_or_else(|| self.empty_tile(x, z)))
    }

    fn empty_tile(&self, x: i32, z: i32) -> Tile {
        let corner = DVec2::new(f64::from(x), f64::from(z)) * self.tile_side();
        Tile { field: *self, corner, columns: vec![Vec::new(); Self::SIDE * Self::SIDE] }
    }

    /// The same, for a client that may leave: `None` soon after `is_given_up` says so.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub fn tile_unless(
        &self,
        scene: &Scene,
        x: i32,
        z: i32,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<Option<Tile>, ReadError> {
        scene.reading(|| self.read_tile(scene, self.empty_tile(x, z), is_given_up))?
    }

    fn read_tile(
        &self,
        scene: &Scene,
        mut tile: Tile,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<Option<Tile>, ReadError> {
        let corner = tile.corner;
        let far = corner + self.tile_side();
        let mut open = vec![0];
        while let Some(node) = open.pop().and_then(|index| scene.nodes().get(index as usize)) {
            if is_given_up() {
                return Ok(None);
            }
            let (min, max) = node.world_box();
            if max.x < corner.x || min.x > far.x || max.z < corner.y || min.z > far.y {
                continue;
            }
            match self.coarse_enough(scene, node) {
                Some(level) => {
                    for piece in level.pieces().filter_map(|id| scene.drawables().get(id.index())) {
                        if tile.add(scene, node, piece, is_given_up)?.is_break() {
                            return Ok(None);
                        }
                    }
                }
                None => open.extend(node.children()),
            }
        }
        for column in &mut tile.columns {
            join(column, Self::SPANS);
        }
        Ok(Some(tile))
    }

    /// The coarsest level of a node that is fine enough, or the finest one of a leaf.
    fn coarse_enough(&self, scene: &Scene, node: &Node) -> Option<Level> {
        let is_enough = |level: &Level| {
            let first = scene.drawables().get(level.first().index());
            first.is_some_and(|first| f64::from(first.error) <= self.cell / 4.0)
        };
        let levels = scene.levels(node);
        levels.clone().rev().find(is_enough).or_else(|| levels.clone().next().filter(|_| node.is_leaf()))
    }
}

impl Tile {
    /// The spans of a column, ascending.
    #[must_use]
    pub fn column(&self, x: usize, z: usize) -> &[Span] {
        let column = (x < Heightfield::SIDE).then(|| self.columns.get(z * Heightfield::SIDE + x)).flatten();
        column.map_or(&[], Vec::as_slice)
    }

    /// The spans at a place of the tile, ascending: lower and upper ends, metres in the world.
    pub fn spans_at(&self, x: f64, z: f64) -> impl Iterator<Item = [f64; 2]> + '_ {
        let Heightfield { cell, unit, base } = self.field;
        let along = |metres: f64| ((metres / cell).max(0.0) as usize).min(Heightfield::SIDE - 1);
        let spans = self.column(along(x - self.corner.x), along(z - self.corner.y));
        spans.iter().map(move |span| [span.bottom, span.top].map(|end| base + unit * f64::from(end)))
    }

    /// The tile encoded for pages, little-endian: x and z of its lower corner and the base (f64, metres),
    /// side of a column and unit of height (f32, metres), columns a side (u32). Then each column: the count
    /// of its spans (u16), and of each bottom and top (u16, units above the base).
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let Heightfield { cell, unit, base } = self.field;
        let mut bytes = Vec::with_capacity(36 + 6 * self.columns.len());
        for number in [self.corner.x, self.corner.y, base] {
            bytes.extend(number.to_le_bytes());
        }
        for number in [cell, unit] {
            bytes.extend((number as f32).to_le_bytes());
        }
        bytes.extend((Heightfield::SIDE as u32).to_le_bytes());
        for column in &self.columns {
            bytes.extend((column.len() as u16).to_le_bytes());
            for span in column {
                bytes.extend(span.bottom.to_le_bytes());
                bytes.extend(span.top.to_le_bytes());
            }
        }
        bytes
    }

    /// Decodes a [tile](Self::to_bytes). `None` if the bytes are invalid.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (head, mut rest) = bytes.split_at_checked(36)?;
        let double = |at: usize| Some(f64::from_le_bytes(head.get(at..at + 8)?.try_into().ok()?));
        let single = |at: usize| Some(f32::from_le_bytes(head.get(at..at + 4)?.try_into().ok()?));
        let (corner, base) = (DVec2::new(double(0)?, double(8)?), double(16)?);
        let (cell, unit) = (f64::from(single(24)?), f64::from(single(28)?));
        let side = u32::from_le_bytes(head.get(32..36)?.try_into().ok()?);
        let is_length = |length: f64| length.is_finite() && length > 0.0;
        let is_sound = corner.is_finite() && base.is_finite() && is_length(cell) && is_length(unit);
        if !is_sound || side as usize != Heightfield::SIDE {
            return None;
        }
        let mut word = || {
            let (word, others) = rest.split_first_chunk::<2>()?;
            rest = others;
            Some(u16::from_le_bytes(*word))
        };
        let mut columns = Vec::with_capacity(Heightfield::SIDE * Heightfield::SIDE);
        for _ in 0..Heightfield::SIDE * Heightfield::SIDE {
            let count = word()?;
            let mut column: Vec<Span> = Vec::new();
            for _ in 0..count {
                let span = Span { bottom: word()?, top: word()? };
                let is_above = column.last().is_none_or(|below| span.bottom > below.top);
                if !is_above || span.bottom >= span.top {
                    return None;
                }
                column.push(span);
            }
            columns.push(column);
        }
        let field = Heightfield { cell, unit, base };
        rest.is_empty().then_some(Self { field, corner, columns })
    }

    /// Whether it has no spans.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.columns.iter().all(Vec::is_empty)
    }

    /// Adds the triangles of a drawable, unless the tile is given up.
    fn add(
        &mut self,
        scene: &Scene,
        node: &Node,
        drawable: &Drawable,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<ControlFlow<()>, ReadError> {
        let geometry = scene.geometry(drawable.geometry)?;
        // In columns and units from the tile's corner and the base, to keep large coordinates precise.
        let Heightfield { cell, unit, base } = self.field;
        let origin = node.origin() - DVec3::new(self.corner.x, base, self.corner.y);
        let linear = node.linear().as_dmat3();
        let place = |position: [f32; 3]| {
            (linear * DVec3::from_array(position.map(f64::from)) + origin) / DVec3::new(cell, unit, cell)
        };
        let corners: Vec<DVec3> = geometry.vertices.iter().map(|vertex| place(vertex.position)).collect();
        for triangles in geometry.indices.as_chunks::<3>().0.chunks(BETWEEN_LOOKS) {
            if is_given_up() {
                return Ok(ControlFlow::Break(()));
            }
            for triangle in triangles {
                if let [Some(a), Some(b), Some(c)] = triangle.map(|index| corners.get(index as usize)) {
                    self.add_triangle([*a, *b, *c]);
                }
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Adds a triangle's part in each column: it is cut into rows, and these into columns.
    fn add_triangle(&mut self, triangle: [DVec3; 3]) {
        let (mut row, mut rest, mut column) =
            (Polygon::default(), Polygon::of(&triangle), Polygon::default());
        let Some(rows) = rest.cells(2) else { return };
        rest.keep(2, rows.start as f64, 1.0);
        for z in rows {
            row.clone_from(&rest);
            row.keep(2, (z + 1) as f64, -1.0);
            rest.keep(2, (z + 1) as f64, 1.0);
            let Some(columns) = row.cells(0) else { continue };
            row.keep(0, columns.start as f64, 1.0);
            for x in columns {
                column.clone_from(&row);
                column.keep(0, (x + 1) as f64, -1.0);
                row.keep(0, (x + 1) as f64, 1.0);
                let span = column.span();
                let place = self.columns.get_mut(z * Heightfield::SIDE + x);
                if let (Some(span), Some(column)) = (span, place) {
                    if column.len() >= UNJOINED {
                        join(column, UNJOINED / 2);
                    }
                    column.push(span);
                }
            }
        }
    }
}

/// A convex polygon that is being cut.
#[derive(Debug, Default, Clone)]
struct Polygon {
    corners: Vec<DVec3>,
    cut: Vec<DVec3>,
}

impl Polygon {
    fn of(triangle: &[DVec3; 3]) -> Self {
        Self { corners: triangle.to_vec(), cut: Vec::new() }
    }

    /// The tile's cells that it may touch along an axis. None if it is NaN, or outside.
    fn cells(&self, axis: usize) -> Option<std::ops::Range<usize>> {
        let along = || self.corners.iter().map(|corner| corner[axis]);
        let (low, high) = along().fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at), high.max(at)));
        let side = Heightfield::SIDE as f64;
        let is_finite = self.corners.iter().all(|corner| corner.is_finite());
        if !is_finite || low >= side || high < 0.0 {
            return None;
        }
        let (first, last) = (low.max(0.0) as usize, high.min(side - 1.0) as usize);
        Some(first..last + 1)
    }

    /// Keeps the part beyond a plane across an axis, on the `sign` side (Sutherland and Hodgman 1974).
    fn keep(&mut self, axis: usize, plane: f64, sign: f64) {
        let Some(&last) = self.corners.last() else { return };
        let beyond = |corner: DVec3| sign * (corner[axis] - plane);
        self.cut.clear();
        let mut before = last;
        for &corner in &self.corners {
            let (from, to) = (beyond(before), beyond(corner));
            if (from < 0.0) != (to < 0.0) {
                let mut crossing = before + (corner - before) * (from / (from - to));
                crossing[axis] = plane;
                self.cut.push(crossing);
            }
            if to >= 0.0 {
                self.cut.push(corner);
            }
            before = corner;
        }
        std::mem::swap(&mut self.corners, &mut self.cut);
    }

    /// Its heights, at least one unit. A flat polygon is the upper end of its span.
    fn span(&self) -> Option<Span> {
        let along = || self.corners.iter().map(|corner| corner.y);
        let low = along().reduce(f64::min)?;
        let high = along().reduce(f64::max)?;
        // Within a thousandth of a unit, so that rounding does not raise a floor by a unit.
        let top = ((high - 1e-3).ceil() as u16).max(1);
        Some(Span { bottom: (low.floor() as u16).min(top - 1), top })
    }
}

/// Sorts spans, and joins touching ones. If more than `most` are left, closes the narrowest gaps.
fn join(spans: &mut Vec<Span>, most: usize) {
    spans.sort_unstable();
    spans.dedup_by(|next, before| {
        let touches = next.bottom <= before.top;
        if touches {
            before.top = before.top.max(next.top);
        }
        touches
    });
    let excess = spans.len().saturating_sub(most);
    if excess > 0 {
        let gaps = spans.array_windows().map(|[below, above]| above.bottom - below.top);
        let mut gaps: Vec<(u16, usize)> = gaps.zip(1..).collect();
        gaps.sort_unstable();
        let closed: BTreeSet<usize> = gaps.into_iter().take(excess).map(|(_, above)| above).collect();
        let mut above = 1..;
        spans.dedup_by(|next, before| {
            let is_closed = above.next().is_some_and(|above| closed.contains(&above));
            if is_closed {
                before.top = next.top;
            }
            is_closed
        });
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::path::testing::{boxes, uncooked};

    /// Eyes at 1.7 m: columns of 10 cm, and units of 5 cm.
    fn field(scene: &Scene) -> Heightfield {
        Heightfield::new(scene, 1.7)
    }

    #[test]
    fn a_floor_ends_where_it_is_and_a_wall_reaches_up_from_it() {
        let scene = uncooked(&boxes(&[
            ([-10.0, -0.2, -10.0], [10.0, 0.0, 10.0]),
            ([1.0, 0.0, -10.0], [1.2, 3.0, 10.0]),
        ]));
        let field = field(&scene);
        assert!((field.tile_side() - 6.4).abs() < 1e-12);
        let tile = field.tile(&scene, 0, 0).unwrap();
        let height = |units: u16| f64::from(units) * field.unit + field.base;
        // A floor of 20 cm is two surfaces, and a wall that stands on it one more.
        let [_, floor] = tile.column(5, 5) else { panic!("{:?}", tile.column(5, 5)) };
        assert!((height(floor.top) - 0.0).abs() < 0.002, "{}", height(floor.top));
        let [_, wall] = tile.column(10, 40) else { panic!("{:?}", tile.column(10, 40)) };
        assert!((height(wall.top) - 3.0).abs() <= 0.05, "{}", height(wall.top));
        assert!(tile.column(8, 40).iter().all(|span| height(span.top) < 0.1));
        // The same, queried by world coordinates.
        let [_, [bottom, top]] = tile.spans_at(1.05, 4.05).collect::<Vec<_>>()[..] else { panic!() };
        assert!((top - 3.0).abs() <= 0.05 && bottom < 0.06, "{bottom} to {top}");
        // Beyond the floor there is nothing, and a tile of its own.
        let edge = field.tile(&scene, 1, 0).unwrap();
        assert_eq!((edge.column(35, 0).len(), edge.column(37, 0).len()), (2, 0));
        assert_eq!(field.tile(&scene, 7, 7).unwrap().column(0, 0), []);
    }

    #[test]
    fn what_travels_has_all_columns() {
        let scene = uncooked(&boxes(&[([0.0; 3], [1.0; 3])]));
        let tile = field(&scene).tile(&scene, -1, 0).unwrap();
        let bytes = tile.to_bytes();
        assert_eq!(bytes.len(), 36 + 64 * 64 * 2 + 4 * tile.columns.iter().map(Vec::len).sum::<usize>());
        assert_eq!(f64::from_le_bytes(bytes[..8].try_into().unwrap()), -field(&scene).tile_side());
        assert_eq!(u32::from_le_bytes(bytes[32..36].try_into().unwrap()), 64);
        let read = Tile::from_bytes(&bytes).unwrap();
        assert_eq!((read.corner, &read.columns), (tile.corner, &tile.columns));
        assert!((read.field.cell - tile.field.cell).abs() < 1e-6);
        for end in [0, 35, 36, bytes.len() / 2, bytes.len() - 1] {
            assert_eq!(Tile::from_bytes(&bytes[..end]), None, "{end} bytes");
        }
        assert_eq!(Tile::from_bytes(&[&bytes[..], &[0]].concat()), None, "more than a tile");
        let mut other = bytes.clone();
        other[32] = 65;
        assert_eq!(Tile::from_bytes(&other), None, "of another size");
        other.clone_from(&bytes);
        other[24..28].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(Tile::from_bytes(&other), None, "columns of no size");
    }

    #[test]
    fn a_scene_higher_than_all_units_has_coarser_ones() {
        let scene = uncooked(&boxes(&[([0.0; 3], [1.0, 1e6, 1.0])]));
        let tile = field(&scene).tile(&scene, 0, 0).unwrap();
        let highest = tile.columns.iter().flatten().map(|span| span.top).max();
        assert!(highest.is_some_and(|top| top > 60_000), "{highest:?}");
    }

    #[test]
    fn a_tile_of_any_scene_travels_in_less_than_a_mebibyte() {
        let spans = |count: u16| -> Vec<Span> {
            (0..count).map(|at| Span { bottom: 20 * at + at % 7, top: 20 * at + 10 }).collect()
        };
        let mut tile = Tile {
            field: Heightfield { cell: 1.0, unit: 1.0, base: 0.0 },
            corner: DVec2::ZERO,
            columns: vec![spans(3000); Heightfield::SIDE * Heightfield::SIDE],
        };
        tile.columns.iter_mut().for_each(|column| join(column, Heightfield::SPANS));
        assert!(tile.columns.iter().all(|column| column.len() == Heightfield::SPANS));
        let bytes = tile.to_bytes();
        assert!(bytes.len() < 1 << 20, "{}", bytes.len());
        assert_eq!(Tile::from_bytes(&bytes).unwrap().columns, tile.columns);
        // The narrowest gaps are closed.
        let mut few = [(0, 1), (2, 3), (13, 14), (15, 20)].map(|(bottom, top)| Span { bottom, top }).to_vec();
        join(&mut few, 2);
        assert_eq!(few, [Span { bottom: 0, top: 3 }, Span { bottom: 13, top: 20 }]);
    }

    /// Many triangles above each other take no more memory than few.
    #[test]
    fn a_column_is_joined_before_it_has_grown() {
        let mut tile = field(&uncooked(&boxes(&[([0.0; 3], [1.0; 3])]))).empty_tile(0, 0);
        for height in 0..20 * UNJOINED {
            let y = 3.0 * (height * 7919 % 20_011) as f64;
            tile.add_triangle([[0.1, y, 0.1], [0.9, y, 0.1], [0.1, y, 0.9]].map(DVec3::from_array));
            assert!(tile.columns.iter().all(|column| column.len() <= UNJOINED), "{height}");
        }
        assert!(!tile.is_empty());
    }

    #[test]
    fn a_tile_that_is_given_up_is_left() {
        let scene = uncooked(&boxes(&[([0.0; 3], [1.0; 3])]));
        let (field, looks) = (field(&scene), std::cell::Cell::new(0));
        let leaves = || {
            looks.set(looks.get() + 1);
            true
        };
        assert_eq!(field.tile_unless(&scene, 0, 0, &leaves).unwrap(), None);
        assert_eq!(looks.get(), 1);
        assert_eq!(
            field.tile_unless(&scene, 0, 0, &|| false).unwrap(),
            Some(field.tile(&scene, 0, 0).unwrap())
        );
    }

    fn point() -> impl Strategy<Value = DVec3> {
        (-20.0..84.0, 1.0..200.0, -20.0..84.0).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    proptest! {
        /// Every point of a triangle above the tile is in a span of its column, and columns that it does not
        /// touch stay empty.
        #[test]
        fn a_triangle_is_in_the_columns_above_which_it_is(
            corners in prop::array::uniform3(point()),
            weights in prop::collection::vec((0.0..1.0, 0.0..1.0), 50)
        ) {
            let field = Heightfield { cell: 1.0, unit: 1.0, base: 0.0 };
            let columns = vec![Vec::new(); Heightfield::SIDE * Heightfield::SIDE];
            let mut tile = Tile { field, corner: DVec2::ZERO, columns };
            tile.add_triangle(corners);
            tile.columns.iter_mut().for_each(|column| join(column, Heightfield::SPANS));
            let [a, b, c] = corners;
            for (u, v) in weights {
                let (u, v): (f64, f64) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let p = a + (b - a) * u + (c - a) * v;
                if p.x >= 0.0 && p.z >= 0.0 && p.x < 64.0 && p.z < 64.0 {
                    let spans = tile.column(p.x as usize, p.z as usize);
                    let has = |span: &Span| {
                        p.y >= f64::from(span.bottom) - 1e-6 && p.y <= f64::from(span.top) + 2e-3
                    };
                    prop_assert!(spans.iter().any(has), "{p} {spans:?}");
                }
            }
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            for (index, spans) in tile.columns.iter().enumerate() {
                let (x, z) = ((index % 64) as f64, (index / 64) as f64);
                let beside = x > high.x || x + 1.0 < low.x || z > high.z || z + 1.0 < low.z;
                prop_assert!(!beside || spans.is_empty());
                prop_assert!(spans.len() < 2);
            }
        }
    }
}
