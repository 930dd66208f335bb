//! A binary tree of boxes with their sides along the axes.

use std::ops::Range;

use glam::DVec3;

/// A box by its lower and its upper corner, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cuboid {
    pub(super) min: DVec3,
    pub(super) max: DVec3,
}

impl Cuboid {
    /// Around nothing.
    const NONE: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    pub(super) fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::NONE, |all, point| all.and(&Self { min: point, max: point }))
    }

    pub(super) fn and(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(super) fn moved(&self, by: DVec3) -> Self {
        Self { min: self.min + by, max: self.max + by }
    }

    /// The squared distance to another box; 0 where they touch or overlap.
    pub(super) fn square(&self, other: &Self) -> f64 {
        (self.min - other.max).max(other.min - self.max).max(DVec3::ZERO).length_squared()
    }

    /// The squared length of its diagonal.
    pub(super) fn diagonal(&self) -> f64 {
        (self.max - self.min).length_squared()
    }
}

/// Items in boxes. The items under a branch are consecutive.
#[derive(Debug, Default)]
pub(super) struct Boxes {
    branches: Vec<Branch>,
    /// The numbers of the items as they were given.
    order: Vec<u32>,
}

/// A box around items, or around two branches.
#[derive(Debug, Clone, Copy)]
pub(super) struct Branch {
    pub(super) bounds: Cuboid,
    /// The first item in the tree's order, or the first of two branches that stand side by side.
    first: u32,
    /// The number of items; 0 for a branch over branches.
    count: u32,
}

/// The most items of a branch without branches.
const PER_LEAF: usize = 4;

impl Boxes {
    /// The tree over items with these boxes, at most 2^31 of them.
    pub(super) fn new(bounds: &[Cuboid]) -> Self {
        let mut order: Vec<u32> = (0..bounds.len() as u32).collect();
        if order.is_empty() {
            return Self::default();
        }
        let over = |items: &[u32], first: usize| {
            let own = items.iter().filter_map(|&item| bounds.get(item as usize));
            let bounds = own.fold(Cuboid::NONE, |all, one| all.and(one));
            Branch { bounds, first: first as u32, count: items.len() as u32 }
        };
        let mut branches = Vec::with_capacity(order.len() / 2 + 1);
        branches.push(over(&order, 0));
        let mut next = 0;
        while let Some(&Branch { bounds: around, first, count }) = branches.get(next) {
            if count as usize > PER_LEAF {
                let axis = (around.max - around.min).max_position();
                let centre =
                    |item: u32| bounds.get(item as usize).map_or(0.0, |of| of.min[axis] + of.max[axis]);
                let (first, half) = (first as usize, count as usize / 2);
                let items = &mut order[first..first + count as usize];
                items.select_nth_unstable_by(half, |a, b| centre(*a).total_cmp(&centre(*b)));
                let (low, high) = items.split_at(half);
                let children = branches.len() as u32;
                let two = [over(low, first), over(high, first + half)];
                branches.extend(two);
                branches[next] = Branch { bounds: around, first: children, count: 0 };
            }
            next += 1;
        }
        Self { branches, order }
    }

    /// The items in the tree's order, in which neighbours are near each other.
    pub(super) fn order(&self) -> &[u32] {
        &self.order
    }

    /// The box around all items. `None` without any.
    pub(super) fn bounds(&self) -> Option<Cuboid> {
        self.branches.first().map(|root| root.bounds)
    }

    /// A branch by its number; that of all items is number 0.
    pub(super) fn branch(&self, number: u32) -> Option<&Branch> {
        self.branches.get(number as usize)
    }

    /// Visits the items in branches whose squared distance from a box is below a limit, the nearer branches
    /// first. `visit` returns the limit from then on.
    pub(super) fn visit_near<E>(
        &self,
        to: &Cuboid,
        mut limit: f64,
        mut visit: impl FnMut(u32) -> Result<f64, E>,
    ) -> Result<(), E> {
        let away = |number: u32| self.branch(number).map(|branch| (branch.bounds.square(to), number));
        let mut open: Vec<(f64, u32)> = away(0).into_iter().collect();
        while let Some((square, number)) = open.pop() {
            let Some(branch) = self.branch(number).filter(|_| square < limit) else { continue };
            match branch.kind() {
                Kind::Items(items) => {
                    for &item in self.order.get(items).unwrap_or_default() {
                        limit = visit(item)?;
                    }
                }
                Kind::Branches(two) => {
                    let begin = open.len();
                    open.extend(two.into_iter().filter_map(away));
                    sort_far_first(open.get_mut(begin..).unwrap_or_default());
                }
            }
        }
        Ok(())
    }
}

/// The things under a branch.
pub(super) enum Kind {
    /// Items, by their places in the tree's order.
    Items(Range<usize>),
    /// Two branches.
    Branches([u32; 2]),
}

impl Branch {
    pub(super) fn kind(&self) -> Kind {
        match self.count {
            0 => Kind::Branches([self.first, self.first + 1]),
            count => Kind::Items(self.first as usize..(self.first + count) as usize),
        }
    }
}

/// The last one is then visited next: the nearest.
pub(super) fn sort_far_first<T>(open: &mut [(f64, T)]) {
    open.sort_by(|(a, _), (b, _)| b.total_cmp(a));
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    fn cuboid() -> impl Strategy<Value = Cuboid> {
        (prop::array::uniform3(-9.0..9.0_f64), prop::array::uniform3(0.0..2.0_f64)).prop_map(
            |(min, sides)| {
                let min = DVec3::from_array(min);
                Cuboid { min, max: min + DVec3::from_array(sides) }
            },
        )
    }

    fn near(boxes: &Boxes, to: &Cuboid, limit: f64) -> BTreeSet<u32> {
        let mut seen = BTreeSet::new();
        let visited: Result<(), ()> = boxes.visit_near(to, limit, |item| {
            assert!(seen.insert(item), "{item} comes twice");
            Ok(limit)
        });
        visited.unwrap();
        seen
    }

    #[test]
    fn nothing_has_no_box() {
        let none = Boxes::new(&[]);
        assert_eq!((none.bounds(), none.order().len()), (None, 0));
        assert!(near(&none, &Cuboid::around([DVec3::ZERO]), f64::INFINITY).is_empty());
    }

    #[test]
    fn boxes_that_touch_are_at_no_distance() {
        let of = |low: f64, high: f64| Cuboid { min: DVec3::splat(low), max: DVec3::splat(high) };
        assert_eq!(of(0.0, 1.0).square(&of(1.0, 2.0)), 0.0);
        assert_eq!(of(0.0, 3.0).square(&of(1.0, 2.0)), 0.0);
        assert_eq!(of(0.0, 1.0).square(&of(3.0, 4.0)), 12.0);
        assert_eq!(of(0.0, 1.0).moved(DVec3::X * -4.0).square(&of(0.0, 1.0)), 9.0);
    }

    proptest! {
        #[test]
        fn all_items_within_the_limit_are_visited(
            all in prop::collection::vec(cuboid(), 0..90), to in cuboid(), limit in 0.0..60.0_f64
        ) {
            let boxes = Boxes::new(&all);
            let seen = near(&boxes, &to, limit);
            for (item, one) in (0..).zip(&all) {
                prop_assert!(one.square(&to) >= limit || seen.contains(&item), "{} is missing", item);
            }
            let order: BTreeSet<u32> = boxes.order().iter().copied().collect();
            prop_assert!(order.len() == all.len() && order.into_iter().eq(0..all.len() as u32));
            prop_assert!(near(&boxes, &to, 0.0).is_empty());
        }
    }
}
