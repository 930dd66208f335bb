//! A cooked scene on a device.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use parking_lot::{Condvar, MappedMutexGuard, Mutex, MutexGuard};
use trimaran_cull::View;
use trimaran_proto::DrawableId;
use trimaran_scene::{Drawable, Node, Scene};

use crate::place::{Absent, Place};
use crate::rounding::rounds_as_the_host;
use crate::tree::{Tree, TreeBudget};
use crate::working_set::{Budget, HoldId, WorkingSet, WorkingSetStats};
use crate::{Gpu, GpuError};

/// A scene on a device: the scene itself for its tree, and its most recently drawn triangles. Passes share it
/// through an [`Arc`].
pub struct GpuScene {
    // Before the device's owner, like all objects made from it.
    set: Mutex<WorkingSet>,
    /// Told when a pass has submitted its draws, or holds nothing any more.
    submitted: Condvar,
    /// Once a culler traverses it on the device.
    tree: Mutex<Option<Tree>>,
    /// Whether the device rounds f64 as the host does, once that is known.
    rounds: OnceLock<bool>,
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
}

/// How placing triangles went.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placing {
    /// The bytes that were loaded.
    pub(crate) bytes: u64,
    /// Whether other passes held geometry, which may be why there was no room.
    pub(crate) others_hold: bool,
}

impl GpuScene {
    /// Allocates memory for a scene's triangles by [`GpuOptions::memory`](crate::GpuOptions::memory). They
    /// are read from the scene when first drawn.
    ///
    /// # Errors
    /// If the device has no memory.
    pub fn new(gpu: &Arc<Gpu>, scene: &Arc<Scene>) -> Result<Arc<Self>, GpuError> {
        Self::with(gpu, scene, Budget::new(gpu), false)
    }

    /// `staged`: copy by the device even if the host sees its memory.
    pub(crate) fn with(
        gpu: &Arc<Gpu>,
        scene: &Arc<Scene>,
        budget: Budget,
        staged: bool,
    ) -> Result<Arc<Self>, GpuError> {
        let set = WorkingSet::new(gpu, scene, budget, staged)?;
        Ok(Arc::new(Self {
            set: Mutex::new(set),
            submitted: Condvar::new(),
            tree: Mutex::new(None),
            rounds: OnceLock::new(),
            gpu: Arc::clone(gpu),
            scene: Arc::clone(scene),
        }))
    }

    /// The device that holds it.
    #[must_use]
    pub const fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The state of the geometry on the device.
    #[must_use]
    pub fn working_set(&self) -> WorkingSetStats {
        self.set.lock().stats()
    }

    /// The scene itself.
    pub(crate) const fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Begins anew with a tree that is no larger than this.
    #[cfg(test)]
    pub(crate) fn limit_tree(&self, budget: TreeBudget) {
        *self.tree.lock() = Tree::new(&self.gpu, &self.scene, budget).ok();
    }

    /// Whether the device rounds f64 as the host does, which is tested once.
    pub(crate) fn rounds_as_the_host(&self) -> Result<bool, GpuError> {
        if let Some(rounds) = self.rounds.get() {
            return Ok(*rounds);
        }
        let rounds = rounds_as_the_host(&self.gpu)?;
        Ok(*self.rounds.get_or_init(|| rounds))
    }

