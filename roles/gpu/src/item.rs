//! The item pass (ID buffer): the visible triangle at each pixel, the ground truth of visibility.

use std::mem::offset_of;
use std::sync::Arc;

use ash::vk;
use trimaran_cull::Viewport;
use trimaran_scene::Vertex;

use crate::draw_record::Fetch;
use crate::memory::HostBuffer;
use crate::pass::ScenePass;
use crate::pass_kind::{ColourTarget, PassKind};
use crate::pipeline::{VertexInput, shader};
use crate::solid_pass::SolidPass;
use crate::{GpuError, GpuScene};

/// With Vulkan's own triangle number, which fragment shaders have if the device has geometry shaders.
static NUMBERED: PassKind = PassKind {
    name: "drawing the item buffer",
    vertex: shader!("vs_item"),
    fragment: Some(shader!("fs_item")),
    cut: shader!("fs_item_cut"),
    see_through: None,
    sky: None,
    input: VertexInput::Id,
    colour: Some(TARGET),
    fetch: Fetch::Fixed,
    may_skip: None,
};

/// With a number computed by the vertex shader, on any device. It fetches each triangle's three vertices
/// itself.
static PULLED: PassKind = PassKind {
    vertex: shader!("vs_item_pulled"),
    fragment: Some(shader!("fs_item_pulled")),
    cut: shader!("fs_item_pulled_cut"),
    see_through: None,
    input: VertexInput::PulledId,
    fetch: Fetch::Pulled,
    ..NUMBERED
};

// The vertex layout assumed by `vs_item_pulled`.
const _: () = assert!(size_of::<Vertex>() == 20 && offset_of!(Vertex, position) == 0);

const TARGET: ColourTarget = ColourTarget {
    format: vk::Format::R32G32_UINT,
    background: vk::ClearColorValue { uint32: [ItemImage::BACKGROUND; 4] },
};

/// Whether the scene's device numbers triangles by itself.
fn numbers(scene: &GpuScene) -> bool {
    !scene.gpu().fetches_vertices()
}

/// The visible drawable and triangle at each pixel, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ItemImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The number of the drawable at each pixel, or [`ItemImage::BACKGROUND`].
    pub drawable: Vec<u32>,
    /// The triangle at each pixel, counted from 0 within its drawable, or [`ItemImage::BACKGROUND`].
    pub triangle: Vec<u32>,
}

impl ItemImage {
    /// Stands for "background".
    pub const BACKGROUND: u32 = u32::MAX;
}

/// Draws ids instead of colours.
pub type ItemPass = SolidPass<Items>;

/// The host's copy of an ID buffer.
#[derive(Default)]
pub struct Items(Option<HostBuffer<[u32; 2]>>);

impl ItemPass {
    /// A pass for pictures of `size` at first.
    ///
    /// # Errors
    /// If the device cannot draw that size, or memory does not suffice.
    pub fn new(scene: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        Self::of(scene, if numbers(scene) { &NUMBERED } else { &PULLED }, size)
    }

    fn of(scene: &Arc<GpuScene>, kind: &'static PassKind, size: Viewport) -> Result<Self, GpuError> {
        Ok(Self { pass: ScenePass::new(scene, kind, size)?, kept: Items::default() })
    }

    /// The raw pixels: drawable and triangle, row by row from the top; see [`ItemImage`].
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn items(&mut self) -> Result<&[[u32; 2]], GpuError> {
        self.pass.read_colour(&mut self.kept.0)
    }

    /// Copies the pixels into `image`, reusing its memory.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn read(&mut self, image: &mut ItemImage) -> Result<(), GpuError> {
        let size = self.pass.size();
        let items = self.items()?;
        (image.width, image.height) = (size.width(), size.height());
        image.drawable.clear();
        image.triangle.clear();
        image.drawable.extend(items.iter().map(|[drawable, _]| drawable));
        image.triangle.extend(items.iter().map(|[_, triangle]| triangle));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_audit::cases::{plant, plant_views};
    use trimaran_cull::{LodRule, View, draw_order, lod_cut};
    use trimaran_proto::{DrawableId, Section, SectionPlane, Sections};
    use trimaran_scene::FlatObject;

