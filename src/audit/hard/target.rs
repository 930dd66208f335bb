//! A target of walks: the f64 oracle, or a Vulkan device.

use std::sync::Arc;

use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_audit::{
    IdBuffer, Placement, Testing, WalkthroughError,
    cases::{Case, CaseError},
    rasterize,
};
use trimaran_cull::{LodRule, View, draw_order, lod_cut};
use trimaran_gpu::{Gpu, GpuError, GpuScene, ItemImage, ItemPass};
use trimaran_proto::{DrawableId, OcclusionTestKind};
use trimaran_scene::Scene;

use crate::{
    audit::{CaseOnDevice, CaseWalkError, Figures, Way, walk_reference},
    comparison::System,
    walkthrough::AuditError,
};

/// A target of walks.
pub(in crate::audit) enum Target<'t> {
    Oracle,
    Device(&'t Arc<Gpu>, &'t Handle),
}

/// Why something was not measured.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// A case could not be made.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// The oracle could not walk it.
    #[error(transparent)]
    Reference(#[from] WalkthroughError),
    /// The device could not walk it.
    #[error("{way}: {source}")]
    Walk {
        /// The system and its occlusion test.
        way: String,
        /// The cause.
        source: Box<CaseWalkError>,
    },
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A picture could not be compared with full detail.
    #[error(transparent)]
    Audit(#[from] AuditError),
}

impl MeasureError {
    /// The device's refusal of a picture because of its size.
    pub(in crate::audit) fn refused_size(&self) -> Option<&GpuError> {
        let error = match self {
            Self::Gpu(error) => error,
            Self::Walk { source, .. } => match &**source {
                CaseWalkError::Gpu(error) => error,
                _ => return None,
            },
            _ => return None,
        };
        matches!(error, GpuError::ViewportTooLarge { .. }).then_some(error)
    }
}

/// The figures of a case, walked in some ways.
pub(in crate::audit) struct Walked(Vec<(String, u8, Figures)>);

impl Walked {
    /// The worst of each figure.
    pub(in crate::audit) fn worst(&self) -> Figures {
        self.0.iter().map(|(.., figures)| *figures).reduce(Figures::worse).unwrap_or_default()
    }

    /// The first way that was not exact, or in which something toggled.
    pub(super) fn wrong(&self) -> Option<(&str, &Figures)> {
        let wrong = |(_, _, figures): &&(String, u8, Figures)| !figures.holds();
        self.0.iter().find(wrong).map(|(way, _, figures)| (way.as_str(), figures))
    }

    /// The number of cullers and the figures of each way.
    pub(super) fn by_cullers(&self) -> impl Iterator<Item = (u8, &Figures)> {
        self.0.iter().map(|(_, cullers, figures)| (*cullers, figures))
    }
}

impl Target<'_> {
    /// Walks a case in all these ways; the oracle, which has one culler, with each of its occlusion tests.
    pub(in crate::audit) fn walk(
        &self,
        case: &Case,
        ways: &[Way],
        rule: LodRule,
    ) -> Result<Walked, MeasureError> {
        let mut walked = Vec::with_capacity(ways.len());
        match self {
            Self::Oracle => {
                for testing in [Testing::Rasterized, Testing::Pyramid] {
                    let name = format!("{testing:?}").to_lowercase();
                    walked.push((name, 1, walk_reference(case, testing, rule)?));
                }
            }
            Self::Device(gpu, runtime) => {
                let mut on_device = CaseOnDevice::new(case, gpu, runtime)?;
                for way in ways {
                    let failed = |cause: CaseWalkError| MeasureError::Walk {
                        way: way.to_string(),
                        source: cause.into(),
                    };
                    let figures = on_device.walk(way).map_err(failed)?;
                    walked.push((way.to_string(), way.system.cullers(), figures));
                }
            }
        }
        Ok(Walked(walked))
    }

    /// How many drawables of a still case one culler does not draw, in all frames together.
    pub(super) fn culled(
        &self,
        case: &Case,
        occlusion_test: OcclusionTestKind,
        rule: LodRule,
    ) -> Result<u64, MeasureError> {
        let figures = match (self, occlusion_test) {
            (Self::Oracle, OcclusionTestKind::Hzb) => walk_reference(case, Testing::Pyramid, rule)?,
            (Self::Oracle, _) => walk_reference(case, Testing::Rasterized, rule)?,
            (Self::Device(..), _) => {
                let way = Way { system: System::Independent1, occlusion_test, rule };
                self.walk(case, &[way], rule)?.worst()
            }
        };
        Ok(figures.whole.saturating_sub(figures.drawn))
    }

    /// The object at each pixel, likewise.
    pub(in crate::audit) fn objects(
        &self,
        case: &Case,
        view: &View,
        rule: LodRule,
    ) -> Result<Vec<Option<u32>>, MeasureError> {
        let owners = self.owners(case, view, rule)?;
        Ok(owners.into_iter().map(|owner| object_of(&case.scene, owner?)).collect())
    }

    /// The drawable at each pixel of the LOD cut of a view, without culling, drawn from the farthest to the
    /// nearest: of two at the same depth the wrong one shows.
    pub(super) fn owners(
        &self,
        case: &Case,
        view: &View,
        rule: LodRule,
    ) -> Result<Vec<Option<DrawableId>>, MeasureError> {
        let mut cut = lod_cut(&case.scene, view, rule);
        draw_order(&case.scene, view, &mut cut);
        cut.reverse();
        match self {
            Self::Oracle => Ok(owners(&rasterize(&case.scene, view, cut, Placement::Single))),
            Self::Device(gpu, _) => {
                let scene = GpuScene::new(gpu, &case.scene)?;
                let mut pass = ItemPass::new(&scene, view.viewport())?;
                pass.begin(view)?;
                pass.draw(&cut)?;
                let owner =
                    |[owner, _]: &[u32; 2]| (*owner != ItemImage::BACKGROUND).then_some(DrawableId(*owner));
                Ok(pass.items()?.iter().map(owner).collect())
            }
        }
    }
}

/// The object that a drawable shows; none for a level of several.
pub(super) fn object_of(scene: &Scene, id: DrawableId) -> Option<u32> {
    let drawable = scene.drawables().get(id.index())?;
    scene.nodes().get(drawable.node as usize).map(|node| node.object)
}

/// The drawable at each pixel.
pub(super) fn owners(picture: &IdBuffer) -> Vec<Option<DrawableId>> {
    picture.ids().iter().map(|id| id.map(|id| id.drawable)).collect()
}
