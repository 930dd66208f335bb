//! The interface through which a display reports to an observer.

use std::time::Duration;

use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, SentBytes};

use super::error::{BoxedError, RoleError};
use crate::{deal::CullerId, links::Link, supply::AheadUse};

/// A drawn frame, for the display's observer.
#[derive(Debug)]
pub struct ShownFrame<'f> {
    /// Its camera. The number is the frame's: how many frames were shown before.
    pub camera: Camera,
    /// Its culler; none if the display itself culled it.
    pub culler: Option<CullerId>,
    /// The drawables, in the order drawn.
    pub ids: &'f [DrawableId],
    /// How many of them were drawn only because ids of the frame were lost on a link with deadlines.
    pub for_loss: u32,
    /// How many drawables of the frame had not come yet, if the display has no scene: coarser ones were drawn
    /// in their place. 0 if the picture is exact.
    pub lacking: u32,
    /// Further frames that have been culled and wait to be drawn.
    pub queued: u32,
    /// The last frame is shown again, after more of it has come.
    pub again: bool,
    /// The picture, if requested.
    pub picture: Option<&'f Image>,
    /// When its camera was published, since the session's start.
    pub published: Duration,
    /// When its begin arrived.
    pub begun: Duration,
    /// When drawing began.
    pub drawing: Duration,
    /// When the device was done with it. RVG was busy from `drawing` to here.
    pub shown: Duration,
    /// The device's part of that, measured by its own timestamps. Zero if it has none.
    pub on_device: Duration,
    /// The traffic between the display and the frame's culler, both ways, since that culler's previous frame:
    /// the frame, statistics of an earlier one, and cameras.
    pub traffic: SentBytes,
    /// Pairs of an id count and the time since the frame's begin: one entry for all batches that came at
    /// once.
    pub arrivals: &'f [(u32, Duration)],
}

/// Observes the display. Its time is the session's: an observer should record and return.
pub trait Observer {
    /// Whether to read back this frame's picture.
    fn wants_picture(&self, frame: FrameNumber) -> bool {
        let _ = frame;
        false
    }

    /// A frame has been shown.
    ///
    /// # Errors
    /// When it cannot be recorded. This ends the session, and the cullers are told.
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError>;

    /// A culler's statistics of a shown frame.
    fn culled(&mut self, stats: &FrameStats) {
        let _ = stats;
    }

    /// An event of a culler.
    fn culler(&mut self, event: CullerEvent<'_>) {
        let _ = event;
    }

    /// The session is over: the use of geometry sent ahead, if the display has no scene.
    fn ahead(&mut self, sent: &AheadUse) {
        let _ = sent;
    }
}

/// An event of a culler, as the display sees it.
#[derive(Debug)]
#[non_exhaustive]
pub enum CullerEvent<'e> {
    /// It has come, over this link.
    Came(CullerId, &'e Link),
    /// It is late: others cull its frames until it answers.
    Late(CullerId),
    /// It is gone, and will be reconnected.
    Left(CullerId, &'e RoleError),
}