    use super::*;
    use crate::common::{CheckedGpu, ids, triangles, upload, view};

    fn items(mut pass: ItemPass, views: &[(View, Vec<DrawableId>)]) -> Vec<ItemImage> {
        let draw = |(view, ids): &(View, Vec<DrawableId>)| {
            let mut image = ItemImage::default();
            pass.begin(view).unwrap();
            pass.draw(ids).unwrap();
            pass.read(&mut image).unwrap();
            image
        };
        views.iter().map(draw).collect()
    }

    /// Asserts that both ways distinguish the same triangles, and returns how many are visible in all views.
    fn assert_same(scene: &Arc<GpuScene>, views: &[(View, Vec<DrawableId>)]) -> usize {
        let size = views[0].0.viewport();
        let [numbered, pulled] =
            [&NUMBERED, &PULLED].map(|kind| items(ItemPass::of(scene, kind, size).unwrap(), views));
        assert!(numbered == pulled);
        let show = |image: &ItemImage| {
            let mut seen: Vec<_> = image.drawable.iter().zip(&image.triangle).collect();
            seen.sort();
            seen.dedup();
            seen.len()
        };
        numbered.iter().map(show).sum()
    }

    /// A level sheet of `n` by `n` squares, whose triangles share the corners that carry their normal.
    fn sheet(n: u32) -> FlatObject {
        let corner =
            |i: u32| [(i % (n + 1)) as f32 / n as f32 - 0.5, (i / (n + 1)) as f32 / n as f32 - 0.5, -1.0];
        let square = |i: u32| {
            let at = i / n * (n + 1) + i % n;
            [at, at + 1, at + n + 1, at + n + 1, at + 1, at + n + 2]
        };
        let corners: Vec<_> = (0..(n + 1) * (n + 1)).map(corner).collect();
        FlatObject { indices: (0..n * n).flat_map(square).collect(), ..triangles(&corners) }
    }

    #[test]
    fn fetching_vertices_tells_the_same_triangles_apart_as_the_devices_own_numbers() {
        let Some(gpu) = CheckedGpu::open() else { return };
        if gpu.fetches_vertices() {
            println!("skipped: the device has no numbers of its own");
            return;
        }
        let sheets = [(50, DVec3::ZERO), (1, DVec3::new(0.6, 0.0, 0.1)), (3, DVec3::new(0.0, 0.0, -0.2))]
            .map(|(n, origin)| FlatObject { origin, ..sheet(n) });
        let scene = upload(&gpu, &sheets);
        let shown = assert_same(&scene, &[(view(300, 300, DVec3::ZERO), ids(3))]);
        assert!(shown > 3_000, "{shown} triangles show");

        let scene = plant(7, 800, DVec3::new(1e6, 2e6, 0.0)).unwrap();
        let size = Viewport::new(320, 200).unwrap();
        let views = plant_views(7, 800, DVec3::new(1e6, 2e6, 0.0), size, 30).unwrap();
        let cut = |view: &View| {
            let mut cut = lod_cut(&scene, view, LodRule::new(1.0).unwrap());
            draw_order(&scene, view, &mut cut);
            (*view, cut)
        };
        let views: Vec<_> = views.iter().step_by(6).map(cut).collect();
        let scene = GpuScene::new(&gpu, &scene).unwrap();
        let whole = assert_same(&scene, &views);

        let direction = [0.6, 0.64, 0.48];
        let section =
            |view: &View| Section::Plane(SectionPlane::new(view.eye().to_array(), direction).unwrap());
        let cut = |(view, ids): &(View, Vec<_>)| {
            (view.with_sections(Sections::new(&[section(view)]).unwrap()), ids.clone())
        };
        let shown = assert_same(&scene, &views.iter().map(cut).collect::<Vec<_>>());
        assert!(shown > 0 && shown < whole, "{shown} of {whole} triangles show");
    }
}
