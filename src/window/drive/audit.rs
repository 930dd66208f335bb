//! The errors of a moving eye's pictures, against the exact pictures of the same poses.

use std::{collections::HashMap, sync::Arc, time::Duration};

use trimaran_cull::{CutRule, View, Viewport, draw_order, lod_cut, retain_in_sight};
use trimaran_gpu::{GpuError, GpuScene, ItemImage, ItemPass};
use trimaran_proto::DrawableId;
use trimaran_scene::{Node, NodeId, Scene};

use super::album::Taken;
use crate::{page::WrongPixels, report::schema::Stat};

/// A picture counts as right if at most this percentage of pixels shows another object.
const FEW: f64 = 0.1;

/// The inputs of exact pictures.
pub(in crate::window) struct Exact<'e, W> {
    pub(in crate::window) scene: &'e Arc<Scene>,
    pub(in crate::window) drawn: &'e Arc<GpuScene>,
    pub(in crate::window) rule: &'e CutRule,
    /// The view to cull for a picture of a view.
    pub(in crate::window) wider: W,
}

impl<W: Fn(&View) -> View> Exact<'_, W> {
    /// Counts the pixels that show another object than those of the whole cut.
    pub(super) fn audit(&self, pictures: &[Taken], size: Viewport) -> Result<WrongPixels, GpuError> {
        let Self { scene, drawn, rule, wider } = self;
        let mut pass = ItemPass::new(drawn, size)?;
        let mut percent = Vec::new();
        let (mut wrong, mut jumping) = (Spans::default(), Spans::default());
        for Taken { at, camera, ids, has_jumped } in pictures {
            jumping.add(*at, *has_jumped);
            let Some(ids) = ids else { continue };
            let view = View::new(*camera, size);
            let mut exact = lod_cut(scene, &wider(&view), *rule);
            retain_in_sight(scene, &view, &mut exact);
            draw_order(scene, &view, &mut exact);
            // See-through drawables cover nothing.
            let mut ids = ids.clone();
            rule.retain_solid(scene, &mut ids);
            rule.retain_solid(scene, &mut exact);
            let shown = items(&mut pass, &view, &ids)?;
            let due = items(&mut pass, &view, &exact)?;
            let share = 100.0 * wrong_share(scene, &shown, &due);
            percent.push(share);
            wrong.add(*at, share > FEW);
        }
        let mean = percent.iter().sum::<f64>() / percent.len().max(1) as f64;
        let right = percent.iter().filter(|share| **share == 0.0).count();
        let spread = Stat::of(percent).unwrap_or(Stat { frames: 0, median: 0.0, p95: 0.0, max: 0.0 });
        Ok(WrongPixels {
            pictures: spread.frames,
            right: u32::try_from(right).unwrap_or(u32::MAX),
            median_percent: spread.median,
            p95_percent: spread.p95,
            mean_percent: mean,
            most_percent: spread.max,
            longest_ms: 1e3 * wrong.longest.as_secs_f64(),
            jump_ms: 1e3 * jumping.longest.as_secs_f64(),
        })
    }
}

/// The drawable at each pixel.
fn items(pass: &mut ItemPass, view: &View, ids: &[DrawableId]) -> Result<Vec<u32>, GpuError> {
    pass.begin(view)?;
    pass.draw(ids)?;
    pass.finish()?;
    Ok(pass.items()?.iter().map(|[drawable, _]| *drawable).collect())
}

/// The share of pixels at which two pictures show different objects.
fn wrong_share(scene: &Scene, shown: &[u32], due: &[u32]) -> f64 {
    let mut known = HashMap::new();
    let different = |pair: &(&u32, &u32)| {
        let (&shown, &due) = *pair;
        shown != due && !*known.entry((shown, due)).or_insert_with(|| show_the_same(scene, shown, due))
    };
    shown.iter().zip(due).filter(different).count() as f64 / due.len().max(1) as f64
}

/// Whether two drawables show the same object, or one shows a group with the other's.
fn show_the_same(scene: &Scene, a: u32, b: u32) -> bool {
    let node = |drawable: u32| {
        let drawable =
            scene.drawables().get(drawable as usize).filter(|_| drawable != ItemImage::BACKGROUND)?;
        Some((drawable.node, scene.nodes().get(drawable.node as usize)?))
    };
    let (Some((a, of_a)), Some((b, of_b))) = (node(a), node(b)) else { return false };
    let is_within = |part: u32, whole: u32| {
        part == whole || scene.ancestors(NodeId(part)).any(|(above, _)| above.0 == whole)
    };
    let is_one = |node: &Node| node.objects == 1;
    is_one(of_a) && is_one(of_b) && of_a.object == of_b.object || is_within(a, b) || is_within(b, a)
}

/// How long a condition held without a break.
#[derive(Debug, Default)]
struct Spans {
    longest: Duration,
    since: Option<Duration>,
}

impl Spans {
    /// The condition holds or not from this time until the next call.
    fn add(&mut self, at: Duration, holds: bool) {
        if let Some(since) = self.since {
            self.longest = self.longest.max(at.saturating_sub(since));
        }
        self.since = holds.then(|| self.since.unwrap_or(at));
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_audit::cases::plant;

    use super::*;

    #[test]
    fn a_pixel_is_wrong_where_another_object_shows() {
        let scene = plant(1, 200, DVec3::ZERO).unwrap();
        let levels = |node: u32| scene.nodes().get(node as usize).unwrap().drawables().collect::<Vec<_>>();
        let leaf = scene.leaf(3).unwrap().0;
        let other = scene.leaf(4).unwrap().0;
        let (parent, _) = scene.ancestors(leaf).next().unwrap();
        let [leaf, other, parent] = [leaf, other, parent].map(|node| levels(node.0)[0].0);
        let nothing = ItemImage::BACKGROUND;
        assert_eq!(wrong_share(&scene, &[leaf, nothing, parent, leaf], &[leaf, nothing, leaf, parent]), 0.0);
        assert_eq!(wrong_share(&scene, &[leaf, nothing, leaf, leaf], &[other, leaf, nothing, leaf]), 0.75);
    }

    #[test]
    fn the_longest_span_counts() {
        let mut spans = Spans::default();
        for (at, holds) in [(0, false), (10, true), (30, true), (40, false), (50, true), (60, false)] {
            spans.add(Duration::from_millis(at), holds);
        }
        assert_eq!(spans.longest, Duration::from_millis(30));
    }
}
