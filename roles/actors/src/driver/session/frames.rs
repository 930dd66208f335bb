//! A display's work on a frame: publishes its camera, culls it itself if no culler does, shows it.

use std::{sync::Arc, time::Duration};

use trimaran_proto::{Camera, FrameNumber, FrameStats, ViewState, ViewVersion};

use super::super::{
    culler::{CullerWork, VisibleIds},
    culler_link::{Culled, FoundAlone},
    display::DisplayWork,
    error::RoleError,
    observer::ShownFrame,
};
use super::{Loading, Session};
use crate::{
    choice::Mode,
    clock::nanoseconds,
    deal::{CullerId, Pace},
};

impl<W: DisplayWork, A: CullerWork> Session<'_, W, A> {
    /// Publishes the cameras that are due.
    pub(super) fn deal(&mut self) -> Result<(), RoleError> {
        let now = self.role.net.now();
        for (id, frame) in self.dealer.deal(now) {
            let camera = self.published.newest(frame).unwrap_or_else(|| self.cameras.camera(frame));
            self.publish(id, camera)?;
        }
        if self.role.pace != Pace::Live {
            return Ok(());
        }
        let newer: Vec<_> = self.dealer.refreshable().collect();
        for (id, frame) in newer {
            let camera = self.cameras.camera(frame);
            if self.published.newest(frame) != Some(camera) {
                self.publish(id, camera)?;
            }
        }
        loop {
            let pose = self.cameras.camera(self.dealer.fresh());
            let news = self.newest.is_none_or(|newest| newest.for_frame(pose.frame()) != pose);
            if !news && self.is_seen(&pose) {
                return Ok(());
            }
            let Some(id) = self.dealer.wants_camera(news) else { return Ok(()) };
            let frame = self.dealer.hand_out(id, now);
            self.newest = Some(pose);
            self.publish(id, pose.for_frame(frame))?;
        }
    }

    /// Whether everything visible from a pose has arrived. If the eye rests there, nothing is left to do.
    pub(super) fn is_seen(&self, pose: &Camera) -> bool {
        let there = self.there.values().filter(|culled| culled.missing == 0).map(|culled| &culled.camera);
        self.shown_whole.iter().chain(there).any(|camera| camera.for_frame(pose.frame()) == *pose)
    }

    /// Publishes a camera, preceded by its view state if the culler has another one.
    fn publish(&mut self, id: CullerId, camera: Camera) -> Result<(), RoleError> {
        self.published.note(camera, self.clock.elapsed());
        let view = camera.view();
        if self.cullers.iter().any(|culler| culler.id == id && culler.told != view) {
            let messages = self.view_state(view)?.to_messages(view)?;
            for culler in self.cullers.iter_mut().filter(|culler| culler.id == id) {
                messages.iter().for_each(|message| culler.say(message.clone()));
                culler.told = view;
            }
        }
        if let Some(culler) = self.cullers.iter_mut().find(|culler| culler.id == id) {
            // A lost culler is noticed by its receiver.
            let _unheard = culler.link.latest_tx.publish(camera);
        }
        Ok(())
    }

    fn view_state(&mut self, version: ViewVersion) -> Result<Arc<ViewState>, RoleError> {
        match version {
            ViewVersion(0) => Ok(Arc::new(self.role.settings.into())),
            _ => self.cameras.view_state(version).ok_or(RoleError::UnknownView(version)),
        }
    }

    /// Culls a frame that no culler does.
    pub(super) async fn cull_itself(&mut self, frame: FrameNumber) -> Result<(), RoleError> {
        let camera = self.published.newest(frame).unwrap_or_else(|| self.cameras.camera(frame));
        self.published.note(camera, self.clock.elapsed());
        if self.culled_in != camera.view() {
            self.culled_in = camera.view();
            self.choice.look_again();
            let state = self.view_state(camera.view())?;
            if let Some(alone) = &mut self.role.alone {
                alone.change_view(&state);
            }
        }
        let Some(alone) = &mut self.role.alone else { return Ok(()) };
        let has_choice = alone.counted_cost(&[]).is_some();
        let mut mode = if has_choice { self.choice.mode() } else { Mode::Occlusion };
        let mut begun = self.clock.elapsed();
        let mut visible = VisibleIds::kept();
        if mode == Mode::Frustum {
            alone.find_in_frustum(camera, &mut visible).await?;
            let counted = alone.counted_cost(visible.found()).map(nanoseconds);
            let by_counts = matches!(self.role.pace, Pace::Lockstep { .. });
            if !counted.is_some_and(|counted| self.choice.may_draw_frustum(counted, by_counts)) {
                (mode, visible) = (Mode::Occlusion, VisibleIds::kept());
            }
        }
        let mut occluders_of = None;
        if mode == Mode::Occlusion {
            alone.begin_occluders(camera, false).await?;
            // All that was in the frustum says little of what hides much: then it is as after a jump.
            if !self.last_in_frustum {
                alone.take_occluders(&self.last)?;
                occluders_of = self.stats.last_shown();
            }
            alone.complete_occluders(camera).await?;
            begun = self.clock.elapsed();
            alone.cull(camera, &mut visible).await?;
        }
        let stats = FrameStats { occluders_of, ..alone.frame_stats() };
        let ids = visible.into_found();
        let took = stats.or_busy_ns.saturating_add(stats.hc_end_ns.saturating_sub(stats.hc_start_ns));
        let counted = alone.counted_cost(&ids).map(nanoseconds);
        let found = counted.map(|counted| FoundAlone { mode, took, counted });
        // It is not shown yet.
        let _later = self.stats.note(stats);
        self.there.insert(frame, Culled { found, ..Culled::alone(camera, ids, begun) });
        self.dealer.culled_itself(frame);
        Ok(())
    }

    /// Shows a frame that is due.
    pub(super) async fn show(&mut self, frame: FrameNumber) -> Result<(), RoleError> {
        let older = self.dealer.shown(frame);
        self.there.retain(|there, _| !older.contains(there));
        let Some(culled) = self.there.remove(&frame) else { return Ok(()) };
        let published = self.published.when(&culled.camera).unwrap_or(culled.begun);
        self.published.shown(frame);
        self.draw(frame, culled, published, false).await?;
        if let Some(stats) = self.stats.shown(frame) {
            self.observer.culled(&stats);
        }
        Ok(())
    }

    /// A frame that the display itself has culled is drawn. In lockstep only counts decide how the next one
    /// is culled, so that equal walks draw equal ids.
    fn note_cost(&mut self, FoundAlone { mode, took, counted }: FoundAlone, drawing: Duration) {
        let cost = match self.role.pace {
            Pace::Lockstep { .. } => counted,
            Pace::Live => took.saturating_add(nanoseconds(drawing)),
        };
        if self.role.work.draws_at_once() {
            self.choice.drawn(mode, cost, counted);
        }
    }

    /// Shows the last frame again, after more of it has come.
    pub(super) async fn show_again(&mut self) -> Result<(), RoleError> {
        let Some(Loading { frame, culled, published, .. }) = self.loading.take() else { return Ok(()) };
        self.draw(frame, culled, published, true).await?;
        self.stats.shown_again();
        Ok(())
    }

    /// RVG: draws the frame, and tells the observer.
    async fn draw(
        &mut self,
        frame: FrameNumber,
        mut culled: Culled,
        published: Duration,
        again: bool,
    ) -> Result<(), RoleError> {
        // Before this it only takes messages, which is no computing.
        self.role.work.begin_frame().await;
        let drawing = self.clock.elapsed();
        let camera = culled.camera;
        if self.drawn_in != camera.view() {
            self.drawn_in = camera.view();
            let state = self.view_state(camera.view())?;
            self.role.work.change_view(&state);
        }
        let lacking = culled.lacking.len();
        let mut ids = if lacking == 0 { std::mem::take(&mut culled.ids) } else { culled.there() };
        self.note_drawn(&ids);
        let for_loss = self.role.work.draw(camera, &mut ids, culled.missing).await?;
        self.shown_whole = (culled.missing == 0).then_some(camera);
        let shown = self.clock.elapsed();
        let on_device = self.role.work.device_time();
        if let Some(found) = culled.found {
            self.note_cost(found, shown.saturating_sub(drawing));
        }
        self.last_in_frustum = culled.found.is_some_and(|found| found.mode == Mode::Frustum);
        let number = self.stats.next_number();
        let picture = match self.observer.wants_picture(number) {
            true => self.role.work.picture()?,
            false => None,
        };
        let seen = ShownFrame {
            camera: camera.for_frame(number),
            culler: culled.by,
            ids: &ids,
            for_loss: u32::try_from(for_loss).unwrap_or(u32::MAX),
            lacking: u32::try_from(lacking).unwrap_or(u32::MAX),
            queued: u32::try_from(self.there.len()).unwrap_or(u32::MAX),
            again,
            picture,
            published,
            begun: culled.begun,
            drawing,
            shown,
            on_device,
            traffic: std::mem::take(&mut culled.traffic),
            arrivals: &std::mem::take(&mut culled.arrivals),
        };
        self.observer.shown(&seen).map_err(RoleError::Observer)?;
        self.role.work.end_frame();
        self.last = ids;
        self.loading = (lacking > 0).then_some(Loading { frame, culled, published, lacked: lacking });
        self.note_shown(frame)
    }
}
