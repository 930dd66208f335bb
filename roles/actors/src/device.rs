//! What a role needs of its GPU, so that the drivers run on Vulkan or on the f64 reference alike.

use std::time::Duration;

use trimaran_cull::{CullStats, CutRule, View};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

/// What the drawing of a frame's occluders took.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct OccluderCost {
    /// Time in which the device or its driver was busy with them.
    pub busy: Duration,
    /// Drawables drawn.
    pub drawables: u32,
    /// Triangles drawn.
    pub triangles: u64,
}

/// The device of one machine of the pair: it draws occluders and culls against their depth, which stays on it (paper, section
/// 3.2).
pub trait PairDevice {
    /// Why the device failed.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Starts the occluders of a frame: clears the depth and sets the camera.
    ///
    /// # Errors
    /// As the device says.
    fn begin_occluders(&mut self, view: &View) -> Result<(), Self::Error>;

    /// Draws some more occluders. The result does not depend on their order or grouping.
    ///
    /// # Errors
    /// As the device says.
    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Self::Error>;

    /// Completes the depth.
    ///
    /// # Errors
    /// As the device says.
    fn finish_occluders(&mut self) -> Result<OccluderCost, Self::Error>;

    /// Culls the scene against the depth and hands each visible drawable to `sink` as soon as it is decided.
    ///
    /// # Errors
    /// As the device says.
    fn cull(
        &mut self,
        scene: &Scene,
        view: &View,
        rule: CutRule,
        sink: &mut dyn FnMut(DrawableId),
    ) -> Result<CullStats, Self::Error>;
}

/// A picture: 8-bit sRGB red, green, blue and alpha, row 0 at the top.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Picture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Four bytes a pixel.
    pub rgba: Vec<u8>,
}

/// The display's device: it draws what is visible.
pub trait PictureDevice {
    /// Why the device failed.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Draws the drawables in the order given and returns the time the device was busy.
    ///
    /// # Errors
    /// As the device says.
    fn draw(&mut self, view: &View, ids: &[DrawableId]) -> Result<Duration, Self::Error>;

    /// Reads back the picture drawn last, into `picture`, whose memory is used again.
    ///
    /// # Errors
    /// As the device says.
    fn read(&mut self, picture: &mut Picture) -> Result<(), Self::Error>;
}
