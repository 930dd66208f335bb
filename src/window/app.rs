//! The window: what a person does in it, and the pictures it shows.

use std::{
    sync::{Arc, mpsc},
    time::Duration,
};

use glam::{DVec2, DVec3};
use trimaran_actors::Stopwatch;
use trimaran_cull::{View, Viewport};
use trimaran_gpu::{GpuError, GpuScene, PicturePass, PresentMode, Presenter};
use trimaran_proto::{Camera, FrameNumber, LodRule, Settings, SettingsError, ViewState};
use trimaran_scene::Scene;
use winit::{
    application::ApplicationHandler,
    dpi::{LogicalSize, PhysicalPosition, PhysicalSize},
    event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow},
    keyboard::{KeyCode, ModifiersState, PhysicalKey},
    window::{Window, WindowId},
};

use super::{
    WindowError, WindowReport,
    drive::{Drawn, Drive, Exact, Moved},
    navigate::{Drag, Ground, Keys, Mode, Navigator, Pose, Prediction},
    pictures::Pictures,
    recent_sets::RecentSets,
    role::{FoundSet, Wish},
};

/// The picture that is culled for is so much wider and higher: what a turn uncovers is there already.
const WIDER: f64 = 1.5;
/// An eye is foreseen for the time until its set is there, and in turn a little short of that and beyond: it
/// may slow down, or go around a corner.
const SPREAD: [f64; 3] = [0.6, 1.2, 1.8];
/// The time without another picture until the last one is drawn more finely.
const REST: Duration = Duration::from_millis(150);
/// How often the title says where the eye is, at most.
const TITLE: Duration = Duration::from_millis(250);

/// What other threads tell the window.
#[derive(Debug, Clone, Copy)]
pub(super) enum News {
    /// A set has come.
    Set,
    /// Close.
    Close,
}

/// The window and what it shows.
pub(super) struct App {
    pub(super) name: String,
    pub(super) scene: Arc<Scene>,
    pub(super) drawn: Arc<GpuScene>,
    /// The window's inside at first, in pixels of a screen that is not scaled.
    pub(super) size: [u32; 2],
    pub(super) mode: PresentMode,
    pub(super) lod: LodRule,
    /// Nothing comes nearer to an eye of a walk than twice this, metres.
    pub(super) near: f32,
    pub(super) navigator: Navigator,
    pub(super) ground: Ground,
    pub(super) wish: Wish,
    pub(super) sets: mpsc::Receiver<FoundSet>,
    pub(super) clock: Stopwatch,
    /// A walk that it repeats by itself.
    pub(super) drive: Option<Drive>,
    pub(super) state: State,
}

/// What changes while the window is there.
#[derive(Default)]
pub(super) struct State {
    shown: Option<Shown>,
    keys: Keys,
    modifiers: ModifiersState,
    pointer: Pointer,
    recent: RecentSets,
    prediction: Prediction,
    /// What was asked for last, if the eye is there.
    asked: Option<Camera>,
    /// Which place of the spread is next.
    turn: usize,
    /// How long the newest set took.
    latency: Duration,
    /// When the picture before was begun.
    last: Duration,
    /// When what is shown has changed last, unless it was drawn finely since.
    changed: Option<Duration>,
    titled: Titled,
    report: Option<WindowReport>,
    failure: Option<WindowError>,
}

/// A window with its pictures.
struct Shown {
    window: Arc<Window>,
    /// Its inside, pixels of the screen.
    size: PhysicalSize<u32>,
    presenter: Presenter,
    pictures: Pictures,
    /// The size of the picture for which is culled.
    culled: Option<Viewport>,
    is_hidden: bool,
}

/// Where the pointer is, and what it drags.
#[derive(Debug, Default)]
struct Pointer {
    at: PhysicalPosition<f64>,
    /// With which button.
    drags: Option<MouseButton>,
}

/// What the title says, and since when.
#[derive(Debug, Default)]
struct Titled {
    at: Duration,
    pictures: u32,
    says: String,
}

