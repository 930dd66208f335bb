//! The three passes over one scene, and their output for the same ids.

use std::sync::Arc;

use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{View, Viewport};
use trimaran_gpu::{GpuScene, ItemImage, ItemPass, OccluderPass, PicturePass};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::common::{CheckedGpu, depth, items, pixels};

/// The three passes over one scene.
pub(crate) struct Passes {
    pub(crate) scene: Arc<Scene>,
    occluders: OccluderPass,
    pub(crate) picture: PicturePass,
    items: ItemPass,
}

/// Their output for the same ids, row by row.
#[derive(PartialEq)]
pub(crate) struct Drawn {
    pub(crate) occluders: Vec<f32>,
    pub(crate) depth: Vec<f32>,
    pub(crate) pixels: Vec<[u8; 4]>,
    pub(crate) items: Vec<[u32; 2]>,
}

pub(crate) const NOTHING: [u32; 2] = [ItemImage::BACKGROUND; 2];

impl Passes {
    pub(crate) fn new(gpu: &CheckedGpu, scene: Arc<Scene>) -> Self {
        let (uploaded, size) = (GpuScene::new(gpu, &scene).unwrap(), Viewport::new(8, 8).unwrap());
        Self {
            scene,
            occluders: OccluderPass::new(&uploaded, size).unwrap(),
            picture: PicturePass::new(&uploaded, size).unwrap(),
            items: ItemPass::new(&uploaded, size).unwrap(),
        }
    }

    pub(crate) fn draw(&mut self, view: &View, ids: &[DrawableId]) -> Drawn {
        Drawn {
            occluders: depth(&mut self.occluders, view, ids),
            pixels: pixels(&mut self.picture, view, ids),
            depth: self.picture.read_depth().unwrap().depth().to_vec(),
            items: items(&mut self.items, view, ids),
        }
    }

    /// The number of pixels at which the items differ from the reference's.
    pub(crate) fn differing(&self, view: &View, ids: &[DrawableId], drawn: &Drawn) -> usize {
        let expected = rasterize(&self.scene, view, ids.iter().copied(), Placement::Single);
        let expected = expected.ids().iter().map(|id| id.map_or(NOTHING, |id| [id.drawable.0, id.triangle]));
        expected.zip(&drawn.items).filter(|(expected, item)| expected != *item).count()
    }
}

impl Drawn {
    /// Asserts the properties of passes that draw the same ids.
    pub(crate) fn check(&self, at: &str) {
        for (i, (&occluder, &depth)) in self.occluders.iter().zip(&self.depth).enumerate() {
            assert!(occluder <= depth, "{at}, pixel {i}: an occluder at {occluder}, the picture at {depth}");
            assert_eq!(depth > 0.0, self.items[i] != NOTHING, "{at}, pixel {i}: picture and items differ");
        }
    }
}
