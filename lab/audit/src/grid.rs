//! A grid for finding screen points in a rectangle.

use glam::DVec2;

/// The smallest rectangle around points: lower and upper corner; inverted and infinite around none.
pub(crate) fn bounds(points: &[DVec2]) -> (DVec2, DVec2) {
    let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    points.iter().fold(start, |(low, high), &p| (low.min(p), high.max(p)))
}

/// Points sorted into square cells, to find those in a rectangle without visiting all.
pub(crate) struct Grid {
    corner: DVec2,
    cell: f64,
    columns: usize,
    rows: usize,
    /// The points, cell by cell.
    order: Vec<usize>,
    /// Where each cell's points start in `order`, and the end of the last.
    starts: Vec<usize>,
}

impl Grid {
    /// Sorts points into cells of about the size given, at least 2.
    pub(crate) fn new(points: &[DVec2], cell: f64) -> Self {
        let (corner, high) = bounds(points);
        let cell = cell.max(2.0);
        let count = |extent: f64| (extent / cell) as usize + 1;
        let (columns, rows) = (count(high.x - corner.x), count(high.y - corner.y));
        let cell_of = |p: DVec2| {
            let at = (p - corner) / cell;
            at.y as usize * columns + at.x as usize
        };
        let mut starts = vec![0; columns * rows + 1];
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&point| cell_of(points[point]));
        for &point in points {
            starts[cell_of(point) + 1] += 1;
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        Self { corner, cell, columns, rows, order, starts }
    }

    /// The points, as indices, of the cells that touch a rectangle, a row of cells at a time.
    pub(crate) fn cells(&self, low: DVec2, high: DVec2) -> impl Iterator<Item = &[usize]> {
        let (low, high) = ((low - self.corner) / self.cell, (high - self.corner) / self.cell);
        // Float-to-integer conversion saturates, so coordinates left of the grid map to its first cell,
        // unless the whole rectangle is outside.
        let end = |high: f64, count: usize| {
            if high < 0.0 { 0 } else { (high as usize).saturating_add(1).min(count) }
        };
        let columns = low.x as usize..end(high.x, self.columns);
        let rows = low.y as usize..if columns.is_empty() { 0 } else { end(high.y, self.rows) };
        rows.map(move |row| {
            let first = row * self.columns;
            &self.order[self.starts[first + columns.start]..self.starts[first + columns.end]]
        })
    }

    /// Whether there is a point in the cells that touch a rectangle.
    pub(crate) fn holds_any(&self, low: DVec2, high: DVec2) -> bool {
        self.cells(low, high).any(|points| !points.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = DVec2> {
        (-50.0..50.0_f64, -50.0..50.0_f64).prop_map(|(x, y)| DVec2::new(x, y))
    }

    #[test]
    fn a_grid_of_one_point_has_one_cell() {
        let grid = Grid::new(&[DVec2::ONE], 8.0);
        assert!(grid.holds_any(DVec2::ZERO, DVec2::ONE));
        assert!(!grid.holds_any(DVec2::splat(-9.0), DVec2::ZERO));
    }

    proptest! {
        #[test]
        fn every_point_in_a_rectangle_is_found_once(
            points in prop::collection::vec(point(), 1..80), a in point(), b in point(), cell in 0.1..30.0_f64
        ) {
            let (low, high) = (a.min(b), a.max(b));
            let grid = Grid::new(&points, cell);
            let mut found: Vec<usize> = grid.cells(low, high).flatten().copied().collect();
            found.sort_unstable();
            let listed = found.len();
            found.dedup();
            prop_assert_eq!(found.len(), listed);
            for (index, p) in points.iter().enumerate() {
                if p.cmpge(low).all() && p.cmple(high).all() {
                    prop_assert!(found.binary_search(&index).is_ok(), "{}", p);
                }
            }
            prop_assert!(!found.is_empty() || !grid.holds_any(low, high));
        }
    }
}