impl App {
    /// What is to be told of a walk that it has repeated, or why it was closed though nobody wanted that.
    pub(super) fn into_report(self) -> Result<Option<WindowReport>, WindowError> {
        self.state.failure.map_or(Ok(self.state.report), Err)
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<Shown, WindowError> {
        let attributes =
            Window::default_attributes()
                .with_title(&self.name)
                .with_inner_size(LogicalSize::<u32>::from(self.size));
        let window = Arc::new(event_loop.create_window(attributes).map_err(WindowError::Window)?);
        let presenter = Presenter::new(self.drawn.gpu(), Arc::clone(&window), self.mode)?;
        let size = window.inner_size();
        let first = Viewport::new(size.width.max(1), size.height.max(1)).map_err(WindowError::Size)?;
        let pass = PicturePass::for_window(&self.drawn, first)?;
        let pictures = Pictures::new(&self.scene, pass);
        Ok(Shown { window, size, presenter, pictures, culled: None, is_hidden: false })
    }

    /// Draws from where the eye is now. Gives whether another picture is due at once.
    fn picture(&mut self) -> Result<bool, WindowError> {
        let State { shown: Some(shown), .. } = &mut self.state else { return Ok(false) };
        let size = shown.size;
        // It may be waited for here: what moves the eye is asked afterwards.
        let Some(picture) = shown.presenter.acquire([size.width, size.height])? else {
            return Ok(!shown.is_hidden && size.width > 0 && size.height > 0);
        };
        let now = self.clock.elapsed();
        let moved = self.follow(now);
        self.take_sets();
        let camera = self.camera(self.navigator.pose(), 1.0)?;
        self.ask(picture, moved)?;
        let is_exact = self.is_exact();
        let State { shown: Some(shown), recent, .. } = &mut self.state else { return Ok(false) };
        shown.window.pre_present_notify();
        shown.pictures.show(&View::new(camera, picture), recent, is_exact, &mut shown.presenter)?;
        if let Some(drive) = &mut self.drive {
            let posed = recent.newest().map(|set| set.posed);
            let ids = shown.pictures.ids();
            drive.note(&Drawn { at: now, camera, size: picture, ids, posed, is_exact });
        }
        self.state.changed = Some(now);
        self.tell(now, moved);
        let walks = self.drive.as_ref().is_some_and(Drive::is_walking);
        Ok(moved || walks || self.state.keys.is_any_held())
    }

    /// Looks back on a walk that is over. Gives what is to be told of it.
    fn look_back(&self) -> Result<Option<WindowReport>, WindowError> {
        let Some(drive) = self.drive.as_ref().filter(|drive| drive.is_done()) else { return Ok(None) };
        let wider = |view: &View| {
            let camera = view.camera();
            let wide = wider(view.viewport()).unwrap_or(view.viewport());
            let tan = camera.tan_half_fov_y() * (wide.height() as f32 / view.viewport().height() as f32);
            let asked = Camera::new(camera.eye(), camera.orientation(), tan, camera.near(), FrameNumber(0));
            View::new(asked.unwrap_or(*camera), wide)
        };
        let exact = Exact { scene: &self.scene, drawn: &self.drawn, lod: self.lod, wider };
        Ok(drive.report(&exact, self.mode)?)
    }

    /// The same picture once more, as the mean of four pixels each, where the device draws pictures as large.
    fn picture_finely(&mut self) -> Result<(), WindowError> {
        self.state.changed = None;
        let camera = self.camera(self.navigator.pose(), 1.0)?;
        let is_exact = self.is_exact();
        let State { shown: Some(shown), recent, .. } = &mut self.state else { return Ok(()) };
        let size = shown.size;
        let Some(picture) = shown.presenter.acquire([size.width, size.height])? else { return Ok(()) };
        let largest = self.drawn.gpu().info().max_viewport;
        let [width, height] = [picture.width(), picture.height()].map(|side| 2 * side);
        let fine = Viewport::new(width, height).ok().filter(|_| width.max(height) <= largest);
        let view = View::new(camera, fine.unwrap_or(picture));
        shown.window.pre_present_notify();
        shown.pictures.show(&view, recent, is_exact, &mut shown.presenter)?;
        Ok(())
    }

    /// Moves the eye as the person wants. Gives whether it has moved.
    fn follow(&mut self, now: Duration) -> bool {
        let Self { navigator, ground, state, drive, .. } = self;
        if let Some(drive) = drive {
            let moved = drive.step(navigator, now);
            if moved == Some(Moved::Leapt) {
                state.prediction.forget();
            }
            state.prediction.add(now, navigator.pose());
            return moved.is_some();
        }
        let pose = navigator.pose();
        ground.look_around(pose.eye.x, pose.eye.z);
        let time = now.saturating_sub(std::mem::replace(&mut state.last, now));
        let motion = state.keys.motion();
        let moved = navigator.step(time, motion, state.keys.is_fast(), ground);
        state.prediction.add(now, navigator.pose());
        moved
    }

    fn take_sets(&mut self) {
        for set in self.sets.try_iter() {
            self.state.latency = set.came.saturating_sub(set.posed);
            self.state.recent.add(set);
        }
    }

    /// Asks what is visible from where the eye will be when the set is there. Once it rests, its own pose
    /// follows.
    fn ask(&mut self, picture: Viewport, moved: bool) -> Result<(), WindowError> {
        let wide = wider(picture).map_err(WindowError::Size)?;
        let State { shown: Some(shown), prediction, turn, latency, .. } = &mut self.state else {
            return Ok(());
        };
        *turn = (*turn + 1) % SPREAD.len();
        let ahead = latency.mul_f64(SPREAD.get(*turn).copied().unwrap_or(1.0));
        let foreseen = if moved { prediction.after(ahead) } else { None };
        let is_other_size = shown.culled.replace(wide) != Some(wide);
        let pose = foreseen.unwrap_or_else(|| self.navigator.pose());
        let camera = self.camera(pose, f64::from(wide.height()) / f64::from(picture.height()))?;
        let asked = if is_other_size {
            self.wish.change(ViewState::from(Settings::new(wide, self.lod)), camera)
        } else {
            self.wish.look(camera)
        };
        self.state.asked = foreseen.is_none().then_some(asked);
        Ok(())
    }

    /// A camera of the pose, whose picture is so much wider and higher than the one that is shown.
    fn camera(&self, Pose { eye, gaze }: Pose, wider: f64) -> Result<Camera, WindowError> {
        let tan = (self.navigator.vfov_deg().to_radians() / 2.0).tan() * wider;
        let orientation = gaze.orientation().normalize().to_array();
        Camera::new(eye.to_array(), orientation, tan as f32, self.near, FrameNumber(0))
            .map_err(WindowError::Eye)
    }

    /// Whether the newest set was found from where the eye is, and for a picture of this size.
    fn is_exact(&self) -> bool {
        let State { recent, asked, .. } = &self.state;
        let found = recent.newest().map(|newest| newest.camera.for_frame(FrameNumber(0)));
        found.is_some() && found == *asked
    }

    /// Says in the title where the eye is.
    fn tell(&mut self, now: Duration, moved: bool) {
        let State { shown: Some(shown), titled, .. } = &mut self.state else { return };
        titled.pictures += 1;
        let since = now.saturating_sub(titled.at);
        if moved && since < TITLE {
            return;
        }
        let DVec3 { x, y, z } = self.navigator.pose().eye;
        let (mode, speed) = (self.navigator.mode().name(), self.navigator.speed());
        let mut says = format!("{}: {mode} at {speed:.2} m/s, eye at {x:.2} {y:.2} {z:.2}", self.name);
        if moved {
            says += &format!(", {:.0} pictures a second", f64::from(titled.pictures) / since.as_secs_f64());
        }
        if says != titled.says {
            shown.window.set_title(&says);
        }
        *titled = Titled { at: now, pictures: 0, says };
    }

    /// The point of the world that shows under the pointer; none where nothing is.
    fn pointed_at(&mut self) -> Option<DVec3> {
        let pose = self.navigator.pose();
        let tan = (self.navigator.vfov_deg().to_radians() / 2.0).tan();
        let near = f64::from(self.near);
        let State { shown: Some(shown), pointer, .. } = &mut self.state else { return None };
        let [width, height] = [shown.size.width, shown.size.height].map(f64::from);
        let share = DVec2::new(pointer.at.x / width, pointer.at.y / height);
        let depth = match shown.pictures.depth_at(share) {
            Ok(depth) => f64::from(depth),
            Err(error) => {
                tracing::warn!(%error, "does not know what is pointed at");
                0.0
            }
        };
        let along = near / depth;
        let [right, up] = [2.0 * share.x - 1.0, 1.0 - 2.0 * share.y];
        let seen = DVec3::new(right * tan * width / height, up * tan, -1.0) * along;
        let point = pose.eye + pose.gaze.orientation() * seen;
        point.is_finite().then_some(point)
    }

    fn key(&mut self, event_loop: &ActiveEventLoop, key: &KeyEvent) {
        let PhysicalKey::Code(code) = key.physical_key else { return };
        let is_down = key.state == ElementState::Pressed;
        let modifiers = self.state.modifiers;
        if modifiers.control_key() || modifiers.super_key() || modifiers.alt_key() {
            if is_down && modifiers.control_key() && matches!(code, KeyCode::KeyQ | KeyCode::KeyW) {
                event_loop.exit();
            }
            // What was held before is let go of unseen.
            if !is_down {
                self.state.keys.press(code, false);
            }
            return;
        }
        if !self.state.keys.press(code, is_down) && is_down {
            match code {
                KeyCode::Digit1 => self.navigator.set_mode(Mode::Walk),
                KeyCode::Digit2 => self.navigator.set_mode(Mode::Fly),
                KeyCode::Digit3 => self.navigator.set_mode(Mode::Orbit),
                KeyCode::Minus => self.navigator.set_vfov(self.navigator.vfov_deg() + 5.0),
                KeyCode::Equal => self.navigator.set_vfov(self.navigator.vfov_deg() - 5.0),
                _ => {}
            }
        }
    }

    fn button(&mut self, button: MouseButton, is_down: bool) {
        if is_down {
            let pivot = if self.navigator.mode() == Mode::Walk { None } else { self.pointed_at() };
            self.navigator.begin_drag(pivot);
            self.state.pointer.drags = Some(button);
        } else if self.state.pointer.drags == Some(button) {
            self.state.pointer.drags = None;
        }
    }

    fn pointer(&mut self, to: PhysicalPosition<f64>) {
        let from = std::mem::replace(&mut self.state.pointer.at, to);
        let (Some(button), Some(shown)) = (self.state.pointer.drags, &self.state.shown) else { return };
        let scale = shown.window.scale_factor();
        let is_pan = button != MouseButton::Left || self.state.modifiers.shift_key();
        let drag = Drag { right: (to.x - from.x) / scale, down: (to.y - from.y) / scale, is_pan };
        self.navigator.drag(drag, f64::from(shown.size.height) / scale);
    }

    fn wheel(&mut self, delta: MouseScrollDelta) {
        let steps = match delta {
            MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
            // A touchpad: as far as a wheel turns the page by a step.
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / 50.0,
        };
        if self.navigator.mode() == Mode::Orbit {
            let pivot = self.pointed_at();
            self.navigator.begin_drag(pivot);
        }
        self.navigator.wheel(steps);
    }

    /// Ends with an error, if there is one.
    fn guard<T>(&mut self, event_loop: &ActiveEventLoop, done: Result<T, WindowError>) -> Option<T> {
        match done {
            Ok(done) => Some(done),
            Err(error) => {
                self.state.failure = Some(error);
                event_loop.exit();
                None
            }
        }
    }

    fn redraw(&self) {
        if let Some(shown) = self.state.shown.as_ref().filter(|shown| !shown.is_hidden) {
            shown.window.request_redraw();
        }
    }
}

impl ApplicationHandler<News> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.state.shown.is_none() {
            let opened = self.open(event_loop);
            self.state.shown = self.guard(event_loop, opened);
        }
        self.redraw();
    }

    fn suspended(&mut self, _: &ActiveEventLoop) {
        self.state.shown = None;
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The connection to the screen goes with the event loop, and nothing of the window may outlive it.
        self.state.shown = None;
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, news: News) {
        match news {
            News::Set => self.redraw(),
            News::Close => event_loop.exit(),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::RedrawRequested => {
                let drawn = self.picture();
                if self.guard(event_loop, drawn) == Some(true) {
                    self.redraw();
                }
                let seen = self.look_back();
                self.state.report = self.guard(event_loop, seen).flatten();
                if self.state.report.is_some() {
                    event_loop.exit();
                }
                return;
            }
            WindowEvent::Occluded(is_hidden) => {
                if let Some(shown) = &mut self.state.shown {
                    shown.is_hidden = is_hidden;
                }
            }
            WindowEvent::Focused(false) => {
                self.state.keys.release();
                self.state.pointer.drags = None;
            }
            WindowEvent::ModifiersChanged(modifiers) => self.state.modifiers = modifiers.state(),
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => self.key(event_loop, &event),
            WindowEvent::MouseInput { state, button, .. } => {
                self.button(button, state == ElementState::Pressed);
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.pointer(position);
                if self.state.pointer.drags.is_none() {
                    return;
                }
            }
            WindowEvent::MouseWheel { delta, .. } => self.wheel(delta),
            WindowEvent::Resized(size) => {
                if let Some(shown) = &mut self.state.shown {
                    shown.size = size;
                }
            }
            _ => return,
        }
        self.redraw();
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(changed) = self.state.changed else {
            event_loop.set_control_flow(ControlFlow::Wait);
            return;
        };
        let rested = self.clock.elapsed().saturating_sub(changed);
        if rested < REST {
            event_loop.set_control_flow(ControlFlow::wait_duration(REST - rested));
            return;
        }
        let drawn = self.picture_finely();
        self.guard(event_loop, drawn);
        event_loop.set_control_flow(ControlFlow::Wait);
    }
}

/// The size of the picture that is culled for where one of this size is shown.
fn wider(picture: Viewport) -> Result<Viewport, SettingsError> {
    let wider = |side: u32| ((f64::from(side) * WIDER).ceil() as u32).min(65_536);
    Viewport::new(wider(picture.width()), wider(picture.height()))
}

impl From<GpuError> for WindowError {
    fn from(error: GpuError) -> Self {
        Self::Gpu(error)
    }
}
