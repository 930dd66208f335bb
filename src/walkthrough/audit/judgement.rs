//! A judge of pixels that culling changes: a rasterizer in f64.

use std::{fmt, ops::AddAssign};

use serde::Serialize;
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{CutRule, View};
use trimaran_gpu::ItemImage;
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

/// Pixels that culling changed, by what a rasterizer in f64 shows there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Judgement {
    /// It shows what is there with culling: the driver has drawn something in front of what hides it.
    pub driver: u64,
    /// It shows what is there without culling: the culler has lost something.
    pub culler: u64,
    /// It shows something else: surfaces of one depth, or an edge.
    pub neither: u64,
    /// The same solid triangle shows, and what is see-through before it differs. The rasterizer does not
    /// blend.
    pub blended: u64,
}

impl AddAssign for Judgement {
    fn add_assign(&mut self, other: Self) {
        self.driver += other.driver;
        self.culler += other.culler;
        self.neither += other.neither;
        self.blended += other.blended;
    }
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { driver, culler, neither, blended } = self;
        write!(f, "in f64, {driver} are right with culling, {culler} without, {neither} are neither")?;
        if *blended > 0 {
            write!(f, "; {blended} differ only in what is see-through")?;
        }
        Ok(())
    }
}

impl Judgement {
    /// Whether wrong pixels are right with culling, and none is without.
    #[must_use]
    pub const fn is_of_driver(&self) -> bool {
        self.driver > 0 && self.culler + self.blended == 0
    }

    /// Adds the pixels at which a frame without culling, of this cut, and the same frame as it was drawn
    /// differ.
    pub(crate) fn add(
        &mut self,
        scene: &Scene,
        view: &View,
        rule: &CutRule,
        cut: &[DrawableId],
        [whole, shown]: [&ItemImage; 2],
    ) {
        let pairs = |items: &ItemImage| -> Vec<[u32; 2]> {
            items
                .drawable
                .iter()
                .zip(&items.triangle)
                .map(|(drawable, triangle)| [*drawable, *triangle])
                .collect()
        };
        let (whole, shown) = (pairs(whole), pairs(shown));
        if whole == shown {
            return;
        }
        let solid = rule.divide(scene, cut, &mut Vec::new());
        let right = rasterize(scene, view, solid.iter().copied(), Placement::Exact);
        let right = right
            .ids()
            .iter()
            .map(|id| id.map_or([ItemImage::BACKGROUND; 2], |id| [id.drawable.0, id.triangle]));
        for ((whole, shown), right) in whole.into_iter().zip(shown).zip(right).filter(|((a, b), _)| a != b) {
            let count = match right {
                _ if right == shown => &mut self.driver,
                _ if right == whole => &mut self.culler,
                _ => &mut self.neither,
            };
            *count += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use trimaran_audit::cases::{Mesh, Object, build, looking};
    use trimaran_cull::{LodRule, Viewport, lod_cut};

    use super::*;

    #[test]
    fn the_rasterizer_says_which_picture_is_wrong() {
        let wall = Object::new(Mesh::rectangle(Vec3::Y * 2.0, Vec3::X * 9.0, Vec3::Z * 9.0, 1));
        let scene = build(&[wall], false).unwrap();
        let view = looking(DVec3::ZERO, DVec3::Y, 90.0, Viewport::new(8, 8).unwrap(), 0).unwrap();
        let rule = CutRule::from(LodRule::new(1.0).unwrap());
        let cut = lod_cut(&scene, &view, &rule);
        let right = rasterize(&scene, &view, cut.iter().copied(), Placement::Exact);
        let items = |at: usize, drawable: u32| {
            let mut items = ItemImage { width: 8, height: 8, ..ItemImage::default() };
            items.drawable = right.ids().iter().map(|id| id.unwrap().drawable.0).collect();
            items.triangle = right.ids().iter().map(|id| id.unwrap().triangle).collect();
            items.drawable[at] = drawable;
            items
        };
        let judged = |whole: ItemImage, shown: ItemImage| {
            let mut judgement = Judgement::default();
            judgement.add(&scene, &view, &rule, &cut, [&whole, &shown]);
            judgement
        };
        let (sound, none) = (cut[0].0, Judgement::default());
        assert_eq!(judged(items(5, sound), items(5, sound)), none);
        assert_eq!(judged(items(5, sound), items(5, 7)), Judgement { culler: 1, ..none });
        assert_eq!(judged(items(5, 7), items(5, sound)), Judgement { driver: 1, ..none });
        assert_eq!(judged(items(5, 7), items(5, 8)), Judgement { neither: 1, ..none });
        assert_eq!(judged(items(5, 7), items(6, 7)), Judgement { driver: 1, culler: 1, ..none });
    }
}
