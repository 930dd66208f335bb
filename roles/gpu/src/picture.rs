//! The picture pass (RVG): shaded colour.

use std::sync::Arc;
use std::time::Duration;

use ash::vk;
use trimaran_cull::{Cancel, DepthImage, Image, PictureDevice, View, Viewport};
use trimaran_proto::DrawableId;

use crate::draw_record::Fetch;
use crate::memory::HostBuffer;
use crate::pass::ScenePass;
use crate::pass_kind::{ColourTarget, PassKind};
use crate::pipeline::{VertexInput, shader};
#[cfg(feature = "window")]
use crate::window::{Acquired, Presenter};
use crate::{GpuError, GpuScene, PassTiming};

/// The background: a light grey sky, as sRGB.
pub const BACKGROUND: [u8; 4] = [219, 226, 232, 255];

const KIND: PassKind = PassKind {
    name: "drawing the picture",
    vertex: shader!("vs_picture"),
    fragment: Some(shader!("fs_picture")),
    cut: shader!("fs_picture_cut"),
    see_through: Some([shader!("fs_see_through"), shader!("fs_see_through_cut")]),
    sky: None,
    input: VertexInput::Facet,
    colour: Some(ColourTarget {
        // Not an SRGB format: the shader's output is encoded already.
        format: vk::Format::R8G8B8A8_UNORM,
        background: vk::ClearColorValue { float32: [219.0 / 255.0, 226.0 / 255.0, 232.0 / 255.0, 1.0] },
    }),
    fetch: Fetch::Fixed,
    may_skip: None,
};

/// For people: see [`PicturePass::for_window`].
#[cfg(feature = "window")]
static WINDOW: PassKind = PassKind {
    vertex: shader!("vs_window"),
    fragment: Some(shader!("fs_window")),
    cut: shader!("fs_window_cut"),
    see_through: Some([shader!("fs_window_see_through"), shader!("fs_window_see_through_cut")]),
    sky: Some([shader!("vs_sky"), shader!("fs_sky")]),
    ..KIND
};

/// Draws shaded pictures. Frames alternate between two sets of attachments, so that the next can be prepared
/// and submitted while the device still draws this one.
pub struct PicturePass {
    frames: [Frame; 2],
    /// The frame of the next draws.
    current: usize,
    /// The frame that is read: the last one waited for.
    readable: usize,
}

struct Frame {
    pass: ScenePass,
    /// The window's image that the picture was copied to: dropped after the pass, whose work uses it.
    #[cfg(feature = "window")]
    shown: Option<Acquired>,
    colour: Option<HostBuffer<[u8; 4]>>,
}

impl PicturePass {
    /// A pass for pictures of `size` at first.
    ///
    /// # Errors
    /// If the device cannot draw that size, or memory does not suffice.
    pub fn new(scene: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        Self::of(scene, &KIND, size)
    }

    /// A pass for pictures in a window, for people. Colours are calmer than those for measurements, and the
    /// background has sky and ground.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    #[cfg(feature = "window")]
    pub fn for_window(scene: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        Self::of(scene, &WINDOW, size)
    }

    fn of(scene: &Arc<GpuScene>, kind: &'static PassKind, size: Viewport) -> Result<Self, GpuError> {
        let frame = || {
            Ok(Frame {
                pass: ScenePass::new(scene, kind, size)?,
                #[cfg(feature = "window")]
                shown: None,
                colour: None,
            })
        };
        Ok(Self { frames: [frame()?, frame()?], current: 0, readable: 0 })
    }

    /// Ends waits for the device when `cancel` says so, with [`GpuError::Cancelled`]. The pass is unusable
    /// then.
    pub fn cancel_when(&mut self, cancel: impl Fn() -> bool + Send + Sync + 'static) {
        self.cancel_on(&(Arc::new(cancel) as Cancel));
    }

    /// Starts a picture of the view's size, on the other set of attachments; waits for drawing there to end.
    ///
    /// # Errors
    /// If the device fails, or cannot draw the view's size.
    pub fn begin(&mut self, view: &View) -> Result<(), GpuError> {
        self.current ^= 1;
        let frame = self.current();
        frame.pass.begin(view)?;
        #[cfg(feature = "window")]
        {
            frame.shown = None;
        }
        Ok(())
    }

