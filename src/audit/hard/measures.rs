//! Figures of the hard cases besides walks.

use std::collections::BTreeMap;

use trimaran_audit::{Placement, cases::Case, rasterize};
use trimaran_cull::{LodRule, View, lod_cut};
use trimaran_gpu::GpuScene;
use trimaran_proto::Settings;

use super::{
    gaps::{culled_gap, resolved_gap},
    inputs::{equal_bounds, invalid_cameras, not_finite},
    target::{MeasureError, Target, Walked, object_of, owners},
};
use crate::walkthrough::{Auditor, ViewStates};

/// A figure of its own.
#[derive(Debug, Clone, Copy)]
pub(super) enum Measure {
    /// From which gap on an object behind a wall is culled.
    CulledGap,
    /// The smallest gap between two surfaces that depth resolves.
    ResolvedGap,
    /// Pixels of the pairs of plates that show the farther one.
    WrongOrder,
    /// Pixels that differ from those of the same scene at the origin.
    UnlikeAtOrigin,
    /// How many invalid cameras, pictures and bounds are refused.
    InvalidCameras,
    /// How many scenes with NaN or infinity are refused.
    NotFinite,
    /// How far levels of detail move surfaces of a case.
    Deviation(&'static str),
    /// Pixels of a case that show the background.
    Background(&'static str),
    /// The delay of a case's pictures.
    Latency(&'static str),
    /// Drawables that a role drew, and that are not of the frame's LOD cut.
    OutsideCut,
    /// Whether cuts are sound where an error equals the bound.
    EqualBounds,
}

/// A figure with its unit, and whether it is as it should be. `None`: it is not measured there.
pub(super) type Measured = Option<(String, bool)>;

/// The means of measuring a target.
pub(super) struct Bench<'b> {
    pub(super) target: &'b Target<'b>,
    pub(super) rule: LodRule,
    pub(super) cases: &'b [Case],
    /// The walks, by the names of their cases.
    pub(super) walked: &'b BTreeMap<&'static str, Result<Walked, MeasureError>>,
}

/// How many pixels the picture of the steady turn moves by between two frames.
const TURN_PX: u32 = 8;

/// An error bound at which these small pictures have coarse levels.
const COARSE_PX: f64 = 16.0;

impl Measure {
    /// The case of which it is a figure, if it is one of several.
    pub(super) const fn case(self) -> Option<&'static str> {
        match self {
            Self::Deviation(name) => Some(name),
            _ => None,
        }
    }

    /// The figure, and its bound.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::CulledGap => {
                "smallest gap behind a wall that is culled, of the distance: at most 1e-4, hzb 0.75 pixels"
            }
            Self::ResolvedGap => "smallest gap that depth resolves, of the distance: at most 1e-6",
            Self::WrongOrder => "pixels that show the farther plate of a pair: 0",
            Self::UnlikeAtOrigin => "pixels unlike those of the same plant at the origin: 0",
            Self::InvalidCameras => "invalid cameras and pictures that are refused: all",
            Self::NotFinite => "scenes with such numbers that are refused: all",
            Self::Deviation(_) => "how far levels move a surface, with a bound of 16 px: at most 16 px",
            Self::Background(_) => "pixels of the closed dome that show the background: 0",
            Self::Latency(_) => "frames shown between a camera and its picture, by cullers n: at most 2n-1",
            Self::OutsideCut => "drawables that were drawn outside of the frame's LOD cut, all cases: 0",
            Self::EqualBounds => "cuts at bounds that equal an error, with each leaf covered once: all",
        }
    }

    /// Measures it.
    pub(super) fn of(self, bench: &Bench<'_>) -> Result<Measured, MeasureError> {
        match self {
            Self::CulledGap => culled_gap(bench),
            Self::ResolvedGap => resolved_gap(bench),
            Self::WrongOrder => wrong_order(bench),
            Self::UnlikeAtOrigin => unlike_at_origin(bench),
            Self::InvalidCameras => Ok(bench.once(invalid_cameras)),
            Self::NotFinite => Ok(bench.once(not_finite)),
            Self::Deviation(name) => deviation(bench, name),
            Self::Background(name) => Ok(bench.walked(name).map(|walked| {
                let pixels = walked.worst().background;
                (format!("{pixels} px"), pixels == 0)
            })),
            Self::Latency(name) => Ok(bench.latency(name)),
            Self::OutsideCut => {
                let all = bench.walked.values().flatten().map(|walked| walked.worst().outside_cut);
                let outside: u64 = all.sum();
                Ok(Some((format!("{outside} drawables"), outside == 0)))
            }
            Self::EqualBounds => {
                let plant = bench.case("origin at 0").filter(|_| bench.is_oracle());
                Ok(plant.map(equal_bounds))
            }
        }
    }
}

