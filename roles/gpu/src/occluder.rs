//! The occluder pass (OR): depth alone.

use std::sync::Arc;

use trimaran_cull::{DepthImage, View, Viewport};
use trimaran_proto::DrawableId;

use crate::draw_record::Fetch;
use crate::hzb::HzbBoxes;
use crate::pass::ScenePass;
use crate::pass_kind::PassKind;
use crate::pipeline::{VertexInput, shader};
use crate::query::QueryBoxes;
use crate::raster::RasterBoxes;
use crate::wait::Cancel;
use crate::{DeviceHzbTest, GpuError, GpuScene, PassTiming, QueryTest, RasterTest};

static KIND: PassKind = PassKind {
    name: "drawing the occluders",
    vertex: shader!("vs_depth"),
    fragment: None,
    cut: shader!("fs_depth_cut"),
    see_through: None,
    sky: None,
    input: VertexInput::Position,
    colour: None,
    fetch: Fetch::Fixed,
    may_skip: Some(MOST_BROUGHT),
};

/// Any subset of the cut is a valid set of occluders. So a frame loads at most this many bytes of geometry to
/// the device (a quarter of a million triangles), and draws what is loaded.
const MOST_BROUGHT: u64 = 8 << 20;

/// Draws occluders into a depth buffer that stays on the device, for occlusion tests.
///
/// Depth is 32-bit float, reversed: near / distance, 0 for the background.
pub struct OccluderPass {
    // Before all other fields: its stream waits for work that uses the rest.
    pub(crate) pass: ScenePass,
    queries: Option<QueryBoxes>,
    raster: Option<RasterBoxes>,
    hzb: Option<HzbBoxes>,
}

impl OccluderPass {
    /// A pass for pictures of `size` at first.
    ///
    /// # Errors
    /// If the device cannot draw that size, or memory does not suffice.
    pub fn new(scene: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        Ok(Self { pass: ScenePass::new(scene, &KIND, size)?, queries: None, raster: None, hzb: None })
    }

    /// Ends waits for the device when `cancel` says so, with [`GpuError::Cancelled`]. The pass is unusable
    /// then.
    pub fn cancel_when(&mut self, cancel: impl Fn() -> bool + Send + Sync + 'static) {
        self.pass.cancel_when(&(Arc::new(cancel) as Cancel));
    }

    /// Starts a frame: an empty depth buffer of the view's size.
    ///
    /// # Errors
    /// If the device fails, or cannot draw the view's size.
    pub fn begin(&mut self, view: &View) -> Result<(), GpuError> {
        self.pass.begin(view)
    }

    /// Adds occluders. The device starts on them at the next [`flush`](Self::flush).
    ///
    /// # Errors
    /// If an id is not the scene's (those before it may have been added), before [`begin`](Self::begin), or
    /// without memory.
    pub fn draw(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        self.pass.draw(ids)
    }

    /// Submits the added draws to the device, which draws while the host goes on. Each flush costs a
    /// submission (tens of microseconds): worth it for hundreds of draws.
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

    /// The depth on the host: copied from the device on the first call after drawing.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn read_depth(&mut self) -> Result<DepthImage<'_>, GpuError> {
        self.pass.read_depth()
    }

    /// Tests boxes by occlusion queries against the drawn depth.
    ///
    /// # Errors
    /// If the device cannot make the queries.
    pub fn query_test(&mut self) -> Result<QueryTest<'_>, GpuError> {
        QueryTest::new(&mut self.pass, &mut self.queries)
    }

    /// Tests boxes by counting fragments against the drawn depth.
    ///
    /// # Errors
    /// If the device cannot make the buffers.
    pub fn raster_test(&mut self) -> Result<RasterTest<'_>, GpuError> {
        RasterTest::new(&mut self.pass, &mut self.raster)
    }

    /// Tests boxes on the device against a pyramid of the drawn depth.
    ///
    /// # Errors
    /// If the device has no f64 in shaders, or cannot make the buffers.
    pub fn hzb_test(&mut self) -> Result<DeviceHzbTest<'_>, GpuError> {
        DeviceHzbTest::new(&mut self.pass, &mut self.hzb)
    }
}