    /// The tree on the device, for one culler at a time.
    pub(crate) fn tree(&self) -> Result<MappedMutexGuard<'_, Tree>, GpuError> {
        let mut tree = self.tree.lock();
        if tree.is_none() {
            *tree = Some(Tree::new(&self.gpu, &self.scene, TreeBudget::new(&self.gpu))?);
        }
        MutexGuard::try_map(tree, Option::as_mut).map_err(|_| GpuError::NotBegun("the tree"))
    }

    /// The set itself, for one pass at a time.
    pub(crate) fn set(&self) -> MutexGuard<'_, WorkingSet> {
        self.set.lock()
    }

    /// Loads the triangles of `ids` to the device and appends their places to `places`, in order: `None` for
    /// skipped ones. Fewer than the ids if there is no more room. The triangles stay while a pass holds the
    /// set.
    ///
    /// # Errors
    /// If the scene lacks an id, cannot be read, or a drawable is larger than the whole budget.
    pub(crate) fn place(
        &self,
        hold: HoldId,
        ids: &[DrawableId],
        absent: Absent,
        places: &mut Vec<Option<Place>>,
    ) -> Result<Placing, GpuError> {
        let mut numbers = Vec::with_capacity(ids.len());
        for &id in ids {
            let known = self.scene.drawables().get(id.index());
            numbers.push(known.map_or_else(|| self.find(id).map(|(drawable, _)| drawable), Ok)?.geometry);
        }
        let mut set = self.set.lock();
        set.begin_draws(hold);
        let bytes = set.place(&numbers, absent, places)?;
        Ok(Placing { bytes, others_hold: set.is_held_by_others(hold) })
    }

    /// All draws of the pass that were placed so far were submitted.
    pub(crate) fn end_draws(&self, hold: HoldId) {
        self.set.lock().end_draws(hold);
        self.submitted.notify_all();
    }

    /// The device is done with all draws of the pass.
    pub(crate) fn release(&self, hold: HoldId) {
        self.set.lock().release(hold);
        self.submitted.notify_all();
    }

    /// Waits until no other pass holds geometry for draws that it has not submitted, for at most `longest`.
    /// Returns whether none does.
    pub(crate) fn wait_for_others(&self, hold: HoldId, longest: Duration) -> bool {
        let mut set = self.set.lock();
        let waits = |set: &mut WorkingSet| set.is_recorded_by_others(hold);
        !self.submitted.wait_while_for(&mut set, waits, longest).timed_out()
    }

    /// Whether the drawable would have room if nothing else were held.
    pub(crate) fn could_hold(&self, id: DrawableId) -> bool {
        self.find(id).is_ok_and(|(drawable, _)| self.set.lock().could_hold(drawable.geometry))
    }

    /// The error for a drawable without room although nothing else is held.
    pub(crate) fn too_small(&self, id: DrawableId) -> GpuError {
        match self.find(id) {
            Ok((drawable, _)) => self.set.lock().too_small(drawable.geometry),
            Err(error) => error,
        }
    }

    /// A drawable, and its node with the drawable's box.
    pub(crate) fn find(&self, id: DrawableId) -> Result<(&Drawable, Node), GpuError> {
        let found = self
            .scene
            .part(id)
            .map_or_else(|| self.scene.reading(|| self.scene.part(id)), |found| Ok(Some(found)));
        let count = self.scene.drawables().len();
        found.map_err(GpuError::Scene)?.ok_or(GpuError::UnknownDrawable { id, count })
    }
}

/// A pass's hold on the scene's working set. Dropped after the pass's stream, which waits for the device.
pub(crate) struct Hold {
    scene: Arc<GpuScene>,
    id: HoldId,
}

impl Hold {
    pub(crate) fn new(scene: &Arc<GpuScene>) -> Self {
        Self { scene: Arc::clone(scene), id: scene.set().hold() }
    }

    pub(crate) const fn id(&self) -> HoldId {
        self.id
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        self.scene.release(self.id);
    }
}

impl std::fmt::Debug for GpuScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuScene").field("working_set", &self.working_set()).finish_non_exhaustive()
    }
}

/// The map from a node's local frame to view space, as the rows of a 3x4 matrix: the one definition of a
/// vertex's position, used by every pass.
///
/// World coordinates of plants are too large for f32. So the eye is subtracted and the rotation applied in
/// f64, and each entry is rounded once, to f32, at the end. The remaining error is about half an ulp of the
/// *view-space* distance.
pub(crate) fn in_view(node: &Node, view: &View) -> [[f32; 4]; 3] {
    let rotation = view.to_view().to_cols_array();
    let eye = view.eye().to_array();
    let offset: [f64; 3] = std::array::from_fn(|i| node.origin[i] - eye[i]);
    std::array::from_fn(|row| {
        let r = [rotation[row], rotation[3 + row], rotation[6 + row]];
        let dot = |v: [f64; 3]| (r[0] * v[0] + r[1] * v[1] + r[2] * v[2]) as f32;
        let column = |c: usize| std::array::from_fn(|i| f64::from(node.linear[3 * c + i]));
        [dot(column(0)), dot(column(1)), dot(column(2)), dot(offset)]
    })
}
