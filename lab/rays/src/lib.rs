//! Visibility by rays cast on the CPU, for machines without a GPU.
//!
//! | module | what is in it |
//! |---|---|
//! | `packet` | four rays from one point, against boxes and triangles |
//! | `tree` | a tree of boxes, and its traversal by rays |
//! | `mesh` | the triangles of drawables, each mesh under a tree of its own |
//! | `placed` | a frame's drawables under one tree: what a ray hits first |
//! | `pixels` | the rays of a view, one through the centre of each pixel |

mod mesh;
mod packet;
mod pixels;
mod placed;
#[cfg(test)]
mod tests;
mod tree;

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use trimaran_cull::{CutRule, View, lod_cut};
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_scene::Scene;

use mesh::Meshes;
use placed::Placed;

/// Casts a ray through the centre of each pixel, and takes the first hits. All see-through drawables are
/// taken. It keeps the meshes with their trees.
pub struct Rays {
    scene: Arc<Scene>,
    meshes: Meshes,
    placed: Placed,
    solid: Vec<DrawableId>,
    see_through: Vec<DrawableId>,
}

impl Rays {
    /// For frames of this scene.
    #[must_use]
    pub fn new(scene: &Arc<Scene>) -> Self {
        Self {
            scene: Arc::clone(scene),
            meshes: Meshes::default(),
            placed: Placed::default(),
            solid: Vec::new(),
            see_through: Vec::new(),
        }
    }

    /// Builds a tree of a frame's LOD cut. Returns the drawables that can hide others.
    pub fn place(&mut self, view: &View, rule: &CutRule) -> &[DrawableId] {
        let cut = lod_cut(&self.scene, view, rule);
        self.solid = rule.divide(&self.scene, &cut, &mut self.see_through).into_owned();
        self.placed = Placed::new(&self.scene, view, &self.solid, &mut self.meshes);
        &self.solid
    }

    /// Adds to `found` the hits of this view's rays, among the drawables [placed](Self::place) for it.
    pub fn cast(&self, view: &View, found: &mut Vec<DrawableId>) -> CullCounts {
        let shows: Vec<AtomicBool> = self.solid.iter().map(|_| AtomicBool::new(false)).collect();
        let show = |index: u32| {
            // Writing an equal value would still take the memory from the other threads' caches.
            if let Some(shows) = shows.get(index as usize)
                && !shows.load(Ordering::Relaxed)
            {
                shows.store(true, Ordering::Relaxed);
            }
        };
        self.placed.cast(view, |_, index| show(index));
        self.placed.undecided().iter().copied().for_each(show);
        let shown = self.solid.iter().zip(shows).filter(|(_, shows)| shows.load(Ordering::Relaxed));
        found.extend(shown.map(|(id, _)| *id));
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let hidden = self.solid.len().saturating_sub(found.len());
        let not_finite = self.placed.undecided().len();
        found.extend_from_slice(&self.see_through);
        CullCounts {
            tested: count(self.solid.len() - not_finite),
            hidden: count(hidden),
            not_finite: count(not_finite),
            emitted: count(found.len()),
            ..CullCounts::default()
        }
    }
}
