//! Whether a device culls as the host does: eight frames of a small plant, culled on both.

use std::sync::Arc;

use glam::DQuat;
use trimaran_actors::OccluderPolicy;
use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_cull::{Culler, CutRule, LodRule, OcclusionTest as _, View, Viewport};
use trimaran_gpu::{Gpu, GpuScene, Optional, VulkanCuller};
use trimaran_proto::{Camera, FrameNumber, OcclusionTestKind};

use crate::cli::finding::Finding;

/// Views from the middle of the plant, all around.
const FRAMES: u32 = 8;

/// The check of a device that compares each of its traversals with the host's.
pub(super) fn check(gpu: &Arc<Gpu>) -> Finding {
    let on_host = |why: &str| Finding::new("culling", true, format!("on the host: {why}"));
    if gpu.info().lacks.contains(&Optional::Float64) {
        return on_host("the device has no f64 in shaders");
    }
    match compare(gpu) {
        Ok(Some(drawables)) => {
            let detail = format!("the device culls as the host: {drawables} drawables in {FRAMES} frames");
            Finding::new("culling", true, detail)
        }
        Ok(None) => on_host("the device rounds f64 in another way, or binds too few buffers"),
        Err(error) => Finding::new("culling", false, trimaran_transport::causes(&*error)),
    }
}

/// How many drawables both found; `None` if the device does not traverse the tree.
fn compare(gpu: &Arc<Gpu>) -> Result<Option<usize>, Box<dyn std::error::Error>> {
    let model = plant(&PlantOptions { seed: 1, objects: 300, triangles: 20_000 });
    let scene = Arc::new(cook(&model, &CookOptions::default(), &())?);
    let (size, rule) = (Viewport::new(512, 512)?, CutRule::from(LodRule::new(2.0)?));
    let drawn = GpuScene::new(gpu, &scene)?;
    let mut device = VulkanCuller::new(&drawn, size, OcclusionTestKind::Hzb)?;
    let mut culler = Culler::new(Arc::clone(&scene));
    let (min, max) = scene.nodes().first().map(|root| root.world_box()).unwrap_or_default();
    let (mut last, mut found) = (Vec::new(), 0);
    for frame in 0..FRAMES {
        let turn = DQuat::from_rotation_y(f64::from(frame) * std::f64::consts::TAU / f64::from(FRAMES));
        let eye = ((min + max) * 0.5).to_array();
        let view = View::new(Camera::new(eye, turn.to_array(), 0.5, 0.1, FrameNumber(frame))?, size);
        let frame = OccluderPolicy::default().cull(&mut culler, &mut device, &view, &rule, &last)?;
        if device.traverse(&view, &rule)?.is_none() {
            return Ok(None);
        }
        found += frame.visible.len();
        last = frame.visible;
    }
    Ok(Some(found))
}
