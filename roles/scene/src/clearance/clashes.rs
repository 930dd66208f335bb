//! Clashes: pairs of objects that are too near each other.

use std::{
    ops::Range,
    sync::atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;
use trimaran_proto::ObjectSet;

use super::{
    Clearance, ClearanceError, Clearances,
    objects::{Located, Placed, Search},
};

/// Which objects clash.
#[derive(Debug, Clone, Copy)]
pub struct ClashRule<'r> {
    /// One object of a pair is in this set,
    pub between: &'r ObjectSet,
    /// and the other one in this set, which may share objects with the first one.
    pub and: &'r ObjectSet,
    /// They clash if they are this near, metres, or nearer by rounded coordinates alone. Not negative.
    pub tolerance: f64,
    /// The group of each object, as [`Hierarchy::groups_at`](crate::Hierarchy::groups_at) finds it. A pair is
    /// ignored if the group of each has the other one too. Objects past the end are in no group.
    pub groups: &'r [Range<u32>],
    /// The most clashes that may be found, without those that are ignored.
    pub most: usize,
}

impl ClashRule<'_> {
    fn ignores(&self, [a, b]: [u32; 2]) -> bool {
        let has = |of: u32, other: u32| {
            self.groups.get(of as usize).is_some_and(|objects| objects.contains(&other))
        };
        has(a, b) && has(b, a)
    }
}

/// The clashes that a search has found.
#[derive(Debug, Clone, PartialEq)]
pub struct Clashes {
    /// The nearest first; of equal distances those with lower numbers.
    pub found: Vec<Clearance>,
    /// How many more there are within groups, and so were ignored.
    pub ignored: usize,
}

/// Watches a search from another thread, and may stop it.
pub trait Watch: Sync {
    /// This many `of` all objects of the first set have been compared with those of the second one.
    fn advance(&self, done: usize, of: usize);

    /// Whether the search is to end. It is asked every few milliseconds.
    fn is_stopped(&self) -> bool;
}

/// Nobody watches.
impl Watch for () {
    fn advance(&self, _: usize, _: usize) {}

    fn is_stopped(&self) -> bool {
        false
    }
}

impl Clearances<'_> {
    /// All pairs of objects that clash, each once. The first object of a pair is of the set `between`. It
    /// computes on the threads of rayon's present pool, and takes some hundred bytes for each object of the
    /// sets and for each clash.
    ///
    /// # Errors
    /// If a part of the scene cannot be read, if there are too many clashes, or soon after `watch` stops it.
    pub fn clashes(&self, rule: &ClashRule<'_>, watch: &dyn Watch) -> Result<Clashes, ClearanceError> {
        let placed = |set| self.scene.reading(|| Placed::of(self.scene, set));
        let (here, there) = (placed(rule.between)?, placed(rule.and)?);
        let [compared, found, ignored] = [(); 3].map(|()| AtomicUsize::new(0));
        let of = here.boxes.order().len();
        let clashes_of = |&item: &u32| {
            let Some(object) = here.get(item) else { return Ok(Vec::new()) };
            let mut clashes = self.clashes_of(object, &there, rule, watch)?;
            let count = clashes.len();
            clashes.retain(|clash| !rule.ignores(clash.objects));
            ignored.fetch_add(count - clashes.len(), Ordering::Relaxed);
            if found.fetch_add(clashes.len(), Ordering::Relaxed) + clashes.len() > rule.most {
                return Err(ClearanceError::TooMany { most: rule.most });
            }
            watch.advance(compared.fetch_add(1, Ordering::Relaxed) + 1, of);
            Ok(clashes)
        };
        let all: Result<Vec<Vec<Clearance>>, _> = here.boxes.order().par_iter().map(clashes_of).collect();
        let mut all: Vec<Clearance> = all?.into_iter().flatten().collect();
        all.par_sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.objects.cmp(&b.objects)));
        Ok(Clashes { found: all, ignored: ignored.into_inner() })
    }

    fn clashes_of(
        &self,
        object: &Located,
        there: &Placed,
        rule: &ClashRule<'_>,
        watch: &dyn Watch,
    ) -> Result<Vec<Clearance>, ClearanceError> {
        let is_stopped = || watch.is_stopped();
        if is_stopped() {
            return Err(ClearanceError::Stopped);
        }
        // A distance at the limit counts.
        let limit = |rounding: f64| (rule.tolerance + object.rounding + rounding).powi(2).next_up();
        // Where both sets have both objects, the pair would come twice.
        let is_twice = |other: u32| {
            other < object.number && rule.and.contains(object.number) && rule.between.contains(other)
        };
        let (farthest, mut others) = (limit(there.rounding), Vec::new());
        there.boxes.visit_near(&object.bounds, farthest, |item| {
            let other = there.get(item).filter(|other| other.number != object.number);
            others.extend(other.filter(|other| {
                !is_twice(other.number) && other.bounds.square(&object.bounds) < limit(other.rounding)
            }));
            Ok::<f64, ClearanceError>(farthest)
        })?;
        let compare = |search: &mut Search<'_>, other: &&Located| {
            self.scene.reading(|| search.between([object, *other], limit(other.rounding)))?
        };
        let clashes = others.par_iter().map_init(|| Search::new(self, &is_stopped), compare);
        clashes.filter_map(Result::transpose).collect()
    }
}
