//! Why something visible was not drawn, in a finished session: repeats its machine's work, and compares it
//! with the reference.

use std::{collections::BTreeMap, sync::Arc};

use thiserror::Error;
use trimaran_actors::{CullerDevice, OccluderPolicy, RoleError};
use trimaran_audit::{CulledFrame, Missing, causes};
use trimaran_cull::{Culler, FalseCullCause, View, occluder_bias_px};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::report::schema::FalseCull;
use crate::walkthrough::{FrameRecord, ViewStates};

/// Why the cause could not be searched for.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AttributionError {
    /// The frame could not be culled again.
    #[error("culling the frame failed")]
    Culling(#[from] RoleError),
    /// The machine failed.
    #[error("the device failed")]
    Device(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// The false culls of the last frame of `walk`, by cause. A session is deterministic: from the frames before
/// and the frame's camera, `machine` draws the same occluders and tests the same boxes as the machine of the
/// session did. Returns none if the sets of these frames are unknown: some were drawn only as far as they had
/// come.
///
/// # Errors
/// If the machine fails, or the frames are not of this scene.
pub(super) fn false_culls<D: CullerDevice>(
    scene: &Arc<Scene>,
    views: &ViewStates,
    machine: &mut D,
    walk: &[FrameRecord],
    missing: &[Missing],
) -> Result<Vec<FalseCull>, AttributionError> {
    let [earlier @ .., record] = walk else { return Ok(Vec::new()) };
    // Cullers did no work for a frame that is shown again.
    let earlier: Vec<&FrameRecord> = earlier.iter().filter(|earlier| !earlier.again).collect();
    let before: Vec<&FrameRecord> = earlier.iter().rev().take(2).copied().collect();
    if record.again || before.iter().any(|before| before.lacking > 0) {
        return Ok(Vec::new());
    }
    let mut session = Session { culler: Culler::new(Arc::clone(scene)), views };
    // The cause may lie in its culler's work for the culler's last frame.
    if let Some(place) = earlier.iter().rposition(|own| own.culler == record.culler)
        && let Some((own, own_earlier)) = earlier.get(..=place).and_then(<[_]>::split_last)
        && session.draw_occluders(machine, own_earlier, own)?.is_none()
    {
        return Ok(Vec::new());
    }
    let Some(occluders) = session.draw_occluders(machine, &earlier, record)? else { return Ok(Vec::new()) };
    let seen = |camera| views.view(camera).on_grid(machine.grid());
    let view = seen(record.camera);
    let before: Vec<(View, &[DrawableId])> =
        before.iter().map(|before| (seen(before.camera), before.ids.as_slice())).collect();
    let depth = machine.read_depth().map_err(device)?.depth().to_vec();
    let frame = CulledFrame {
        scene,
        view: &view,
        rule: &views.rule(scene, &record.camera),
        occluders: &occluders,
        depth: &depth,
        sent: record.stats.as_ref().map(|stats| stats.culling.emitted.into()),
        drawn: &record.ids,
        bias_px: occluder_bias_px(&view),
        before: &before,
    };
    let causes = causes(&frame, machine, missing).map_err(device)?;
    Ok(by_cause(missing.iter().zip(causes)))
}

/// State shared by all frames of a session.
struct Session<'v> {
    culler: Culler,
    views: &'v ViewStates,
}

impl Session<'_> {
    /// Culls a frame again, with occluders from an earlier frame, and returns the drawn ones. `None` if the
    /// earlier frame's set is unknown.
    fn draw_occluders<D: CullerDevice>(
        &mut self,
        machine: &mut D,
        earlier: &[&FrameRecord],
        record: &FrameRecord,
    ) -> Result<Option<Vec<DrawableId>>, AttributionError> {
        let view = self.views.view(record.camera).on_grid(machine.grid());
        let rule = self.views.rule(self.culler.scene(), &record.camera);
        machine.change_occlusion_test(self.views.of(&record.camera).occlusion_test);
        let source = record.stats.and_then(|stats| stats.occluders_of);
        let before = earlier.iter().rfind(|before| Some(before.camera.frame()) == source);
        if before.is_some_and(|before| before.lacking > 0) {
            return Ok(None);
        }
        let last = before.map(|before| before.ids.as_slice()).unwrap_or_default();
        let policy = OccluderPolicy::default();
        Ok(Some(policy.cull(&mut self.culler, machine, &view, &rule, last)?.occluders))
    }
}

fn by_cause<'m>(causes: impl Iterator<Item = (&'m Missing, FalseCullCause)>) -> Vec<FalseCull> {
    let mut found = BTreeMap::new();
    for (missing, cause) in causes {
        let sum = found.entry(cause).or_insert(FalseCull { cause, nodes: 0, pixels: 0 });
        sum.nodes += 1;
        sum.pixels += missing.pixels.len() as u64;
    }
    found.into_values().collect()
}

fn device<E: std::error::Error + Send + Sync + 'static>(cause: E) -> AttributionError {
    AttributionError::Device(Box::new(cause))
}
