//! A device that fails the test on validation messages, and scenes made by hand.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use parking_lot::{ReentrantMutex, ReentrantMutexGuard};
use trimaran_cull::{OcclusionTest, TestBox, View, Viewport};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene, ItemPass, OccluderPass, Optional, PicturePass};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_scene::{FlatObject, Rgba8, Scene, SceneArrays};

/// An open device without validation messages when it is dropped.
///
/// One thread has such devices at a time: Debian's validation layer crashes a thread that calls Vulkan while
/// another opens or closes a device (Vulkan-ValidationLayers, issue 4391).
pub(crate) struct CheckedGpu(
    Arc<Gpu>,
    #[expect(dead_code, reason = "held")] ReentrantMutexGuard<'static, ()>,
);

static ONE_THREAD: ReentrantMutex<()> = ReentrantMutex::new(());

impl CheckedGpu {
    /// A device, or `None` if there is no Vulkan at all and the test may be skipped.
    pub(crate) fn open() -> Option<Self> {
        Self::with(GpuOptions::default())
    }

    /// The same, opened with these options, and validated.
    pub(crate) fn with(options: GpuOptions) -> Option<Self> {
        let turn = ONE_THREAD.lock();
        match Gpu::open(&GpuOptions { validation: true, ..options }) {
            Ok(gpu) => Some(Self(gpu, turn)),
            Err(error @ GpuError::NoLoader(_)) if !gpu_is_required() => {
                println!("skipped: {error}");
                None
            }
            Err(error) => panic!("{error}"),
        }
    }
}

fn gpu_is_required() -> bool {
    std::env::var_os("TRIMARAN_REQUIRE_GPU").is_some_and(|value| value == "1")
}

/// Whether a test that keeps the depth pyramid on the device is to be skipped.
pub(crate) fn lacks_float64(gpu: &Gpu) -> bool {
    let lacks = gpu.info().lacks.contains(&Optional::Float64);
    if lacks {
        println!("skipped: the device has no f64 in shaders");
    }
    lacks
}

impl Deref for CheckedGpu {
    type Target = Arc<Gpu>;

    fn deref(&self) -> &Arc<Gpu> {
        &self.0
    }
}

impl DerefMut for CheckedGpu {
    fn deref_mut(&mut self) -> &mut Arc<Gpu> {
        &mut self.0
    }
}

impl Drop for CheckedGpu {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let messages = self.0.validation_messages();
            assert!(
                messages.is_empty(),
                "{} validation messages, the first: {}",
                messages.len(),
                messages[0]
            );
        }
    }
}

/// Triangles whose corners are given one after the other, at the world's origin.
pub(crate) fn triangles(positions: &[[f32; 3]]) -> FlatObject {
    FlatObject {
        positions: positions.iter().copied().map(Vec3::from_array).collect(),
        indices: (0..positions.len() as u32).collect(),
        colour: Rgba8([200, 150, 100, 255]),
        origin: DVec3::ZERO,
        linear: Mat3::IDENTITY,
    }
}

/// An upright rectangle about `centre` that faces along z; triangle 0 is its lower left half.
pub(crate) fn wall(centre: Vec3, half_width: f32, half_height: f32) -> FlatObject {
    let at = |x: f32, y: f32| (centre + Vec3::new(x * half_width, y * half_height, 0.0)).to_array();
    let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)];
    FlatObject { indices: vec![0, 1, 2, 2, 1, 3], ..triangles(&corners) }
}

/// A scene of these objects; object i is drawable i.
pub(crate) fn scene(objects: &[FlatObject]) -> Scene {
    Scene::from_arrays(SceneArrays::flat(objects)).unwrap()
}

/// Objects on a device.
pub(crate) fn upload(gpu: &Arc<Gpu>, objects: &[FlatObject]) -> Arc<GpuScene> {
    GpuScene::new(gpu, &Arc::new(scene(objects))).unwrap()
}

/// All drawables of a scene of this many objects.
pub(crate) fn ids(count: usize) -> Vec<DrawableId> {
    (0..count as u32).map(DrawableId).collect()
}

/// The near distance of these tests, metres.
pub(crate) const NEAR: f32 = 0.125;

/// A camera at `eye` that looks along -z, 90 degrees high, into a picture of this size.
pub(crate) fn view(width: u32, height: u32, eye: DVec3) -> View {
    let viewport = Viewport::new(width, height).unwrap();
    let camera = Camera::new(eye.to_array(), [0.0, 0.0, 0.0, 1.0], 1.0, NEAR, FrameNumber(0));
    View::new(camera.unwrap(), viewport)
}

/// The depth of these drawables.
pub(crate) fn depth(pass: &mut OccluderPass, view: &View, ids: &[DrawableId]) -> Vec<f32> {
    pass.begin(view).unwrap();
    pass.draw(ids).unwrap();
    pass.read_depth().unwrap().depth().to_vec()
}

/// The picture of these drawables.
pub(crate) fn pixels(pass: &mut PicturePass, view: &View, ids: &[DrawableId]) -> Vec<[u8; 4]> {
    pass.begin(view).unwrap();
    pass.draw(ids).unwrap();
    pass.finish().unwrap();
    pass.pixels().unwrap().to_vec()
}

/// The ID buffer of these drawables.
pub(crate) fn items(pass: &mut ItemPass, view: &View, ids: &[DrawableId]) -> Vec<[u32; 2]> {
    pass.begin(view).unwrap();
    pass.draw(ids).unwrap();
    pass.items().unwrap().to_vec()
}

/// The answers of an occlusion test.
pub(crate) fn answers(mut test: impl OcclusionTest, view: &View, boxes: &[TestBox]) -> Vec<u32> {
    // Earlier content must not stay.
    let mut answers = vec![9; 7];
    test.test(view, boxes, &mut answers).unwrap();
    answers
}
