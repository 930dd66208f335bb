//! Whole sessions of a display and two cullers in this process.

use std::sync::Arc;

use tokio::runtime::{Builder, Runtime};
use trimaran::report::Frame;
use trimaran::vulkan::{VulkanCuller, VulkanDisplay};
use trimaran::walkthrough::{Auditor, CameraPath, FrameRecord, PathChoice, Plan, Recorder, SceneOnDevices};
use trimaran_actors::{CullerDevice, CullerId, LocalSession, Stop};
use trimaran_cull::{LodRule, View, lod_cut};
use trimaran_proto::{BatchSize, OcclusionTestKind, Settings, Viewport};
use trimaran_scene::Scene;

/// A scene on the devices of a display and two cullers, or `None` if there is no device and none is required.
pub(crate) fn on_devices(scene: &Arc<Scene>) -> Option<SceneOnDevices> {
    with_cullers(scene, 2)
}

/// The same with this many cullers, at most three.
pub(crate) fn with_cullers(scene: &Arc<Scene>, cullers: usize) -> Option<SceneOnDevices> {
    let [display, others @ ..] = super::devices()?;
    Some(SceneOnDevices::new(scene, &others[..cullers], display).unwrap())
}

/// A walk that shows each of its frames.
pub(crate) fn plan(
    [width, height]: [u32; 2],
    epsilon_px: f64,
    batch: u32,
    occlusion_test: OcclusionTestKind,
) -> Plan {
    let settings = Settings::new(Viewport::new(width, height).unwrap(), LodRule::new(epsilon_px).unwrap());
    let batch = BatchSize::new(batch).unwrap();
    Plan { audit_every: 1, ..Plan::new(Settings { batch, occlusion_test, ..settings }) }
}

/// The first `frames` cameras of a path.
pub(crate) fn camera_path(
    devices: &SceneOnDevices,
    plan: &Plan,
    path: &PathChoice,
    frames: u32,
) -> CameraPath {
    CameraPath::find(path, &devices.scene, plan.settings().into(), Some(frames)).unwrap()
}

/// Walks with all roles in this process; every picture is read back.
pub(crate) fn walk_in_process(devices: &SceneOnDevices, plan: &Plan, path: &CameraPath) -> Vec<FrameRecord> {
    recorded(|recorder, runtime, stop| {
        devices.walk(plan, path, recorder, runtime.handle(), stop).unwrap();
    })
}

/// The same with cullers of other devices: a culler's, or without one the display's own.
pub(crate) fn walk_with<P: CullerDevice>(
    devices: &SceneOnDevices,
    plan: &Plan,
    path: &CameraPath,
    culler: impl Fn(Option<CullerId>) -> P + Sync,
) -> Vec<FrameRecord> {
    let display = VulkanDisplay::new(&devices.display, plan.viewport).unwrap();
    let session = LocalSession::new(&devices.scene, plan.settings(), path.frames());
    let device = |id| Ok(culler(id));
    recorded(|recorder, runtime, stop| {
        session.run(device, display, &mut path.clone(), recorder, runtime.handle(), stop).unwrap();
    })
}

fn recorded(walk: impl FnOnce(&mut Recorder<'_>, &Runtime, &Stop)) -> Vec<FrameRecord> {
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let (_stopper, stop) = Stop::new();
    let mut quiet = |_| {};
    let mut recorder = Recorder::new(1, &mut quiet);
    walk(&mut recorder, &runtime, &stop);
    recorder.into_frames()
}

/// Audits one frame in this many of a session on the display's device, with the given culler.
pub(crate) fn audit<P: CullerDevice>(
    devices: &SceneOnDevices,
    plan: &Plan,
    records: &[FrameRecord],
    every: usize,
    mut culler: P,
    mut each: impl FnMut(&FrameRecord, Frame),
) {
    let mut auditor = Auditor::new(&devices.scene, &devices.display, plan.settings()).unwrap();
    for (index, record) in records.iter().enumerate().step_by(every) {
        let mut frame = Frame::default();
        let walk = &records[..=index];
        auditor.audit(Some(&mut culler), walk, false, &mut frame, &mut Default::default()).unwrap();
        each(record, frame);
    }
}

/// A correct culler on the display's device.
pub(crate) fn culler(devices: &SceneOnDevices, plan: &Plan) -> VulkanCuller {
    VulkanCuller::new(&devices.display, plan.viewport, plan.occlusion_test).unwrap()
}

/// How many drawables the frame's LOD cut has before culling.
pub(crate) fn uncut_count(devices: &SceneOnDevices, plan: &Plan, record: &FrameRecord) -> usize {
    let view = View::new(record.camera, plan.viewport);
    lod_cut(&devices.scene, &view, plan.lod).len()
}

/// Fails if the validation layer has reported anything.
pub(crate) fn assert_no_validation_messages(devices: &SceneOnDevices) {
    for drawn in devices.drawn() {
        assert_eq!(drawn.gpu().validation_messages(), Vec::<String>::new());
    }
}
