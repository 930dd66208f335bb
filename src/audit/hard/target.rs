//! What cases are walked on: the f64 oracle, or a Vulkan device.

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
use trimaran_proto::DrawableId;

use crate::{
    audit::{CaseOnDevice, CaseWalkError, Figures, Way, walk_reference},
    walkthrough::AuditError,
};

/// What cases are walked on.
pub(super) enum Target<'t> {
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
    /// Whether the device cannot draw the picture because of its size.
    #[must_use]
    pub fn is_refused_size(&self) -> bool {
        match self {
            Self::Gpu(GpuError::ViewportTooLarge { .. }) => true,
            Self::Walk { source, .. } => {
                matches!(**source, CaseWalkError::Gpu(GpuError::ViewportTooLarge { .. }))
            }
            _ => false,
        }
    }
}

/// A walk's figures, and the way that was worst if it was not exact.
pub(super) struct Walked {
    pub(super) figures: Figures,
    pub(super) worst: Option<String>,
}

impl Target<'_> {
    /// The worst figures of all the ways to walk a case.
    pub(super) fn walk(&self, case: &Case, ways: &[Way], rule: LodRule) -> Result<Walked, MeasureError> {
        let mut walked = Walked { figures: Figures::default(), worst: None };
        let mut add = |name: &dyn Fn() -> String, figures: Figures| {
            if walked.worst.is_none() && !(figures.is_exact() && figures.toggles.unwrap_or(0) == 0) {
                walked.worst = Some(name());
            }
            walked.figures = walked.figures.worse(figures);
        };
        match self {
            Self::Oracle => {
                for testing in [Testing::Rasterized, Testing::Pyramid] {
                    add(&|| format!("{testing:?}").to_lowercase(), walk_reference(case, testing, rule)?);
                }
            }
            Self::Device(gpu, runtime) => {
                let mut on_device = CaseOnDevice::new(case, gpu, runtime)?;
                for way in ways {
                    let name = || way.to_string();
                    let figures = on_device.walk(way);
                    add(
                        &name,
                        figures.map_err(|cause| MeasureError::Walk { way: name(), source: cause.into() })?,
                    );
                }
            }
        }
        Ok(walked)
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

/// The drawable at each pixel.
pub(super) fn owners(picture: &IdBuffer) -> Vec<Option<DrawableId>> {
    picture.ids().iter().map(|id| id.map(|id| id.drawable)).collect()
}
