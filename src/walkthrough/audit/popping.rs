//! Pictures that change although nothing does but the levels of detail.

use std::collections::HashSet;

use trimaran_audit::metrics::{ImageRef, flip, mismatching_pixels};
use trimaran_cull::{Choice, Image, LodCut, draw_order};
use trimaran_proto::{Camera, DrawableId};
use trimaran_scene::{Level, NodeId};

use super::{AuditError, Auditor};

/// A frame's picture with its own levels, against the same with the levels of the frame before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelSwitch {
    /// The share of its pixels that change.
    pub changed: f64,
    /// Mean FLIP between the two.
    pub flip_mean: f64,
    /// The largest error on the screen, pixels, of a level that only one of them has.
    pub largest_px: f64,
}

impl Auditor {
    /// Draws a frame twice without culling: with the levels that `camera` chooses, and with those that
    /// `before` would choose of the same nodes.
    ///
    /// # Errors
    /// If the device fails.
    pub fn level_switch(&mut self, before: Camera, camera: Camera) -> Result<LevelSwitch, AuditError> {
        let (view, rule) = self.redrawer.seen_from(&camera);
        let (view_before, _) = self.redrawer.seen_from(&before);
        let scene = &self.redrawer.scene;
        let now = LodCut::new(scene, &view, &rule);
        let chosen = levels(&now, &now);
        let kept = levels(&now, &LodCut::new(scene, &view_before, &rule));
        let largest_px = largest_difference(&now, &chosen, &kept);
        if chosen == kept {
            return Ok(LevelSwitch { changed: 0.0, flip_mean: 0.0, largest_px });
        }
        let (mut shown, mut unchanged) = (Image::default(), Image::default());
        for (levels, picture) in [(&chosen, &mut shown), (&kept, &mut unchanged)] {
            let mut ids: Vec<DrawableId> = levels.iter().copied().flat_map(Level::pieces).collect();
            draw_order(&self.redrawer.scene, &view, &mut ids);
            self.redrawer.draw(&view, &rule, &ids, picture)?;
        }
        let (shown, unchanged) = (ImageRef::of(&shown)?, ImageRef::of(&unchanged)?);
        let pixels = shown.pixels().len();
        Ok(LevelSwitch {
            changed: mismatching_pixels(&shown, &unchanged)? as f64 / pixels as f64,
            flip_mean: flip(&shown, &unchanged)?.mean(),
            largest_px,
        })
    }
}

/// The levels that `choosing` draws of what is in the frustum of `seen`.
fn levels(seen: &LodCut<'_>, choosing: &LodCut<'_>) -> Vec<Level> {
    let nodes = seen.scene().nodes();
    let (mut levels, mut open) = (Vec::new(), vec![NodeId(0)]);
    while let Some(id) = open.pop() {
        let Some(node) = nodes.get(id.0 as usize).filter(|node| !seen.outside(node)) else { continue };
        match choosing.choose(id, node) {
            Choice::Draw(level) => levels.push(level),
            Choice::Refine => open.extend(node.children().map(NodeId)),
            Choice::Nothing => {}
        }
    }
    levels
}

/// The largest error on the screen of `cut` of a level that only one of the two has.
fn largest_difference(cut: &LodCut<'_>, one: &[Level], other: &[Level]) -> f64 {
    let scene = cut.scene();
    let error = |level: &Level| {
        let drawable = scene.drawables().get(level.first().index())?;
        let node = scene.nodes().get(drawable.node as usize)?;
        Some(cut.error_on_screen(node, drawable.error.into()))
    };
    let [ones, others] = [one, other].map(|levels| levels.iter().copied().collect::<HashSet<Level>>());
    ones.symmetric_difference(&others).filter_map(error).fold(0.0, f64::max)
}
