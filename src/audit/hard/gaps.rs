//! How close two surfaces may be.

use glam::{DVec3, Vec3};
use trimaran_audit::cases::{Case, CaseError, Mesh, Object, build, looking_past};
use trimaran_cull::{LodRule, Viewport};
use trimaran_proto::OcclusionTestKind;

use super::{
    measures::{Bench, Measured},
    target::{MeasureError, Target},
};
use crate::{audit::Way, comparison::System};

/// The near plane, metres.
const NEAR: f32 = 0.01;

/// A wall across the view at `distance` metres, and a plate behind it, farther by `gap` of the distance.
fn pair(near: f32, distance: f64, gap: f64, plate: f64, frames: u32) -> Result<Case, CaseError> {
    let rectangle = |half: f64, y: f64| {
        let half = (half * distance) as f32;
        let mesh = Mesh::rectangle(Vec3::ZERO, Vec3::X * half, Vec3::Z * half, 1);
        Object::new(mesh).at(DVec3::Y * (y * distance))
    };
    let scene = build(&[rectangle(2.0, 1.0), rectangle(plate, 1.0 + gap)], false)?;
    let size = Viewport::new(32, 24)?;
    let view = looking_past(near, DVec3::ZERO, DVec3::Y, 60.0, size, 0)?;
    Ok(Case { name: "pair", scene: scene.into(), views: vec![view; frames as usize] })
}

/// The largest of the smallest gaps at the distances, of those gaps from small to large that satisfy.
fn smallest(
    distances: impl Iterator<Item = f64>,
    gaps: &[f64],
    mut satisfies: impl FnMut(f64, f64) -> Result<bool, MeasureError>,
) -> Result<Option<f64>, MeasureError> {
    let mut largest = Some(0.0_f64);
    for distance in distances {
        let mut found = None;
        for &gap in gaps {
            if satisfies(distance, gap)? {
                found = Some(gap);
                break;
            }
        }
        largest = largest.zip(found).map(|(largest, found)| largest.max(found));
    }
    Ok(largest)
}

/// From which gap on a plate behind a wall is culled, at 1 m to 1,000 km. With rasterized boxes it is a part
/// of the distance. A depth pyramid takes boxes to be nearer by half a pixel: there it is in pixels.
pub(super) fn culled_gap(bench: &Bench<'_>) -> Result<Measured, MeasureError> {
    use OcclusionTestKind::{Hzb, Query, Raster};
    const MOST: f64 = 1e-4;
    const MOST_PX: f64 = 0.75;
    let pixel = 2.0 * 30_f64.to_radians().tan() / 24.0;
    let gap = |gaps: &[f64], tests: &[OcclusionTestKind]| {
        let distances = [0, 2, 4, 6].into_iter().map(|power| 10_f64.powi(power));
        smallest(distances, gaps, |distance, gap| {
            let case = pair(NEAR, distance, gap, 0.06, 6)?;
            for test in tests {
                if bench.target.culled(&case, *test, bench.rule)? == 0 {
                    return Ok(false);
                }
            }
            Ok(true)
        })
    };
    let powers: Vec<f64> = (1..=7).rev().map(|power| 10_f64.powi(-power)).collect();
    let pixels: Vec<f64> = (1..=16).map(|quarters| f64::from(quarters) * 0.25 * pixel).collect();
    let (drawn, pyramid) = (gap(&powers, &[Query, Raster])?, gap(&pixels, &[Hzb])?);
    Ok(Some(match drawn.zip(pyramid) {
        Some((drawn, pyramid)) => {
            let px = pyramid / pixel;
            (format!("{drawn:.0e} of it; hzb {px:.2} px"), drawn <= MOST && px <= MOST_PX)
        }
        None => ("none".to_owned(), false),
    }))
}

/// The smallest gap that is resolved at 0.1 m to 10,000 km, of the distance.
pub(super) fn resolved_gap(bench: &Bench<'_>) -> Result<Measured, MeasureError> {
    let mut largest = Some(0.0_f64);
    for distance in (-1..=7).map(|power| 10_f64.powi(power)) {
        let found = resolved(bench.target, NEAR, distance, bench.rule)?;
        largest = largest.zip(found).map(|(largest, found)| largest.max(found));
    }
    Ok(Some(largest.map_or(("none".to_owned(), false), |gap| (format!("{gap:.0e} of it"), gap <= 1e-6))))
}

/// The smallest gap at which the nearer of two surfaces shows at each pixel, though it is drawn first, of
/// their distance.
fn resolved(
    target: &Target<'_>,
    near: f32,
    distance: f64,
    rule: LodRule,
) -> Result<Option<f64>, MeasureError> {
    for gap in (1..=25).rev().map(|power| 0.5_f64.powi(power)) {
        let case = pair(near, distance, gap, 2.0, 1)?;
        let Some(view) = case.views.first() else { return Ok(None) };
        let objects = target.objects(&case, view, rule)?;
        if objects.iter().all(|object| *object == Some(0)) {
            return Ok(Some(gap));
        }
    }
    Ok(None)
}

/// The smallest gap that is resolved, and how many pixels are wrong where a plate is a tenth of the distance
/// behind a wall.
pub(in crate::audit) fn depth_at(
    target: &Target<'_>,
    near: f32,
    distance: f64,
    rule: LodRule,
) -> Result<(Option<f64>, u64), MeasureError> {
    let way = |occlusion_test| Way { system: System::Independent1, occlusion_test, rule };
    let case = pair(near, distance, 0.1, 0.06, 4)?;
    let walked = target.walk(&case, &OcclusionTestKind::ALL.map(way), rule)?.worst();
    Ok((resolved(target, near, distance, rule)?, walked.wrong_pixels + walked.lost_nodes))
}
