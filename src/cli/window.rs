//! `trimaran view --window`: the same in a window of the system.

use std::path::Path;

use trimaran::{
    page::SceneDescription,
    window::{WindowOptions, navigate::Start, open},
};
use trimaran_proto::LodRule;

use super::{
    Failure,
    args::{DeviceArgs, ViewArgs},
    walking::{self, gpu_options, runtime, stop_on_signal},
};

/// The most pixels by which a silhouette may be off: as in the page.
const EPSILON: f64 = 2.0;

pub(super) fn run(args: &ViewArgs, scene: &Path) -> Result<(), Failure> {
    let file = walking::open(scene)?;
    let SceneDescription { name, has_floors, eye_height, clearance, vfov_deg, start, .. } =
        SceneDescription::new(scene, &file.scene).map_err(Failure::broken)?;
    let DeviceArgs { device, gpu_memory, device_timeout } = &args.device;
    let (eye, forward) = (start.eye.into(), start.forward.into());
    let options = WindowOptions {
        name,
        start: Start { eye, forward, eye_height, has_floors, vfov_deg },
        clearance,
        lod: LodRule::new(EPSILON).map_err(Failure::broken)?,
        present_mode: args.present_mode.into(),
        gpu: gpu_options(device.as_deref(), *gpu_memory, *device_timeout),
    };
    let runtime = runtime()?;
    let stop = stop_on_signal(&runtime);
    open(&file.scene, &options, runtime.handle(), &stop)
        .map_err(|error| if error.is_of_input() { Failure::bad_input(error) } else { Failure::broken(error) })
}