    /// Adds draws, in this order: of equal depths the first one wins.
    ///
    /// # Errors
    /// If an id is not the scene's (those before it may have been added), before [`begin`](Self::begin),
    /// after [`draw_see_through`](Self::draw_see_through) in the same frame, or without memory.
    pub fn draw(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        self.current().pass.draw(ids)
    }

    /// Adds see-through draws, in the order of blending: back to front. All solid draws of this frame must be
    /// added before. Both faces of each triangle before the solid picture are blended over it, with a share
    /// of [`SEE_THROUGH_ALPHA`](crate::SEE_THROUGH_ALPHA) in the encoded colours, or less where a colour's
    /// own alpha is less. Depth and alpha stay as the solid picture left them.
    ///
    /// # Errors
    /// If an id is not the scene's (those before it may have been added), before [`begin`](Self::begin), if
    /// the device fails, or without memory.
    pub fn draw_see_through(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        self.current().pass.draw_see_through(ids)
    }

    /// Submits the added draws to the device, which draws while the host goes on. At the end of a frame this
    /// lets the next one [`begin`](Self::begin) before this one is [`finish`](Self::finish)ed.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn flush(&mut self) -> Result<(), GpuError> {
        self.current().pass.flush()
    }

    /// Shows the picture begun last in a window, after its added draws; waits for neither. Nothing is shown
    /// if the presenter has acquired no image.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    #[cfg(feature = "window")]
    pub fn present(&mut self, presenter: &mut Presenter) -> Result<(), GpuError> {
        let Some(acquired) = presenter.acquired() else { return Ok(()) };
        let frame = self.current();
        if frame.shown.take().is_some() {
            // The same picture again, perhaps in a window of another size.
            frame.pass.finish()?;
        }
        frame.pass.fill_window(frame.shown.insert(acquired.clone()))?;
        presenter.present(&acquired)
    }

    /// Waits until the picture begun last is drawn, and selects it for reading.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn finish(&mut self) -> Result<PassTiming, GpuError> {
        self.readable = self.current;
        self.current().pass.finish()
    }

    /// Waits until the picture *before* the one begun last is drawn, and selects it for reading: for a caller
    /// that prepares a frame while the last one is drawn. Before the second frame this is an error.
    ///
    /// # Errors
    /// If the device fails, or there is no such picture.
    pub fn finish_previous(&mut self) -> Result<PassTiming, GpuError> {
        self.readable = self.current ^ 1;
        self.readable().pass.finish()
    }

    /// The pixels of the picture finished last: sRGB-encoded red, green, blue and alpha, row by row from the
    /// top.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn pixels(&mut self) -> Result<&[[u8; 4]], GpuError> {
        let Frame { pass, colour, .. } = self.readable();
        pass.read_colour(colour)
    }

    /// Copies the picture finished last into `picture`, reusing its memory.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn read(&mut self, picture: &mut Image) -> Result<(), GpuError> {
        let size = self.readable().pass.size();
        (picture.width, picture.height) = (size.width(), size.height());
        picture.rgba.clear();
        picture.rgba.extend_from_slice(self.pixels()?.as_flattened());
        Ok(())
    }

    /// The depth of the picture finished last.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn read_depth(&mut self) -> Result<DepthImage<'_>, GpuError> {
        self.readable().pass.read_depth()
    }

    fn current(&mut self) -> &mut Frame {
        let [even, odd] = &mut self.frames;
        if self.current == 0 { even } else { odd }
    }

    fn readable(&mut self) -> &mut Frame {
        let [even, odd] = &mut self.frames;
        if self.readable == 0 { even } else { odd }
    }
}

impl PictureDevice for PicturePass {
    type Error = GpuError;

    fn cancel_on(&mut self, cancel: &Cancel) {
        self.frames.iter_mut().for_each(|frame| frame.pass.cancel_when(cancel));
    }

    fn draw(
        &mut self,
        view: &View,
        solid: &[DrawableId],
        see_through: &[DrawableId],
    ) -> Result<Duration, GpuError> {
        self.begin(view)?;
        self.draw(solid)?;
        self.draw_see_through(see_through)?;
        let timing = self.finish()?;
        Ok(Duration::try_from_secs_f64(timing.device_ms * 1e-3).unwrap_or_default())
    }

    fn read(&mut self, picture: &mut Image) -> Result<(), GpuError> {
        self.read(picture)
    }
}
