//! Exact visibility: the drawables that own a pixel of an ID buffer (paper, section 5: item buffer).

use std::sync::Arc;

use trimaran_actors::{RoleError, Stop};
use trimaran_cull::{DrawOrder, Viewport, lod_cut};
use trimaran_gpu::{GpuError, GpuScene, ItemPass};
use trimaran_proto::{CullCounts, DrawableId};
use trimaran_scene::Scene;

use super::{
    failed,
    work::{FrameCuller, Seen},
};

/// Draws the whole LOD cut into an ID buffer, and takes the drawables that own a pixel. All see-through ones
/// are taken.
pub(super) struct Exact {
    scene: Arc<Scene>,
    pass: ItemPass,
    order: DrawOrder,
    solid: Vec<DrawableId>,
    see_through: Vec<DrawableId>,
    /// For each drawable, whether it owns a pixel of the frame.
    shows: Vec<bool>,
}

impl Exact {
    pub(super) fn new(scene: &Arc<Scene>, drawn: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        Ok(Self {
            scene: Arc::clone(scene),
            pass: ItemPass::new(drawn, size)?,
            order: DrawOrder::default(),
            solid: Vec::new(),
            see_through: Vec::new(),
            shows: vec![false; scene.drawables().len()],
        })
    }
}

impl FrameCuller for Exact {
    fn cancel_on(&mut self, stop: &Stop) {
        let stop = stop.clone();
        self.pass.cancel_when(move || stop.requested());
    }

    fn draw_occluders(&mut self, seen: Seen<'_>, _: &[DrawableId]) -> Result<&[DrawableId], RoleError> {
        let mut cut = lod_cut(&self.scene, seen.view, seen.rule);
        self.order.sort(&self.scene, seen.view, &mut cut);
        self.solid = seen.rule.divide(&self.scene, &cut, &mut self.see_through).into_owned();
        let mut draw = || {
            self.pass.begin(seen.view)?;
            self.pass.draw(&self.solid)?;
            self.pass.finish()
        };
        draw().map_err(failed("drawing the item buffer"))?;
        Ok(&self.solid)
    }

    fn cull(&mut self, _: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError> {
        let items = self.pass.items().map_err(failed("reading the item buffer"))?;
        for [drawable, _] in items {
            // The background is no drawable.
            if let Some(shows) = self.shows.get_mut(*drawable as usize)
                && !std::mem::replace(shows, true)
            {
                found.push(DrawableId(*drawable));
            }
        }
        for id in &*found {
            if let Some(shows) = self.shows.get_mut(id.index()) {
                *shows = false;
            }
        }
        found.extend_from_slice(&self.see_through);
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let tested = self.solid.len();
        let hidden = (tested + self.see_through.len()).saturating_sub(found.len());
        let emitted = count(found.len());
        Ok(CullCounts { tested: count(tested), hidden: count(hidden), emitted, ..CullCounts::default() })
    }
}
