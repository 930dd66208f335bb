//! The occluder pass (OR): depth alone.

use std::sync::Arc;

use trimaran_cull::{DepthImage, Viewport};

use crate::draw_record::Fetch;
use crate::half_depth::HalfDepth;
use crate::hzb::HzbBoxes;
use crate::pass::ScenePass;
use crate::pass_kind::PassKind;
use crate::pipeline::{VertexInput, shader};
use crate::query::QueryBoxes;
use crate::raster::RasterBoxes;
use crate::reuse::reuse_or_make;
use crate::solid_pass::SolidPass;
use crate::{DeviceHzbTest, GpuError, GpuScene, QueryTest, RasterTest};

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
pub type OccluderPass = SolidPass<Occluders>;

/// Resources of occlusion tests, each made on first use.
#[derive(Default)]
pub struct Occluders {
    queries: Option<QueryBoxes>,
    raster: Option<RasterBoxes>,
    hzb: Option<HzbBoxes>,
    half: Option<HalfDepth>,
}

impl OccluderPass {
    /// A pass for pictures of `size` at first.
    ///
    /// # Errors
    /// If the device cannot draw that size, or memory does not suffice.
    pub fn new(scene: &Arc<GpuScene>, size: Viewport) -> Result<Self, GpuError> {
        Ok(Self { pass: ScenePass::new(scene, &KIND, size)?, kept: Occluders::default() })
    }

    /// The depth on the host: copied from the device on the first call after drawing.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn read_depth(&mut self) -> Result<DepthImage<'_>, GpuError> {
        self.pass.read_depth()
    }

    /// The farthest depth of each block of 2 x 2 pixels on the host, row by row: level 1 of a
    /// [`DepthPyramid`](trimaran_cull::DepthPyramid), or the pixel of a picture that has no other. Made and
    /// copied on the first call after drawing.
    ///
    /// # Errors
    /// If the device fails, or before [`begin`](Self::begin).
    pub fn read_half_depth(&mut self) -> Result<&[f32], GpuError> {
        let Self { pass, kept } = self;
        reuse_or_make(&mut kept.half, |_| true, || HalfDepth::new(pass))?.read(pass)
    }

    /// Tests boxes by occlusion queries against the drawn depth.
    ///
    /// # Errors
    /// If the device cannot make the queries.
    pub fn query_test(&mut self) -> Result<QueryTest<'_>, GpuError> {
        QueryTest::new(&mut self.pass, &mut self.kept.queries)
    }

    /// Tests boxes by counting fragments against the drawn depth.
    ///
    /// # Errors
    /// If the device cannot make the buffers.
    pub fn raster_test(&mut self) -> Result<RasterTest<'_>, GpuError> {
        RasterTest::new(&mut self.pass, &mut self.kept.raster)
    }

    /// Tests boxes on the device against a pyramid of the drawn depth.
    ///
    /// # Errors
    /// If the device has no f64 in shaders, or cannot make the buffers.
    pub fn hzb_test(&mut self) -> Result<DeviceHzbTest<'_>, GpuError> {
        DeviceHzbTest::new(&mut self.pass, &mut self.kept.hzb)
    }
}
