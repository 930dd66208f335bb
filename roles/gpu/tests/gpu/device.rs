//! Opening devices.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use trimaran_gpu::{DeviceChoice, Gpu, GpuError, GpuOptions, OccluderPass};

use crate::common::{CheckedGpu, NEAR, depth, ids, upload, view, wall};

fn validated() -> GpuOptions {
    GpuOptions { validation: true, ..GpuOptions::default() }
}

#[test]
fn a_device_opens_and_says_what_it_is() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let info = gpu.info();
    assert!(!info.name.is_empty());
    assert!(info.api_version >= (1, 3, 0));
    assert_eq!(info.missing, Vec::<&str>::new());
    assert!(info.max_viewport >= 4096);
    assert_eq!(Gpu::list().unwrap().first(), Some(info), "the best device is listed first and opened");
}

#[test]
fn a_device_is_found_by_a_part_of_its_name() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let part: String = gpu.info().name.chars().take(5).collect::<String>().to_uppercase();
    let named = GpuOptions { device: DeviceChoice::Named(part), ..validated() };
    assert_eq!(Gpu::open(&named).unwrap().info(), gpu.info());
}

#[test]
fn a_device_that_is_not_there_is_named_beside_those_that_are() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let absent = GpuOptions { device: DeviceChoice::Named("Voodoo 2".into()), ..validated() };
    let error = Gpu::open(&absent).unwrap_err();
    assert!(matches!(error, GpuError::NoSuchDevice { .. }), "{error}");
    assert!(error.to_string().contains("Voodoo 2"), "{error}");
    assert!(error.to_string().contains(&gpu.info().name), "{error}");
}

#[test]
fn two_devices_in_one_process_draw_at_once() {
    let (Some(one), Some(another)) = (CheckedGpu::open(), CheckedGpu::open()) else { return };
    let depth_of = |gpu: &Arc<Gpu>, distance: f32| {
        let scene = upload(gpu, &[wall(Vec3::new(0.0, 0.0, -distance), 99.0, 99.0)]);
        let view = view(64, 64, DVec3::ZERO);
        let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
        let mut depths = Vec::new();
        for _ in 0..20 {
            depths.extend(depth(&mut pass, &view, &ids(1)));
        }
        depths
    };
    let (one, another): (&Arc<Gpu>, &Arc<Gpu>) = (&one, &another);
    let (near, far) = std::thread::scope(|scope| {
        let near = scope.spawn(|| depth_of(one, 1.0));
        let far = scope.spawn(|| depth_of(another, 4.0));
        (near.join().unwrap(), far.join().unwrap())
    });
    assert!(near.iter().all(|&depth| depth == NEAR), "near / 1 m, exactly");
    assert!(far.iter().all(|&depth| depth == NEAR / 4.0), "near / 4 m, exactly");
}

#[test]
fn one_device_is_shared_by_threads() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let scene = upload(&gpu, &[wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0)]);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let view = view(33, 17, DVec3::ZERO);
                let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
                for _ in 0..20 {
                    assert!(depth(&mut pass, &view, &ids(1)).iter().all(|&depth| depth == NEAR / 2.0));
                }
            });
        }
    });
}
