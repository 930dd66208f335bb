//! The item pass: which triangle shows at each pixel, the ground truth of visibility.

use std::sync::Arc;

use ash::vk;
use trimaran_cull::{View, Viewport};
use trimaran_proto::DrawableId;

use crate::memory::HostBuffer;
use crate::pass::{ColourTarget, PassKind, ScenePass};
use crate::pipeline::{VertexInput, shader};
use crate::{GpuError, GpuScene, PassTiming};

static KIND: PassKind = PassKind {
    name: "drawing the item buffer",
    vertex: shader!("vs_item"),
    fragment: Some(shader!("fs_item")),
    input: VertexInput::Id,
    colour: Some(ColourTarget {
        format: vk::Format::R32G32_UINT,
        background: vk::ClearColorValue { uint32: [ItemImage::BACKGROUND; 4] },
    }),
};

/// What shows at each pixel, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ItemImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The drawable at each pixel (the number in its [`DrawableId`]), or [`ItemImage::BACKGROUND`].
    pub drawable: Vec<u32>,
    /// The triangle at each pixel, counted from 0 within its drawable, or [`ItemImage::BACKGROUND`].
    pub triangle: Vec<u32>,
}

impl ItemImage {
    /// Stands for "nothing shows here".
    pub const BACKGROUND: u32 = u32::MAX;
}

/// Draws ids instead of colours.
pub struct ItemPass {
    pass: ScenePass,
    items: Option<HostBuffer<[u32; 2]>>,
}

impl ItemPass {
    /// A pass for pictures of `size` at first.
    ///
    /// # Errors
    /// If the device cannot tell triangles apart or draw that size, or memory does not suffice.
    pub fn new(scene: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        let info = scene.gpu().info();
        if !info.item_pass {
            return Err(GpuError::MissingFeature {
                pass: KIND.name,
                feature: "geometryShader (for the primitive id)",
                device: info.name.clone(),
            });
        }
        Ok(Self { pass: ScenePass::new(scene, &KIND, size)?, items: None })
    }

    /// Starts a frame of the view's size.
    ///
    /// # Errors
    /// If the device fails, or cannot draw the view's size.
    pub fn begin(&mut self, view: &View) -> Result<(), GpuError> {
        self.pass.begin(view)
    }

    /// Adds draws, in this order: of equal depths the first one shows.
    ///
    /// # Errors
    /// If an id is not the scene's (those before it may have been added), before [`begin`](Self::begin), or without memory.
    pub fn draw(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        self.pass.draw(ids)
    }

    /// Hands what was added to the device, which draws it while the host goes on.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn flush(&mut self) -> Result<(), GpuError> {
        self.pass.flush()
    }

    /// Waits until all is drawn.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn finish(&mut self) -> Result<PassTiming, GpuError> {
        self.pass.finish()
    }

    /// The pixels as they are: drawable and triangle, row by row from the top; see [`ItemImage`].
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn items(&mut self) -> Result<&[[u32; 2]], GpuError> {
        self.pass.read_colour(&mut self.items)?;
        Ok(self.items.as_ref().map(HostBuffer::elements).unwrap_or_default())
    }

    /// Copies the pixels into `image`, whose memory is used again.
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
