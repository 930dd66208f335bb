//! What a display tells whoever watches it.

use std::time::Duration;

use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, SentBytes};

use super::error::{BoxedError, RoleError};
use crate::{deal::CullerId, links::Link, supply::AheadUse};

/// A frame that has been drawn, as the display's observer sees it.
#[derive(Debug)]
pub struct ShownFrame<'f> {
    /// The camera it shows. Its number is the frame's: how many frames were shown before.
    pub camera: Camera,
    /// Who culled it; none if the display itself did.
    pub culler: Option<CullerId>,
    /// What was drawn, in the order drawn.
    pub ids: &'f [DrawableId],
    /// How many of them were drawn only because ids of the frame were lost on a link with deadlines.
    pub for_loss: u32,
    /// How many drawables of the frame had not come yet, where the display has no scene: coarser ones were
    /// drawn in their place. 0 where the picture is exact.
    pub lacking: u32,
    /// The last frame is shown again, as more of it has come.
    pub again: bool,
    /// The picture, if it was asked for.
    pub picture: Option<&'f Image>,
    /// When its camera was handed out, since the session's start.
    pub published: Duration,
    /// When its begin arrived.
    pub begun: Duration,
    /// When drawing began.
    pub drawing: Duration,
    /// When the device was done with it. RVG was busy from `drawing` to here.
    pub shown: Duration,
    /// What travelled between the display and the frame's culler, both ways, since that culler's frame
    /// before: the frame, statistics of an earlier one, and cameras.
    pub traffic: SentBytes,
    /// How many ids had come, and when, since the frame's begin: one entry for all batches that came at
    /// once.
    pub arrivals: &'f [(u32, Duration)],
}

/// Sees what the display does. Time spent here is the session's: an observer notes and returns.
pub trait Observer {
    /// Whether this frame's picture is to be read back.
    fn wants_picture(&self, frame: FrameNumber) -> bool {
        let _ = frame;
        false
    }

    /// A frame has been shown.
    ///
    /// # Errors
    /// When it cannot be noted. The session ends with it, and the cullers are told.
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError>;

    /// What a culler did for a frame that has been shown.
    fn culled(&mut self, stats: &FrameStats) {
        let _ = stats;
    }

    /// What became of a culler.
    fn culler(&mut self, event: CullerEvent<'_>) {
        let _ = event;
    }

    /// The session is over: what came of geometry that was sent before a frame needed it, where the display
    /// has no scene.
    fn ahead(&mut self, sent: &AheadUse) {
        let _ = sent;
    }
}

/// What becomes of a culler, as the display sees it.
#[derive(Debug)]
#[non_exhaustive]
pub enum CullerEvent<'e> {
    /// It has come, over this link.
    Came(CullerId, &'e Link),
    /// It is late: others cull its frames until it answers.
    Late(CullerId),
    /// It is gone, and looked for again.
    Left(CullerId, &'e RoleError),
}
