//! Visibility by rays cast on the CPU: what a machine without a GPU can do.
//!
//! | module | what is in it |
//! |---|---|
//! | `packet` | four rays from one point, against boxes and triangles |
//! | `tree` | boxes under a tree, and how rays go down it |
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

/// Casts a ray through the centre of each pixel, and takes what is hit first. What is seen through is taken
/// as a whole. It keeps the meshes that it has made trees of.
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

    /// Puts the LOD cut of a frame under a tree. Returns what of it hides other things.
    pub fn place(&mut self, view: &View, rule: &CutRule) -> &[DrawableId] {
        let cut = lod_cut(&self.scene, view, rule);
        self.solid = rule.divide(&self.scene, &cut, &mut self.see_through).into_owned();
        self.placed = Placed::new(&self.scene, view, &self.solid, &mut self.meshes);
        &self.solid
    }

    /// Adds to `found` what rays of this view hit, of what was [placed](Self::place) for it.
    pub fn cast(&self, view: &View, found: &mut Vec<DrawableId>) -> CullCounts {
        let shows: Vec<AtomicBool> = self.solid.iter().map(|_| AtomicBool::new(false)).collect();
        let show = |index: u32| {
            // Writing what is there already would take the memory from the other threads.
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