impl Bench<'_> {
    pub(super) const fn is_oracle(&self) -> bool {
        matches!(self.target, Target::Oracle)
    }

    fn once(&self, measure: fn() -> (String, bool)) -> Measured {
        self.is_oracle().then(measure)
    }

    fn case(&self, name: &str) -> Option<&Case> {
        self.cases.iter().find(|case| case.name == name)
    }

    fn walked(&self, name: &str) -> Option<&Walked> {
        self.walked.get(name)?.as_ref().ok()
    }

    /// Two frames of each culler are under way: the one that it culls, and the one after it.
    fn latency(&self, name: &str) -> Measured {
        let walked = self.walked(name).filter(|_| !self.is_oracle())?;
        let mut most = BTreeMap::<u8, u32>::new();
        for (cullers, figures) in walked.by_cullers() {
            let frames = most.entry(cullers).or_default();
            *frames = figures.latency_frames.max(*frames);
        }
        let holds =
            most.iter().all(|(cullers, frames)| *frames <= (2 * u32::from(*cullers)).saturating_sub(1));
        let frames =
            |(cullers, frames): (&u8, &u32)| format!("{cullers}: {frames} ({} px)", frames * TURN_PX);
        Some((most.iter().map(frames).collect::<Vec<_>>().join(", "), holds))
    }
}

fn wrong_order(bench: &Bench<'_>) -> Result<Measured, MeasureError> {
    let Some(case) = bench.case("near plane at 1 mm, pairs up to 100 km away") else { return Ok(None) };
    let mut wrong = 0;
    for view in &case.views {
        let shown = bench.target.owners(case, view, bench.rule)?;
        let cut = lod_cut(&case.scene, view, bench.rule);
        let exact = owners(&rasterize(&case.scene, view, cut, Placement::Exact));
        // Two objects after each other are a pair.
        let partners = |(shown, exact): (&Option<_>, &Option<_>)| {
            let (shown, exact) = (object_of(&case.scene, (*shown)?)?, object_of(&case.scene, (*exact)?)?);
            (shown != exact && shown / 2 == exact / 2).then_some(())
        };
        wrong += shown.iter().zip(&exact).filter_map(partners).count();
    }
    Ok(Some((format!("{wrong} px"), wrong == 0)))
}

fn unlike_at_origin(bench: &Bench<'_>) -> Result<Measured, MeasureError> {
    let Some(here) = bench.case("origin at 0") else { return Ok(None) };
    let mut unlike = 0;
    for far in ["origin at 1e6", "origin at 1e7", "origin at 1e8"].iter().filter_map(|name| bench.case(name))
    {
        let mut pixels = 0;
        for (there, view) in here.views.iter().zip(&far.views) {
            let [a, b] =
                [bench.target.owners(here, there, bench.rule)?, bench.target.owners(far, view, bench.rule)?];
            pixels += a.iter().zip(&b).filter(|(a, b)| a != b).count();
        }
        unlike = unlike.max(pixels);
    }
    Ok(Some((format!("{unlike} px"), unlike == 0)))
}

fn deviation(bench: &Bench<'_>, name: &str) -> Result<Measured, MeasureError> {
    let Some(case) = bench.case(name) else { return Ok(None) };
    let Ok(rule) = LodRule::new(COARSE_PX) else { return Ok(None) };
    let Some(moved) = deviation_px(bench.target, case, rule)? else { return Ok(None) };
    Ok(Some((format!("{moved:.2} px"), moved <= COARSE_PX)))
}

/// The largest distance by which levels of detail move a surface of a case, pixels. Every third frame is
/// measured, on devices only.
pub(in crate::audit) fn deviation_px(
    target: &Target<'_>,
    case: &Case,
    rule: LodRule,
) -> Result<Option<f64>, MeasureError> {
    let (Target::Device(gpu, _), Some(first)) = (target, case.views.first()) else { return Ok(None) };
    let views = ViewStates::from(Settings::new(first.viewport(), rule));
    let drawn = GpuScene::new(gpu, &case.scene)?;
    let mut auditor = Auditor::new(&case.scene, &drawn, views)?;
    let mut most = 0_f64;
    for view in case.views.iter().step_by(3) {
        let error = auditor.reference(*View::camera(view), true)?.error;
        let deviations = error.map(|error| [error.surface_max_px, error.silhouette_max_px]);
        most = deviations.into_iter().flatten().flatten().fold(most, f64::max);
    }
    Ok(Some(most))
}
