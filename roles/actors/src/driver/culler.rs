//! A culler: which messages move when (paper, algorithm 4.2).

use std::{future::Future, time::Duration};

use trimaran_proto::{Camera, DrawableId, FrameStats, IdBatch, RoleMessage, SentBytes, Settings};
use trimaran_transport::Traffic;

use super::{
    close::{part, worked},
    error::{RoleError, link},
};
use crate::{
    links::{FrameEvent, FrameSender, FrameStart, Link},
    machine::{CullerIndex, CullerMachine, CullerStep, OrderError},
    stop::Stop,
    turn::{Turn, Turns},
};

/// What a culler does with a frame: on a device, or as it was recorded.
pub trait CullerWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// The culler has nothing to do until its next camera comes.
    fn awaits_camera(&mut self) {}

    /// A camera has come, from which the next frame may be culled.
    fn has_camera(&mut self, camera: &Camera) {
        let _ = camera;
    }

    /// Begins the occluders of a frame (OR).
    ///
    /// # Errors
    /// As the device says.
    fn begin_occluders(&mut self, camera: Camera) -> Result<(), RoleError>;

    /// Takes what the other culler found visible in the frame before, as it comes.
    ///
    /// # Errors
    /// If no frame can have an id, or as the device says.
    fn take_occluders(&mut self, batch: &IdBatch) -> Result<(), RoleError>;

    /// All ids are there: completes the occluders of the frame.
    ///
    /// # Errors
    /// As the device says.
    fn complete_occluders(&mut self, camera: Camera) -> impl Future<Output = Result<(), RoleError>>;

    /// Culls the frame (HC), and gives `visible` each drawable as soon as it is found.
    ///
    /// # Errors
    /// As the device says, and as `visible` does.
    fn cull(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> impl Future<Output = Result<(), RoleError>>;

    /// What was done for the frame, whose end has just been sent. Since the last frame's end `to_other` was
    /// sent to the other culler, and since the occluders were complete others have computed for `away` in
    /// this culler's place.
    fn frame_stats(&mut self, to_other: SentBytes, away: Duration) -> FrameStats;
}

/// Takes the ids of a frame that is being culled: they leave for all receivers at once, while culling goes
/// on.
#[derive(Debug)]
pub struct VisibleIds<'l>(Vec<&'l mut FrameSender>);

impl VisibleIds<'_> {
    /// Sends what was found visible. It waits where a receiver has no room.
    ///
    /// # Errors
    /// When a receiver is gone or stalls.
    pub async fn push(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        for sender in &mut self.0 {
            sender.push(ids).await.map_err(link("sending ids"))?;
        }
        Ok(())
    }
}

/// A culler, joined to the two other roles.
#[derive(Debug)]
pub struct CullerRole<W> {
    /// Which.
    pub index: CullerIndex,
    /// What it does with a frame.
    pub work: W,
    /// The link to the display.
    pub display: Link,
    /// The link to the other culler.
    pub other: Link,
    /// What the display has decided.
    pub settings: Settings,
    /// What it measures by, and whether it computes while other roles of the process do.
    pub turns: Turns,
}

impl<W: CullerWork> CullerRole<W> {
    /// Plays the role until the session ends, a peer leaves, or `stop` asks. Where the work is a device's, it
    /// occupies its thread.
    ///
    /// # Errors
    /// When a peer dies, is interrupted or breaks the order, or the device fails. The peers are told before
    /// it returns. That this role itself was asked to stop is no error.
    pub async fn run(mut self, stop: &Stop) -> Result<(), RoleError> {
        self.work.cancel_on(stop);
        let turn = self.turns.of_a_role();
        let result = worked(self.frames(&turn), &turn, stop).await;
        part([self.display, self.other], result, stop).await
    }

    async fn frames(&mut self, turn: &Turn) -> Result<(), RoleError> {
        let mut machine = CullerMachine::new(self.index, self.settings.first, self.settings.frames);
        let mut sent_to_other = self.other.stats.read().sent;
        loop {
            match machine.step() {
                CullerStep::AwaitCamera { .. } => {
                    self.work.awaits_camera();
                    let camera = self.display.latest_rx.latest().await;
                    let camera = camera.map_err(link("waiting for a camera"))?;
                    self.work.has_camera(&camera);
                    machine.camera(camera).map_err(by("display"))?;
                }
                CullerStep::Occlude { camera } => {
                    let event = self.other.frames_rx.recv().await.map_err(link("receiving occluders"))?;
                    match event {
                        FrameEvent::Begin(start) => {
                            machine.occluders_began(start.frame).map_err(by(OTHER))?;
                            // It has the turn until the frame is culled.
                            turn.take().await;
                            self.work.begin_occluders(camera)?;
                        }
                        FrameEvent::Batch(batch) => self.work.take_occluders(&batch)?,
                        FrameEvent::End(_) => machine.occluders_ended().map_err(by(OTHER))?,
                    }
                }
                CullerStep::Cull { camera, feeds_other } => {
                    if camera.frame() == self.settings.first {
                        // No frame before it to take occluders from.
                        turn.take().await;
                        self.work.begin_occluders(camera)?;
                    }
                    self.cull(camera, feeds_other, turn, &mut sent_to_other).await?;
                    turn.give_back();
                    machine.culled().map_err(by(OTHER))?;
                }
                CullerStep::Done => return Ok(()),
            }
        }
    }

    /// Culls a frame, whose occluders are all there (paper, section 4.1): sends the camera, then each visible
    /// drawable as it is decided, then the end.
    async fn cull(
        &mut self,
        camera: Camera,
        feeds_other: bool,
        turn: &Turn,
        sent_to_other: &mut Traffic,
    ) -> Result<(), RoleError> {
        self.work.complete_occluders(camera).await?;
        // Only what passes from here on is missing from HC.
        turn.away();
        // The other culler first: it draws while the display only gathers.
        let other = feeds_other.then_some(&mut self.other.frames_tx);
        let mut visible = VisibleIds(other.into_iter().chain([&mut self.display.frames_tx]).collect());
        for sender in &mut visible.0 {
            let start = FrameStart { frame: camera.frame(), header: camera };
            sender.begin(start).await.map_err(link("beginning a frame"))?;
        }
        self.work.cull(camera, &mut visible).await?;
        for sender in &mut visible.0 {
            sender.finish().await.map_err(link("ending a frame"))?;
        }
        let sent = self.other.stats.read().sent;
        let to_other = sent_bytes(sent - std::mem::replace(sent_to_other, sent));
        let stats = self.work.frame_stats(to_other, turn.away());
        let said = RoleMessage::Stats(stats);
        self.display.messages_tx.send(&said).await.map_err(link("sending statistics"))
    }
}

/// How messages speak of the other culler.
pub(crate) const OTHER: &str = "other culler";

fn by(peer: &'static str) -> impl FnOnce(OrderError) -> RoleError {
    move |cause| RoleError::Order { peer, cause }
}

pub(super) const fn sent_bytes(traffic: Traffic) -> SentBytes {
    SentBytes {
        camera: traffic.latest.bytes,
        begin: traffic.begin.bytes,
        ids: traffic.batches.bytes,
        end: traffic.end.bytes,
        control: traffic.control.bytes + traffic.messages.bytes,
        headers: traffic.header_bytes,
        messages: traffic.latest.messages
            + traffic.begin.messages
            + traffic.batches.messages
            + traffic.end.messages
            + traffic.messages.messages
            + traffic.control.messages,
    }
}
