//! A device that fails the test on validation messages, and scenes made by hand.

use std::ops::Deref;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::{View, Viewport};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_scene::{Drawable, Node, ObjectRecord, Rgba8, Scene, SceneArrays, Shading, Vertex};

/// An open device that must have nothing to complain of when it goes.
pub(crate) struct CheckedGpu(Arc<Gpu>);

impl CheckedGpu {
    /// A device, or `None` where there is no Vulkan at all and the test may be skipped.
    pub(crate) fn open() -> Option<Self> {
        Self::with(GpuOptions::default())
    }

    /// The same, opened in this way, and validated.
    pub(crate) fn with(options: GpuOptions) -> Option<Self> {
        match Gpu::open(&GpuOptions { validation: true, ..options }) {
            Ok(gpu) => Some(Self(gpu)),
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

impl Deref for CheckedGpu {
    type Target = Arc<Gpu>;

    fn deref(&self) -> &Arc<Gpu> {
        &self.0
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

/// An object: triangles in a local frame, and where that is.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) indices: Vec<u32>,
    pub(crate) colour: [u8; 4],
    pub(crate) origin: DVec3,
    pub(crate) linear: Mat3,
}

impl Part {
    /// Triangles whose corners are given one after the other, at the world's origin.
    pub(crate) fn triangles(positions: &[[f32; 3]]) -> Self {
        Self {
            positions: positions.to_vec(),
            indices: (0..positions.len() as u32).collect(),
            colour: [200, 150, 100, 255],
            origin: DVec3::ZERO,
            linear: Mat3::IDENTITY,
        }
    }

    /// An upright rectangle about `centre` that faces along z; triangle 0 is its lower left half.
    pub(crate) fn wall(centre: Vec3, half_width: f32, half_height: f32) -> Self {
        let at = |x: f32, y: f32| (centre + Vec3::new(x * half_width, y * half_height, 0.0)).to_array();
        let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)];
        Self { indices: vec![0, 1, 2, 2, 1, 3], ..Self::triangles(&corners) }
    }

    fn shaded(&self) -> (Vec<Vertex>, Vec<u32>) {
        let vertex = |&position: &[f32; 3]| Vertex::new(position, Rgba8(self.colour));
        let mut shading = Shading::new(self.positions.iter().map(vertex).collect());
        let mut indices = self.indices.clone();
        shading.turn(&mut indices);
        (shading.into_vertices(), indices)
    }

    /// The same part elsewhere.
    pub(crate) fn at(self, origin: DVec3) -> Self {
        Self { origin, ..self }
    }
}

/// A scene of these parts; part i is drawable i.
pub(crate) fn scene(parts: &[Part]) -> Scene {
    let far = 1e12;
    let mut arrays = SceneArrays { sources: vec!["test".into()], ..SceneArrays::default() };
    let node = |parent, first_child, child_count, part: Option<(u32, &Part)>| Node {
        world_min: [-far; 3],
        world_max: [far; 3],
        origin: part.map_or([0.0; 3], |(_, part)| part.origin.to_array()),
        linear: part.map_or(Mat3::IDENTITY, |(_, part)| part.linear).to_cols_array(),
        local_min: [-1e9; 3],
        local_max: [1e9; 3],
        parent,
        first_child,
        child_count,
        first_drawable: part.map_or(0, |(index, _)| index),
        drawable_count: u32::from(part.is_some()),
        object: part.map_or(Node::NONE, |(index, _)| index),
        reserved: 0,
    };
    arrays.nodes.push(node(Node::NONE, 1, parts.len() as u32, None));
    for (index, part) in (0..).zip(parts) {
        arrays.nodes.push(node(0, 0, 0, Some((index, part))));
        let (vertices, indices) = part.shaded();
        arrays.drawables.push(Drawable {
            error: 0.0,
            node: index + 1,
            first_index: arrays.indices.len() as u32,
            index_count: part.indices.len() as u32,
            vertex_offset: arrays.vertices.len() as u32,
            vertex_count: vertices.len() as u32,
        });
        arrays.indices.extend(indices);
        arrays.vertices.extend(vertices);
        arrays.objects.push(ObjectRecord { source: 0, source_index: index, name_start: 0, name_length: 0 });
    }
    Scene::from_arrays(arrays).unwrap()
}

/// Parts on a device.
pub(crate) fn upload(gpu: &Arc<Gpu>, parts: &[Part]) -> Arc<GpuScene> {
    GpuScene::upload(gpu, &Arc::new(scene(parts))).unwrap()
}

/// All drawables of a scene of so many parts.
pub(crate) fn ids(count: usize) -> Vec<DrawableId> {
    (0..count as u32).map(DrawableId).collect()
}

/// The nearest that anything is seen in these tests, metres.
pub(crate) const NEAR: f32 = 0.125;

/// A camera at `eye` that looks along -z, 90 degrees high, into a picture of this size.
pub(crate) fn view(width: u32, height: u32, eye: DVec3) -> View {
    let viewport = Viewport::new(width, height).unwrap();
    let camera =
        Camera::new(eye.to_array(), [0.0, 0.0, 0.0, 1.0], 1.0, viewport.aspect(), NEAR, FrameNumber(0));
    View::new(camera.unwrap(), viewport)
}
