//! What happened in a session, frame by frame.

use std::time::Duration;

use trimaran_actors::{Observer, ShownFrame};
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, SentBytes};
use xxhash_rust::xxh3::xxh3_64;

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

/// Notes every frame of a session.
pub struct Recorder<'p> {
    frames: Vec<FrameRecord>,
    picture_every: u32,
    progress: &'p mut dyn FnMut(FrameNumber),
}

impl<'p> Recorder<'p> {
    /// Reads back every `picture_every`-th picture, none if 0, and calls `progress` after each frame.
    pub fn new(picture_every: u32, progress: &'p mut dyn FnMut(FrameNumber)) -> Self {
        Self { frames: Vec::new(), picture_every, progress }
    }

    /// The frame after the last one shown.
    #[must_use]
    pub fn next_frame(&self) -> FrameNumber {
        self.frames.last().and_then(|record| record.camera.frame().next()).unwrap_or(FrameNumber(0))
    }

    /// The frames, in the order shown.
    #[must_use]
    pub fn into_frames(self) -> Vec<FrameRecord> {
        self.frames
    }
}

impl Observer for Recorder<'_> {
    fn wants_picture(&self, frame: FrameNumber) -> bool {
        self.picture_every > 0 && frame.0.is_multiple_of(self.picture_every)
    }

    fn shown(&mut self, frame: &ShownFrame<'_>) {
        self.frames.push(FrameRecord {
            camera: frame.camera,
            ids: frame.ids.to_vec(),
            for_loss: frame.for_loss,
            picture: frame.picture.map(|picture| xxh3_64(&picture.rgba)),
            published: frame.published,
            begun: frame.begun,
            drawing: frame.drawing,
            shown: frame.shown,
            traffic: frame.traffic,
            arrivals: frame.arrivals.to_vec(),
            stats: None,
        });
        (self.progress)(frame.camera.frame());
    }

    fn pair_did(&mut self, stats: &FrameStats) {
        if let Some(record) = self.frames.get_mut(stats.frame.0 as usize) {
            record.stats = Some(*stats);
        }
    }
}
