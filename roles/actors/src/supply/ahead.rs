//! Geometry that a moving camera will soon need, sent before a frame does.
//!
//! The eye's pose is predicted from its motion. There, recently visible nodes have other levels of detail,
//! and nodes that enter the picture at its edge look large.

use std::{
    collections::{HashMap, VecDeque},
    sync::Arc,
    time::Duration,
};

use glam::{DQuat, DVec3};
use trimaran_cull::{CutRule, LodCut, OccluderMapper, View};
use trimaran_proto::{Camera, DrawableId};
use trimaran_scene::Scene;
use trimaran_transport::Instant;

/// How far ahead the pose is predicted.
const HORIZON: Duration = Duration::from_millis(500);
/// How long an unused piece counts.
const COUNTED: Duration = Duration::from_secs(10);
/// A camera that has moved this many times as far as before has jumped.
const JUMP: f64 = 4.0;
/// The most nodes per level of the tree in the search for large ones ahead.
const WIDEST: usize = 16;

/// The geometry to send ahead, and the unused part of it.
#[derive(Debug)]
pub(super) struct Ahead {
    /// How many unused bytes may have been sent; with 0 nothing is sent.
    budget: u64,
    mapper: Option<OccluderMapper>,
    /// The frame being found, and since when its pose is known.
    frame: Option<(View, Instant)>,
    found: Vec<DrawableId>,
    /// The camera's previous motion.
    before: Option<Motion>,
    /// The last found frame, at its pose after [`HORIZON`]: not evaluated yet.
    next: Option<(View, Vec<DrawableId>)>,
    /// To be sent, the last entry first.
    due: Vec<DrawableId>,
    /// Sent and unused pieces, oldest first, and their bytes.
    sent: VecDeque<(Instant, u32)>,
    unused: HashMap<u32, u64>,
    unused_bytes: u64,
}

/// A camera's motion between two frames.
#[derive(Debug, Clone, Copy)]
struct Motion {
    translation: DVec3,
    turn: DQuat,
    time: Duration,
}

impl Ahead {
    /// Sends at most this many bytes that no frame uses within ten seconds.
    pub(super) fn new(budget: u64) -> Self {
        Self {
            budget,
            mapper: None,
            frame: None,
            found: Vec::new(),
            before: None,
            next: None,
            due: Vec::new(),
            sent: VecDeque::new(),
            unused: HashMap::new(),
            unused_bytes: 0,
        }
    }

    /// These were found visible from `view`.
    pub(super) fn found(&mut self, scene: &Scene, view: &View, ids: &[DrawableId], now: Instant) {
        if self.budget == 0 {
            return;
        }
        if self.frame.is_none_or(|(before, _)| before != *view) {
            self.begin(view, now);
        }
        self.found.extend_from_slice(ids);
        if !self.unused.is_empty() {
            for drawable in ids.iter().filter_map(|id| scene.drawables().get(id.index())) {
                self.count_off(drawable.geometry);
            }
        }
    }

    /// The next drawable to send ahead, if there is room for it.
    pub(super) fn pop(&mut self, scene: &Arc<Scene>, rule: &CutRule, now: Instant) -> Option<DrawableId> {
        while let Some((_, number)) = self.sent.front().filter(|(at, _)| now.since(*at) > COUNTED) {
            let number = *number;
            self.sent.pop_front();
            self.count_off(number);
        }
        if self.unused_bytes >= self.budget {
            return None;
        }
        if let Some((view, found)) = self.next.take() {
            self.plan(scene, rule, view, &found);
        }
        self.due.pop()
    }

    /// A piece of this many bytes was sent.
    pub(super) fn sent(&mut self, number: u32, bytes: u64, now: Instant) {
        self.sent.push_back((now, number));
        self.unused_bytes += bytes;
        self.unused.insert(number, bytes);
    }

    /// A sent piece no longer counts: it was used, or the display has evicted it.
    pub(super) fn count_off(&mut self, number: u32) {
        if let Some(bytes) = self.unused.remove(&number) {
            self.unused_bytes -= bytes;
        }
    }

    /// Begins a frame: the previous one is complete.
    fn begin(&mut self, view: &View, now: Instant) {
        let found = std::mem::take(&mut self.found);
        let Some((last, at)) = self.frame.replace((*view, now)) else { return };
        let motion = Motion::between(&last, view, now.since(at));
        if motion.is_none() {
            // Frames may come faster than poses.
            self.frame = Some((*view, at));
            if now.since(at) > HORIZON {
                self.stay();
            }
            return;
        }
        let is_steady = self.before.is_some_and(|before| motion.goes_on_from(&before));
        self.stay();
        self.before = Some(motion);
        if is_steady {
            self.next = motion.after(view, HORIZON).map(|view| (view, found));
        }
    }

    /// The eye's next pose is unknown.
    fn stay(&mut self) {
        self.before = None;
        self.next = None;
        self.due.clear();
    }

    /// The cut's drawables from `view` for the found ones, and others that look large.
    fn plan(&mut self, scene: &Arc<Scene>, rule: &CutRule, view: View, found: &[DrawableId]) {
        match &mut self.mapper {
            Some(mapper) => mapper.begin(view, rule),
            None => self.mapper = Some(OccluderMapper::new(Arc::clone(scene), view, rule)),
        }
        let mut due = Vec::new();
        if let Some(mapper) = &mut self.mapper {
            // Culling reports an unreadable scene as an error.
            let _unreadable = mapper.push(found, &mut due);
        }
        self.due = LodCut::new(scene, &view, rule).large_drawables(WIDEST);
        self.due.append(&mut due);
    }
}

impl Motion {
    fn between(from: &View, to: &View, time: Duration) -> Self {
        let orientation = |view: &View| DQuat::from_array(view.camera().orientation()).normalize();
        Self { translation: to.eye() - from.eye(), turn: orientation(to) * orientation(from).inverse(), time }
    }

    fn is_none(&self) -> bool {
        self.translation == DVec3::ZERO && self.angle() < 1e-6
    }

    fn angle(&self) -> f64 {
        self.turn.angle_between(DQuat::IDENTITY)
    }

    /// Whether it is no jump.
    fn goes_on_from(&self, before: &Self) -> bool {
        let room = JUMP * self.time.as_secs_f64() / before.time.as_secs_f64().max(1e-3);
        self.translation.length() <= room * before.translation.length()
            && self.angle() <= room * before.angle() + 1e-3
    }

    /// The view if the motion continues for this long.
    fn after(&self, view: &View, time: Duration) -> Option<View> {
        let times = time.as_secs_f64() / self.time.as_secs_f64().max(1e-3);
        let (axis, angle) = self.turn.to_axis_angle();
        // Beyond that the turn is limited: nobody turns further before seeing something else.
        let turn = DQuat::from_axis_angle(axis, (angle * times).clamp(-0.5, 0.5));
        let camera = view.camera();
        let eye = view.eye() + self.translation * times;
        let orientation = (turn * DQuat::from_array(camera.orientation())).normalize();
        let (tan, near) = (camera.tan_half_fov_y(), camera.near());
        let ahead = Camera::new(eye.to_array(), orientation.to_array(), tan, near, camera.frame()).ok()?;
        Some(View::new(ahead.in_view(camera.view()), view.viewport()).with_sections(*view.sections()))
    }
}

#[cfg(test)]
#[path = "ahead_tests.rs"]
mod tests;
