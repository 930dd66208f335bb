//! A role's work that waits for its turn at the shared device at the beginning of each frame.

use std::{rc::Rc, time::Duration};

use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameStats, ViewState};

use super::{
    culler::{CullerWork, VisibleIds},
    display::DisplayWork,
    error::RoleError,
};
use crate::{clock::nanoseconds, stop::Stop, turn::Turn};

/// Work that has the turn from the beginning of a frame to its end.
#[derive(Debug)]
pub(super) struct InTurn<W> {
    work: W,
    turn: Rc<Turn>,
}

impl<W> InTurn<W> {
    /// This `work` in the `turn` of its role.
    pub(super) fn new(work: W, turn: &Rc<Turn>) -> Self {
        Self { work, turn: Rc::clone(turn) }
    }

    /// Waits for its turn, before a frame begins.
    pub(super) async fn wait_for_turn(&self) {
        self.turn.take().await;
    }

    /// Lets other roles compute: there is nothing to do for this frame.
    pub(super) fn give_turn_back(&self) {
        self.turn.give_back();
    }
}

impl<W: CullerWork> CullerWork for InTurn<W> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.work.cancel_on(stop);
    }

    fn change_view(&mut self, state: &ViewState) {
        self.work.change_view(state);
    }

    fn awaits_camera(&mut self) {
        self.turn.give_back();
        self.work.awaits_camera();
    }

    fn has_camera(&mut self, camera: &Camera) {
        self.work.has_camera(camera);
    }

    /// Keeps the turn until the frame is culled.
    async fn begin_occluders(&mut self, camera: Camera, as_they_come: bool) -> Result<(), RoleError> {
        self.turn.take().await;
        self.work.begin_occluders(camera, as_they_come).await
    }

    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        self.work.take_occluders(ids)
    }

    async fn complete_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        let completed = self.work.complete_occluders(camera).await;
        // Only time away from here on is subtracted from HC.
        self.turn.away();
        completed
    }

    async fn cull(&mut self, camera: Camera, visible: &mut VisibleIds<'_>) -> Result<(), RoleError> {
        visible.turn = Some(Rc::clone(&self.turn)).filter(|turn| turn.is_shared());
        self.work.cull(camera, visible).await
    }

    async fn find_in_frustum(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> Result<(), RoleError> {
        self.turn.take().await;
        self.turn.away();
        self.work.find_in_frustum(camera, visible).await
    }

    fn counted_cost(&self, ids: &[DrawableId]) -> Option<Duration> {
        self.work.counted_cost(ids)
    }

    /// Other roles have computed for a while since the occluders were complete: HC counts as one piece at its
    /// end.
    fn frame_stats(&mut self) -> FrameStats {
        let stats = self.work.frame_stats();
        FrameStats { hc_start_ns: stats.hc_start_ns + nanoseconds(self.turn.away()), ..stats }
    }
}

impl<W: DisplayWork> DisplayWork for InTurn<W> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.work.cancel_on(stop);
    }

    fn change_view(&mut self, state: &ViewState) {
        self.work.change_view(state);
    }

    fn draws_at_once(&self) -> bool {
        self.work.draws_at_once()
    }

    async fn begin_frame(&mut self) {
        self.turn.take().await;
        self.work.begin_frame().await;
    }

    async fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> Result<usize, RoleError> {
        self.work.draw(camera, ids, missing).await
    }

    fn device_time(&self) -> Duration {
        self.work.device_time()
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        self.work.picture()
    }

    fn end_frame(&mut self) {
        self.work.end_frame();
        self.turn.give_back();
    }
}
