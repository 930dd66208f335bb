//! What happened to a frame.

use std::time::Duration;

use trimaran_proto::{Camera, DrawableId, FrameStats, SentBytes};

/// A frame as it was shown.
#[derive(Debug, Clone)]
pub struct FrameRecord {
    /// Its camera.
    pub camera: Camera,
    /// What was drawn, in the order drawn.
    pub ids: Vec<DrawableId>,
    /// How many of them were drawn only because ids of the frame were lost.
    pub for_loss: u32,
    /// XXH3-64 of the picture's bytes, if it was read back.
    pub picture: Option<u64>,
    /// When its camera was handed out; all times are on the display's clock.
    pub published: Duration,
    /// When its begin arrived.
    pub begun: Duration,
    /// When drawing began.
    pub drawing: Duration,
    /// When it was shown.
    pub shown: Duration,
    /// What travelled between the display and the frame's machine.
    pub traffic: SentBytes,
    /// How many ids had come, and when, since the begin: one entry for all batches that came at once.
    pub arrivals: Vec<(u32, Duration)>,
    /// What that machine says it did.
    pub stats: Option<FrameStats>,
}
