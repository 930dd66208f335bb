//! How close two surfaces may be.

use glam::{DVec3, Vec3};
use trimaran_audit::cases::{Case, CaseError, Mesh, Object, build, looking};
use trimaran_cull::Viewport;
use trimaran_proto::DrawableId;

use super::{
    measures::{Bench, Measured, one_culler},
    target::MeasureError,
};

/// A wall across the view at `distance` metres, and a plate behind it, farther by `gap` of the distance.
fn pair(distance: f64, gap: f64, plate: f64, frames: u32) -> Result<Case, CaseError> {
    let rectangle = |half: f64, y: f64| {
        let half = (half * distance) as f32;
        let mesh = Mesh::rectangle(Vec3::ZERO, Vec3::X * half, Vec3::Z * half, 1);
        Object::new(mesh).at(DVec3::Y * (y * distance))
    };
    let scene = build(&[rectangle(2.0, 1.0), rectangle(plate, 1.0 + gap)], false)?;
    let size = Viewport::new(32, 24)?;
    let view = looking(DVec3::ZERO, DVec3::Y, 60.0, size, 0)?;
    Ok(Case { name: "pair", scene: scene.into(), views: vec![view; frames as usize] })
}

/// The gap, as it is printed, and whether it is small enough.
fn shown(gap: Option<f64>, most: f64) -> Measured {
    Some(match gap {
        Some(gap) => (format!("{gap:.0e} of the distance"), gap <= most),
        None => ("none".to_owned(), false),
    })
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

/// From which gap on a plate behind a wall is culled, by each occlusion test, at 1 m to 1,000 km.
pub(super) fn culled_gap(bench: &Bench<'_>) -> Result<Measured, MeasureError> {
    let gaps: Vec<f64> = (1..=7).rev().map(|power| 10_f64.powi(-power)).collect();
    let distances = [0, 2, 4, 6].into_iter().map(|power| 10_f64.powi(power));
    let gap = smallest(distances, &gaps, |distance, gap| {
        let case = pair(distance, gap, 0.06, 6)?;
        for way in one_culler(bench.rule) {
            let figures = bench.target.walk(&case, &[way], bench.rule)?.figures;
            if figures.drawn == figures.whole {
                return Ok(false);
            }
        }
        Ok(true)
    })?;
    Ok(shown(gap, 0.01))
}

/// The smallest gap at which the nearer of two surfaces shows at each pixel, though it is drawn first, at
/// 0.1 m to 10,000 km.
pub(super) fn resolved_gap(bench: &Bench<'_>) -> Result<Measured, MeasureError> {
    let gaps: Vec<f64> = (16..=25).rev().map(|power| 0.5_f64.powi(power)).collect();
    let distances = (-1..=7).map(|power| 10_f64.powi(power));
    let gap = smallest(distances, &gaps, |distance, gap| {
        let case = pair(distance, gap, 2.0, 1)?;
        let Some(view) = case.views.first() else { return Ok(false) };
        let owners = bench.target.owners(&case, view, bench.rule)?;
        let nearer = |owner: &Option<DrawableId>| {
            let drawable = owner.and_then(|id| case.scene.drawables().get(id.index()));
            let node = drawable.and_then(|drawable| case.scene.nodes().get(drawable.node as usize));
            node.is_some_and(|node| node.object == 0)
        };
        Ok(owners.iter().all(nearer))
    })?;
    Ok(shown(gap, 1e-6))
}
